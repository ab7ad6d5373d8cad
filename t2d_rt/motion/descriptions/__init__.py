"""Descriptions of activities: slots, a grammar that writes them, a parser that reads them, a language model for more."""
