"""Keep a user's own clips in the library: an index of motion files, measured once and read when they are used."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import numpy as np

from t2d_rt.core.atomic_write import check_no_folder, replacing, settle
from t2d_rt.core.checks import file_path, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.contacts import contacts, grown, soles
from t2d_rt.motion.descriptions.slots import ACTIONS_OF, ACTIVITIES, Action, Direction, Speed
from t2d_rt.motion.generate.chain import heading_rad
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment, Source, Store, locked
from t2d_rt.motion.interpolate import resample
from t2d_rt.motion.kinematics import Poses, poses_of
from t2d_rt.motion.read import load_motion

NEEDED = "file", "class", "action"
OPTIONAL = "start_s", "stop_s", "direction", "speed", "text"
"""Columns of an index that a user writes."""
MEASURED = "speed_mps", "turn_deg", "distance_m"
"""Columns that are measured and added."""

MOST_BYTES = 20_000_000
MOST_ROWS = 50_000

LEAST_S = 0.5
"""Shortest clip that is taken."""


def registry() -> Path:
    """The index of a user's clips where none is named: t2d-rt/library.csv in the folder for users' data (XDG_DATA_HOME)."""
    base = os.environ.get("XDG_DATA_HOME", "")
    return (Path(base) if base else Path.home() / ".local" / "share") / "t2d-rt" / "library.csv"


def with_users(store: Store, index: str | Path) -> Store:
    """The store with the clips of a user's index; raises an InputError if the index is wrong."""
    path = file_path("library", index)
    segments, sources, files = [], dict(store.sources), dict(store.own)
    for line, row in rows(path, measured=True):
        name = f"{Path(row['file']).name}#{line}"
        segment = Segment(
            name=name,
            clip=name,
            start=round(float(row["start_s"] or 0) * RATE_HZ),
            stop=round(float(row["stop_s"]) * RATE_HZ) + 1,
            activity=row["class"],
            action=row["action"],
            kind=_kind(row),
            direction=row["direction"],
            speed_mps=float(row["speed_mps"]),
            turn_deg=float(row["turn_deg"]),
            distance_m=float(row["distance_m"]),
        )
        segments.append(segment)
        files[name] = Path(row["file"])
        sources[name] = Source(file=files[name].name, licence="yours", sha256="", subject=str(files[name].parent))
    return replace(store, segments=(*store.segments, *segments), sources=sources, own=files)


def _kind(row: Mapping[str, str]) -> str:
    if row["action"] in ("walk", "run"):
        return "steady"
    if row["action"] == "jump":
        return "forward" if row["direction"] in ("forward", "straight") or float(row["distance_m"]) > 0.4 else "up"
    return ""


def add(
    folder: str | Path, index: str | Path, *, library: str | Path | None = None
) -> tuple[list[dict[str, str]], int]:
    """Measure the clips of an index and add its rows to the library's own index; if one is wrong, raise an InputError and add none.

    The rows are returned, with the number of rows of the same files that they replace in the library.

    folder: where the files of the index are.
    index: CSV file with the columns file, class and action, and any of start_s, stop_s, direction, speed and text.
    library: index to add to; by default the `registry`.
    """
    base = file_path("folder", folder)
    if not base.is_dir():
        raise InputError(f"there is no folder '{base}' of clips; check the path")
    added: list[dict[str, str]] = []
    for line, row in rows(file_path("index", index)):
        path = (base / row["file"]).resolve()
        if not path.is_relative_to(base.resolve()):
            raise InputError(
                f"line {line} of {index} names {shown(row['file'])}, which is not in {base}; name files in the folder"
            )
        added.append(_measured(path, row, f"line {line} of {index}"))
    target = registry() if library is None else file_path("library", library)
    listed = [row for _, row in rows(target, measured=True)] if target.is_file() else []
    files = {row["file"] for row in added}
    others = [row for row in listed if row["file"] not in files]
    write(target, [*others, *added])
    return added, len(listed) - len(others)


def remove(what: str | Path, *, library: str | Path | None = None) -> int:
    """Removes the clips of a file, or of a folder's files, from the library's index, and returns their number; the files stay."""
    target = registry() if library is None else file_path("library", library)
    gone = file_path("what", what).resolve()
    listed = [row for _, row in rows(target, measured=True)]
    others = [row for row in listed if Path(row["file"]) != gone and not Path(row["file"]).is_relative_to(gone)]
    if len(others) == len(listed):
        raise InputError(f"the library has no clip of '{gone}'; t2d-rt library list shows those that it has")
    write(target, others)
    return len(listed) - len(others)


def rows(path: Path, *, measured: bool = False) -> Iterable[tuple[int, dict[str, str]]]:
    """Lines of an index with their numbers, checked; raises an InputError that names the first that is wrong."""
    try:
        text = read_bytes(path, limit=MOST_BYTES, noun="clip index").decode("utf-8-sig")
        reader = csv.DictReader(io.StringIO(text), strict=True)
        columns = list(reader.fieldnames or [])
        needed = (*NEEDED, "stop_s", *MEASURED) if measured else NEEDED
        missing = [name for name in needed if name not in columns]
        extra = [name for name in columns if name not in (*NEEDED, *OPTIONAL, *MEASURED)]
        if missing or extra or len(set(columns)) != len(columns):
            raise InputError(
                f"the clip index {path} must have the columns {', '.join(NEEDED)} and may have {', '.join(OPTIONAL)}, got "
                f"{shown(', '.join(map(str, columns)))}; correct its first line"
            )
        numbered_rows: list[tuple[int, dict[str, str]]] = []
        for row in reader:
            if len(numbered_rows) == MOST_ROWS:
                raise InputError(f"the clip index {path} has more than {MOST_ROWS} lines; split it")
            numbered_rows.append((reader.line_num, _checked(row, f"line {reader.line_num} of {path}", measured)))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"the clip index {path} is no table of comma-separated values ({error}); correct it") from None
    if not numbered_rows and not measured:
        raise InputError(f"the clip index {path} has no line beside its first; list the clips in it")
    return numbered_rows


