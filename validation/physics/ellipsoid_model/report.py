"""Note and charts of the section."""

from __future__ import annotations

import numpy as np

from t2d_rt.recording.compare import envelope
from validation.physics.ellipsoid_model.activities import JACKS, NEAR_PEAK_DB, Activity
from validation.physics.ellipsoid_model.spheroids import (
    ASPECTS,
    CONVERGED_RAD,
    LIMIT_DB,
    LIMIT_DEG,
    RANGES_M,
    SPHEROIDS_M,
    SWING_RAD_PER_S,
    Spheroid,
)
from validation.physics.ellipsoid_model.standing import BODY_ASPECTS, BODY_RANGE_M, SECTOR_DEG, Standing, sector_means
from validation.physics.turntable import (
    db,
)
from validation.report import new_figure, save_chart

SEGMENTS = (
    "head", "neck", "chest", "abdomen", "pelvis", "left_upper_arm", "left_forearm", "left_hand", "left_thigh", "left_shank",
    "left_foot",
)  # fmt: skip
"""That are drawn."""


def note(spheroids: list[Spheroid], standing: Standing, activities: list[Activity]) -> str:
    worst = max(np.abs(s.level_db).max() for s in spheroids)
    rows = {str(row["what"]): float(str(row["difference dB"])) for row in standing.rows}
    hidden = {a.name: a.difference_db("unhidden") for a in activities}
    cells = [a.difference_db("ellipsoid") for a in activities]
    lines = [a.torso_line_mps for a in activities]
    return (
        f"Spheroids: conductor, the long axis horizontal, turned in steps of 1 degree; facets of {CONVERGED_RAD} "
        f"rad, sum of the echoes at mid-sweep. The nearest point is right within {worst:.2f} dB; what is left is the "
        "facets' own error (at 0.01 rad one aspect of the 1086 still reads 0.15 dB) and, at 0 and 180 degrees, the "
        "shadow line's return, which all of the rim sends in phase (eq. 6 with k c for k a: 0.01 to 0.02 dB). From "
        "the centre (the paper's baseline) the range is too long by what the spheroid reaches towards the radar, so "
        f"that a limb that swings at {SWING_RAD_PER_S:g} rad/s has a speed wrong by up to "
        f"{max(s.centre_mps for s in spheroids):.1f} m/s, and the level is that of another range. Standing body: the "
        f"first frame of {JACKS}, conductor, at {BODY_RANGE_M:g} m, {BODY_ASPECTS} aspects; a segment's part of the "
        "mesh is the whole mesh's surface, fading out over one row of faces where others take over. Where they "
        "agree: speeds (torso, envelope), for both hang on the same bones, and mean levels of limbs (thigh "
        f"{rows['left_thigh']:+.1f} and {rows['right_thigh']:+.1f} dB, shank {rows['left_shank']:+.1f} dB, forearm "
        f"{rows['left_forearm']:+.1f} dB, head {rows['head']:+.1f} dB, ellipsoid less mesh). Where not: over aspect. "
        "A limb's skin is nearly straight along the bone, so the mesh returns in a sheet across the bone, 5 to 10 "
        "dB above its mean there and 20 dB below it elsewhere; an ellipsoid as long as the bone is bent all along "
        "and spreads the same power smoothly. The trunk is one tall, flat surface, cut into three ellipsoids that "
        f"are each bent in height: they return too little (abdomen {rows['abdomen']:+.1f} dB, pelvis "
        f"{rows['pelvis']:+.1f}, chest {rows['chest']:+.1f}), and so the whole body does "
        f"({rows['body, without occlusion']:+.1f} dB without occlusion, {rows['body, mesh with its shadows']:+.1f} dB "
        f"against the mesh with its shadows). Feet are no ellipsoids either ({rows['left_foot']:+.1f} dB): soles and "
        f"insteps are flat. In spectrograms the cells within {NEAR_PEAK_DB:g} dB of the peak differ by "
        f"{min(cells):.0f} to {max(cells):.0f} dB RMS, where two speckle patterns of one mean would by 7.9: "
        "seventeen lines cannot fill what a skin fills. The line of the torso, the centre of the power within 10 dB "
        f"of the strongest cell, parts by {min(lines):.2f} to {max(lines):.2f} m/s RMS from instant to instant: beside "
        "a trunk that is too weak the limbs pull the ellipsoids' line to and fro. Its median does not. Shadows: who "
        f"faces the radar occludes little of himself (walk {hidden['walk']:.1f} dB RMS, jumping jacks "
        f"{hidden['jumping jacks']:.1f}); arms and knees that swing across the body do (run {hidden['run']:.1f}, "
        f"stylised walk {hidden['stylised walk']:.1f}), and from the side one leg occludes the other (chart). The "
        "ellipsoids of one body do not occlude one another. White lines in the spectrograms: the envelope, 35 dB below "
        "the ridge."
    )


