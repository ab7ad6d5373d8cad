"""A page that shows recordings, with body, room, paths and maps on one timeline, in a single self-contained HTML file."""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.atomic_write import check_file, writing
from t2d_rt.core.calls import public
from t2d_rt.core.checks import file_path, flag, listed
from t2d_rt.core.errors import InputError, printable
from t2d_rt.recording.recording import made_with

if TYPE_CHECKING:
    from t2d_rt.recording.recording import Recording

PAGE = Path(__file__).resolve().parent
KINDS = {"uint8": "u1", "uint16": "u2", "uint32": "u4", "float32": "f4"}
MOST_RECORDINGS = 2


@public
class Viewer:
    """A page of one recording, or of two side by side, which a notebook shows and `save` writes as a file."""

    def __init__(self, recordings: Sequence[Recording] | Recording, titles: Sequence[str] | None = None) -> None:
        """recordings: a `Recording`, or two; their targets, room and paths are computed from their experiments.
        titles: a title for each; by default how it was made.
        """
        from t2d_rt.recording.recording import Recording

        candidates = [recordings] if isinstance(recordings, Recording) else recordings
        shown = listed("recordings", candidates, Recording, "a Recording or a list of two")
        if not 1 <= len(shown) <= MOST_RECORDINGS:
            raise InputError(f"a page shows one recording or two side by side, got {len(shown)}; make several pages")
        names = [told(recording) for recording in shown] if titles is None else titles
        if len(listed("titles", names, str, "a list of texts")) != len(shown):
            raise InputError(f"titles must be a text for each of {len(shown)} recordings, got {len(names)}")
        self.html = page(shown, [printable(name) for name in names])
        """The HTML text of the page."""

    def __repr__(self) -> str:
        return f"Viewer({len(self.html) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        style = "width: 100%; height: 760px; border: 0"
        return f'<iframe style="{style}" srcdoc="{html.escape(self.html)}" allowfullscreen></iframe>'

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Writes the page to a file that ends in .html; an error leaves an existing file unchanged."""
        target = check_page(path, overwrite=overwrite)
        with writing(target, overwrite=overwrite) as new:
            new.write_text(self.html, encoding="utf-8")


def check_page(path: str | Path, *, overwrite: bool) -> Path:
    """A checked absolute path for a page; refuses one with another ending, one that cannot be written,
    and, without `overwrite`, one that exists."""
    target = file_path("path", path)
    check_file(target, "a page", ".html", ".htm", overwrite=flag("overwrite", overwrite))
    return target.resolve()


def told(recording: Recording) -> str:
    """A short text on how a recording was made."""
    method = made_with(recording.settings, measured=recording.experiment is None)
    return f"{method}, {recording.radar.carrier_hz / 1e9:.4g} GHz"


def page(recordings: Sequence[Recording], titles: Sequence[str]) -> str:
    """The HTML text: the template, with all numbers of the recordings inserted in compressed form."""
    from matplotlib import colormaps

    from t2d_rt.view.gather import FRAMES_HZ, gathered, on_one_scale

    contents = [{"title": title, **gathered(recording)} for recording, title in zip(recordings, titles, strict=True)]
    on_one_scale(contents)
    colours = np.round(255 * colormaps["viridis"](np.arange(256))[:, :3]).astype(np.uint8)
    duration_s = max(
        float(recording.radar.chirp_starts_s(len(recording.cube))[-1]) + recording.radar.loop_interval_s
        for recording in recordings
    )
    arrays = _Arrays()
    meta = arrays.placed(
        {
            "title": titles[0] if len(titles) == 1 else "Two recordings on one timeline",
            "duration_s": duration_s,
            "frames_hz": FRAMES_HZ,
            "colours": colours,
            "recordings": contents,
        }
    )
    parts = {
        "TITLE": html.escape(" and ".join(titles)),
        "STYLE": _text("page.css"),
        "META": json.dumps(meta, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "DATA": base64.b64encode(zlib.compress(b"".join(arrays.pieces), 6)).decode("ascii"),
        "SCRIPT": "\n".join(map(_text, ("room.js", "maps.js", "parts.js", "page.js"))),
    }
    return re.sub(r"/\*([A-Z]+)\*/", lambda place: parts[place[1]], _text("page.html"))


def _text(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


class _Arrays:
    """Stores arrays one after the other in a block of bytes, and replaces each by a header with its position."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self.end = 0

    def placed(self, value: Any) -> Any:
        """Plain values, in which arrays of `KINDS` are replaced by headers and other arrays by lists."""
        if isinstance(value, dict):
            return {name: self.placed(item) for name, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.placed(item) for item in value]
        if not isinstance(value, np.ndarray) or value.dtype.name not in KINDS:
            return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
        header: dict[str, Any] = {"at": self.end, "kind": KINDS[value.dtype.name], "count": value.size}
        if value.dtype == np.uint16:  # arrays over frames change little: they are stored as differences
            header["deltas"] = value[0].size
            value = np.concatenate([value[:1], value[1:] - value[:-1]])
        data = value.astype(value.dtype.newbyteorder("<")).tobytes()
        self.pieces += [data, bytes(-len(data) % 4)]  # so that all begin at multiples of 4
        self.end += len(data) + -len(data) % 4
        return header
