"""Safe reading of a user's files and texts: regular files of bounded size, YAML that cannot grow without limit, printable text."""

from __future__ import annotations

import csv
import io
import os
import stat
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO

from t2d_rt.core.checks import file_path, shown
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np

MAX_YAML_BYTES = 1_000_000
MAX_YAML_VALUES = 20_000
"""Greatest number of values in a YAML text, twice those of a radar with 1024 transmitters and receivers each; an alias counts as
everything that it stands for."""
MAX_YAML_DEPTH = 50
MAX_YAML_DIGITS = 400
"""Greatest number of digits of a YAML number: a float has at most 309, and an integer of thousands of digits cannot even be
printed."""

MAX_GZIP_MEMBERS = 10_000
"""Greatest number of members of a gzip file; a file of 150 MB packed in blocks of 64 kB has 2 300."""
GZIP_BLOCK = 65_536

OPENING = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
"""Flags for opening files. Without O_NONBLOCK, opening a pipe waits for a writer; for regular files it has no effect."""


def read_bytes(path: str | Path, *, limit: int, noun: str) -> bytes:
    """Reads a regular file of at most `limit` bytes; `noun` is what error messages call it ("radar file")."""
    with regular_file(path, noun=noun) as file:
        length = os.fstat(file.fileno()).st_size
        data = None
        if length <= limit:
            data = file.read(length + 1) or b""  # None: a kernel's file that would have to be waited for
            if len(data) > length:  # the file grows, or has no size, as in /proc
                data += file.read(limit + 1 - len(data)) or b""
    if data is None or len(data) > limit:
        raise InputError(f"{path} is larger than the {size(limit)} that a {noun} may have; give a smaller one")
    return data


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows of cells as CSV text.

    >>> csv_text([["a", "b"], [1, "2, 3"]])
    'a,b\\n1,"2, 3"\\n'
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def npy_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, Fortran order, and type of the array in a .npy file, which is then positioned at the values."""
    from numpy.lib import format as npy

    version = npy.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format")
    shape, by_columns, dtype = npy.read_array_header_1_0(file) if version == (1, 0) else npy.read_array_header_2_0(file)
    return shape, by_columns, dtype


@contextmanager
def regular_file(path: str | Path, *, noun: str) -> Iterator[BinaryIO]:
    """Opens a regular file for reading; raises an InputError for pipes, devices and what cannot be read."""
    path = file_path(f"the path of a {noun}", path)
    try:
        descriptor = os.open(path, OPENING)
        try:
            mode = os.fstat(descriptor).st_mode
            if not stat.S_ISREG(mode):
                raise InputError(f"{path} is {_kind(mode)}; give the path of one {noun}")
            with open(descriptor, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(descriptor)
    except UnicodeEncodeError:
        raise InputError(f"cannot read {noun} {str(path)!r}: this is not a valid file name; check the path") from None
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot read {noun} {path}: {reason}; check the path and its permissions") from None


def _kind(mode: int) -> str:
    kinds = {stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(mode), "a device")


def gunzip(data: bytes, path: str | Path, *, limit: int) -> bytes:
    """Unpacks a gzip file with all its members, at most `limit` bytes."""
    texts: list[bytes] = []
    room, start, members = limit, 0, 0
    while data[start : start + 1] != b"\0" or data[start:].strip(b"\0"):  # zeros pad the last block, as on tapes
        member = zlib.decompressobj(wbits=31)
        while start < len(data) and not member.eof:
            piece = data[start : start + GZIP_BLOCK]
            try:
                texts.append(member.decompress(piece, room + 1))
            except zlib.error:
                junk = "is followed by bytes that are no gzip data" if members else "is not a valid gzip file"
                raise InputError(f"{path} {junk}; unpack it by hand or fetch it again") from None
            room -= len(texts[-1])
            start += len(piece) - len(member.unused_data)
            if room < 0:
                raise InputError(f"{path} unpacks to more than {size(limit)}; cut it into shorter files")
        members += 1
        if not member.eof:
            raise InputError(f"{path} is cut short; fetch it again")
        if members > MAX_GZIP_MEMBERS:
            raise InputError(f"{path} is made of more than {MAX_GZIP_MEMBERS} gzip members; unpack it by hand")
        if start == len(data):
            break
    return b"".join(texts)


def size(count: int) -> str:
    """A number of bytes as text, such as "1.5 MB"."""
    return f"{count / 1e6:.6g} MB" if count >= 1e6 else f"{count / 1e3:.6g} kB"


# --- YAML ---


def read_yaml(path: str | Path, *, noun: str, example: str) -> dict[str, Any]:
    """Reads the mapping of names and values in a YAML file; raises an InputError where it holds anything else."""
    import yaml

    try:
        text = read_bytes(path, limit=MAX_YAML_BYTES, noun=noun).decode("utf-8-sig")
        values = load_yaml(text)
    except UnicodeDecodeError:
        raise InputError(f"{noun} {path} is not valid YAML (it is no text in UTF-8); correct it") from None
    except yaml.YAMLError as error:
        raise InputError(f"{noun} {path} is not valid YAML ({' '.join(str(error).split())}); correct it") from None
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        raise InputError(f"{noun} {path} must hold {example}, got {shown(values)}")
    return dict(values)


def load_yaml(text: str) -> Any:
    """The value of a YAML text; raises yaml.YAMLError where it is malformed, gives a key twice or exceeds the limits."""
    import yaml

    if len(text) > MAX_YAML_BYTES:
        raise yaml.YAMLError(f"it is longer than {size(MAX_YAML_BYTES)}")
    _check_growth(text)
    try:
        return yaml.load(text, Loader=_loader())
    except ValueError as error:  # such as a date in the thirteenth month
        raise yaml.YAMLError(str(error)) from None


def _check_growth(text: str) -> None:
    """Refuses a text whose nesting, values or aliases exceed the limits, before anything is built from it."""
    import yaml

    count = 0
    begun: list[tuple[str | None, int]] = []
    weights: dict[str, int] = {}
    for event in _events(text):
        anchor, tag = getattr(event, "anchor", None), getattr(event, "tag", None)
        if tag not in (None, "!", "tag:yaml.org,2002:str"):
            raise yaml.YAMLError(f"it holds the tag {shown(tag)}; values are written without")
        if isinstance(event, yaml.AliasEvent):
            if anchor not in weights:
                raise yaml.YAMLError(f"alias *{shown(anchor)} stands for nothing, or for what holds it")
            count += weights[anchor]
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            weights[anchor or ""] = 1
        elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
            weights.pop(anchor or "", None)
            begun.append((anchor, count))
            count += 1
        elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
            name, before = begun.pop()
            weights[name or ""] = count - before
        if count > MAX_YAML_VALUES:
            raise yaml.YAMLError(
                f"it holds more than {MAX_YAML_VALUES} values, each alias counted as what it stands for"
            )
        if len(begun) > MAX_YAML_DEPTH:
            raise yaml.YAMLError(f"it is nested deeper than {MAX_YAML_DEPTH} levels")


def _events(text: str) -> Any:
    import yaml

    try:
        yield from yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (UnicodeEncodeError, ValueError, OverflowError) as error:
        raise yaml.YAMLError(f"it holds characters that no text has: {error}") from None
    except yaml.YAMLError as error:
        if "maximum nesting depth" in str(error):  # an error of PyYAML 6.0.4, which reads ahead
            raise yaml.YAMLError(f"it is nested deeper than {MAX_YAML_DEPTH} levels") from None
        raise


@cache
def _loader() -> Any:
    """PyYAML's safe loader, which in addition refuses a key given twice and numbers of thousands of digits."""
    import yaml

    class Loader(yaml.SafeLoader):
        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            if isinstance(node, yaml.MappingNode):
                # Checked before a merge (<<) brings in keys, which the mapping's own keys may replace.
                _check_keys([(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)])
            return super().construct_mapping(node, deep=deep)

    def whole_number(loader: Any, node: Any) -> Any:
        if len(str(node.value)) > MAX_YAML_DIGITS:
            raise yaml.YAMLError(f"it holds a number of more than {MAX_YAML_DIGITS} digits")
        return yaml.SafeLoader.construct_yaml_int(loader, node)

    Loader.add_constructor("tag:yaml.org,2002:int", whole_number)
    return Loader


def _check_keys(keys: list[tuple[str, Any]]) -> None:
    import yaml

    seen = set()
    for key in keys:
        if key in seen:
            raise yaml.YAMLError(f"key {shown(key[1])} is given twice")
        seen.add(key)
