"""Scattering models; each returns `Echoes`."""
