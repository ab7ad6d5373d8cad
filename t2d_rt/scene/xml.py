"""Writes a `Scene` as a Mitsuba/Sionna XML file with its meshes, which `sionna.rt.load_scene` reads, too."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from t2d_rt.core.atomic_write import replacing, settle
from t2d_rt.core.checks import file_path, instance
from t2d_rt.core.errors import InputError
from t2d_rt.types import Scene, Surface

MARK = " made by t2d-rt "
"""Comment at the beginning of a scene file that `save_scene` wrote."""
BEGINNING = re.compile(
    rf'<scene version="2\.1\.0">\s*(<!--{MARK}-->\s*)?<bsdf type="itu-radio-material" id="[^"]+-\d+um">'
)
"""Pattern for the beginning of a scene file that `save_scene` wrote, the only one whose folder is replaced; older ones have no
mark."""


def save_scene(scene: Scene, folder: str | Path) -> Path:
    """Writes `folder`/<name>.xml and a PLY file for each surface in `folder`/meshes; returns the XML file's path.

    If it fails, nothing is changed. An existing folder is replaced only if it is empty or holds nothing but a scene that this
    function wrote.
    """
    instance("scene", scene, Scene, "a Scene", hint="load_scene or Room.scene() makes one")
    target = file_path("folder", folder).resolve()
    if not scene.name or Path(scene.name).name != scene.name:
        raise InputError(f"scene name {scene.name!r} cannot be the name of a file; give one without slashes")
    # A folder left by a killed run is repaired first: it then holds the old scene or the new one, complete.
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        settle(target)
        _check_replaceable(target)
    except OSError as error:
        raise InputError(f"cannot write the scene to {folder}: {error.strerror}; choose another folder") from error
    with replacing(target, partial(_check_replaceable, target)) as new:
        _write(scene, new)
    return Path(folder) / f"{scene.name}.xml"


def _check_replaceable(folder: Path) -> None:
    """Refuses a folder that holds anything but a scene written by `save_scene`."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    files = [path for path in folder.rglob("*") if not path.is_dir()] if folder.is_dir() else []
    scenes = [path for path in files if path.parent == folder and path.suffix == ".xml" and path.is_file()]
    if len(scenes) != 1 or not BEGINNING.match(_beginning(scenes[0])):
        raise InputError(f"{folder} exists and holds no scene that t2d-rt wrote; choose another folder")
    for path in files:
        if path != scenes[0] and not (path.parent == folder / "meshes" and path.suffix == ".ply"):
            raise InputError(f"{folder} is not replaced, for it holds {path.name} besides a scene; move that elsewhere")


def _beginning(file: Path) -> str:
    with file.open(encoding="utf-8", errors="replace") as text:
        return text.read(1000)


def _write(scene: Scene, folder: Path) -> None:
    """Writes the XML file and the meshes of a scene to a new folder."""
    (folder / "meshes").mkdir(parents=True)
    root = ElementTree.Element("scene", version="2.1.0")
    root.append(ElementTree.Comment(MARK))
    for key, surface in {_material(surface): surface for surface in scene.surfaces}.items():
        bsdf = ElementTree.SubElement(root, "bsdf", type="itu-radio-material", id=key)
        ElementTree.SubElement(bsdf, "string", name="type", value=str(surface.material))
        ElementTree.SubElement(bsdf, "float", name="thickness", value=f"{surface.thickness_m:.9g}")
    for surface in scene.surfaces:
        identity = _identity(surface.name)
        mesh = folder / "meshes" / f"{identity}.ply"
        if mesh.exists():
            raise InputError(f"two surfaces would both be written to {mesh.name} ({surface.name!r}); rename one")
        _write_ply(mesh, surface)
        shape = ElementTree.SubElement(root, "shape", type="ply", id=identity)
        ElementTree.SubElement(shape, "string", name="filename", value=f"meshes/{identity}.ply")
        ElementTree.SubElement(shape, "boolean", name="face_normals", value="true")
        ElementTree.SubElement(shape, "ref", id=_material(surface), name="bsdf")
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(folder / f"{scene.name}.xml", encoding="utf-8")


def _material(surface: Surface) -> str:
    """The id of a surface's material in the file: its ITU name and thickness in micrometres."""
    if not isinstance(surface.material, str):
        raise InputError(
            f"{surface.name} has a material of its own ({surface.material.name}), which a scene file cannot hold; use an ITU name"
        )
    return f"{surface.material}-{surface.thickness_m * 1e6:.0f}um"


def _identity(name: str) -> str:
    """A name that is valid for Mitsuba and for file systems."""
    return re.sub(r"[^A-Za-z0-9+_-]+", "-", name)


def _write_ply(path: Path, surface: Surface) -> None:
    """Writes a binary PLY file in float32, as Mitsuba reads it."""
    faces = np.zeros(len(surface.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, surface.faces
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(surface.vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + surface.vertices.astype("<f4").tobytes() + faces.tobytes())