def spheroid_chart(spheroids: list[Spheroid]) -> str:
    figure, axes = new_figure(nrows=2, ncols=2, figsize=(9, 6.5), sharex=True)
    angle = np.linspace(0, 180, ASPECTS)
    for number, s in enumerate(spheroids):
        colour, style = f"C{number % len(RANGES_M)}", "-" if s.semi_axes_m == SPHEROIDS_M[0] else "--"
        for axis, values in zip(axes.ravel(), (s.level_db, s.phase_deg, s.centre_db, 1e3 * s.centre_m), strict=True):
            axis.plot(angle, values, style, color=colour, linewidth=1, label=s.name)
    for axis, limit in zip(axes[0], (LIMIT_DB, LIMIT_DEG), strict=True):
        for sign in (-1, 1):
            axis.axhline(sign * limit, color="C3", linestyle=":", linewidth=1)
        axis.set(ylim=(-1.6 * limit, 1.6 * limit))
    axes[0, 0].set(ylabel="level error [dB]", title="specular point")
    axes[0, 1].set(ylabel="phase error [deg]", title="specular point")
    axes[1, 0].set(ylabel="level error [dB]", title="from the centre (baseline)")
    axes[1, 1].set(ylabel="range too long by [mm]", title="from the centre (baseline)")
    axes[1, 1].legend(fontsize=7, loc="upper center", ncols=2)
    axes[1, 1].set(ylim=(30, 290))
    for axis in axes[1]:
        axis.set(xlabel="angle of the long axis to the line of sight [deg]", xticks=range(0, 181, 30))
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    return save_chart(figure, "ellipsoid_spheroids.png")


def segment_chart(standing: Standing) -> str:
    figure, axes = new_figure(nrows=3, ncols=4, figsize=(11, 7), sharex=True, sharey=True)
    for axis, name in zip(axes.ravel(), SEGMENTS, strict=False):
        number = standing.names.index(name)
        axis.plot(standing.angle_deg, db(standing.parts[number]), "C0-", linewidth=0.3, alpha=0.4)
        axis.plot(standing.angle_deg, db(sector_means(standing.parts[number])), "C0-", label="mesh")
        axis.plot(standing.angle_deg, db(standing.limbs[number]), "C1-", label="ellipsoid")
        axis.set(title=name.replace("_", " "), ylim=(-48, 6), xticks=range(0, 361, 90))
        axis.grid(alpha=0.3)
    axes[-1, -1].axis("off")
    axes[-1, -1].legend(*axes[0, 0].get_legend_handles_labels(), loc="center")
    figure.supxlabel("aspect [deg]: 0 front, 90 right, 180 back")
    figure.supylabel("RCS, conductor [dBsm]")
    return save_chart(figure, "ellipsoid_segments.png")


def body_chart(standing: Standing) -> str:
    figure, axis = new_figure(figsize=(7.5, 4))
    for values, colour, label in (
        (standing.mesh, "C0", "mesh with its shadows"),
        (standing.unhidden, "C2", "mesh, without occlusion"),
        (standing.ellipsoids, "C1", "17 ellipsoids"),
    ):
        axis.plot(standing.angle_deg, db(values), color=colour, linewidth=0.3, alpha=0.35)
        axis.plot(
            standing.angle_deg, db(sector_means(values)), color=colour, label=f"{label}, mean over {SECTOR_DEG} degrees"
        )
    axis.set(
        xlabel="aspect [deg]: 0 front, 90 right, 180 back", ylabel="RCS, conductor [dBsm]", xticks=range(0, 361, 45),
        ylim=(-22, 15), title="standing adult at 10 m",
    )  # fmt: skip
    axis.legend(fontsize=8, loc="lower center", ncols=2)
    axis.grid(alpha=0.3)
    return save_chart(figure, "ellipsoid_body.png")


def activity_chart(activity: Activity) -> str:
    figure, axes = new_figure(ncols=3, figsize=(11, 3.6), sharey=True)
    peak = max(image.max() for image in activity.images.values())
    titles = {"ellipsoid": "ellipsoids", "mesh": "mesh", "unhidden": "mesh, without occlusion"}
    for axis, (key, title) in zip(axes, titles.items(), strict=True):
        shown = axis.pcolormesh(
            activity.times_s, activity.speeds_mps, activity.images[key] - peak, vmin=-50, vmax=0, cmap="viridis", rasterized=True
        )  # fmt: skip
        for edge in envelope(activity.images[key], activity.speeds_mps):
            axis.plot(activity.times_s, edge, "w-", linewidth=0.6)
        axis.set(title=title, xlabel="time [s]")
    upper, lower = envelope(activity.images["mesh"], activity.speeds_mps)
    axes[0].set(ylabel="speed [m/s]", ylim=(lower.min() - 1, upper.max() + 1))
    figure.colorbar(shown, ax=axes, label="dB re peak")
    figure.suptitle(activity.name)
    return save_chart(figure, f"ellipsoid_{activity.name.replace(' ', '_')}.png")
