"""Paths as data: sets of unlike chains, what is evaluated of them in whole and row by row, and pickling."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from builders import ANTENNA_M, UP, icosphere, plate, small_room, static_mesh
from t2d_rt.core.backend import Backend, select
from t2d_rt.pipeline.path_pairs import probed
from t2d_rt.propagation.clutter import static_paths
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.images import existing, vertices
from t2d_rt.propagation.mean_visibility import MeanVisibility
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.paths import FoundPaths, find_paths
from t2d_rt.propagation.scene_paths import radar_paths
from t2d_rt.propagation.visibility import ExactVisibility, Occlusion
from t2d_rt.scattering.paths import ranked_pairs
from t2d_rt.types import PEC, Material, MovingMesh, OneWayPath, PathSet, Radar, RadarTrack, Scene
from t2d_rt.types.path_fields import SweepNodes, field_over, fields_over, received

FREQUENCY_HZ = 77.87e9
FREQUENCIES_HZ = FREQUENCY_HZ + 1e9 * np.array([-0.5, 0.0, 0.5])
SCREEN = Material(name="screen", relative_permittivity=2.7, conductivity_s_per_m=0.4, scattering_coefficient=0.3)


def scene() -> Scene:
    """A conducting wall to the left that ends half-way, a rough lossy floor, and a thin screen."""
    wall = plate("wall", [(-2, 2, -2), (1.9, 2, -2), (1.9, 2, 4), (-2, 2, 4)], PEC)
    floor = plate("floor", [(-2, -4, 0), (12, -4, 0), (12, 2, 0), (-2, 2, 0)], SCREEN, 0.1)
    screen = plate("screen", [(1.5, -1, 0.1), (1.5, 0.2, 0.1), (1.5, 0.2, 1.6), (1.5, -1, 1.6)], SCREEN, 0.004)
    return Scene(name="test", surfaces=(wall, floor, screen))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return np.random.default_rng(3).uniform((2.0, -1.0, 0.3), (4.0, 1.5, 1.9), (60, 3))


@pytest.fixture(scope="module")
def found(points: np.ndarray) -> FoundPaths:
    mirrors = Mirrors.of(scene(), select("cpu"))
    return find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=2, transmissions=1, probes_m=points)


def test_rows_of_unlike_length_are_padded(found: FoundPaths) -> None:
    paths = found.paths
    lengths = [len(chain) for chain in paths.chains]
    assert {0, 1, 2} <= set(lengths)
    assert paths.mask.shape == (len(paths), max(lengths))
    assert paths.mask.sum(axis=1).tolist() == lengths
    assert np.array_equal(paths.mask, np.arange(max(lengths)) < np.array(lengths)[:, None])
    for row, path in enumerate(paths):
        assert path.chain == paths.chains[row]
        assert len(path.elements.mirror) == lengths[row]
        assert path.transmissions == sum("(through)" in name for name in path.chain)
        assert path.order + path.transmissions == lengths[row]
        assert (path.delay_s > 0) == (path.transmissions > 0)
        assert np.linalg.det(path.mirror_matrix) == pytest.approx((-1) ** path.order)


def test_a_path_ends_where_its_image_says(found: FoundPaths, points: np.ndarray) -> None:
    """The straight line from the image is as long as the path over its vertices, and begins as the apparent position says."""
    for path in found.paths:
        stops = vertices(path, points)
        assert stops.shape == (len(path.chain) + 2, *points.shape)
        length = np.linalg.norm(np.diff(stops, axis=0), axis=-1).sum(axis=0)
        here = existing(found.edges.mirrors, found.paths, points)[found.paths.chains.index(path.chain)]
        apparent = path.unfolded(points) - path.antenna_m
        np.testing.assert_allclose(np.linalg.norm(points - path.image_m, axis=1)[here], length[here], rtol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(apparent, axis=1), np.linalg.norm(points - path.image_m, axis=1))
        first = (stops[1] - stops[0])[here]
        np.testing.assert_allclose(
            np.cross(first, apparent[here]), 0, atol=1e-9 * float(np.abs(apparent).max()) ** 2
        )  # parallel


def test_paths_exist_inside_outlines_where_nothing_stands_between(found: FoundPaths, points: np.ndarray) -> None:
    """Worked out anew from the plates' corners, which lie along the axes."""
    plates = [(each.vertices.min(axis=0), each.vertices.max(axis=0)) for each in scene().surfaces]
    flat = [int(np.argmin(high - low)) for low, high in plates]
    counts = np.zeros(2, int)
    for row, path in enumerate(found.paths):
        stops = vertices(path, points)
        length = np.linalg.norm(np.diff(stops, axis=0), axis=-1).sum(axis=0)
        expected = (
            np.abs(length - np.linalg.norm(points - path.image_m, axis=1)) < 1e-9
        )  # every plane is met between its neighbours
        inside, free = expected.copy(), expected.copy()
        for number, stop in zip(path.elements.mirror, stops[1:-1], strict=True):
            low, high = plates[number]
            inside &= ((stop > low - 1e-6) & (stop < high + 1e-6)).all(axis=1)
        for start, stop in pairwise(stops):
            for axis, (low, high) in zip(flat, plates, strict=True):
                before, after = start[:, axis] - low[axis], stop[:, axis] - low[axis]
                crossed = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > 1e-6)
                at = start + (before / np.where(crossed, before - after, 1))[:, None] * (stop - start)
                free &= ~(crossed & ((at > low - 1e-9) & (at < high + 1e-9)).all(axis=1))
        assert np.array_equal(found.fraction[row], inside & free), path.name
        counts += [(expected & ~inside).sum(), (inside & ~free).sum()]
    assert (counts > 20).all(), "some end beside an outline, some are blocked"


