"""Replies of language models, kept on disk: the same request is not paid for twice.

Nothing depends on the folder. An entry that is missing, damaged, half written or of another request counts as none.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any

from t2d_rt.core import disk_cache

FOLDER = "replies"
LARGEST_BYTES = 2_000_000
"""Of an entry; larger files are no replies."""


def name_of(**request: Any) -> str:
    """The name of a request: the hash of all that its reply follows from."""
    text = json.dumps(request, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def read(name: str) -> str | None:
    """The reply to a request; None where none is kept."""
    home = disk_cache.folder()
    if home is None:
        return None
    path = home / FOLDER / f"{name}.json"
    try:
        with disk_cache.own_file(path, LARGEST_BYTES) as file:
            entry = json.loads(file.read())
        reply = entry["reply"]
        sound = entry["name"] == name and entry["check"] == _check(reply)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    return reply if sound else None


def write(name: str, reply: str) -> None:
    """Keeps a reply, if the disk allows it; whole or not at all."""
    home = disk_cache.folder()
    if home is None:
        return
    text = json.dumps({"name": name, "check": _check(reply), "reply": reply})
    if len(text) > LARGEST_BYTES:
        return
    with contextlib.suppress(OSError):
        folder = home / FOLDER
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, unfinished = tempfile.mkstemp(suffix=".part", dir=folder)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write(text)
            Path(unfinished).replace(folder / f"{name}.json")
        except BaseException:
            Path(unfinished).unlink(missing_ok=True)
            raise


def _check(reply: str) -> str:
    return hashlib.sha256(reply.encode()).hexdigest()
