"""Descriptions as JSON lines: one object a line, with all keys of the schema."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from t2d_rt.core.atomic_write import check_taken, replacing
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.descriptions.slots import Description

LARGEST_FILE = 100_000_000
"""Bytes of a file of descriptions."""


def as_json(description: Description) -> dict[str, Any]:
    """A description as plain data, its class first; steps hold what they say only."""
    fields = description.model_dump(mode="json", by_alias=True)
    for name in ("before", "after"):
        fields[name] = [step.model_dump(mode="json", exclude_none=True) for step in getattr(description, name)]
    return {"class": fields.pop("class"), **fields}


def json_lines(descriptions: Iterable[Description]) -> str:
    """The text of a file of descriptions."""
    return "".join(json.dumps(as_json(each), ensure_ascii=False) + "\n" for each in descriptions)


def write_descriptions(path: str | Path, descriptions: Iterable[Description], *, overwrite: bool = False) -> None:
    """Writes descriptions as JSON lines, whole or not at all."""
    target = Path(path)
    with replacing(target, lambda: check_taken(target, overwrite=overwrite)) as new:
        new.write_text(json_lines(descriptions), encoding="utf-8")


def read_descriptions(path: str | Path) -> list[Description]:
    """The descriptions of a file of JSON lines; an InputError that names the line where one is wrong."""
    data = read_bytes(path, limit=LARGEST_FILE, noun="file of descriptions")
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"file of descriptions {path} is no text in UTF-8; write it with t2d-rt describe") from None
    found = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                found.append(Description.model_validate_json(line))
            except InputError as error:
                raise InputError(f"line {number} of {path}: {error}") from None
    if not found:
        raise InputError(f"file of descriptions {path} holds none; write it with t2d-rt describe")
    return found
