"""Read an animation of a .glb file (glTF 2.0, Khronos) as a raw skeleton in time: metres, y up, the file's own interpolation.

The joints are those of its skins, else all nodes that are animated and their children. The place of a node at an instant follows
from the product of the transforms above it; scales move joints but do not turn them.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.errors import InputError, printable, warn
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.quaternions import conjugate, from_matrix, multiply, normalise, rotate
from t2d_rt.motion.read.bvh import MAX_FRAMES, MAX_JOINTS, RawSkeleton, of_poses
from t2d_rt.motion.read.clock import tidy

MAX_BYTES = 150_000_000
MAX_NODES = 20_000
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS: Mapping[int, tuple[str, float]] = {
    5120: ("<i1", 127.0), 5121: ("<u1", 255.0), 5122: ("<i2", 32767.0), 5123: ("<u2", 65535.0), 5126: ("<f4", 1.0),
}  # fmt: skip
"""Types of numbers, and the number that integers are divided by (glTF 2.0, 3.11)."""
DEFAULTS = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}

Curve = tuple[np.ndarray, np.ndarray, str]
"""Times [s] (K,), values (K, 3 or 4), or (3 K, ...) of splines, and the name of the interpolation."""


@dataclass(frozen=True, slots=True)
class _Gltf:
    """The JSON of a file, and its binary chunk."""

    path: Path
    tree: dict[str, Any]
    binary: bytes

    def list(self, name: str) -> list[Any]:
        """One of its lists of objects."""
        objects = self.tree.get(name, [])
        if not isinstance(objects, list) or not all(isinstance(item, dict) for item in objects):
            raise InputError(f"{self.path}: {name} must be a list of objects; the file is damaged")
        return objects

    def numbers(self, accessor: int) -> np.ndarray:
        """The rows (K, N) of an accessor; raises an InputError if it cannot be read."""
        try:
            entry = self.list("accessors")[accessor]
            view = self.list("bufferViews")[entry["bufferView"]]
            kind, whole = COMPONENTS[entry["componentType"]]
            width, count = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]], int(entry["count"])
            start = int(view.get("byteOffset", 0)) + int(entry.get("byteOffset", 0))
            row = width * np.dtype(kind).itemsize
            step = int(view.get("byteStride", row))
            if "sparse" in entry or "extensions" in view or view.get("buffer") or "uri" in self.list("buffers")[0]:
                raise InputError(
                    f"{self.path}: its animation is sparse, compressed or in another file; export it as a plain .glb"
                )
            if not (0 < count <= 1_000_000 and start >= 0 and row <= step <= 255):
                raise ValueError
            values = np.ndarray((count, width), kind, self.binary, start, (step, np.dtype(kind).itemsize))
        except InputError:
            raise
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            raise InputError(
                f"{self.path}: accessor {accessor} cannot be read; the file is cut short or damaged"
            ) from None
        return np.maximum(values.astype(float) / whole, -1.0) if whole > 1 else values.astype(float)


def read_gltf(path: Path) -> RawSkeleton:
    """The joints of a .glb file in its first animation; a warning names the others. Raises an InputError if it holds none."""
    file = _opened(path)
    nodes, animations = file.list("nodes"), file.list("animations")
    if not animations:
        raise InputError(f"{path} holds no animation; export it with one, or give it as a mesh (MovingMesh)")
    if not nodes or len(nodes) > MAX_NODES:
        raise InputError(f"{path} holds {len(nodes)} nodes; expected 1 to {MAX_NODES}")
    if len(animations) > 1:
        titles = [printable(str(entry.get("name", number)))[:60] for number, entry in enumerate(animations)]
        warn(
            f"{path.name} holds {len(animations)} animations, {', '.join(titles[:9])}: the first is read; export one alone"
        )
    above = _parents(nodes, path)
    moved = _channels(file, animations[0], len(nodes))
    times, rate_hz = _clock(moved, path)
    joints = _joints(file, nodes, above, {node for node, _ in moved})
    # Each transform takes 128 bytes; the limit is ten minutes of 100 joints at 60 Hz.
    if len(times) * len(nodes) > 4_000_000:
        raise InputError(
            f"{path}: {len(times)} frames of {len(nodes)} nodes are too many; cut the motion, or export the bones alone"
        )
    matrices = _global(nodes, above, moved, times, path)
    # Rotations count from the rest pose, as in a BVH file.
    rest = _global(nodes, above, {}, times[:1], path)
    placed, turned = np.zeros((len(times), len(joints), 3)), np.zeros((len(times), len(joints), 4))
    for number, node in enumerate(joints):
        placed[:, number] = matrices[node][:, :3, 3]
        turned[:, number] = multiply(_turn(matrices[node][:, :3, :3]), conjugate(_turn(rest[node][:, :3, :3])))
    names = tuple(numbered((printable(str(nodes[node].get("name", f"node {node}"))) for node in joints), "#"))
    place = {node: number for number, node in enumerate(joints)}
    return of_poses(names, tuple(place.get(above[node], -1) for node in joints), placed, turned, rate_hz)


def _opened(path: Path) -> _Gltf:
    data = read_bytes(path, limit=MAX_BYTES, noun="GLB file")
    try:
        magic, version, _, length, kind = struct.unpack_from("<4sIIII", data)
        if magic != b"glTF" or version != 2 or kind != JSON_CHUNK:
            raise ValueError
        tree = json.loads(data[20 : 20 + length])
        binary = data[20 + length :]
        if binary and struct.unpack_from("<II", binary)[1] == BINARY_CHUNK:
            binary = binary[8 : 8 + struct.unpack_from("<I", binary)[0]]
    except (struct.error, ValueError, RecursionError):
        raise InputError(f"{path} is not a .glb file of glTF 2.0, or cut short; export it again") from None
    if not isinstance(tree, dict):
        raise InputError(f"{path} is not a .glb file of glTF 2.0; export it again")
    return _Gltf(path, tree, binary)


def _list_of(numbers: Any, path: Path) -> list[Any]:
    """The list of nodes' numbers; raises an InputError if it is none."""
    if not isinstance(numbers, list) or not all(type(number) is int for number in numbers):
        raise InputError(f"{path}: nodes must be listed by their numbers, got {shown(numbers)}; the file is damaged")
    return numbers