def test_a_set_is_evaluated_as_its_rows_are(found: FoundPaths, points: np.ndarray) -> None:
    paths, mirrors = found.paths, found.edges.mirrors
    whole = existing(mirrors, paths, points)
    assert np.array_equal(whole, found.fraction)
    assert not whole.all()
    assert whole.any(axis=1).all()
    for row, path in enumerate(paths):
        alone = paths.taken(np.array([row]))
        assert alone.mask.shape == (1, len(path.chain))
        assert alone[0] == path
        assert np.array_equal(existing(mirrors, alone, points)[0], whole[row])
        assert np.array_equal(
            field_over(alone[0], points, FREQUENCIES_HZ), field_over(paths[row], points, FREQUENCIES_HZ)
        )


def test_paths_of_all_orders_are_evaluated_together_as_they_are_alone(found: FoundPaths, points: np.ndarray) -> None:
    """Fields and what reaches the points, of reflections and transmissions, in any order."""
    paths = list(found.paths)[::-1]
    assert len({len(path.chain) for path in paths}) > 1
    both = fields_over(paths, points, FREQUENCIES_HZ)
    reached = found.edges.fractions(paths, points)
    for row, path in enumerate(paths):
        np.testing.assert_allclose(
            np.moveaxis(both.field[:, :, row], 0, -1), field_over(path, points, FREQUENCIES_HZ), atol=1e-12
        )
        straight = points - path.image_m
        straight /= np.linalg.norm(straight, axis=1, keepdims=True)
        np.testing.assert_allclose(both.arrival[:, row].T, straight, atol=1e-9)
        np.testing.assert_allclose(path.mirror_matrix @ straight.T, both.departure[:, row], atol=1e-9)
        np.testing.assert_allclose(reached[row], found.edges.fraction(path, points), atol=1e-6)


def test_existing_says_the_same_in_blocks(
    found: FoundPaths, points: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("t2d_rt.core.memory.BLOCK_BYTES", 3 * 24 * len(points) * (found.paths.mask.shape[1] + 2))
    assert np.array_equal(existing(found.edges.mirrors, found.paths, points), found.fraction)


def test_pickled_sets_are_equal_and_evaluate_the_same(found: FoundPaths, points: np.ndarray) -> None:
    copy: PathSet = pickle.loads(pickle.dumps(found.paths))
    assert copy == found.paths
    for path, same in zip(found.paths, copy, strict=True):
        assert path == same
        assert path.key == same.key
        for evaluate in (vertices, lambda *of: field_over(*of, FREQUENCIES_HZ), found.edges.fraction):
            assert np.array_equal(evaluate(path, points), evaluate(same, points))  # type: ignore[operator]
    assert found.paths != found.paths.taken(np.arange(1, len(found.paths)))
    assert found.paths[0] != found.paths[1]
    assert found.paths[0] != "direct"


def test_the_line_of_sight(points: np.ndarray) -> None:
    """Alone it is a set of no columns; its field is the part of the polarisation across the ray, of length one."""
    mirrors = Mirrors.of(scene(), select("cpu"))
    found = find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=0, probes_m=points)
    (path,) = found.paths
    assert found.paths.mask.shape == (1, 0)
    assert path == OneWayPath.line_of_sight(ANTENNA_M, UP)
    assert (path.name, path.order, path.transmissions, path.delay_s) == ("direct", 0, 0, 0)
    assert np.array_equal(vertices(path, points), [np.broadcast_to(ANTENNA_M, points.shape), points])
    assert np.array_equal(path.unfolded(points), points)
    ray = points - ANTENNA_M
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    expected = UP - (ray @ UP)[:, None] * ray
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(field_over(path, points, FREQUENCIES_HZ), np.tile(expected, (3, 1, 1)), atol=1e-12)
    behind = (np.abs(vertices(path, points)[1] - ANTENNA_M)[:, 0] > 1.5) & (found.fraction[0] == 0)
    assert behind.any()


