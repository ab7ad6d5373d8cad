"""Fixtures of several test files: a kernel backend, the field of a target in an ADC cube, scene files, the command line.

Those of the session run by themselves: bundled motions and parsers of commands are kept, what is kept on disk has a folder of its
own, no file waits for the disk, and Dr.Jit has one thread beside other processes of tests.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType

import numpy as np
import pytest

import t2d_rt.motion.read as motion_reader
from builders import MOTIONS, WALK, WALL
from command_line import Command, Run, listing
from t2d_rt.cli import _command, main
from t2d_rt.core.backend import Backend, select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.disk_cache import VARIABLE
from t2d_rt.motion.read.passes import Reading
from t2d_rt.types import Motion, Radar

ReadField = Callable[..., np.ndarray]
Make = Callable[..., Path]


@pytest.fixture(scope="session", autouse=True)
def disk_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The tests' own folder for what is kept on disk; all processes of a run and those that they start have it."""
    home = tmp_path_factory.getbasetemp()
    os.environ[VARIABLE] = str((home.parent if "PYTEST_XDIST_WORKER" in os.environ else home) / "cache")


@pytest.fixture(scope="session", autouse=True)
def nothing_waits_for_the_disk() -> Iterator[None]:
    """A power cut is not tested, and each of thousands of small files would wait some 10 ms to be safe from one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_many() -> None:
    """Beside other processes of tests Dr.Jit computes on one thread; `test_array_pipeline` compares one with several."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        import drjit as dr

        dr.set_thread_count(1)


@pytest.fixture(scope="session", autouse=True)
def parsers_are_kept() -> Iterator[None]:
    """To set up the options of a command takes as long as most of its refusals; a process of tests does so once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("t2d_rt.cli._command", cache(_command))
        yield


@pytest.fixture(scope="session", autouse=True)
def bundled_motions_are_read_once() -> Iterator[None]:
    """Hundreds of tests begin with the same walk, which takes a tenth of a second to read; what is made of it cannot change it."""
    read, home, as_it_is = motion_reader._read, MOTIONS, Reading()

    @cache
    def bundled(path: Path) -> Motion:
        motion = read(path, as_it_is)
        motion.joints.setflags(write=False)
        motion.rotations.setflags(write=False)
        return motion

    def read_once(path: Path, reading: Reading) -> Motion:
        place = path.resolve()
        return bundled(place) if place.parent == home and reading == as_it_is else read(path, reading)

    # Warnings name the caller outside the package, so this function must look as if it were defined in the package.
    inside = FunctionType(read_once.__code__, vars(motion_reader), closure=read_once.__closure__)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_reader, "_read", inside)
        yield


@pytest.fixture(scope="session")
def backend() -> Backend:
    return select("cpu")


@pytest.fixture
def coarse_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of a body's facets and a tenth of its diffuse points' places, for tests of what is done with a recording: programs
    run as they are written, in less time."""
    monkeypatch.setattr(import_module("t2d_rt.body.skin"), "SAGITTA_RAD", 6.0)
    monkeypatch.setattr(import_module("t2d_rt.scattering.mesh"), "POINT_SAGITTA_RAD", 6.0)
    for mover in ("pet", "curtain"):
        monkeypatch.setattr(import_module(f"t2d_rt.scene.movers.{mover}"), "SAGITTA_RAD", 2.0)


@pytest.fixture(scope="session")
def field_in_cube() -> ReadField:
    """`field_in_cube(cube, radar, range_m, rx_range_m)`: (chirp,) complex sqrt(sigma) [m] of what stands there.

    The carrier of a point with that path is taken out (physics.md, eq. 1), a Hann window over the sweep keeps other
    ranges out, and the radar equation (eq. 2) scales: a point of 1 m^2 reads 1, whatever the radar.
    """

    def read(cube: np.ndarray, radar: Radar, range_m: float, rx_range_m: float | None = None) -> np.ndarray:
        rx_range_m = range_m if rx_range_m is None else rx_range_m
        delay, t = (range_m + rx_range_m) / SPEED_OF_LIGHT, radar.sample_times_s
        cycles = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * t - delay**2 / 2)
        window = np.hanning(radar.samples + 2)[1:-1]
        field = cube[:, 0].astype(complex) @ (window / window.sum() * np.exp(-2j * np.pi * (cycles % 1)))
        return field / np.sqrt(radar.received_power_w(1.0, range_m, rx_range_m))

    return read


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Writes a scene of that body, with one material and wall.ply, and gives its path."""

    def made(body: str, wall: str | bytes = WALL) -> Path:
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        (home / "wall.ply").write_bytes(wall if isinstance(wall, bytes) else wall.encode())
        path = home / "scene.xml"
        path.write_text(f'<scene version="2.1.0"><bsdf type="diffuse" id="mat-itu_concrete"/>{body}</scene>')
        return path

    return made


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`run("simulate", ...)` in an empty folder; the walk is there as walk.bvh."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.bvh").symlink_to(WALK)

    def run_command(*arguments: str) -> Run:
        capsys.readouterr()
        try:
            code = main(arguments)
        except SystemExit as stop:  # --help and --print_config of the parser
            code = stop.code if isinstance(stop.code, int) else 0
        return Run(code, *capsys.readouterr())

    return run_command


@pytest.fixture
def refused(run: Command, tmp_path: Path) -> Callable[..., str]:
    """`refused(...)`: the one sentence of a run that must fail and leave everything as it was."""

    def check(*arguments: str) -> str:
        before = listing(tmp_path)
        code, _, err = run(*arguments)
        assert code == 2
        assert err.startswith("t2d-rt: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert listing(tmp_path) == before
        return err.strip()

    return check
