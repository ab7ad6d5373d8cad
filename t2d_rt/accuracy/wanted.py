"""The accuracy or the tolerance that a user asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from t2d_rt.accuracy.budget import Budget
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import as_given, check_tolerance, planned
from t2d_rt.core.checks import flag, shown
from t2d_rt.core.errors import InputError
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.types import Accuracy


@dataclass(frozen=True, slots=True)
class Wanted:
    """An accuracy, and a tolerance for which its other fields are chosen."""

    given: Accuracy
    """The fields that are set in it stay."""
    tolerance_db: float | None
    measured: bool
    """Whether the error is measured after the run."""

    @classmethod
    def of(
        cls,
        accuracy: Accuracy | Mapping[str, Any] | None,
        tolerance_db: float | None,
        measure_error: bool | None = None,
    ) -> Wanted:
        """From the options of `simulate`, checked."""
        if measure_error is not None:
            flag("measure_error", measure_error)
        if tolerance_db is not None:
            check_tolerance(tolerance_db)
        return cls(
            checked_accuracy(accuracy),
            tolerance_db,
            tolerance_db is not None if measure_error is None else measure_error,
        )


def checked_accuracy(accuracy: Accuracy | Mapping[str, Any] | None) -> Accuracy:
    """An `Accuracy`, or one of the fields given; the default one for None."""
    if accuracy is None:
        return Accuracy()
    if isinstance(accuracy, Accuracy):
        return accuracy
    if not isinstance(accuracy, Mapping):
        raise InputError(
            f"accuracy must be an Accuracy or a mapping of its fields, got {shown(accuracy)}; {{'sagitta_rad': 0.2}} is one"
        )
    return Accuracy.model_validate(accuracy)


def chosen(model: Model, wanted: Wanted) -> Plan:
    """The accuracy that keeps to the tolerance, or the one given where there is none: for all path pairs, whichever are on."""
    if wanted.tolerance_db is None:
        return Plan(Budget(as_given(model, wanted.given), wanted.given), None, wanted.given)
    return planned(model, wanted.tolerance_db, wanted.given)