def test_static_paths_pickle() -> None:
    radar = Radar.preset("table2")
    paths = static_paths(scene(), radar, order=2, backend=select("cpu"))
    assert len(paths) >= 2
    for path in paths:
        same = pickle.loads(pickle.dumps(path))
        assert same == path
        assert np.array_equal(received(same, FREQUENCIES_HZ), received(path, FREQUENCIES_HZ))


@pytest.mark.parametrize("nodes", [3, 7])
def test_a_spectrum_is_the_line_of_least_squares(nodes: int) -> None:
    """Against a fit to many samples of the sweep: the two faces of a slab, 41 mm apart."""
    radar = Radar.preset("table2")
    frequencies = np.linspace(-0.5, 0.5, 4001) * radar.bandwidth_hz
    spectrum = np.array([[0.3 + 0.1j], [0.2]])

    def faces(hz: np.ndarray) -> np.ndarray:
        return spectrum[0] - spectrum[1] * np.exp(-2j * np.pi * (hz[:, None] + 1e9) / 7.3e9)

    every = SweepNodes.of(radar, nodes)
    value, slope = every.line(faces(every.frequencies_hz - radar.mid_frequency_hz))
    whole, left_out = every.powers(faces(every.frequencies_hz - radar.mid_frequency_hz))
    samples = faces(frequencies)[:, 0]
    fit = np.polyfit(frequencies, samples, 1)
    assert value[0] == pytest.approx(fit[1], rel=1e-3)
    assert slope[0] == pytest.approx(fit[0], rel=1e-2)
    assert whole[0] == pytest.approx(np.mean(np.abs(samples) ** 2), rel=1e-3)
    assert left_out[0] == pytest.approx(np.mean(np.abs(samples - np.polyval(fit, frequencies)) ** 2), rel=0.05)


def test_pairs_over_thin_walls_say_what_a_line_leaves_out_of_their_spectra() -> None:
    """None of the straight path and of metal, some of a thin slab, and more of it over a wider sweep."""
    middle = np.array([[2.4, 0.3, 1.1]])
    slab = Material(name="slab", relative_permittivity=2.7, conductivity_s_per_m=0.05)

    def left_out_db(material: Material, band_hz: float) -> list[float]:
        radar = Radar.preset("table2")
        radar = Radar.preset("table2", slope_hz_per_s=radar.slope_hz_per_s * band_hz / radar.bandwidth_hz)
        wall = plate("wall", [(-2, 2, -2), (9, 2, -2), (9, 2, 4), (-2, 2, 4)], material, 0.0125)
        room = Scene(name="test", surfaces=(wall,))
        ends = probed(radar_paths(room, radar, middle, order=2, backend=select("cpu")), middle)
        return sorted(each.bent_db - each.mean_db for each in ranked_pairs(radar, ends, order=2))

    metal, narrow, wide = left_out_db(PEC, 4e9), left_out_db(slab, 0.2e9), left_out_db(slab, 4e9)
    assert metal[-1] < -200
    assert narrow[0] < -200
    assert narrow[-1] < wide[-1] - 12
    assert wide[-1] < -3


def test_which_ends_are_one_antenna_is_said() -> None:
    """Pairs swapped are one pair of two copies where one antenna does both, and only there, equal as the sets may be."""
    middle = np.array([[2.4, 0.3, 1.1]])
    radar = Radar.preset("table2")
    room = small_room()
    found = radar_paths(room, radar, middle, order=2, backend=select("cpu"))
    assert found.one_antenna
    ends = probed(found, middle)
    joined = ranked_pairs(radar, ends, order=2)
    apart = ranked_pairs(radar, pickle.loads(pickle.dumps(ends)), order=2)
    assert [(each.pair.name, each.pair.copies) for each in joined] == [(e.pair.name, e.pair.copies) for e in apart]
    assert {each.pair.copies for each in joined} == {1, 2}
    separate = ranked_pairs(
        radar,
        type(ends)(probes_m=middle, out=ends.out, back=ends.back, one_antenna=False, fraction=ends.fraction),
        order=2,
    )
    assert {each.pair.copies for each in separate} == {1}
    assert sum(each.pair.copies for each in joined) == len(separate)


