"""Memory: what runs take is bounded, told beforehand and given back, and the bounds do not change what is computed."""

import os
import subprocess
import sys
import tracemalloc
import warnings
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ball
from measures import nmse_db
from t2d_rt.core import factored_cubes as products
from t2d_rt.core import memory
from t2d_rt.core.backend import ALIGNMENT, select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.experiment.setup import check_outside
from t2d_rt.pipeline.echo_model import farthest_and_fastest
from t2d_rt.propagation.edges import Edges
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.radar import delay_bins
from t2d_rt.radar import synthesize as synthesis
from t2d_rt.scattering import mesh as echo_mesh
from t2d_rt.scattering import streams as echo_streams
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scattering.rate import SurfaceRate
from t2d_rt.types import Echoes
from t2d_rt.types.scatterer import Scatterer

LOOP = import_module("t2d_rt.simulate")
"""The module, whose name in the package is that of its function."""
RADAR = t2d.Radar.preset("table2-uniform")
ROUGH = t2d.Material(name="rough", relative_permittivity=6.6, conductivity_s_per_m=36.0, scattering_coefficient=0.4)


def approaching(level: int = 3, frames: int = 8, speed_mps: float = 1.0) -> t2d.MovingMesh:
    """A sphere of 15 cm that comes from 3 m."""
    return ball((3.0, 0.2, 1.0), (-speed_mps, 0, 0), 0.3, radius_m=0.15, level=level, frames=frames)


@pytest.mark.parametrize("memory_gb", [0, -1, 0.5, float("nan"), float("inf"), "2", None, True])
def test_a_limit_that_is_none(memory_gb: object) -> None:
    with pytest.raises(t2d.InputError, match=r"memory_gb must .*got"):
        t2d.simulate(approaching(), radar=RADAR, memory_gb=memory_gb)