def _checked(row: Mapping[str | None, object], where: str, measured: bool) -> dict[str, str]:
    if None in row or any(not isinstance(value, str) for value in row.values()):
        raise InputError(f"{where} has another number of values than the first line; correct it")
    cells = {name: str(row.get(name) or "").strip() for name in (*NEEDED, *OPTIONAL, *MEASURED)}
    if not cells["file"] or "\0" in cells["file"]:
        raise InputError(f"{where} names no file; fill the column file")
    kinds = {"action": Action, "direction": Direction, "speed": Speed}
    words: dict[str, tuple[str, ...]] = {name: get_args(kind) for name, kind in kinds.items()}
    for name, allowed in {"class": ACTIVITIES, **words}.items():
        if cells[name] not in allowed and (cells[name] or name in NEEDED):
            raise InputError(f"{where} has {name} {shown(cells[name])}; it must be one of {', '.join(allowed)}")
    if cells["action"] not in (*ACTIONS_OF[cells["class"]], "stand"):  # type: ignore[index]
        raise InputError(f"{where}: class {cells['class']} has no action {cells['action']}; correct one of them")
    for name in ("start_s", "stop_s", *(MEASURED if measured else ())):
        try:
            value = float(cells[name] or 0)
        except ValueError:
            value = np.nan
        if not (np.isfinite(value) and abs(value) < 1e6 and (value >= 0 or name == "turn_deg")):
            raise InputError(
                f"{where} has {name} {shown(cells[name])}; it must be a number of seconds"
                + (" or metres" if measured else "")
            )
    return cells


def _measured(path: Path, row: dict[str, str], where: str) -> dict[str, str]:
    """A row with the absolute path of its file and the columns that are measured of the clip."""
    try:
        poses, _ = recorded(path)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    end_s = (len(poses) - 1) / RATE_HZ
    start_s, stop_s = float(row["start_s"] or 0), float(row["stop_s"] or end_s)
    if not (start_s + LEAST_S <= stop_s <= end_s + 0.02):
        raise InputError(
            f"{where} asks for {start_s:g} to {stop_s:g} s of a motion of {end_s:.2f} s; a clip lies in it and is "
            f"{LEAST_S} s or longer"
        )
    part = poses.part(round(start_s * RATE_HZ), round(min(stop_s, end_s) * RATE_HZ) + 1)
    joints, _ = part.world()
    if np.linalg.norm(np.diff(joints, axis=0), axis=-1).mean() * RATE_HZ < 1e-3:
        raise InputError(
            f"{where}: nothing moves in {path.name} from {start_s:g} to {stop_s:g} s; leave it out or give other times"
        )
    distance_m = float(np.linalg.norm(part.root[-1, :2] - part.root[0, :2]))
    heading = heading_rad(part)
    return row | {
        "file": str(path),
        "start_s": f"{start_s:.3f}",
        "stop_s": f"{min(stop_s, end_s):.3f}",
        "speed_mps": f"{distance_m * RATE_HZ / (len(part) - 1):.3f}",
        "turn_deg": f"{np.degrees(heading[-1] - heading[0]):.1f}",
        "distance_m": f"{distance_m:.3f}",
    }


def write(path: Path, table: list[dict[str, str]]) -> None:
    """Write an index in one go."""
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, (*NEEDED, *OPTIONAL, *MEASURED), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    check_no_folder(path)
    settle(path)
    with replacing(path, partial(check_no_folder, path)) as new:
        new.write_text(buffer.getvalue(), encoding="utf-8")


def recorded(path: Path) -> tuple[Poses, np.ndarray]:
    """A motion file as poses at the library's rate, with heels and balls of standing feet at z = 0, and its contacts (T, 2, 2)."""
    try:
        stamp = path.stat().st_mtime_ns
    except OSError as error:
        raise InputError(
            f"cannot read the clip {path} of the library: {error.strerror}; put it back, or t2d-rt library remove it"
        ) from None
    return _recorded(path, stamp)


@lru_cache(maxsize=16)
def _recorded(path: Path, stamp: int) -> tuple[Poses, np.ndarray]:
    motion = load_motion(path)
    poses = poses_of(motion if motion.rate_hz == RATE_HZ else resample(motion, RATE_HZ))
    planted = grown(poses, contacts(poses))
    lowest = soles(poses)[..., 2].min(axis=(1, 2))
    stands = planted.any(axis=(1, 2))
    level = float(np.median(lowest[stands])) if stands.sum() > 10 else float(np.percentile(lowest, 2))
    return locked(replace(poses, root=poses.root - [0.0, 0.0, level]), planted)
