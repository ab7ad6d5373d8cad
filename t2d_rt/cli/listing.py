"""`t2d-rt list`: every name that a command takes, with a line about it."""

from __future__ import annotations

from collections.abc import Iterator

KINDS = "presets", "scenes", "bodies", "movers", "motions"


def lines(kind: str) -> Iterator[str]:
    """A heading, then a line for each name."""
    found = {"presets": _presets, "scenes": _scenes, "bodies": _bodies, "movers": _movers, "motions": _motions}[kind]
    rows = list(found())
    width = max(len(name) for name, _ in rows) + 2
    yield f"{kind}:"
    for name, told in rows:
        yield f"  {name:{width}}{told}"


def _presets() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import presets
    from t2d_rt.types import Radar

    for name in presets():
        radar = Radar.preset(name)
        yield (
            name,
            (
                f"{radar.carrier_hz / 1e9:.4g} GHz, sweep {radar.bandwidth_hz / 1e9:.3g} GHz, PRF {radar.prf_hz / 1e3:.4g} kHz, "
                f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} antennas, bin {100 * radar.range_resolution_m:.3g} cm, "
                f"up to {radar.max_range_m:.3g} m, +-{radar.max_speed_mps:.3g} m/s"
            ),
        )


def _scenes() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import FREE_SPACE, scenes
    from t2d_rt.propagation.scenes import load_scene

    for name in scenes():
        if name == FREE_SPACE:
            yield name, "nothing but the targets"
            continue
        scene = load_scene(name)
        low, high = scene.bounds_m
        size = " x ".join(f"{length:.3g}" for length in high - low)
        yield name, f"{size} m, {len(scene.surfaces)} objects"


def _bodies() -> Iterator[tuple[str, str]]:
    from t2d_rt.body import ABOUT, bodies, template

    for name in bodies():
        body = template(name)
        who = ABOUT.get(name, "a body")
        yield name, f"{who}, {body.stature_m:.2f} m tall before it is fitted to a motion, {len(body.faces)} faces"


def _movers() -> Iterator[tuple[str, str]]:
    from t2d_rt.core.errors import InputError
    from t2d_rt.scene.movers import kind_named, kind_names

    for name in kind_names():
        try:
            kind = kind_named(name)
        except InputError as error:  # of one package, which hides no other
            yield name, str(error)
            continue
        told = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
        options = [field for field in kind.model_fields if field not in ("kind", "position_m")]
        yield name, f"{told} Options: {', '.join(options)}."


def _motions() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import EXAMPLES

    for name, (file, told) in EXAMPLES.items():
        yield name, f"{told}; {file}"
