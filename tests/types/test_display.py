"""What an interpreter prints of results, motions, scenes and radars, and what a notebook shows of them."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Motion, Radar

RADAR = Radar.preset("ci4r", samples=64)


def result(**settings: Any) -> Recording:
    rng = np.random.default_rng(0)
    cube = rng.normal(size=(1600, 1, 64)) + 1j * rng.normal(size=(1600, 1, 64))
    return Recording(cube.astype(np.complex64), RADAR, settings=settings)


def motion(placed: bool | None) -> Motion:
    walk = t2d.example("walk")
    return replace(walk, placed=placed, report="<script>alert('x')</script> & more")


VALUES = {
    "result": lambda: result(method="mesh", scene="living_room", error_db=-21.37),
    "motion": lambda: motion(False),
    "scene": lambda: t2d.load_scene("corridor"),
    "radar": lambda: RADAR,
}


class Table(HTMLParser):
    """Headings and cells of a table; what else there is is a fault."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.cells: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        assert tag in ("table", "caption", "tr", "th", "td")
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.cells.append(data)


@pytest.mark.parametrize("name", list(VALUES))
def test_texts_are_short_and_tables_are_whole(name: str) -> None:
    value = VALUES[name]()
    assert len(repr(value).splitlines()) == 1
    assert len(repr(value)) <= 130
    assert str(value) == repr(value)
    cells = Table(value._repr_html_()).cells
    assert cells[0].startswith(type(value).__name__)
    assert 9 <= len(cells) <= 21


def test_a_result_says_what_it_is() -> None:
    assert repr(VALUES["result"]()) == (
        "Recording(mesh, living_room, measured error -21.4 dB, 77.18 GHz, 1 600 chirps x 1 antenna x 64 samples, 0.50 s)"
    )
    cells = Table(VALUES["result"]()._repr_html_()).cells
    assert cells[cells.index("error of the field") + 1] == "-21.4 dB"
    assert cells[cells.index("ADC cube") + 1].endswith("0.8192 MB")
    assert repr(result()).startswith("Recording(measured, 77.18 GHz, ")
    assert "\x1b" not in repr(result(method="\x1b[31mred"))


@pytest.mark.parametrize(
    ("placed", "told"),
    [(True, "in the radar's world"), (False, "in its own coordinates"), (None, "in coordinates that are not known")],
)
def test_a_motion_says_where_it_is(placed: bool | None, told: str) -> None:
    assert repr(motion(placed)) == f"Motion(523 frames at 120 Hz, 4.35 s, 27 joints, {told})"


def test_texts_of_files_are_no_markup() -> None:
    shown = motion(False)._repr_html_()
    assert "<script>" not in shown
    assert "<script>alert('x')</script> & more" in Table(shown).cells


def test_a_scene_says_its_size_and_materials() -> None:
    scene = t2d.load_scene("corridor")
    assert repr(scene) == "Scene('corridor', 10 surfaces, 48 triangles, 12 x 1.8 x 2.6 m)"
    cells = Table(scene._repr_html_()).cells
    assert cells[cells.index("materials") + 1] == "concrete (5), ceiling_board (1), wood (4)"


def test_a_radar_says_what_it_resolves() -> None:
    assert repr(Radar.preset("array-3x4")) == (
        "Radar(77 GHz, sweep 1.54 GHz in 256 samples, PRF 25 kHz, 3 x 4 antennas, range bin 9.76 cm up to 25 m, +-8.03 m/s)"
    )
    assert "bursts of 128 chirps every 100 ms" in Radar.preset("table2-burst")._repr_html_()
