"""Descriptions of activities: slots, a grammar that writes them, a parser that reads them, a language model for more."""

from __future__ import annotations

from t2d_rt.motion.descriptions.diversity import Diversity, diversity
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.language_model import LanguageModel, TokenBudget, Written, model_descriptions
from t2d_rt.motion.descriptions.parse import Parsed, parse_description
from t2d_rt.motion.descriptions.slots import (
    ACTIVITIES,
    Activity,
    Description,
    Step,
    read_descriptions,
    write_descriptions,
)

__all__ = [
    "ACTIVITIES",
    "Activity",
    "Description",
    "Diversity",
    "LanguageModel",
    "Parsed",
    "Step",
    "TokenBudget",
    "Written",
    "diversity",
    "grammar_descriptions",
    "model_descriptions",
    "parse_description",
    "read_descriptions",
    "write_descriptions",
]