def _parents(nodes: list[Any], path: Path) -> list[int]:
    """Number of the node above each node, -1 if there is none."""
    above = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        for child in _list_of(node.get("children", []), path):
            if not isinstance(child, int) or not 0 <= child < len(nodes) or above[child] >= 0:
                raise InputError(f"{path}: node {number} has a child {shown(child)} that is none; the file is damaged")
            above[child] = number
    return above


def _channels(file: _Gltf, animation: dict[str, Any], nodes: int) -> dict[tuple[int, str], Curve]:
    """Curves by node and by the property that they move: translation, rotation or scale."""
    curves: dict[tuple[int, str], Curve] = {}
    try:
        for channel in animation["channels"]:
            node, what = channel["target"].get("node"), channel["target"]["path"]
            if node is None or what not in DEFAULTS:
                continue
            sampler = animation["samplers"][channel["sampler"]]
            how = sampler.get("interpolation", "LINEAR")
            keys, values = file.numbers(sampler["input"])[:, 0], file.numbers(sampler["output"])
            fits = len(values) == len(keys) * (3 if how == "CUBICSPLINE" else 1) and how in _BETWEEN
            sound = np.isfinite(keys).all() and np.isfinite(values).all() and (np.diff(keys) > 0).all()
            if not (fits and sound and 0 <= node < nodes and values.shape[1] == len(DEFAULTS[what])):
                raise InputError(f"{file.path}: the keys of node {node} are not times in order with a {what} each")
            curves[node, what] = keys, values, how
    except (KeyError, IndexError, TypeError, AttributeError):
        raise InputError(f"{file.path}: its animation cannot be read; the file is damaged") from None
    if not curves:
        raise InputError(f"{file.path}: its animation moves no node; export one of a skeleton")
    return curves


def _clock(moved: Mapping[tuple[int, str], Curve], path: Path) -> tuple[np.ndarray, float]:
    """Even instants [s] from the first key to the last one, and their rate [Hz], which is that of the closest keys."""
    instants = np.unique(np.concatenate([keys for keys, *_ in moved.values()]))
    steps = np.concatenate([np.diff(keys) for keys, *_ in moved.values()])
    if not len(steps):
        raise InputError(f"{path}: its animation has a single instant; a motion needs at least 2 frames")
    rate_hz = min(tidy(1.0 / float(np.percentile(steps, 5)), 5e-3), 240.0)
    count = round(float(instants[-1] - instants[0]) * rate_hz) + 1
    if not 2 <= count <= MAX_FRAMES:
        raise InputError(f"{path}: {count} frames at {rate_hz:g} Hz; expected 2 to {MAX_FRAMES}")
    return np.minimum(instants[0] + np.arange(count) / rate_hz, instants[-1]), rate_hz


def _joints(file: _Gltf, nodes: list[Any], above: list[int], moved: set[int]) -> list[int]:
    """The nodes that are joints, parents before children."""
    joints = {node for skin in file.list("skins") for node in _list_of(skin.get("joints", []), file.path)} or set(moved)
    if not all(isinstance(node, int) and 0 <= node < len(nodes) for node in joints):
        raise InputError(f"{file.path}: a skin names a joint that is no node; the file is damaged")
    if not file.list("skins"):  # ends of limbs are not animated
        joints |= {node for node in range(len(nodes)) if above[node] in joints and "mesh" not in nodes[node]}
    if len(joints) > MAX_JOINTS:
        raise InputError(f"{file.path} has {len(joints)} joints, more than {MAX_JOINTS}")
    return [node for node in _downward(above, file.path) if node in joints]


