"""Scattering models of targets and of the static scene; each makes a `Scatterer`, which returns echoes."""
