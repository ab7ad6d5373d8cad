"""Several radars at once: each has the samples that it has alone, and hears the others at their places."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import t2d_rt as t2d
from builders import ball
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError
from t2d_rt.types import Radar
from t2d_rt.types.radar_pairs import bistatic, heard

TABLE2 = Radar.preset("table2")
ASIDE = TABLE2.replace(position_m=(2.0, -2.0, 1.2), boresight=(0.0, 1.0, 0.0))
TARGET = ball((2.5, 0.3, 1.0), (-1.0, 0.0, 0.0), 0.05)


def test_each_has_the_samples_that_it_has_alone() -> None:
    walk = t2d.trim(t2d.example("walk"), 0.0, 0.1)
    found = t2d.simulate_radars(walk, [TABLE2, ASIDE], method="ellipsoid")
    before_the_first = t2d.place(walk, radar_position_m=TABLE2.position_m, boresight=TABLE2.boresight)
    for radar, recording in zip((TABLE2, ASIDE), found, strict=True):
        assert recording.radar == radar
        assert np.array_equal(recording.cube, t2d.simulate(before_the_first, radar=radar, method="ellipsoid").cube)


def test_noise_of_each_is_its_own() -> None:
    options = {"accuracy": {"occlusion": False}, "noise": t2d.Receiver(), "seed": 5}
    first, second = t2d.simulate_radars(TARGET, [TABLE2, TABLE2], **options)
    clean = t2d.simulate(TARGET, radar=TABLE2, **{**options, "noise": "none"}).cube
    added = [(each.cube - clean).ravel() for each in (first, second)]
    assert abs(np.vdot(*added)) < 0.02 * np.linalg.norm(added[0]) * np.linalg.norm(added[1])
    # With its seed each is the same alone; the first one's is that of the simulation.
    assert np.array_equal(first.cube, t2d.simulate(TARGET, radar=TABLE2, **options).cube)
    alone = t2d.simulate(TARGET, radar=TABLE2, **{**options, "noise": second.experiment.noise})
    assert np.array_equal(second.cube, alone.cube)


def test_pair_of_radars() -> None:
    pair = bistatic(TABLE2, ASIDE)
    assert np.allclose(pair.tx_position_m, TABLE2.position_m)
    assert np.allclose(pair.rx_position_m, ASIDE.position_m)
    # A small ball returns at the delay of both distances, by the radar equation for two places.
    recording = t2d.simulate(TARGET, radar=pair)
    centre = np.array((2.5, 0.3, 1.0))
    out_m, back_m = (np.linalg.norm(centre - each) - 0.09 for each in (pair.tx_position_m, pair.rx_position_m))
    power = np.mean(np.abs(recording.cube[0, 0]) ** 2)
    assert power == pytest.approx(float(pair.received_power_w(math.pi * 0.1**2, out_m, back_m)), rel=0.1)
    # Swapped, it is the same by reciprocity.
    swapped = t2d.simulate(TARGET, radar=bistatic(ASIDE, TABLE2))
    assert np.allclose(swapped.cube, recording.cube, atol=1e-3 * np.abs(recording.cube).max())
    with pytest.raises(InputError, match="prf_hz of the transmitter is 5000"):
        bistatic(TABLE2.replace(prf_hz=5000.0), ASIDE)
    with pytest.raises(InputError, match="isotropic and upright"):
        bistatic(TABLE2.replace(tx_pattern={"kind": "cosine", "exponent": 2}), ASIDE)


def test_radars_hear_one_another_at_their_distance() -> None:
    # Friis: EIRP in that direction, twice as far 6 dB less; cos^2 at 60 degrees off the boresight is another 6 dB.
    sharp = {"kind": "cosine", "exponent": 2}
    powers = []
    for range_m, angle_deg in ((5.0, 0.0), (10.0, 0.0), (5.0, 60.0)):
        angle = math.radians(180 + angle_deg)
        other = TABLE2.replace(
            position_m=(range_m, 0, 1), boresight=(math.cos(angle), math.sin(angle), 0), tx_pattern=sharp,
            slope_hz_per_s=20e12, carrier_hz=77.3e9, prf_hz=9000.0,
        )  # fmt: skip
        silent, noisy = (
            t2d.simulate_radars(TARGET, [TABLE2, other], noise=t2d.Receiver(seed=3), interference=each)[0]
            for each in (False, True)
        )
        powers.append(np.sum(np.abs(noisy.cube - silent.cube) ** 2))
        assert heard(other, TABLE2).eirp_dbm == pytest.approx(
            21 + 10 * math.log10(math.cos(math.radians(angle_deg)) ** 2)
        )
    assert 10 * np.log10(powers[0] / powers[1]) == pytest.approx(6.02, abs=0.1)
    assert 10 * np.log10(powers[0] / powers[2]) == pytest.approx(6.02, abs=0.1)


def test_radars_that_begin_at_stated_instants_hear_one_another_at_that_delay() -> None:
    """Of one waveform: a sweep that begins d later and is R away leaves a tone of the frequency slope (d + R / c)."""
    other, later_s = TABLE2.replace(position_m=(6.0, 0.0, 1.0), boresight=(-1.0, 0.0, 0.0)), 25e-9
    options = {"noise": t2d.Receiver(), "method": "ellipsoid", "measure_error": False}
    walk = t2d.trim(t2d.example("walk"), 0.0, 0.1)
    found = t2d.simulate_radars(walk, [TABLE2, other], interference=True, starts_s=[0.0, later_s], **options)
    again = t2d.simulate_radars(walk, [TABLE2, other], interference=True, starts_s=[0.2, 0.2 + later_s], **options)
    range_m = np.linalg.norm(np.subtract(TABLE2.position_m, other.position_m))
    spectrum = np.abs(np.fft.fft(found[0].cube[:, 0], axis=1)).mean(axis=0)
    beat_hz = TABLE2.slope_hz_per_s * (later_s + range_m / 299_792_458.0)
    assert spectrum.argmax() == round(beat_hz / TABLE2.sample_rate_hz * TABLE2.samples)
    assert np.allclose(
        found[0].cube, again[0].cube, atol=1e-4 * np.abs(found[0].cube).max()
    )  # 0.2 s have 3e-17 s of rounding
    # The other way round the sweep begins before the own: below the IF band. The walk's echo is a tenth.
    assert np.abs(np.fft.fft(found[1].cube[:, 0], axis=1)).max() < 0.1 * spectrum.max()
    with pytest.raises(InputError, match="give interference=True as well"):
        t2d.simulate_radars(walk, [TABLE2, other], starts_s=[0.0, later_s], **options)
    with pytest.raises(InputError, match=r"starts_s must .* shape .* one instant for each radar"):
        t2d.simulate_radars(walk, [TABLE2, other], interference=True, starts_s=[0.0], **options)


def test_a_radar_that_begins_later_is_not_heard_before() -> None:
    """Nor is a chirp missing afterwards; a radar that began before is heard from the first row on."""
    other, later_s = TABLE2.replace(position_m=(6.0, 0.0, 1.0), boresight=(-1.0, 0.0, 0.0)), 0.05
    options = {"noise": t2d.Receiver(seed=3), "method": "ellipsoid", "measure_error": False}
    walk = t2d.trim(t2d.example("walk"), 0.0, 0.1)
    silent = t2d.simulate_radars(walk, [TABLE2, other], **options)
    first = round(later_s * TABLE2.prf_hz)
    starts_s = [0.0, first / TABLE2.prf_hz + 25e-9]  # so that the beat of the chirps that are heard lies in the IF band
    heard_by = t2d.simulate_radars(walk, [TABLE2, other], interference=True, starts_s=starts_s, **options)
    added = np.abs(heard_by[0].cube - silent[0].cube).max(axis=(1, 2))
    assert not added[:first].any()
    assert added[first:].min() > 0.5 * added.max() > 0
    early = t2d.simulate_radars(walk, [TABLE2, other], interference=True, starts_s=[starts_s[1], 50e-9], **options)
    added = np.abs(early[0].cube - silent[0].cube).max(axis=(1, 2))
    assert added.min() > 0.5 * added.max() > 0


def test_a_start_that_is_drawn_is_not_written() -> None:
    assert "first_s" not in heard(ASIDE, TABLE2).model_dump()
    assert heard(ASIDE, TABLE2, 1e-6).model_dump()["first_s"] == pytest.approx(
        1e-6 + np.linalg.norm([2, -2, 0.2]) / 299_792_458.0
    )


def test_radars_that_are_none() -> None:
    with pytest.raises(InputError, match="a list of radars"):
        t2d.simulate_radars(TARGET, TABLE2)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="takes the place of radar"):
        t2d.simulate_radars(TARGET, [TABLE2], radar=TABLE2)
    with pytest.raises(InputError, match="transmitter must be a Radar, got 'table2'"):
        bistatic("table2", "table2")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="give noise"):
        t2d.simulate_radars(TARGET, [TABLE2, ASIDE], interference=True)
    with pytest.raises(InputError, match="bursts"):
        heard(Radar.preset("table2-burst"), ASIDE)
    with pytest.raises(InputError, match="in one place"):
        heard(TABLE2, TABLE2)


def test_of_an_experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    other = {name: value for name, value in ASIDE.model_dump(mode="json").items() if value is not None}
    targets = [{"kind": "file", "file": "walk", "stop_s": 0.1}]
    values = {"targets": targets, "radars": ["table2", other], "method": "ellipsoid"}
    Path("two.yaml").write_text(yaml.safe_dump(values))
    assert main(["simulate", "two.yaml"]) == 0
    for name, radar in (("two-1", TABLE2), ("two-2", ASIDE)):
        assert Path(f"{name}.png").exists()
        assert t2d.Recording.load(f"{name}.zarr").radar == radar
    assert main(["simulate", "two.yaml", "--method", "ellipsoid", "--overwrite"]) != 0
    # Files lie beside that of the experiment, wherever it is called from.
    ASIDE.to_yaml("aside.yaml")
    Path("noise.yaml").write_text(t2d.Receiver(seed=7).to_yaml())
    Path("files.yaml").write_text(yaml.safe_dump({**values, "radars": ["aside.yaml"], "noise": "noise.yaml"}))
    Path("one.yaml").write_text(yaml.safe_dump({"targets": targets, "radar": "aside.yaml"}))
    Path("elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")
    assert main(["simulate", "../files.yaml", "-o", "files.zarr"]) == 0
    found = t2d.Recording.load("files-1.zarr")
    assert (found.radar, found.experiment and found.experiment.noise) == (ASIDE, t2d.Receiver(seed=7))
    assert t2d.Experiment.from_yaml("../one.yaml").radar == ASIDE
    monkeypatch.chdir("..")
    Path("two.yaml").write_text(yaml.safe_dump({**values, "radars": []}))
    assert main(["simulate", "two.yaml", "-o", "other.zarr"]) != 0
    capsys.readouterr()
    for command in ("plan", "info", "paths"):
        assert main([command, "files.yaml"]) == 2
        assert "files.yaml has several radars, which t2d-rt simulate alone takes" in capsys.readouterr().err
