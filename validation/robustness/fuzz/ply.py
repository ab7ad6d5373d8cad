"""PLY files: whole ones, and damaged in their numbers, header and bytes."""

from __future__ import annotations

import numpy as np

from validation.robustness.fuzz.case import corrupted, pick

FLOOR = np.array([[-0.5, -2, 0], [5, -2, 0], [5, 2, 0], [-0.5, 2, 0]])
WALL = np.array([[5, -2, 0], [5, -2, 2.5], [5, 2, 2.5], [5, 2, 0]])
BOX = np.array([[3, 1, 0], [3.5, 1, 0], [3.5, 1.5, 0], [3.25, 1.25, 1]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])
FOUR = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A small binary PLY file."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", faces.shape[1])])
    rows["count"], rows["corners"] = faces.shape[1], faces
    return head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def mesh(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    """A PLY file, damaged; whether its numbers cannot be those of a mesh."""
    return pick(rng, (_numbers, _numbers, _corners, _corners, _header, _header, _bytes, _ascii))(rng, vertices, faces)


def _numbers(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    vertices = vertices.astype(float).copy()
    value = pick(rng, (np.nan, np.inf, -np.inf, 1e38, 1e30, 1e-40, 1e6, -1e4, 101.0, 0.0))
    how = pick(rng, ("one", "a vertex", "all", "an axis", "scaled", "all one point", "none", "many"))
    if how == "one":
        vertices[int(rng.integers(len(vertices))), int(rng.integers(3))] = value
    elif how == "a vertex":
        vertices[int(rng.integers(len(vertices)))] = value
    elif how == "all":
        vertices[:] = value
    elif how == "an axis":
        vertices[:, int(rng.integers(3))] = value
    elif how == "scaled":
        value = float(10 ** rng.uniform(-30, 3))
        vertices *= value
    elif how == "all one point":
        vertices[:] = vertices[0]
    elif how == "none":
        vertices = vertices[:0]
    elif how == "many":
        vertices = np.tile(vertices, (int(10 ** rng.uniform(2, 5)), 1))
    return f"coordinates {value:g}, {how}", ply(vertices, faces), not np.isfinite(vertices).all()


def _corners(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    faces = faces.copy()
    corner = int(rng.integers(len(faces))), int(rng.integers(3))
    value = pick(rng, (-1, len(vertices), len(vertices) + 1, 2**31 - 1, -(2**31), 10**6, 1000, 0))
    how = pick(
        rng,
        (
            "one", "one", "one", "a face of one corner", "all", "none", "many", "twice", "turned", "quads", "digons", "unused",
        ),
    )  # fmt: skip
    if how == "one":
        faces[corner] = value
    elif how == "a face of one corner":
        faces[corner[0]] = faces[corner]
    elif how == "all":
        faces[:] = value
    elif how == "none":
        faces = faces[:0]
    elif how == "many":
        faces = np.tile(faces, (int(10 ** rng.uniform(2, 4.5)), 1))
    elif how == "twice":
        faces = np.concatenate([faces, faces])
    elif how == "turned":
        faces = np.concatenate([faces, faces[:, ::-1]])
    elif how == "quads":
        faces = np.concatenate([faces, faces[:, :1]], axis=1)
    elif how == "digons":
        faces = faces[:, :2]
    elif how == "unused":
        vertices = np.concatenate([vertices, np.full((3, 3), 90.0)])
    return f"corners {value}, {how}", ply(vertices, faces), bool(((faces < 0) | (faces >= len(vertices))).any())


def _header(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    data = ply(vertices, faces)
    old, new = pick(
        rng,
        [
            (f"element vertex {len(vertices)}", f"element vertex {count}")
            for count in ("0", "-1", "1", "999999999", "99999999999999999999", "4294967296", "x", "", "3.5", "1e9")
        ]
        + [
            (f"element face {len(faces)}", f"element face {count}")
            for count in ("0", "-1", "1", "999999999", "99999999999999999999", "4294967295", "x", "", "2 2")
        ]
        + [
            ("property float x", "property double x"), ("property float x", "property list uchar float x"),
            ("property float x", "property uchar x"),
            ("property float x\n", ""), ("property float x", "property float y"), ("property float x",
            "property float x\nproperty float u"),
            ("list uchar int", "list int int"), ("list uchar int", "list float int"), ("list uchar int", "list uchar float"),
            ("list uchar int", "list uchar double"), ("list uchar int", "list uchar ushort"), ("vertex_indices",
            "vertex_index"),
            ("vertex_indices", "corners"), ("end_header\n", ""), ("end_header", "END_HEADER"), ("ply\n", "PLY\n"), ("ply\n",
            "ply\r\n"),
            ("ply\n", ""), ("binary_little_endian 1.0", "binary_big_endian 1.0"), ("binary_little_endian 1.0", "ascii 1.0"),
            ("binary_little_endian 1.0", "binary_little_endian 9.9"), ("binary_little_endian", "binary_middle_endian"),
            ("element face", "element edge 0\nelement face"), ("element face", "element tree"), ("element vertex",
            "element face"),
            ("ply\n", "ply\ncomment " + "x" * 10**5 + "\n"), ("ply\n", "ply\ncomment \x1b[31m\n"), ("ply\n",
            "ply\n" + "comment\n" * 10**4),
            ("end_header", "property int nx\nend_header"), ("end_header", "element vertex 4\nproperty float x\nend_header"),
        ],
    )  # fmt: skip
    return f"{old.strip()[:30]!r} -> {new.strip()[:40]!r}", data.replace(old.encode(), new.encode(), 1), False


def _bytes(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    return (*corrupted(rng, ply(vertices, faces)), False)


def _ascii(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, bytes, bool]:
    """The same in words, one of them replaced."""
    head = ply(vertices, faces).split(b"end_header\n")[0].replace(b"binary_little_endian", b"ascii") + b"end_header\n"
    words = [[f"{x:g}" for x in row] for row in vertices] + [["3", *map(str, row)] for row in faces]
    row = pick(rng, words)
    at = int(rng.integers(len(row)))
    row[at] = value = pick(rng, ("nan", "inf", "x", "", "1e400", "-1", "99", "1,5", "4", "3.7", "\0", "2"))
    return f"in words, one {value!r}", head + "\n".join(" ".join(row) for row in words).encode() + b"\n", False
