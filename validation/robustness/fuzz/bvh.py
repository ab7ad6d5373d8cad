"""Motion files: small valid ones of three writers, damaged in their fields, structure, bytes and packing; files that are none."""

from __future__ import annotations

import functools
import gzip
import os
import re
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import t2d_rt as t2d
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    Wrong,
    chance,
    check_motion,
    command,
    corrupted,
    leaving_nothing,
    pick,
)

BASES = ("momask_22j_120frames.bvh", "bvhtoolbox_walk01.bvh", "14_14_jumping_jacks.bvh")
FRAMES = 14
NUMBERS = (
    "nan", "inf", "-inf", "NaN(0)", "1e400", "1e308", "-1e9", "1e9", "999999999", "1e-320", "-0", "0", "1_000", "0x10", "1,5",
    "", "--1",
    "1e", "1d5", "٣", "½", "true", "None", "9" * 400, "0." + "0" * 500 + "1", "+.5", "5.", "1e15", "-1", "1e-5", "3.5", "%s",
    "$x",
)  # fmt: skip
WORDS = (
    "HIERARCHY", "MOTION", "ROOT", "JOINT", "End Site", "{", "}", "OFFSET", "CHANNELS", "Frames:", "Frame Time:", "CHANNELS 0",
    "CHANNELS 3 Xrotation Xrotation Xrotation", "CHANNELS 6", "CHANNELS -3", "CHANNELS 99999999 Xrotation", "OFFSET 0 0",
    "OFFSET 0 0 0 0", "ROOT Hips", "JOINT", "\x1b[31mred\x1b[0m", "\x85", "\x0c", "\0", "JOINT \x1b]0;title\x07", "#",
    "Frames: 1e9",
)  # fmt: skip