def _downward(above: list[int], path: Path) -> list[int]:
    """All nodes, parents before children."""
    depth = []
    for node in range(len(above)):
        steps, here = 0, node
        while above[here] >= 0:
            here, steps = above[here], steps + 1
            if steps > len(above):
                raise InputError(f"{path}: its nodes carry one another in a ring; the file is damaged")
        depth.append(steps)
    return sorted(range(len(above)), key=depth.__getitem__)


def _global(
    nodes: list[Any], above: list[int], moved: Mapping[tuple[int, str], Curve], times: np.ndarray, path: Path
) -> dict[int, np.ndarray]:
    """Transforms (T, 4, 4) of all nodes to the scene's axes."""
    transforms: dict[int, np.ndarray] = {}
    for node in _downward(above, path):
        try:
            local = _local(nodes[node], {what: moved[node, what] for what in DEFAULTS if (node, what) in moved}, times)
        except (TypeError, ValueError):
            raise InputError(f"{path}: the transform of node {node} is none; the file is damaged") from None
        transforms[node] = local if above[node] < 0 else transforms[above[node]] @ local
    return transforms


def _local(node: dict[str, Any], moved: Mapping[str, Curve], times: np.ndarray) -> np.ndarray:
    """Transforms (T, 4, 4) of a node against the one above, or (1, 4, 4) if nothing moves it."""
    if "matrix" in node and not moved:
        return np.array(node["matrix"], float).reshape(1, 4, 4).swapaxes(1, 2)
    at = {
        what: _BETWEEN[moved[what][2]](*moved[what][:2], times)
        if what in moved
        else np.array(node.get(what, default), float).reshape(1, len(default))
        for what, default in DEFAULTS.items()
    }
    frames = max(map(len, at.values()))
    matrix = np.tile(np.eye(4), (frames, 1, 1))
    axes = at["scale"][:, :, None] * rotate(normalise(at["rotation"])[:, None], np.eye(3))
    matrix[:, :3, :3] = axes.swapaxes(1, 2)
    matrix[:, :3, 3] = at["translation"]
    return matrix


def _turn(matrices: np.ndarray) -> np.ndarray:
    """Rotations (T, 4) of matrices (T, 3, 3) without their scales: the columns are made orthonormal in turn."""
    x, y = (matrices[..., k] for k in (0, 1))
    x = normalise(x)
    y = normalise(y - (y * x).sum(axis=-1, keepdims=True) * x)
    return from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


def _steps(keys: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (T,) of the keys before and after each instant, and the fraction (T, 1) of the way between them."""
    after = np.clip(np.searchsorted(keys, times, side="right"), 1, max(len(keys) - 1, 1))
    before, after = after - 1, np.minimum(after, len(keys) - 1)
    gone = (times - keys[before]) / np.maximum(keys[after] - keys[before], 1e-12)
    return before, after, np.clip(gone, 0.0, 1.0)[:, None]


def _held(keys: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    return values[np.clip(np.searchsorted(keys, times + 1e-6, side="right") - 1, 0, len(keys) - 1)]


def _linear(keys: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Linear interpolation, of rotations along the great circle (glTF 2.0, C.3 and C.4)."""
    before, after, gone = _steps(keys, times)
    first, last = values[before], values[after]
    if values.shape[1] == 3:
        return first + gone * (last - first)
    cosine = (first * last).sum(axis=1, keepdims=True)
    last, angle = np.where(cosine < 0, -last, last), np.arccos(np.minimum(np.abs(cosine), 1.0))
    small = angle < 1e-4
    weights = [
        np.where(small, part, np.sin(part * angle) / np.where(small, 1.0, np.sin(angle))) for part in (1 - gone, gone)
    ]
    return weights[0] * first + weights[1] * last


def _spline(keys: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Cubic Hermite splines: three rows a key, tangent in, value, tangent out (glTF 2.0, C.5)."""
    before, after, t = _steps(keys, times)
    into, at, out = (values[k::3] for k in range(3))
    span = (keys[after] - keys[before])[:, None]
    return (
        (2 * t**3 - 3 * t**2 + 1) * at[before]
        + span * (t**3 - 2 * t**2 + t) * out[before]
        + (3 * t**2 - 2 * t**3) * at[after]
        + span * (t**3 - t**2) * into[after]
    )


_BETWEEN = {"STEP": _held, "LINEAR": _linear, "CUBICSPLINE": _spline}
