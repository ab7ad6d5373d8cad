"""Makes the furniture in meshes/furniture: boxes, one PLY file for each material of a piece.

    python meshes/make_furniture.py

Pieces stand on z = 0 with their middle at the origin and look along +x; metres. A file's name is
<piece>.<ITU material>.ply. Sizes are ordinary. Parts of one piece touch but do not overlap, so that no two faces lie in one place.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

Box = tuple[str, tuple[float, float, float], tuple[float, float, float]]
"""Material, size along x, y, z, and lowest corner."""


def legs(material: str, length: float, width: float, height: float, thick: float) -> list[Box]:
    """Four legs under the corners of a plate of `length` x `width`."""
    ends = [(-length / 2, length / 2 - thick), (-width / 2, width / 2 - thick)]
    return [(material, (thick, thick, height), (x, y, 0.0)) for x in ends[0] for y in ends[1]]


def middle(material: str, size: tuple[float, float, float], z: float, x: float = 0.0, y: float = 0.0) -> Box:
    """A box whose middle stands over (x, y)."""
    return material, size, (x - size[0] / 2, y - size[1] / 2, z)


PIECES: dict[str, list[Box]] = {
    "table": [middle("wood", (0.9, 1.6, 0.03), 0.72), *legs("wood", 0.84, 1.54, 0.72, 0.06)],
    "desk": [middle("chipboard", (0.7, 1.4, 0.025), 0.715), *legs("metal", 0.66, 1.36, 0.715, 0.04)],
    "chair": [
        middle("wood", (0.42, 0.42, 0.03), 0.43), *legs("wood", 0.40, 0.40, 0.43, 0.035),
        middle("wood", (0.025, 0.40, 0.45), 0.46, x=-0.19),
    ],
    "coffee_table": [middle("glass", (0.6, 1.1, 0.008), 0.40), *legs("metal", 0.56, 1.06, 0.40, 0.03)],
    "sofa": [
        middle("chipboard", (0.90, 1.56, 0.40), 0.06), middle("chipboard", (0.20, 1.56, 0.42), 0.46, x=-0.35),
        middle("chipboard", (0.90, 0.20, 0.60), 0.06, y=-0.88), middle("chipboard", (0.90, 0.20, 0.60), 0.06, y=0.88),
    ],
    "armchair": [
        middle("chipboard", (0.80, 0.56, 0.38), 0.06), middle("chipboard", (0.18, 0.56, 0.42), 0.44, x=-0.31),
        middle("chipboard", (0.80, 0.16, 0.54), 0.06, y=-0.36), middle("chipboard", (0.80, 0.16, 0.54), 0.06, y=0.36),
    ],
    "bookcase": [
        middle("chipboard", (0.018, 0.80, 1.90), 0.0, x=-0.141),
        *[middle("chipboard", (0.282, 0.020, 1.90), 0.0, x=0.009, y=y) for y in (-0.39, 0.39)],
        *[middle("chipboard", (0.282, 0.76, 0.020), z, x=0.009) for z in (0.06, 0.50, 0.95, 1.40, 1.85)],
    ],
    "cupboard": [middle("metal", (0.45, 0.90, 1.90), 0.05)],
    "wardrobe": [middle("chipboard", (0.60, 1.50, 2.05), 0.04)],
    "sideboard": [middle("wood", (0.45, 1.60, 0.60), 0.12)],
    "television": [middle("glass", (0.03, 1.12, 0.64), 0.06), middle("metal", (0.22, 0.50, 0.02), 0.0)],
    "bed": [
        middle("chipboard", (2.00, 1.40, 0.20), 0.12), middle("chipboard", (1.96, 1.36, 0.20), 0.34),
        middle("wood", (0.04, 1.44, 0.95), 0.0, x=-1.03),
    ],
    "bedside_table": [middle("wood", (0.40, 0.45, 0.50), 0.05)],
    "hospital_bed": [
        middle("metal", (2.05, 0.90, 0.06), 0.44), middle("chipboard", (1.95, 0.85, 0.14), 0.52),
        *legs("metal", 1.90, 0.80, 0.44, 0.05),
        middle("metal", (0.03, 0.90, 0.50), 0.46, x=-1.05), middle("metal", (0.03, 0.90, 0.36), 0.46, x=1.05),
    ],
    "trolley": [
        middle("metal", (0.45, 0.60, 0.02), 0.20), middle("metal", (0.45, 0.60, 0.02), 0.80),
        *[(m, s, (x, y, 0.22)) for m, s, (x, y, _) in legs("metal", 0.43, 0.58, 0.58, 0.025)],
        *legs("metal", 0.43, 0.58, 0.20, 0.025),
    ],
    "screen": [middle("plasterboard", (0.03, 1.60, 1.70), 0.10), *[
        middle("metal", (0.40, 0.04, 0.04), 0.06, y=y) for y in (-0.75, 0.75)
    ]],
    "radiator": [middle("metal", (0.10, 1.00, 0.60), 0.12)],
}  # fmt: skip


def mesh(boxes: list[Box]) -> trimesh.Trimesh:
    """All boxes of one material."""
    parts = []
    for _, size, corner in boxes:
        part = trimesh.creation.box(extents=size)
        part.apply_translation(np.array(corner) + np.array(size) / 2)
        parts.append(part)
    return trimesh.util.concatenate(parts)


def main() -> None:
    """Writes all pieces."""
    folder = Path(__file__).parent / "furniture"
    folder.mkdir(exist_ok=True)
    for name, boxes in PIECES.items():
        for material in sorted({box[0] for box in boxes}):
            part = mesh([box for box in boxes if box[0] == material])
            (folder / f"{name}.{material}.ply").write_bytes(trimesh.exchange.ply.export_ply(part, vertex_normal=False))


if __name__ == "__main__":
    main()