class Made(NamedTuple):
    """A file's bytes, and what has to come of them where that is known."""

    told: str
    data: bytes
    expected: str = ""
    """same: the motion of the file without the change; refused; nothing where both may be."""
    suffix: str = ".bvh"


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One motion file and what is done with it."""
    if chance(rng, 0.1):
        told, path = special(rng, folder)
        return _used(rng, told, path, "")
    base = _text(pick(rng, BASES))
    made = pick(rng, (fields, structure, damage, packing, same, large))(rng, base)
    name = pick(rng, NAMES) if chance(rng, 0.1) else "motion"
    path = folder / f"{name}{made.suffix}"
    path.write_bytes(made.data)
    if made.expected == "same":
        (folder / "base.bvh").write_text(base, encoding="utf-8")
    return _used(rng, made.told, path, made.expected)


NAMES = (
    "a b", "a\nb", "a\x1b[31m", "$x$", "%s{}", "naïve", "日本", "-rf", "a" * 200, "..", "a.zarr", "\u202egnp", "a\udcff", "~",
    "{name}", "C:\\x",
)  # fmt: skip


@functools.cache
def _text(name: str) -> str:
    """A shipped motion with its first frames."""
    head, _, motion = (MOTIONS / name).read_text(encoding="utf-8").replace("\r\n", "\n").partition("MOTION\n")
    lines = motion.splitlines()
    step = lines[1]
    return "\n".join([f"{head}MOTION", f"Frames: {FRAMES}", step, *lines[2 : 2 + FRAMES], ""])


# --- what is made of it ---------------------------------------------------------------------------------------------


def fields(rng: np.random.Generator, text: str) -> Made:
    """One to three numbers or names replaced."""
    told = []
    for _ in range(int(rng.integers(1, 4))):
        lines = text.split("\n")
        kind = pick(rng, ("OFFSET", "CHANNELS", "Frames", "Frame Time", "JOINT", "row"))
        motion = lines.index("MOTION")
        places = (
            list(range(motion + 3, motion + 3 + FRAMES)) if kind == "row"
            else [i for i, line in enumerate(lines) if line.strip().startswith(kind)]
        )  # fmt: skip
        if not places:
            continue
        at = pick(rng, places)
        words = lines[at].split(" ")
        word = int(rng.integers(len(words)))
        words[word] = pick(rng, NUMBERS if chance(rng, 0.8) else WORDS)
        lines[at] = " ".join(words)
        told.append(f"{kind} line {at} word {word} {words[word][:30]!r}")
        text = "\n".join(lines)
    return Made("; ".join(told), _bytes(text))


def structure(rng: np.random.Generator, text: str) -> Made:
    """Lines dropped, doubled, exchanged, moved, put in."""
    lines, told = text.split("\n"), []
    for _ in range(int(rng.integers(1, 4))):
        # two of three changes are to the hierarchy or the header, which are the smaller part
        a, b = (int(rng.integers(len(lines) if chance(rng, 0.33) else max(1, len(lines) - FRAMES))) for _ in range(2))
        how = pick(rng, ("drop", "double", "exchange", "move", "put in", "join", "cut"))
        told.append(f"{how} {a} {b}")
        if how == "drop":
            del lines[a]
        elif how == "double":
            lines.insert(a, lines[a])
        elif how == "exchange":
            lines[a], lines[b] = lines[b], lines[a]
        elif how == "move":
            lines.insert(b, lines.pop(a))
        elif how == "put in":
            lines.insert(a, pick(rng, WORDS + NUMBERS))
        elif how == "join" and a + 1 < len(lines):
            lines[a] += " " + lines.pop(a + 1)
        elif how == "cut":
            del lines[max(a, 1) :]
    return Made("; ".join(told), _bytes("\n".join(lines)))


def damage(rng: np.random.Generator, text: str) -> Made:
    """Bytes damaged, or another encoding."""
    if chance(rng, 0.25):
        encoding = pick(rng, ("utf-16", "utf-16-le", "utf-32", "utf-7", "cp037", "utf-8-sig"))
        return Made(encoding, text.encode(encoding))
    told, data = corrupted(rng, text.encode())
    return Made(told, data)


def packing(rng: np.random.Generator, text: str) -> Made:
    """gzip in one and several members, cut, damaged, with junk behind, twice, under a wrong name."""
    data = text.encode()
    packed = gzip.compress(data, mtime=0)
    half = int(rng.integers(1, len(data)))
    place = int(rng.integers(10, len(packed)))
    return pick(
        rng,
        (
            lambda: Made("gz", packed, "same", ".bvh.gz"),
            lambda: Made(f"gz of two members, at {half}", gzip.compress(data[:half]) + gzip.compress(data[half:]), "same",
            ".bvh.gz"),
            lambda: Made("gz of 300 members", b"".join(gzip.compress(data[i::300]) for i in range(300)), "", ".bvh.gz"),
            lambda: Made("gz with an empty member", gzip.compress(b"") + packed, "same", ".bvh.gz"),
            lambda: Made(f"gz cut at {place}", packed[:place], "refused", ".bvh.gz"),
            lambda: Made("gz and junk", packed + b"junk behind it", "refused", ".bvh.gz"),
            lambda: Made("gz and half a member", packed + packed[: place // 2 + 12], "refused", ".bvh.gz"),
            lambda: Made("gz and zeros", packed + bytes(512), "", ".bvh.gz"),
            lambda: Made("gz with a wrong checksum", packed[:-8] + bytes([packed[-8] ^ 1]) + packed[-7:], "refused", ".bvh.gz"),
            lambda: Made("gz with a wrong length", packed[:-1] + b"\x7f", "refused", ".bvh.gz"),
            lambda: Made(f"gz flipped at {place}", packed[:place] + bytes([packed[place] ^ 16]) + packed[place + 1 :], "",
            ".bvh.gz"),
            lambda: Made("gz in gz", gzip.compress(packed), "refused", ".bvh.gz"),
            lambda: Made("gz without the suffix", packed, "refused", ".bvh"),
            lambda: Made("text named gz", data, "refused", ".bvh.gz"),
            lambda: Made("suffix in capitals", packed, "same", ".BVH.GZ"),
            lambda: Made("header flags", packed[:3] + bytes([int(rng.integers(256))]) + packed[4:], "", ".bvh.gz"),
            lambda: _bomb(rng),
        ),
    )()  # fmt: skip


def _bomb(rng: np.random.Generator) -> Made:
    """A small gz of a large text."""
    piece = pick(rng, (b"\n", b" ", b"x\n", b"0 ", b"{\n", b"\0", b"JOINT a\n"))
    head = pick(
        rng,
        (
            b"",
            b"HIERARCHY\n",
            b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION\nFrames: 2\nFrame Time: .1\n",
        ),
    )
    size = int(10 ** rng.uniform(6.5, 8.3))
    data = gzip.compress(head + piece * (size // len(piece)), compresslevel=1)
    return Made(f"gz of {size / 1e6:.0f} MB of {piece!r} after {head[-30:]!r}", data, "refused", ".bvh.gz")


def same(rng: np.random.Generator, text: str) -> Made:
    """Another way of writing the same motion."""
    head, _, tail = text.partition("MOTION\n")
    joint = "\tJOINT {}\n\t{{\n\tOFFSET 0 1 0\n\tCHANNELS 0\n\tEnd Site\n\t{{\n\tOFFSET 0 1 0\n\t}}\n\t}}\n}}\n"
    writings: tuple[tuple[str, Callable[[], bytes]], ...] = (
        ("CRLF", lambda: text.replace("\n", "\r\n").encode()),
        ("BOM", lambda: b"\xef\xbb\xbf" + text.encode()),
        ("no indentation", lambda: re.sub(r"(?m)^[ \t]+", "", text).encode()),
        ("tabs", lambda: text.replace(" ", "\t").replace("End\tSite", "End Site").replace("Frame\tTime",
        "Frame Time").encode()),
        ("blank lines", lambda: text.replace("\n", "\n\n \n").encode()),
        ("spaces at the ends", lambda: text.replace("\n", "  \t\n").encode()),
        ("keywords in small letters", lambda: head.replace("ROOT", "root").replace("JOINT",
        "joint").encode() + b"motion\n" + tail.encode()),
        ("one more joint", lambda: _with_joint(head, joint, pick(rng, ("Größe", "àÅ", "名前", "a b", "x" * 300, "e\u0301",
        "\u0105"))).encode()
         + b"MOTION\n" + tail.encode()),
        ("one more joint in Latin-1", lambda: _with_joint(head, joint,
        "Gr\xf6\xdfe").encode("latin-1") + b"MOTION\n" + tail.encode()),
        ("a row over two lines", lambda: _broken(text).encode()),
    )  # fmt: skip
    told, make = pick(rng, writings)
    return Made(told, make(), "same")


def _with_joint(head: str, joint: str, name: str) -> str:
    return head[: head.rindex("}")] + joint.format(name)


def _broken(text: str) -> str:
    lines = text.split("\n")
    at = lines.index("MOTION") + 4
    words = lines[at].split()
    lines[at] = " ".join(words[: len(words) // 2]) + "\n" + " ".join(words[len(words) // 2 :])
    return "\n".join(lines)


def large(rng: np.random.Generator, text: str) -> Made:
    """More of something than any person has."""
    count = int(10 ** rng.uniform(3, 5))
    head, _, tail = text.partition("MOTION\n")
    body = "OFFSET 0 1 0\nCHANNELS 0\n"
    many = "\n".join(f"JOINT j{i}\n{{\n{body}}}" for i in range(count))
    deep = "".join(f"JOINT j{i}\n{{\n{body}" for i in range(count)) + "}\n" * count
    motion = "MOTION\nFrames: 2\nFrame Time: .01\n"
    kinds: tuple[tuple[str, Callable[[], str]], ...] = (
        ("joints beside one another", lambda: head[: head.rindex("}")] + many + "\n}\nMOTION\n" + tail),
        ("joints below one another", lambda: head[: head.rindex("}")] + deep + "\n}\nMOTION\n" + tail),
        ("end sites", lambda: head[: head.rindex("}")] + "End Site\n{\nOFFSET 0 0 0\n}\n" * count + "}\nMOTION\n" + tail),
        ("braces", lambda: "HIERARCHY\nROOT a\n" + "{\n" * count + motion),
        ("channels", lambda: f"HIERARCHY\nROOT a\n{{\nOFFSET 0 0 0\nCHANNELS {count}{' Xrotation' * count}\n}}\n{motion}"),
        ("numbers in a row", lambda: text + " ".join(["1"] * count)),
        ("frames that are not there", lambda: text.replace(f"Frames: {FRAMES}", f"Frames: {count}")),
        ("letters in a name", lambda: text.replace("JOINT ", "JOINT " + "x" * count)),
        ("letters in a line", lambda: text.replace("MOTION\n", "MOTION\n" + "x" * 10 * count)),
        ("digits", lambda: text.replace("OFFSET ", "OFFSET " + "1" * count, 1)),
        ("frames", lambda: _repeated(text, count)),
    )  # fmt: skip
    told, make = pick(rng, kinds)
    return Made(f"{count} {told}", make().encode())


def _repeated(text: str, count: int) -> str:
    lines = text.split("\n")
    at = lines.index("MOTION") + 3
    rows = lines[at : at + FRAMES]
    copies = max(1, min(count, 5000) // FRAMES)
    return "\n".join([*lines[: at - 2], f"Frames: {copies * FRAMES}", lines[at - 1], *(rows * copies), ""])


def special(rng: np.random.Generator, folder: Path) -> tuple[str, Path]:
    """A path at which there is no plain file, or a very large one."""
    path = folder / pick(rng, ("motion.bvh", "motion.bvh.gz"))
    links = {
        "a loop of links": path.name, "a dangling link": "nowhere.bvh", "a link to zeros": "/dev/zero",
        "a link to nothing": "/dev/null",
        "a link to full": "/dev/full", "a link to random": "/dev/urandom", "a link to a terminal": "/dev/tty",
        "a link to its memory": "/proc/self/mem", "a link to its own process": "/proc/self/status",
        "a link to a folder": "/tmp",
        "a link to stdin": "/dev/stdin", "a link to a kernel's pipe": "/proc/kmsg",
    }  # fmt: skip
    kind = pick(rng, (*links, "pipe", "socket", "folder", "sparse", "forbidden", "zip", "none"))
    if kind in links:
        path.symlink_to(links[kind])
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        socket.socket(socket.AF_UNIX).bind(os.path.relpath(path))
    elif kind == "folder":
        path.mkdir()
    elif kind == "sparse":
        with path.open("wb") as file:
            file.write(gzip.compress(b"HIERARCHY\n") if path.suffix == ".gz" else b"HIERARCHY\n")
            file.truncate(1000 * 2**20)  # the limit of a file's size in these processes; far more than any motion
    elif kind == "forbidden":
        path.write_text("HIERARCHY")
        path.chmod(0)
    elif kind == "zip":
        path.write_bytes(b"PK\3\4" + struct.pack("<26x") + b"HIERARCHY")
    return f"{path.name} is {kind}", path


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")


# --- what is done with it -------------------------------------------------------------------------------------------

OPTIONS: dict[str, tuple[Any, ...]] = {
    "units": ("m", "cm", "parsec", "", 0.0, -1.0, float("nan"), 1e-300, 1e300, "1", 3, True, [], b"m"),
    "up": ("y", "-z", "w", "", 3, "yy", ["y"]),
    "floor": (0.0, 1.5, 1e300, float("nan"), float("-inf"), "0", [0.0]),
    "drop_tpose": (True, False, "yes", 3, None),
    "smooth_hz": (None, "auto", 5.0, 0.0, -1.0, 1e9, 1e-9, float("nan"), "much", "5", 59.99, 60.0),
    "flavour": ("cmu", "iclone", "mixamo", "", "no such", 3, None, "CMU"),
}
"""Options of the reader, usual ones and odd ones."""


def _used(rng: np.random.Generator, told: str, path: Path, expected: str) -> Attempt:
    use = pick(rng, ("load", "load", "load", "options", "info", "simulate")) if not expected else "load"
    if use == "info":
        return Attempt(f"{told}: t2d-rt info {path.name}", command(["info", str(path)]))
    if use == "simulate":
        words = [
            "simulate", str(path), "--method", "ellipsoid", "--radar", "ci4r", "--radar.samples=32", "--stop-s=0.1", "-o",
            "x.zarr",
        ]  # fmt: skip
        return Attempt(f"{told}: t2d-rt {' '.join(words)}", leaving_nothing(command(words), path.parent))
    options: dict[str, Any] = {}
    if use == "options":
        options = {name: pick(rng, OPTIONS[name]) for name in sorted(set(pick(rng, sorted(OPTIONS)) for _ in range(2)))}
    given = "".join(f", {name}={value!r}" for name, value in options.items())
    return Attempt(f"{told}: load_motion({path.name!r}{given})", lambda: _loaded(path, expected, options))


def _loaded(path: Path, expected: str, options: dict[str, Any]) -> None:
    try:
        motion = t2d.load_motion(path, **options)
    except t2d.T2DError:
        if expected == "same":
            raise Wrong("refused, although it only writes a good motion in another way") from None
        raise
    if expected == "refused":
        raise Wrong("read as if it were whole")
    check_motion(motion)
    str(t2d.describe(motion))
    check_motion(t2d.place(motion))
    if expected == "same":
        base = t2d.load_motion(path.with_name("base.bvh"))
        if base.joints.shape != motion.joints.shape or not np.array_equal(base.joints, motion.joints):
            raise Wrong("read as another motion, although it only writes the same one in another way")