def test_unused_memory_is_given_back_where_the_process_holds_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it held before a run counts as well."""
    given: list[int] = []
    monkeypatch.setattr(memory, "release", lambda: given.append(1))
    for held, expected in ((1.3e9, 0), (1.5e9, 1)):
        monkeypatch.setattr(memory, "resident_bytes", lambda held=held: int(held))
        memory.MemoryLimit(limit_bytes=2e9, held_bytes=1.2e9).release()
        assert len(given) == expected
    memory.release_above(1.6e9)
    memory.release_above(1.4e9)
    assert len(given) == 2


def test_the_last_used_are_kept_whatever_threads_do() -> None:
    kept, made = memory.LastUsed[int](3), []

    def value(key: int) -> int:
        return kept.get(key, lambda: made.append(key) or 10 * key)

    assert [value(key) for key in (1, 2, 3, 1, 4, 1, 2)] == [10, 20, 30, 10, 40, 10, 20]
    assert made == [1, 2, 3, 4, 2]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(value, [key % 7 for key in range(2000)])) == [10 * (key % 7) for key in range(2000)]


def test_memory_is_reused_once_no_view_of_it_is_left() -> None:
    memory.release()
    first = memory.reused(1000)
    place, part = first.ctypes.data, first[10:20].reshape(2, 5)
    del first
    other = memory.reused(1000)
    assert other.ctypes.data != place, "a view still reads it"
    del part
    assert memory.reused(960).ctypes.data == place
    left = [each.ctypes.data for each in memory._left.values()]
    assert memory.reused(800).ctypes.data not in left, "memory that is far larger would be held for nothing"
    memory.release()
    assert not memory._left


def test_what_is_kept_for_later_arrays_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "LEFT_BYTES", 5000)
    memory.release()
    held = [memory.reused(size) for size in (1000, 1100, 2000, 3000)]
    del held
    assert 0 < sum(each.size for each in memory._left.values()) <= 5000
    memory.release()
    small, large = (memory.reused_empty((count, 3), np.complex64) for count in (10, memory.REUSED_BYTES // 24 + 1))
    assert (small.shape, large.dtype, len(memory._left)) == ((10, 3), np.complex64, 0)
    monkeypatch.undo()
    place = large.ctypes.data
    del small, large
    again = memory.reused_empty((memory.REUSED_BYTES // 40 + 1, 5), np.float64)
    assert again.ctypes.data == place
    memory.release()


@pytest.mark.parametrize("multiplexing", ["tdm", "ddm"])
@pytest.mark.parametrize("number", [3, 3000])
def test_a_cube_holds_nothing_of_an_earlier_one(multiplexing: str, number: int) -> None:
    """Chirps in which no echo is lit among them, of few echoes and of many."""
    radar = t2d.Radar.preset("array-3x4").replace(multiplexing=multiplexing)
    times_s = np.arange(41) * 2e-3
    lit = np.where((times_s > 0.02) & (times_s < 0.06), 0, 1e-6)[:, None] * np.ones(number)
    delay_s = (2 * (3 + np.linspace(0, 1, number)) + 0.1 * times_s[:, None]) / SPEED_OF_LIGHT
    echoes = Echoes(times_s=times_s, delay_s=delay_s, amplitude=lit.astype(np.complex64))

    memory.release()
    expected = np.array(synthesis.synthesize(echoes, radar))
    assert not expected[len(expected) // 2].any()
    assert expected[0].any()
    poisoned = memory.reused(expected.nbytes + ALIGNMENT)
    poisoned[:] = 255  # not a number in every sample
    first, beyond = poisoned.ctypes.data, poisoned.ctypes.data + len(poisoned)
    del poisoned
    found = synthesis.synthesize(echoes, radar)
    assert first <= found.ctypes.data < beyond, "the cube took it"
    assert np.array_equal(found, expected)


@pytest.mark.slow
def test_parts_of_the_echoes_sum_to_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = t2d.simulate([approaching(2), approaching(2)], radar=RADAR, scene="empty_room", reflections=1).cube
    monkeypatch.setattr(echo_streams, "MOST_ECHOES", 3_000)
    calls = []
    every = LOOP.blocks_of_echoes
    monkeypatch.setattr(LOOP, "blocks_of_echoes", lambda part: calls.append(part.echoes) or every(part))
    parts = t2d.simulate([approaching(2), approaching(2)], radar=RADAR, scene="empty_room", reflections=1).cube
    assert len(calls) > 3
    assert max(calls) <= 3_000
    # Other groups, so that the difference is that of two sums of -50 dB at most.
    assert nmse_db(parts, whole) < -50


@pytest.mark.slow
def test_a_view_of_many_echoes_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    def stream() -> Scatterer:
        return echo_mesh.mesh_echoes(
            approaching(4), RADAR, times_s=np.linspace(0, 0.3, 20), material=ROUGH,
            detail=echo_mesh.Detail(sagitta_rad=0.07, points=500), seed=0,
            views=[PathVisibility()], backend=select("auto"),
        )  # fmt: skip

    whole = stream()
    monkeypatch.setattr(echo_streams, "MOST_ECHOES", whole.echoes // 3)
    cut = stream()
    assert len(cut.parts) in (3, 4)
    assert [part.echoes for part in cut.parts] == [part.frames(0, 3).delay_s.shape[1] for part in cut.parts]
    for found, expected in zip(cut.frames(0, 3), whole.frames(0, 3), strict=True):
        assert (found is None and expected is None) or np.array_equal(found, expected)


def test_the_limit_does_not_change_the_result() -> None:
    few, many = (t2d.simulate(approaching(), radar=RADAR, memory_gb=limit).cube for limit in (1.0, 100.0))
    assert np.array_equal(few, many)


def test_what_takes_more_is_refused_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.accuracy.cost.SUMMED_BYTES", 1e7)
    monkeypatch.setattr(LOOP, "Synthesis", lambda *_, **__: pytest.fail("it began"))
    with pytest.raises(t2d.InputError, match=r"takes about [\d.]+ GB of memory, more than the limit of 2 GB; ask for"):
        t2d.simulate(approaching(), radar=RADAR)
    with pytest.raises(t2d.InputError, match=r"raise memory_gb"):
        t2d.plan(approaching(), radar=RADAR)


def test_a_mesh_of_too_many_faces_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.experiment.setup.REFINING_BYTES", 2e6)
    with pytest.raises(t2d.InputError, match=r"ball of 1280 faces takes about 2.6 GB of memory.*fewer triangles"):
        t2d.simulate(approaching(), radar=RADAR)


def test_a_plan_tells_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a sphere at rest only the cube grows with the record, by 8 bytes a sample."""
    monkeypatch.setattr(memory, "resident_bytes", lambda: 0)
    plans = [t2d.plan(ball((3, 0, 1), time_s=each), radar=RADAR, tolerance_db=-15) for each in (0.1, 1.0)]
    more = len(RADAR.chirp_times_s(1.0)) - len(RADAR.chirp_times_s(0.1))
    assert plans[1].memory_bytes - plans[0].memory_bytes == 8 * RADAR.samples * more
    assert f"{plans[1].memory_bytes / 1e9:.1f} GB" in str(plans[1])