def test_each_antenna_has_its_own_blockage() -> None:
    """One antenna behind a screen that the other's search has not seen."""
    target = np.array([[3.0, 0.0, 1.0], [3.0, 1.9, 1.0]])
    screen = plate("screen", [(1.5, -1, 0), (1.5, 0.5, 0), (1.5, 0.5, 2), (1.5, -1, 2)])
    far = plate("far", [(9, -1, 0), (9, 1, 0), (9, 1, 2), (9, -1, 2)])
    hidden, free = (
        find_paths(Mirrors.of(Scene(name="s", surfaces=surfaces), select("cpu")), place, UP, FREQUENCY_HZ, order=0, probes_m=target)
        for surfaces, place in (((screen, far), ANTENNA_M), ((far,), ANTENNA_M + [0.0, 0.1, 0.0]))
    )  # fmt: skip
    blockage = SceneBlockage({each.paths.antenna_m.tobytes(): each.edges for each in (hidden, free)})
    assert blockage.fraction(hidden.paths[0], target).tolist() == [0, 1]
    assert blockage.fraction(free.paths[0], target).tolist() == [1, 1]


def test_antennas_apart_have_paths_of_their_own() -> None:
    middle = np.array([[2.4, 0.3, 1.1], [2.6, -0.4, 0.9]])
    radar = Radar.preset("table2", rx_offsets_m=[[0.0, 0.3, 0.0]])
    found = radar_paths(scene(), radar, middle, order=1, backend=select("cpu"))
    assert not found.one_antenna
    assert set(found.blockage.edges) == {radar.tx_position_m.tobytes(), radar.rx_position_m.tobytes()}
    for end, place in ((found.out, radar.tx_position_m), (found.back, radar.rx_position_m)):
        assert all(np.array_equal(path.antenna_m, place) for path in end.paths)
        assert all(found.blockage.fraction(path, middle).max() > 0 for path in end.paths)


def test_kept_chains_are_those_of_their_own_search() -> None:
    """Of the same place, order, losses and content of the scene: what is kept for one search answers no other."""
    backend, wall = select("cpu"), plate("wall", [(-2, 2, -9), (1.9, 2, -9), (1.9, 2, -5), (-2, 2, -5)], PEC)
    mirrors = Mirrors.of(scene(), backend)
    below = Mirrors.of(Scene(name="test", surfaces=(wall, *scene().surfaces[1:])), backend)
    loss_db = np.full(len(mirrors.parts), 41.0)  # more than a ray bears
    searches: list[tuple[Mirrors, np.ndarray, int, dict[str, Any]]] = [
        (mirrors, ANTENNA_M, 1, {}), (mirrors, ANTENNA_M + [0.0, 5.0, 0.0], 1, {}), (mirrors, ANTENNA_M, 2, {}),
        (mirrors, ANTENNA_M, 0, {"transmissions": 1}), (mirrors, ANTENNA_M, 0, {"transmissions": 1, "loss_db": loss_db}),
        (below, ANTENNA_M, 2, {}),
    ]  # fmt: skip
    first, again = ([tuple(each.chains(place, n, **more)) for each, place, n, more in searches] for _ in range(2))
    assert first == again
    assert len(set(first)) == len(searches)
    mirrors.chains(ANTENNA_M, 1).clear()  # the caller's own
    assert tuple(mirrors.chains(ANTENNA_M, 1)) == first[0]


def test_paths_of_a_radar_that_moves_are_searched_along_its_track() -> None:
    radar = Radar.preset("table2", track=RadarTrack(times_s=[0, 1], positions_m=[(0, 0, 1), (1, 0, 1)]))
    with pytest.raises(ValueError, match="at sample times, got None"):
        static_paths(scene(), radar, order=1, backend=select("cpu"))
    with pytest.raises(ValueError, match="along its track, got none"):
        radar_paths(scene(), radar, np.array([[3.0, 0.0, 1.0]]), order=1, backend=select("cpu"))


# --- bodies in between ---

MIDDLE_M, RECORD_S = np.array([4.0, 0.3, 1.2]), np.array([0.0, 1.0])
EDGE_M = 5e-3
"""Rays start 2 mm towards the viewpoint and 2 mm along the normal: a shadow's edge may lie that far off."""
MIRRORED = {"wall": ([1, -1, 1], [0, 4, 0]), "right": ([1, -1, 1], [0, -8, 0])}
"""Signs and shift of a place's image in each."""


