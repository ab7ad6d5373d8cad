"""The study of recorded walks: its measures and what it reads."""

import numpy as np
import pytest
from scipy.io import savemat

from t2d_rt.core.errors import InputError
from validation.studies.walks import RADAR, REST, in_noise, levels, measures, read_map, window_of


def drawn(rows: int = 120, columns: int = 40) -> np.ndarray:
    """A torso in row 20 at 30 dB, limbs in rows 21 to 40 at 13 dB, of which every other cell is empty."""
    level = np.full((rows, columns), -5.0)
    level[20:40:2] = 13.0
    level[19] = 30.0
    return level


def test_measures_of_a_drawn_map_are_what_was_drawn() -> None:
    limbs_8, limbs_12, limbs_18, over, under = measures(drawn())
    assert (limbs_8, limbs_12) == (39 / 20, 39 / 20)
    assert limbs_18 == 1
    assert over == pytest.approx(9 / 18)
    assert under == 0


def test_a_map_tells_its_floor_its_looks_and_its_torso(tmp_path) -> None:
    rng = np.random.default_rng(1)
    level = 100 + 10 * np.log10(rng.gamma(16, 1 / 16, size=(192, 200)))
    level[REST - 27] += 30
    savemat(tmp_path / "walk.mat", {"tfmap": level})
    found = read_map(f"{tmp_path / 'walk.mat'}:45")
    assert (found.name, found.angle_deg, found.torso) == ("walk", 45, 27)
    assert found.looks == pytest.approx(16, rel=0.1)
    assert found.top_db == pytest.approx(30, abs=0.3)
    assert abs(np.median(found.level_db[40:])) < 0.1
    for told in (f"{tmp_path / 'walk.mat'}", f"{tmp_path / 'none.mat'}:0"):
        with pytest.raises(InputError, match=r"FILE\.mat:ANGLE"):
            read_map(told)


def test_the_window_puts_a_torso_in_its_row_and_noise_lies_under_it() -> None:
    speed_mps, row, top_db = 1.2, 27, 32.0
    wavelength_m = 299792458.0 / RADAR.mid_frequency_hz
    times_s = np.arange(4000) / RADAR.prf_hz
    beat = 2 * np.pi * 20 / RADAR.samples * np.arange(RADAR.samples)
    cube = np.exp(1j * (beat + 4 * np.pi * speed_mps * times_s[:, None] / wavelength_m))[:, None].astype(np.complex64)
    cube = cube if levels(cube, 256).max() > levels(cube.conj(), 256).max() else cube.conj()
    window = window_of(cube, row)
    assert window == pytest.approx(row * RADAR.prf_hz * wavelength_m / (2 * speed_mps), abs=window / row)
    level = in_noise(cube, window, top_db, seed=0)
    assert np.median(level[row - 1]) == pytest.approx(top_db, abs=0.2)
    assert abs(np.median(level[60:])) < 0.3