@pytest.mark.slow
def test_instants_of_large_meshes_come_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    surface = approaching(5)
    expected = farthest_and_fastest(surface, RADAR, (0.0, 0.3)), SurfaceRate(surface, RADAR, (0.0, 0.3)).needed_hz()
    monkeypatch.setattr(memory, "BLOCK_BYTES", 2**21)
    tracemalloc.start()
    found = farthest_and_fastest(surface, RADAR, (0.0, 0.3))
    check_outside(surface, RADAR, np.array([0.0, 0.3]))
    rate = SurfaceRate(surface, RADAR, (0.0, 0.3)).needed_hz()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found == expected[0]
    assert rate == pytest.approx(expected[1], rel=1e-9)
    # All 200 instants of 10 242 vertices at once are 49 MB, and several such arrays.
    assert peak < 40 * 2**20


def test_frames_of_large_meshes_come_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = t2d.simulate(approaching(), radar=RADAR).cube
    monkeypatch.setattr("t2d_rt.radar.windows.READ_VERTEX_FRAMES", 20_000)
    assert np.array_equal(t2d.simulate(approaching(), radar=RADAR).cube, whole)


def test_a_very_wide_sweep_is_summed_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = t2d.simulate(approaching(), radar=RADAR).cube
    monkeypatch.setattr(products, "BASIS_NUMBERS", 20_000)
    monkeypatch.setattr(synthesis, "MOST_INSTANTS", 50)
    in_pieces = t2d.simulate(approaching(), radar=RADAR).cube
    # Some BLAS add up the products of fewer rows in another order.
    assert np.abs(in_pieces - whole).max() < 1e-6 * np.abs(whole).max()


@pytest.mark.filterwarnings("ignore::t2d_rt.T2DWarning")
def test_slots_without_a_chirp_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    radar = t2d.Radar(carrier_hz=77e9, slope_hz_per_s=400e12, samples=64, sample_rate_hz=1e6, prf_hz=100.0)
    moving = approaching(1, 4, 3.0)
    left_out = t2d.simulate(moving, radar=radar).cube
    monkeypatch.setattr(delay_bins, "MANY_SLOTS", 1_000)
    assert np.array_equal(t2d.simulate(moving, radar=radar).cube, left_out)


@pytest.mark.slow
def test_long_sweeps_keep_to_the_memory() -> None:
    # Range bins of 1.4 mm; samples of all buckets at once took 9.6 GB.
    radar = t2d.Radar(
        carrier_hz=77e9, slope_hz_per_s=111e12, samples=16_384, sample_rate_hz=16.384e6, prf_hz=40.0
    )  # fmt: skip
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", t2d.T2DWarning)
        t2d.simulate(approaching(1, 4), radar=radar)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 400e6


def test_rays_where_two_mirrors_meet() -> None:
    """A path over two mirrors whose seam it touches has a part of no length."""
    scene = t2d.load_scene("empty_room")
    backend = select("auto")
    mirrors = Mirrors.of(scene, backend)
    edges = Edges.of(mirrors, RADAR.wavelength_m)
    floor, wall = (next(n for n, each in enumerate(mirrors.parts) if abs(each.normal[axis]) > 0.9) for axis in (2, 1))
    normal = [mirrors.parts[n].normal for n in (floor, wall)]
    seam = np.linalg.lstsq(np.array(normal), [mirrors.parts[n].offset_m for n in (floor, wall)], rcond=None)[0]
    seam = seam + [1.5, 0, 0]
    antenna, point = np.array([0.0, 0, 1]), np.array([3.0, 0, 1])
    stops = np.array([[antenna], [seam], [seam], [point]], np.float32)
    near = np.ones((3 * 2, 1), bool)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fraction = edges._free_rays(
            stops, near, np.ones((2, 1), bool), np.array([[0.1, 0.1], [-0.1, 0.1]], np.float32),
            np.array([[floor], [wall]]),
        )  # fmt: skip
    assert np.isfinite(fraction).all()


def test_freed_memory_is_kept_where_dask_says_otherwise() -> None:
    """Pages asked of the system by arrays that come and go: with the variable of dask's workers hardly more than without."""
    code = (
        "import resource, sys, numpy as np; from t2d_rt.core.memory import keep_freed\n"
        "if 'kept' in sys.argv: keep_freed()\n"
        "for _ in range(200): np.ones(2**18)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)"
    )

    def pages(*words: str, **variables: str) -> int:
        run = subprocess.run(
            [sys.executable, "-c", code, *words], env={**os.environ, **variables}, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        return int(run.stdout)

    trimmed = {"MALLOC_TRIM_THRESHOLD_": "65536"}
    assert pages(**trimmed) > 100_000
    assert pages("kept", **trimmed) < 60_000
