"""Reads triangle meshes from PLY and OBJ files, strictly: no more memory is allocated than the content of the file needs."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices [m], float64 (V, 3), and triangles, int64 (F, 3)."""

MAX_MESH_BYTES = 16_000_000
MAX_ROWS = 500_000
"""Greatest number of vertices, and of faces, in a file: as many as a whole scene may have."""
MAX_PROPERTIES = 20
_NAMES = "char int8 uchar uint8 short int16 ushort uint16 int int32 uint uint32 float float32 double float64"
TYPES = dict(zip(_NAMES.split(), "bbBBhhHHiiIIffdd", strict=True))
"""Scalar types of PLY, as codes of `struct`."""
FLOATS = "fd"
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")


def read_mesh(path: Path) -> Mesh:
    """The mesh in a PLY or OBJ file of at most `MAX_MESH_BYTES`; coordinates are rounded to float32, as ray tracers do."""
    return parsed_mesh(read_bytes(path, limit=MAX_MESH_BYTES, noun="mesh file"), path)


def parsed_mesh(data: bytes, path: Path) -> Mesh:
    """The mesh in the bytes of the file at `path`, whose suffix determines the format."""
    try:
        if path.suffix.lower() == ".ply":
            return _checked(*_ply(data))
        if path.suffix.lower() == ".obj":
            return _checked(*_obj(data))
        raise InputError("is neither a .ply nor an .obj file")
    except InputError as error:
        raise InputError(f"mesh {path} {error}; export it again, as triangles in metres") from None


def _checked(points: np.ndarray | Sequence[Sequence[float]], polygons: Sequence[Sequence[int]]) -> Mesh:
    """Vertices and triangles of polygons, each divided into a fan around its first corner; refuses values that are not finite and
    indices without a vertex."""
    if not len(points) or not polygons:
        raise InputError("holds no face" if len(points) else "holds no vertex")
    with np.errstate(over="ignore"):  # values that exceed float32 become infinite here and are refused below
        vertices = np.array(points, np.float64).astype(np.float32).astype(np.float64)
    if not np.isfinite(vertices).all():
        raise InputError(f"has {np.count_nonzero(~np.isfinite(vertices))} NaN or infinite coordinates")
    triangles = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    lowest, highest = min(map(min, triangles)), max(map(max, triangles))
    if lowest < 0 or highest >= len(vertices):
        wrong = lowest if lowest < 0 else highest
        raise InputError(f"has a face at vertex {wrong}, which does not exist: its vertices are 0..{len(vertices) - 1}")
    return vertices, np.array(triangles, np.int64)


def _check_count(count: int, noun: str) -> None:
    if count > MAX_ROWS:
        raise InputError(f"has {count} {noun}, more than {MAX_ROWS}")


# --- PLY (G. Turk, The PLY polygon file format, 1994) ---


@dataclass(frozen=True, slots=True)
class _Property:
    """A column of a PLY element: a scalar, or a list preceded by its length."""

    name: str
    kind: str
    count_kind: str = ""
    """Type of the length of a list; empty for a scalar."""


@dataclass(frozen=True, slots=True)
class _Element:
    """A table of a PLY file: its number of rows and their properties."""

    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        """Names of its properties, in order."""
        return [column.name for column in self.properties]


def _ply(data: bytes) -> tuple[np.ndarray, list[list[int]]]:
    """Coordinates (V, 3) and polygons of a PLY file."""
    order, (vertex, face), start = _ply_header(data)
    values = _Binary(data, start, order) if order else _Ascii(data[start:].split())
    corners = next(place for place, column in enumerate(face.properties) if column.name in CORNERS)
    polygons = []
    try:
        points = values.table(vertex)
        for _ in range(face.count):
            row = [values.take(column.kind, _count(values, column)) for column in face.properties]
            polygons.append(row[corners])
    except (struct.error, ValueError):
        raise InputError(
            f"is cut short or damaged: {vertex.count} vertices and {face.count} faces cannot be read"
        ) from None
    for polygon in polygons:
        if len(polygon) not in (3, 4):
            raise InputError(f"has a face of {len(polygon)} corners instead of 3 or 4")
    return points[:, [vertex.names.index(axis) for axis in "xyz"]], polygons


