"""Note and charts of the section."""

from __future__ import annotations

import math

import numpy as np

from validation.physics import exact
from validation.physics.canonical.pattern import (
    BODY_KA,
    FACET_KA,
    FAR_M,
    KA,
    LIMIT_DB,
    NEAR_AXIS_DEG,
    NEAR_M,
    ORIENTATIONS,
    RANGE_M,
    SHOWN_DB,
    Pattern,
)
from validation.physics.turntable import db
from validation.report import new_figure, save_chart


def note(valid: dict[float, float], width: dict[bool, float], corners: list[Pattern], near: Pattern) -> str:
    missing = ", ".join(f"{p.missing_db:.0f} dB ({p.title})" for p in corners)
    return (
        f"Physical optics stays within 1 dB of the Mie series from ka = {valid[1.0]:.1f} on and within {LIMIT_DB} dB "
        f"from {valid[LIMIT_DB]:.1f}; what is left is the return of the shadow line, which a perfect conductor does "
        f"not have so sharply, and the wave that creeps round. For an endless cylinder it is ka = {width[True]:.1f} "
        f"with the field along the axis and {width[False]:.1f} across. At 77 GHz a body's wrists have ka = "
        f"{BODY_KA[0]} and its chest {BODY_KA[1]}; fingers of 7 mm radius 11. Spheres of facets: default fineness, "
        f"sum of the echoes at mid-sweep, radii of 0.06 mm to 0.3 m at {RANGE_M:g} m, each in a random orientation. "
        "Along an axis of symmetry of a regular mesh the facets' lattice can return lobes that add up, up to 0.5 dB "
        "(table); the float64 sum of the same facets agrees, so it is the mesh's shape and not arithmetic; a body's "
        f"mesh has no such axis. Patterns at {FAR_M / 1e3:g} km: the plate against 4 pi A^2/lambda^2 cos^2 sinc^2, "
        "the cylinder against the exact integral over its side (2 pi a L^2/lambda broadside) and the end that is "
        f"lit. At {NEAR_M:g} m the plate is many facets, whose lattice returns lobes 50 dB below the peak: side "
        f"lobes 28 to 30 dB below it are off by up to {near.worst_to(SHOWN_DB):.1f} dB. Read from the ADC cube: "
        "`simulate` at default settings, `table2-long`. Corners: a mesh returns one bounce. Within "
        f"{NEAR_AXIS_DEG:g} degrees of the axis it lacks {missing} of the closed forms 8 pi a^4/lambda^2, 12 pi "
        "a^4/lambda^2 and 4 pi a^4/(3 lambda^2), or more; what it does return is the single plates' side lobes, "
        "exactly. Multiple bounces inside a target are not modelled: armpits, the crook of an arm and legs side by "
        "side return too little where they form corners. A room's walls are mirrors and do bounce: a corner of two "
        "or three of them returns pi R^2 as image theory asks. Sources: Bohren and Huffman, chapter 4; Bowman, "
        "Senior, Uslenghi, chapters 2 and 10; Knott, Shaeffer, Tuley, chapter 6; Kerr, Propagation of Short Radio "
        "Waves, on corner reflectors."
    )