def _ball(radius_m: float, centre_m: np.ndarray, level: int = 3) -> MovingMesh:
    vertices_m, faces = icosphere(level, radius_m)
    return static_mesh(vertices_m + centre_m, faces)


def _over(chain: tuple[str, ...]) -> OneWayPath:
    """The path from `ANTENNA_M` over mirrors of a wall at y = 2 and one at the right, y = -4."""
    wall = plate("wall", [(-2, 2, -1), (12, 2, -1), (12, 2, 4), (-2, 2, 4)])
    right = plate("right", [(-2, -4, -1), (12, -4, -1), (12, -4, 4), (-2, -4, 4)])
    mirrors = Mirrors.of(Scene(name="corridor", surfaces=(wall, right)), select("cpu"))
    found = find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=2, probes_m=MIDDLE_M[None])
    (path,) = [each for each in found.paths if each.chain == chain]
    return path


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(
    ("chain", "part"), [(("wall",), 0), (("wall",), 1), *((("wall", "right"), part) for part in range(3))]
)
def test_a_body_hides_wherever_a_path_runs(backend: Backend, chain: tuple[str, ...], part: int, exact: bool) -> None:
    """As its image does on the straight line from the antenna's image: bodies are mirrored here, and not the lines."""
    path, target = _over(chain), _ball(0.4, MIDDLE_M, level=4)
    lines = vertices(path, MIDDLE_M)
    centre = lines[part] + 0.6 * (lines[part + 1] - lines[part]) + [0, 0, 0.12]
    meshes = [target, _ball(0.12, centre)]
    points, image = target.at(np.zeros(1))[0], path.image_m
    for name in chain[part:]:
        centre = MIRRORED[name][0] * centre + MIRRORED[name][1]
    ray = points - image
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    depth = 0.12 - np.linalg.norm(centre - image - (ray @ (centre - image))[:, None] * ray, axis=1)
    normals = (points - MIDDLE_M) / 0.4
    lit = np.sum(normals * -ray, axis=1) > 0.05
    if exact:
        seen = ExactVisibility(meshes, path, backend=backend, wavelength_m=None).fraction(
            np.zeros(1), points[None], target.faces
        )[0]
    else:
        view = Occlusion.alone(Occluders(meshes), path, samples_s=RECORD_S, backend=backend, wavelength_m=None)
        seen = view.visibility(np.zeros(1))[0][0]
    dark, free = lit & (depth > EDGE_M), lit & (depth < -EDGE_M)
    assert min(dark.sum(), free.sum()) > 50
    assert not seen[dark].any()
    assert (seen[free] == 1).all()


def test_what_stands_behind_a_mirror_hides_nothing_before_it(backend: Backend) -> None:
    path, target = _over(("wall",)), _ball(0.4, MIDDLE_M)
    behind = _ball(0.5, path.image_m + 0.3 * (MIDDLE_M - path.image_m))
    alone, both = (
        Occlusion.alone(Occluders(some), path, samples_s=RECORD_S, backend=backend, wavelength_m=None).visibility(
            np.zeros(1)
        )[0]
        for some in ([target], [target, behind])
    )
    assert np.array_equal(alone, both)
    assert alone.max() == 1


def test_a_fan_is_hidden_wherever_a_path_runs(backend: Backend) -> None:
    """In the mean over its points, as each of them is: a point is hidden where the ball before the wall meets its path."""
    path, fan = _over(("wall",)), _ball(0.3, MIDDLE_M)
    points, lines = fan.at(np.zeros(1))[0], vertices(path, MIDDLE_M)
    antenna, at_wall, _ = vertices(path, points)
    for aside in (0.0, 0.1, 0.2, 0.3, 1.0):
        centre = lines[0] + 0.6 * (lines[1] - lines[0]) + [0, 0, aside]
        mean = MeanVisibility(fan, Occluders([_ball(0.25, centre, level=4)]), RECORD_S, solid=True, backend=backend)
        seen = mean.over("wall", path, None, 1)(np.zeros(1))
        ahead = (at_wall - antenna) / np.linalg.norm(at_wall - antenna, axis=1, keepdims=True)
        beside = np.linalg.norm(np.cross(centre - antenna, ahead), axis=1)
        assert np.ptp(seen) == 0
        assert abs(seen.mean() - np.mean(beside > 0.25)) < 0.03, aside
