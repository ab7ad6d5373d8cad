"""`Plan`: how a recording will be modelled, as values and as a printed summary."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from t2d_rt.accuracy.budget import OCCLUSION, ErrorBudget, Omission, db, sampled
from t2d_rt.pipeline.echo_model import Model, farthest_and_fastest
from t2d_rt.types import Accuracy, Ellipsoids


@dataclass(frozen=True, slots=True, repr=False)
class Plan:
    """How a recording will be modelled to keep to a tolerance."""

    budget: ErrorBudget
    tolerance_db: float | None
    """Tolerance of the field error [dB]; None where an accuracy was given instead."""
    accuracy: Accuracy
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Predicted time of each part of `simulate`, and of the spectrogram [s]."""
    memory_bytes: float = math.nan
    """Predicted peak memory of the process beyond what it held before [bytes]."""

    @property
    def model(self) -> Model:
        """The targets and how they are modelled."""
        return self.budget.model

    @property
    def omissions(self) -> Sequence[Omission]:
        """The simplifications of the run with their predicted errors, and those that it does not make because they would cause too
        great an error."""
        return self.budget.omissions(self.accuracy)

    @property
    def error_db(self) -> float:
        """Expected field error [dB]: the sum over all that is left out."""
        return db(sum(omission.energy for omission in self.omissions if omission.taken))

    def described(self, memory_bytes: float) -> dict[str, float]:
        """Entries of the settings of a recording that needs `memory_bytes`."""
        asked = {} if self.tolerance_db is None else {"tolerance_db": self.tolerance_db}
        return asked | {"predicted_memory_gb": memory_bytes / 1e9}

    def __str__(self) -> str:
        return summary(self)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def summary(plan: Plan) -> str:
    """The plan as text: what is modelled, what is left out, and what the run takes."""
    model, accuracy = plan.model, plan.accuracy
    radar, counts = model.radar, iter(plan.budget.counts)
    asked = "no tolerance" if plan.tolerance_db is None else f"tolerance {plan.tolerance_db:g} dB"
    lines = [f"{asked}, expected error {plan.error_db:.1f} dB", "modelled:"]
    for geometry, times_s in zip(model.geometries, model.frame_times(accuracy), strict=True):
        rate_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0])
        what = (
            f"{len(geometry.semi_axes_m)} ellipsoids"
            if isinstance(geometry, Ellipsoids)
            else f"about {next(counts).at(accuracy.sagitta_scale):,.0f} facets".replace(",", " ")
        )
        lines.append(f"  {geometry.name}: {what} at {rate_hz:.0f} surface frames a second")
    pairs = model.pairs(accuracy)
    if pairs is not None:
        coarse = len(pairs.pairs) - pairs.dominant
        lines.append(f"  {len(pairs.pairs)} path pairs: {pairs.dominant} dominant, {coarse} modelled more coarsely")
    if model.method == "mesh":
        how = "not traced"
        if accuracy.occlusion:
            how = sampled(accuracy.visibility_rate_hz, accuracy.visibility_subdivision)
        lines.append(f"  {OCCLUSION}: {how}")
    fastest = max(farthest_and_fastest(geometry, radar, model.span_s)[1] for geometry in model.geometries)
    needed_hz, sent_hz = (4 * speed / radar.wavelength_m for speed in (fastest, radar.max_speed_mps))
    lines.append(
        f"  slow time: speeds up to {fastest:.1f} m/s need {needed_hz:.0f} chirps a second, the radar sends {sent_hz:.0f}"
    )
    lines.append("left out, and what that costs:")
    lines += [
        f"  {omission.error_db:6.1f} dB  {omission.what}"
        for omission in plan.omissions
        if omission.taken and math.isfinite(omission.error_db)
    ]
    avoided = [omission for omission in plan.omissions if not omission.taken and math.isfinite(omission.error_db)]
    if avoided:
        lines += [
            "not left out, for it would cost:",
            *(f"  {omission.error_db:6.1f} dB  {omission.what}" for omission in avoided),
        ]
    if plan.seconds:
        parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in plan.seconds.items())
        total = sum(plan.seconds.values())
        lines.append(f"predicted: {total:.1f} s once kernels are compiled ({parts}), {plan.memory_bytes / 1e9:.1f} GB")
    return "\n".join(lines)