def _ply_header(data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order (empty for ASCII), the elements vertex and face, and the offset of their values."""
    # The lazy group matches the shortest header, as "end_header" may occur in the values, too.
    header = re.match(rb"ply[ \t]*\r?\n(.*?\n)??end_header[ \t]*\r?\n", data[:64_000], re.DOTALL)
    if header is None:
        raise InputError("is not a PLY file: it has no header from 'ply' to 'end_header'")
    order: str | None = None
    elements: list[_Element] = []
    for line in (header[1] or b"").decode("ascii", "replace").split("\n"):
        match line.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in ORDERS and order is None:
                order = ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < 20:
                _check_count(int(count), f"rows of element {shown(name)}")
                elements.append(_Element(name, int(count)))
            case ["property", kind, name] if kind in TYPES and elements:
                elements[-1].properties.append(_Property(name, TYPES[kind]))
            case ["property", "list", count, kind, name] if (
                {count, kind} <= TYPES.keys() and elements and TYPES[count] not in FLOATS
            ):
                elements[-1].properties.append(_Property(name, TYPES[kind], TYPES[count]))
            case _:
                raise InputError(f"has a PLY header whose line {shown(line)} cannot be read")
    if order is None:
        raise InputError(f"has a PLY header without a format, one of {', '.join(ORDERS)}")
    _check_elements(elements)
    return order, elements[:2], header.end()


def _check_elements(elements: list[_Element]) -> None:
    """Refuses a file unless it begins with vertices of three coordinates, followed by faces of one list of integers."""
    if [element.name for element in elements[:2]] != ["vertex", "face"]:
        raise InputError("has a PLY header that does not begin with element vertex and then element face")
    vertex, face = elements[:2]
    for element in (vertex, face):
        if len(set(element.names)) < len(element.names) or len(element.names) > MAX_PROPERTIES:
            twice = f"twice, or more than {MAX_PROPERTIES} of them"
            raise InputError(f"has a PLY header that gives a property of element {element.name} {twice}")
    kinds = {column.name: column.kind for column in vertex.properties}
    if not {"x", "y", "z"} <= kinds.keys() or any(kinds[axis] not in FLOATS for axis in "xyz"):
        raise InputError("has a PLY header without x, y and z of type float or double")
    if any(column.count_kind for column in vertex.properties):
        raise InputError("has a PLY header with lists in element vertex")
    corners = [column for column in face.properties if column.name in CORNERS]
    if len(corners) != 1 or not corners[0].count_kind or corners[0].kind in FLOATS:
        raise InputError("has a PLY header without a list vertex_indices of whole numbers")


def _count(values: _Binary | _Ascii, column: _Property) -> int:
    """Number of values of a property that come next, which for a list is given by the number before it."""
    return int(values.take(column.count_kind, 1)[0]) if column.count_kind else 1


class _Binary:
    """Reads numbers one after another from bytes; raises struct.error where they end."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data, self._at, self._order = data, start, order

    def take(self, kind: str, count: int) -> list[Any]:
        """The next `count` values of a type."""
        length = count * struct.calcsize("=" + kind)
        if not 0 <= length <= len(self._data) - self._at:  # checked before a format string of that length is made
            raise struct.error
        values = struct.unpack_from(f"{self._order}{count}{kind}", self._data, self._at)
        self._at += length
        return list(values)

    def table(self, element: _Element) -> np.ndarray:
        """The rows (R, P) of an element without lists, float64."""
        row = np.dtype([(str(place), self._order + column.kind) for place, column in enumerate(element.properties)])
        if element.count * row.itemsize > len(self._data) - self._at:
            raise struct.error
        rows = np.frombuffer(self._data, row, element.count, self._at)
        self._at += rows.nbytes
        return np.stack([rows[name].astype(np.float64) for name in row.fields or {}], axis=1)


class _Ascii:
    """Reads numbers one after another from words; raises struct.error where they end, ValueError where a word is no number."""

    def __init__(self, words: list[bytes]) -> None:
        self._words, self._at = words, 0

    def take(self, kind: str, count: int) -> list[Any]:
        """The next `count` values of a type."""
        if not 0 <= count <= len(self._words) - self._at:
            raise struct.error
        words = self._words[self._at : self._at + count]
        self._at += count
        return [_number(word) if kind in FLOATS else _whole(word) for word in words]

    def table(self, element: _Element) -> np.ndarray:
        """The rows (R, P) of an element without lists, float64."""
        values = self.take("d", element.count * len(element.properties))
        return np.array(values).reshape(element.count, len(element.properties))


def _number(word: bytes) -> float:
    """A number in the notation of files; Python's own parser would accept underscores, too."""
    if b"_" in word:
        raise ValueError(word)
    return float(word)


def _whole(word: bytes) -> int:
    if b"_" in word or len(word) > 20:
        raise ValueError(word)
    return int(word)


# --- OBJ (Wavefront) ---


def _obj(data: bytes) -> tuple[list[list[float]], list[list[int]]]:
    """Coordinates and polygons of an OBJ file; materials, texture and normals are ignored, and no other file is read."""
    points: list[list[float]] = []
    polygons: list[list[int]] = []
    triangles = 0
    for number, line in enumerate(data.splitlines(), 1):
        try:
            match line.split():
                case [b"v", x, y, z, *_]:
                    points.append([_number(x), _number(y), _number(z)])
                case [b"f", _, _, _, *_] as words:
                    polygons.append([_corner(word, len(points)) for word in words[1:]])
                    triangles += len(words) - 3
                case [b"v" | b"f", *_]:
                    raise ValueError
        except ValueError:
            text = line.decode("utf-8", "replace")
            raise InputError(f"has a line {number} that cannot be read, {shown(text)}") from None
        _check_count(len(points), "vertices or more")
        _check_count(triangles, "triangles or more")
    return points, polygons


def obj_labels(data: bytes) -> list[tuple[str, str]]:
    """Object or group, and material, of each triangle of an OBJ file that `parsed_mesh` has read; empty where there is none."""
    labels: list[tuple[str, str]] = []
    name = material = ""
    for line in data.splitlines():
        match line.split(maxsplit=1):
            case [b"o" | b"g", *rest]:
                name = b" ".join(rest).decode("utf-8", "replace").strip()
            case [b"usemtl", *rest]:
                material = b" ".join(rest).decode("utf-8", "replace").strip()
            case [b"f", corners]:
                labels += [(name, material)] * (len(corners.split()) - 2)
    return labels


def _corner(word: bytes, vertices: int) -> int:
    """Index of a vertex from 0: OBJ files count from 1, or backwards from the latest."""
    number = _whole(word.partition(b"/")[0])
    if not number:
        raise ValueError(word)
    return number - 1 if number > 0 else vertices + number
