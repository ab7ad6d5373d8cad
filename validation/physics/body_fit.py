"""The mesh's joints, regressed from rings of its surface, against the motion's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import t2d_rt as t2d
from t2d_rt.body import bodies, regressed_joints, template
from t2d_rt.core.resources import resource
from validation.bodies import RUN, WALK
from validation.report import Check, Section, new_figure, save_chart

OWN = Path(__file__).parents[1] / "motions"
RECORDINGS = {
    "12_01": resource("motions", WALK),
    "iclone_002_01": OWN / "iclone_002_01_walk.bvh.gz",
    "131_01": OWN / "131_01.bvh.gz",
    "iclone_002_03": resource("motions", RUN),
}


def run() -> Section:
    errors = {name: joint_errors(path) for name, path in RECORDINGS.items()}
    checks = []
    for body in bodies():
        for name, path in RECORDINGS.items():
            stacked = np.stack(list((errors[name] if body == "adult" else joint_errors(path, body)).values()))
            what = name if body == "adult" else f"{body}, {name}"
            checks.append(
                Check(what=f"{what}, mean over joints and frames", measured=1e3 * stacked.mean(), limit=15, unit="mm")
            )
            checks.append(Check(what=f"{what}, greatest", measured=1e3 * stacked.max(), limit=40, unit="mm"))
    joints = list(next(iter(errors.values())))
    rows = [
        {
            "joint": joint,
            **{
                f"{name} mean/max mm": f"{1e3 * e[joint].mean():.1f} / {1e3 * e[joint].max():.1f}"
                for name, e in errors.items()
            },
        }
        for joint in joints
    ]
    return Section(
        title="Body fit",
        checks=checks,
        note="Distance of hips, knees, ankles, shoulders, elbows, wrists and head, as regressed from rings of surface "
        "vertices, from the recorded joints, over all frames; the table and the picture are the adult's.",
        table=rows,
        charts=[_chart(errors)],
    )


def joint_errors(recording: Path, body: str = "adult") -> dict[str, np.ndarray]:
    """Distance [m] of each regressed joint from the recorded one, (frames,)."""
    motion = t2d.load_motion(recording)
    found = regressed_joints(template(body), t2d.skin(motion, body).at(motion.times_s))
    return {name: np.linalg.norm(place - motion.joints[:, motion.index(name)], axis=1) for name, place in found.items()}


def _chart(errors: dict[str, dict[str, np.ndarray]]) -> str:
    figure, axis = new_figure(figsize=(7.5, 4))
    joints = list(next(iter(errors.values())))
    for i, (name, each) in enumerate(errors.items()):
        axis.bar(
            np.arange(len(joints)) + 0.2 * (i - 1.5), [1e3 * each[j].mean() for j in joints], width=0.2, label=name
        )
    axis.set_xticks(range(len(joints)), [j.replace("_", " ") for j in joints], rotation=60, ha="right", fontsize=8)
    axis.set(ylabel="mean distance [mm]", title="regressed against recorded joints")
    axis.legend(fontsize=8)
    return save_chart(figure, "body_fit.png")
