"""A `Scene` as a Mitsuba/Sionna XML file with its meshes, for `sionna.rt.load_scene` too."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.types import Scene, Surface


def save_scene(scene: Scene, folder: str | Path) -> Path:
    """Writes `folder`/<name>.xml and a PLY file for each surface in `folder`/meshes; returns the XML file's path.

    Nothing stays behind if it fails; a folder that is there already is replaced if it holds a scene.
    """
    folder = Path(folder)
    if folder.exists() and not (folder.is_dir() and (not any(folder.iterdir()) or list(folder.glob("*.xml")))):
        raise InputError(f"{folder} exists and holds no scene; choose another folder")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise InputError(f"cannot write the scene to {folder}: {error.strerror}; choose another folder") from error
    try:
        (fresh / "meshes").mkdir()
        root = ElementTree.Element("scene", version="2.1.0")
        for key, surface in {_material(surface): surface for surface in scene.surfaces}.items():
            bsdf = ElementTree.SubElement(root, "bsdf", type="itu-radio-material", id=key)
            ElementTree.SubElement(bsdf, "string", name="type", value=str(surface.material))
            ElementTree.SubElement(bsdf, "float", name="thickness", value=f"{surface.thickness_m:.9g}")
        for surface in scene.surfaces:
            identity = _identity(surface.name)
            _write_ply(fresh / "meshes" / f"{identity}.ply", surface)
            shape = ElementTree.SubElement(root, "shape", type="ply", id=identity)
            ElementTree.SubElement(shape, "string", name="filename", value=f"meshes/{identity}.ply")
            ElementTree.SubElement(shape, "boolean", name="face_normals", value="true")
            ElementTree.SubElement(shape, "ref", id=_material(surface), name="bsdf")
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(fresh / f"{scene.name}.xml", encoding="utf-8")
        fresh.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        fresh.rename(folder)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise
    return folder / f"{scene.name}.xml"


def _material(surface: Surface) -> str:
    if not isinstance(surface.material, str):
        raise InputError(
            f"{surface.name} has a material of its own ({surface.material.name}), which a scene file cannot hold; use an ITU name"
        )
    return f"{surface.material}-{surface.thickness_m * 1e6:.0f}um"


def _identity(name: str) -> str:
    """A name that Mitsuba and file systems take."""
    return re.sub(r"[^A-Za-z0-9+_-]+", "-", name)


def _write_ply(path: Path, surface: Surface) -> None:
    """Binary PLY; float32, as Mitsuba reads it."""
    faces = np.zeros(len(surface.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, surface.faces
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(surface.vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + surface.vertices.astype("<f4").tobytes() + faces.tobytes())
