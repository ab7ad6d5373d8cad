"""Guards of `Echoes`, `EchoStream` and `MovingMesh`, and what a mesh is between its frames."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import trimesh

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.scattering.streams import Resampled
from t2d_rt.types import PEC, EchoArrays, Echoes, EchoStream, Material, MovingMesh, stream

TIMES_S = np.arange(5) / 100
BOX = trimesh.creation.box((0.2, 0.3, 0.4))
CORNERS, FACES = np.array(BOX.vertices), np.array(BOX.faces)


def echoes(**change: object) -> Echoes:
    fields = {"times_s": TIMES_S, "delay_s": np.full((5, 2), 1e-8), "amplitude": np.ones((5, 2), np.complex64)}
    return Echoes(**{**fields, **change})  # type: ignore[arg-type]


# --- Echoes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"delay_s": np.zeros((4, 2))}, r"delay_s must have shape \(5, scatterer\), got \(4, 2\)"),
        ({"delay_s": np.zeros(5)}, r"delay_s must have shape \(5, scatterer\), got \(5,\)"),
        ({"amplitude": np.zeros((5, 3))}, r"amplitude must have the delay's shape \(5, 2\), got \(5, 3\)"),
        ({"slope": np.zeros((2, 5))}, r"slope must have the delay's shape \(5, 2\), got \(2, 5\)"),
        ({"times_s": np.array([0, 1, 2, 3, 5.0])}, "times_s must be uniform and increasing"),
        ({"times_s": TIMES_S[::-1]}, "times_s must be uniform and increasing"),
        ({"times_s": np.zeros(5)}, "times_s must be uniform and increasing"),
        ({"times_s": np.array([0, 1, 2, 3, math.nan])}, "times_s of echoes must be finite"),
        ({"delay_s": np.full((5, 2), math.inf)}, "delay_s of echoes must be finite"),
        (
            {"times_s": TIMES_S[:3], "delay_s": np.zeros((3, 2)), "amplitude": np.zeros((3, 2))},
            "echoes need at least 4 frames to interpolate, got 3; raise the surface rate",
        ),
    ],
)
def test_echoes_that_do_not_fit_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        echoes(**change)


def test_echoes_are_frozen_and_know_their_rate() -> None:
    made = echoes()
    assert made.rate_hz == pytest.approx(100)
    with pytest.raises(AttributeError):
        made.slope = None  # type: ignore[misc]


def test_a_stream_gives_the_same_frames() -> None:
    for slope in (None, np.full((5, 2), 2j)):
        made = echoes(delay_s=np.arange(10.0).reshape(5, 2), slope=slope)
        source = stream(made)
        assert stream(source) is source
        delay, amplitude, slopes, *_ = source.frames(1, 3)
        assert np.array_equal(delay, made.delay_s[1:3])
        assert amplitude.shape == (2, 2)
        assert slopes is None if slope is None else np.array_equal(slopes, slope[1:3])
        gathered = source.gather()
        assert np.array_equal(gathered.delay_s, made.delay_s)
        assert (gathered.slope is None) == (slope is None)


def test_a_resampled_scatterer_follows_cubics_however_it_is_asked_for() -> None:
    times, other = np.linspace(0, 1, 14), np.linspace(0, 1, 31)

    def cubic(t: np.ndarray) -> np.ndarray:
        return np.stack([t**3 - t, np.ones_like(t), 0 * t], axis=1)

    def frames(start: int, stop: int) -> EchoArrays:
        here = cubic(times[start:stop])
        stands = np.repeat(here[..., None], 3, axis=2)
        return EchoArrays(here, here.astype(np.complex64), None, stands)

    found = Resampled.of(EchoStream(times_s=times, frames=frames), other)
    whole, parts = found.frames(0, 31), [found.frames(*some) for some in ((0, 3), (3, 4), (4, 20), (20, 31))]
    np.testing.assert_allclose(whole.delay_s, cubic(other), atol=1e-12)
    np.testing.assert_allclose(whole.amplitude, cubic(other), atol=1e-6)
    assert not whole.amplitude[:, 2].any()
    assert whole.slope is None
    assert whole.arrival_m is None
    for name in ("delay_s", "amplitude", "departure_m"):
        np.testing.assert_allclose(
            np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name), atol=1e-6
        )


def test_a_stream_of_too_few_frames_cannot_be_gathered() -> None:
    short = EchoStream(times_s=TIMES_S[:2], frames=lambda a, b: EchoArrays(np.zeros((2, 1)), np.zeros((2, 1))))
    with pytest.raises(InputError, match="at least 4 frames"):
        short.gather()


# --- MovingMesh -----------------------------------------------------------------------------------------------------


def moved(
    vertices: np.ndarray = CORNERS, faces: np.ndarray = FACES, times_s: object = (0, 1), **options: object
) -> MovingMesh:
    return MovingMesh(np.stack([vertices, vertices]), faces, times_s, PEC, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (np.zeros((0, 3), int), r"faces of mesh must have shape \(face, 3\) with at least one face, got \(0, 3\)"),
        (FACES[:, :2], r"faces of mesh must have shape \(face, 3\) with at least one face, got \(12, 2\)"),
        (FACES.ravel(), r"faces of mesh must have shape \(face, 3\) with at least one face, got \(36,\)"),
        (FACES.astype(float), "faces of mesh must be integers, got float64"),
        (FACES + 1, r"faces of mesh must name vertices 0\.\.7, got 1\.\.8"),
        (FACES - 1, r"faces of mesh must name vertices 0\.\.7, got -1\.\.6"),
        (FACES[(FACES != 5).all(axis=1)], "1 of 8 vertices of mesh belong to no face; remove them"),
    ],
)
def test_faces_that_do_not_fit_are_refused(faces: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        moved(faces=faces)


@pytest.mark.parametrize(
    ("times_s", "message"),
    [
        ([0.0], r"times_s must hold at least 2 times, got shape \(1,\); a static target needs two equal frames"),
        ([[0.0, 1.0]], r"times_s must hold at least 2 times, got shape \(1, 2\)"),
        *((times, "times_s must be finite and increasing") for times in ([1.0, 0.0], [1.0, 1.0], [0.0, math.inf], [0.0, math.nan])),
    ],
)  # fmt: skip
def test_times_that_do_not_fit_are_refused(times_s: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        moved(times_s=times_s)
    with pytest.raises(InputError, match=message):
        MovingMesh.from_track(lambda t: np.repeat(CORNERS[None], len(t), axis=0), FACES, times_s)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        *(
            (np.zeros(shape), r"vertices must have shape \(2, vertex, 3\), got")
            for shape in ((8, 3), (2, 8, 2), (3, 8, 3))
        ),
        *(
            (np.stack([CORNERS + [[x, 0, 0]], CORNERS]), "vertices of mesh must be finite")
            for x in (math.nan, math.inf)
        ),
    ],
)
def test_vertices_that_do_not_fit_are_refused(vertices: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MovingMesh(vertices, FACES, np.array([0.0, 1.0]))


def test_an_open_mesh_is_taken_with_a_warning() -> None:
    with pytest.warns(T2DWarning, match=r"crate is not watertight \(4 of 17 edges do not join two faces\)"):
        open_mesh = moved(faces=FACES[:10], name="crate")
    assert open_mesh.faces.shape == (10, 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        moved()


def test_times_outside_the_record_are_refused() -> None:
    mesh = moved(name="crate")
    for asked in (-0.01, 1.01):
        with pytest.raises(InputError, match=r"crate is known from 0 s to 1 s, asked for .*; give a longer motion"):
            mesh.at(np.array([0.5, asked]))
    assert mesh.at(np.array([])).shape == (0, 8, 3)
    assert mesh.at(np.array([1 + 1e-12])).shape == (1, 8, 3)


def test_between_the_frames_a_mesh_moves_on_a_cubic_spline() -> None:
    times_s = np.array([0, 0.1, 0.25, 0.3, 0.6])
    path = np.stack([times_s**3, 1 - times_s, 2 * times_s**2], axis=1)
    mesh = MovingMesh(CORNERS + path[:, None], FACES, times_s)
    asked = np.linspace(0, 0.6, 13)
    expected = CORNERS + np.stack([asked**3, 1 - asked, 2 * asked**2], axis=1)[:, None]
    np.testing.assert_allclose(mesh.at(asked), expected, atol=1e-12)
    np.testing.assert_allclose(mesh.vertices[2], CORNERS + path[2], atol=1e-12)
    assert mesh.duration_s == pytest.approx(0.6)
    # Two and three frames: a line and a parabola.
    for n in (2, 3):
        few = MovingMesh(CORNERS + (times_s[:n, None] ** (n - 1) * [1.0, 0, 0])[:, None], FACES, times_s[:n])
        assert few.at(np.array([0.05]))[0, 0, 0] == pytest.approx(CORNERS[0, 0] + 0.05 ** (n - 1))


def test_a_mesh_gives_a_trimesh_and_says_what_it_is() -> None:
    mesh = moved(name="crate")
    solid = mesh.trimesh(0.5)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(0.2 * 0.3 * 0.4)
    assert repr(mesh) == "MovingMesh(crate: 8 vertices, 12 faces, 1 s, pec)"


# --- Material -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"relative_permittivity": 0.5}, "material wax: relative_permittivity must be 1 or more and finite, got 0.5"),
        (
            {"relative_permittivity": math.nan},
            "material wax: relative_permittivity must be 1 or more and finite, got nan",
        ),
        ({"conductivity_s_per_m": -1.0}, "material wax: conductivity_s_per_m must be 0 or more and finite, got -1"),
        (
            {"conductivity_s_per_m": math.inf},
            "material wax: conductivity_s_per_m must be 0 or more and finite, got inf",
        ),
        ({"scattering_coefficient": 1.1}, r"material wax: scattering_coefficient must lie in 0\.\.1, got 1\.1"),
        ({"scattering_coefficient": math.nan}, r"material wax: scattering_coefficient must lie in 0\.\.1, got nan"),
    ],
)
def test_materials_that_cannot_be_are_refused(fields: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Material(name="wax", **fields)  # type: ignore[arg-type]


def test_faces_must_face_outward() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices = np.stack([ball.vertices, ball.vertices])
    with pytest.raises(InputError, match=r"ball is inside out: .* give faces\[:, ::-1\]"):
        MovingMesh(vertices, ball.faces[:, ::-1], [0, 1], name="ball")
    mixed = np.array(ball.faces)
    mixed[::2] = mixed[::2, ::-1]
    with pytest.warns(T2DWarning, match="are not all oriented alike"):
        MovingMesh(vertices, mixed, [0, 1])


def test_echoes_are_cast_to_what_synthesis_reads() -> None:
    made = Echoes(times_s=np.arange(4) / 100, delay_s=np.full((4, 1), 2e-8), amplitude=np.ones((4, 1)))
    assert made.delay_s.dtype == np.float64
    assert made.amplitude.dtype == np.complex64


@pytest.mark.parametrize("sagitta", [0.0, -0.1, np.nan, np.ones(3)])
def test_a_mesh_refuses_a_sagitta_that_is_none(sagitta: float | np.ndarray) -> None:
    vertices = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]] * 2)
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    with pytest.raises(InputError, match=r"sagitta_rad of mesh must be .*one number or one per vertex \(4,\)"):
        MovingMesh(vertices, faces, [0.0, 1.0], sagitta_rad=sagitta)
