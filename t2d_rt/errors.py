"""What goes wrong in a user's hands: one sentence with what was given, what was expected and what to do."""

from __future__ import annotations


class T2DError(Exception):
    """Base of every error that t2d-rt raises on purpose; the command line prints it in one line and exits with 2."""


class InputError(T2DError, ValueError):
    """A value, file or option that cannot be used."""


class BackendError(T2DError, RuntimeError):
    """The computing backend (LLVM, CUDA) is missing or unusable."""


class T2DWarning(UserWarning):
    """Something the user should know although the run goes on."""
