"""Transfer: a network that learned from simulated events, tuned on few real ones, beside others that know none."""

from __future__ import annotations

from pathlib import Path

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import file_path
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.transfer.cells import Study, StudyOptions
from t2d_rt.learn.transfer.events import Events
from t2d_rt.learn.transfer.report import plot_curves, report_text
from t2d_rt.radar.synthesize import Progress

__all__ = ["Events", "StudyOptions", "run_transfer"]


def run_transfer(
    real: LabelledMaps, simulated: LabelledMaps, folder: str | Path, *, options: StudyOptions | None = None,
    sources: dict[str, str] | None = None, progress: Progress | None = None,
) -> str:  # fmt: skip
    """The study of Table IV, with its report, `report.md` and `curves.png`; a stopped run goes on in the same folder.

    real: maps of both radars of every event, as `read_real` gives them.
    simulated: maps of the same classes and axes, as `read_twins` gives them.
    sources: what the report says of the data.
    """
    target = file_path("the folder of a transfer study", folder)
    study = Study(Events.of(real), Events.of(simulated), target, options or StudyOptions())
    study.run(progress)
    text = report_text(target, sources)
    with replacing(target / "report.md", lambda: None) as new:
        new.write_text(text, encoding="utf-8")
    with replacing(target / "curves.png", lambda: None) as new:
        plot_curves(target).savefig(new, format="png", dpi=120)
    return text
