"""Folders of results of text-to-motion models: pickles forged and damaged, prompts that do not fit."""

from __future__ import annotations

import io
import json
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.motion.generate.files import results
from validation.robustness.fuzz.case import (
    DEEP,
    ODD,
    Attempt,
    chance,
    check_motion,
    corrupted,
    pick,
    quick_walk,
    replaced,
    writing_only,
)

FORGED = (
    b"cos\nsystem\n(S'touch escaped'\ntR.", b"cbuiltins\neval\n(S'open(\"escaped\", \"w\")'\ntR.", b"cnumpy\nload\n(S'x'\ntR.",
    b"cnumpy\ndtype\n(U\x02O8\x89\x88tR(K\x03U\x01|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK?tb.",
    b"(" * 50_000 + b"t" * 50_000 + b".",
    b"\x80\x03cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\nX\x02\x00\x00\x00O8\x85RC\x08AAAAAAAA\x86R.", b"\x80\x03]q\x00h\x00a.",
)  # fmt: skip


class Evil:
    """What writes a file when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch escaped",)


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One folder and the first motion of it."""
    place = folder / "a" / "results"
    place.mkdir(parents=True)
    walk = quick_walk().joints[:, :22][..., [1, 2, 0]].astype(np.float32)
    told = pick(rng, (_mdm, _mdm, _mdm, _momask, _kimodo))(rng, place, np.repeat(walk, 10, axis=0)[:60])
    return Attempt(f"{told}: files", writing_only(lambda: _read(place), folder, "nowhere"))


def _read(place: Path) -> None:
    found = results(place)
    check_motion(found[0].load())


def _mdm(rng: np.random.Generator, place: Path, joints: np.ndarray) -> str:
    motion = joints.transpose(1, 2, 0)[None]
    held: dict[str, Any] = {
        "motion": motion, "text": ["a"], "lengths": np.array([len(joints)]), "num_samples": 1, "num_repetitions": 1,
    }  # fmt: skip
    told = "as written"
    if chance(rng, 0.5):
        name = pick(rng, sorted(held))
        odd = pick(
            rng,
            (*ODD, Evil(), motion.astype("f8"), motion.astype(object), motion[0], np.array(["x"]), -held["lengths"]),
        )
        told, held[name] = f"{name} = {type(odd).__name__}", odd
    body = pickle.dumps(np.array(held, dtype=object), protocol=int(rng.integers(0, 5)))
    if chance(rng, 0.2):
        number = int(rng.integers(len(FORGED)))
        told, body = f"forged pickle {number}", FORGED[number]
    stream = io.BytesIO()
    about = {"descr": "|O", "fortran_order": False, "shape": pick(rng, ((), (), (), (1,), (10**9,)))}
    np.lib.format.write_array_header_1_0(stream, about)
    data = stream.getvalue() + body
    while chance(rng, 0.4):
        how, data = corrupted(rng, data)
        told += f", {how}"
    (place / "results.npy").write_bytes(data)
    (place / "results.txt").write_text(pick(rng, ("a person walks", "", "a\nb", "\0", "a" * 100_000)))
    return f"results.npy {told}"[:300]


def _momask(rng: np.random.Generator, place: Path, joints: np.ndarray) -> str:
    inner = place / "joints" / pick(rng, ("0", "0", "1", "x", "00000000000000000000"))
    inner.mkdir(parents=True)
    file = io.BytesIO()
    np.save(file, pick(rng, (joints, joints[:1], joints * np.nan, joints.astype(int), joints[:, :5], np.zeros(0))))
    told, data = corrupted(rng, file.getvalue()) if chance(rng, 0.5) else ("whole", file.getvalue())
    (inner / "sample0_repeat0_len60_ik.npy").write_bytes(data)
    (place / "prompts.txt").write_text(pick(rng, ("a person walks#60", "", "#", "a\n" * 1000)))
    return f"joints {told}"


def _kimodo(rng: np.random.Generator, place: Path, joints: np.ndarray) -> str:
    np.savez(place / "a.npz", joints=joints)
    told, values = replaced(rng, {"text": "a person walks", "texts": ["a person walks"]})
    text = DEEP if chance(rng, 0.1) else json.dumps(values)
    (place / "a.json").write_text(text)
    return f"a.json {told}"