def ka_chart(mie: np.ndarray, optics_error: np.ndarray, facets: np.ndarray, facet_error: np.ndarray) -> str:
    figure, (level, error) = new_figure(nrows=2, sharex=True, figsize=(7, 6.5))
    level.semilogx(KA, db(mie), "k-", linewidth=1, label="Mie, exact")
    level.semilogx(KA, db(exact.sphere_optics(KA)), "C0-", linewidth=1, alpha=0.8, label="physical optics, exact")
    level.semilogx(
        FACET_KA, db(facets.mean(axis=1)), "C1o", markersize=4, label=f"facets, mean of {ORIENTATIONS} sides"
    )
    level.set(ylabel=r"$\sigma / \pi a^2$ [dB]", ylim=(-32, 8), title="perfectly conducting sphere")
    level.legend(loc="lower right")
    error.loglog(KA, np.abs(optics_error), "C0-", linewidth=0.8, label="physical optics against Mie")
    error.loglog(
        FACET_KA,
        np.abs(facet_error).max(axis=1),
        "C1o",
        markersize=4,
        label="facets against physical optics, worst side",
    )
    for limit in (1.0, LIMIT_DB):
        error.axhline(limit, color="C3", linestyle=":", linewidth=1)
    error.axvspan(*BODY_KA, color="C2", alpha=0.12)
    error.text(
        math.sqrt(BODY_KA[0] * BODY_KA[1]), 14, "wrist to chest\nat 77 GHz", ha="center", va="center", fontsize=8
    )
    error.set(xlabel="ka", ylabel="|error| [dB]", ylim=(2e-5, 40))
    error.legend(loc="lower left", fontsize=8)
    for axis in (level, error):
        axis.grid(alpha=0.3, which="both", linewidth=0.5)
    return save_chart(figure, "canonical_sphere.png")


def width_chart(error: dict[bool, np.ndarray]) -> str:
    figure, axis = new_figure(figsize=(6.5, 3.6))
    for along, label in ((True, "field along the axis"), (False, "field across")):
        axis.loglog(KA, np.abs(error[along]), linewidth=0.8, label=label)
    axis.axhline(LIMIT_DB, color="C3", linestyle=":", linewidth=1)
    axis.set(
        xlabel="ka",
        ylabel="|error of physical optics| [dB]",
        ylim=(1e-3, 40),
        title="endless conducting cylinder, broadside",
    )
    axis.legend()
    axis.grid(alpha=0.3, which="both", linewidth=0.5)
    return save_chart(figure, "canonical_cylinder_ka.png")


def pattern_chart(*patterns: Pattern) -> str:
    figure, axes = new_figure(nrows=len(patterns), figsize=(7, 8.5))
    for axis, p in zip(axes, patterns, strict=True):
        axis.plot(p.angle_deg, db(p.optics), "k-", linewidth=1.6, alpha=0.5, label="exact integral")
        axis.plot(p.angle_deg, db(p.facets), "C1-", linewidth=0.6, label="facets, default")
        top = float(db(p.optics.max()))
        axis.set(ylim=(top - 55, top + 6), ylabel="RCS [dBsm]", title=p.name, xlim=(p.angle_deg[0], p.angle_deg[-1]))
        axis.grid(alpha=0.3)
        axis.legend(loc="upper center" if axis is axes[-1] else "upper right", fontsize=8)
    for axis in axes[:2]:
        axis.set_xlabel("off the normal [deg]")
    axes[-1].set_xlabel("off broadside [deg]: 90 sees the end")
    return save_chart(figure, "canonical_patterns.png")


def corner_chart(patterns: list[Pattern]) -> str:
    figure, axes = new_figure(ncols=len(patterns), figsize=(11, 3.8), sharey=True)
    for axis, p in zip(axes, patterns, strict=True):
        axis.plot(p.angle_deg, db(p.facets), "C1-", linewidth=0.6, label="facets: one bounce")
        truth = p.truth
        many = np.count_nonzero(truth) > 1
        kept = truth > 0
        axis.plot(
            p.angle_deg[kept],
            db(truth[kept]),
            "k-" if many else "k*",
            label="all bounces, closed form" + ("" if many else " (axis)"),
        )
        axis.set(title=p.title, xlabel="off the axis [deg]", ylim=(-80, 30))
        axis.grid(alpha=0.3)
        axis.legend(
            fontsize=7, **({"loc": "lower center"} if many else {"loc": "center", "bbox_to_anchor": (0.5, 0.65)})
        )
    axes[0].set_ylabel("RCS [dBsm]")
    return save_chart(figure, "canonical_corners.png")
