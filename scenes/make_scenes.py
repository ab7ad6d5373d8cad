"""Makes the shipped rooms: scenes/<name>/<name>.xml and its meshes.

    python scenes/make_scenes.py

A radar in its default place, (0, 0, 1) looking along +x, stands in every room 0.5 m before the wall behind it, and about 1 m to
either side of the line ahead is free for people.
"""

from __future__ import annotations

from pathlib import Path

from t2d_rt.scene import Opening, Piece, Room, Slab, save_scene

BRICKED = Slab(material="concrete", thickness_m=0.15)
PARTITION = Slab(material="plasterboard", thickness_m=0.0125)
CONCRETE = Slab(material="concrete", thickness_m=0.2)
BOARDS = Slab(material="wood", thickness_m=0.02)
TILES = Slab(material="ceiling_board", thickness_m=0.015)
DOOR = Slab(material="wood", thickness_m=0.04)
PANE = Slab(material="glass", thickness_m=0.006)

ROOMS = (
    Room(
        name="empty_room",
        size_m=(7.0, 5.0, 2.6),
        walls=PARTITION,
        floor=CONCRETE,
        ceiling=CONCRETE,
        openings=(Opening(name="door", wall="-y", along_m=1.8, width_m=0.9, height_m=2.05, slab=DOOR),),
    ),
    Room(
        name="living_room",
        size_m=(6.5, 5.2, 2.6),
        walls=PARTITION,
        floor=BOARDS,
        ceiling=CONCRETE,
        openings=(
            Opening(name="door", wall="-y", along_m=2.4, width_m=0.9, height_m=2.05, slab=DOOR),
            Opening(name="window", wall="+x", width_m=2.4, height_m=1.3, sill_m=0.9, slab=PANE),
        ),
        furniture=(
            Piece(kind="sofa", x_m=2.6, y_m=2.05, heading_deg=-90),
            Piece(kind="coffee_table", x_m=2.6, y_m=1.25, heading_deg=-90),
            Piece(kind="armchair", x_m=4.9, y_m=1.9, heading_deg=-135),
            Piece(kind="sideboard", x_m=1.9, y_m=-2.3, heading_deg=90),
            Piece(kind="television", x_m=1.9, y_m=-2.3, z_m=0.725, heading_deg=90),
            Piece(kind="bookcase", x_m=0.3, y_m=-2.3, heading_deg=90),
            Piece(kind="table", x_m=5.0, y_m=-1.5, heading_deg=0),
            Piece(kind="chair", name="chair left", x_m=4.25, y_m=-1.5, heading_deg=0),
            Piece(kind="cupboard", x_m=0.45, y_m=2.3, heading_deg=-90),
        ),
    ),
    Room(
        name="bedroom",
        size_m=(5.0, 4.0, 2.5),
        walls=PARTITION,
        floor=BOARDS,
        ceiling=TILES,
        openings=(
            Opening(name="door", wall="-y", along_m=1.7, width_m=0.9, height_m=2.05, slab=DOOR),
            Opening(name="window", wall="+y", along_m=0.6, width_m=1.4, height_m=1.2, sill_m=0.95, slab=PANE),
        ),
        furniture=(
            Piece(kind="bed", x_m=3.4, y_m=1.2, heading_deg=180),
            Piece(kind="bedside_table", x_m=4.2, y_m=0.1, heading_deg=180),
            Piece(kind="wardrobe", x_m=1.2, y_m=-1.65, heading_deg=90),
            Piece(kind="radiator", x_m=2.6, y_m=1.9, heading_deg=-90),
        ),
    ),
    Room(
        name="corridor",
        size_m=(12.0, 1.8, 2.6),
        walls=BRICKED,
        floor=CONCRETE,
        ceiling=TILES,
        openings=tuple(
            Opening(name=f"door {number}", wall=wall, along_m=along, width_m=0.9, height_m=2.05, slab=DOOR)
            for number, (wall, along) in enumerate((("-y", -3.0), ("-y", 2.0), ("+y", -0.5), ("+y", 4.0)), start=1)
        ),
    ),
    Room(
        name="hospital_room",
        size_m=(7.0, 4.6, 2.7),
        walls=PARTITION,
        floor=CONCRETE,
        ceiling=TILES,
        openings=(
            Opening(name="door", wall="-y", along_m=-1.6, width_m=1.2, height_m=2.1, slab=DOOR),
            Opening(name="window", wall="+x", width_m=2.2, height_m=1.4, sill_m=0.9, slab=PANE),
        ),
        furniture=(
            Piece(kind="hospital_bed", x_m=3.6, y_m=1.2, heading_deg=-90),
            Piece(kind="bedside_table", x_m=4.5, y_m=2.0, heading_deg=-90),
            Piece(kind="trolley", x_m=2.4, y_m=1.9, heading_deg=-90),
            Piece(kind="armchair", x_m=4.9, y_m=-1.6, heading_deg=135),
            Piece(kind="screen", x_m=1.5, y_m=1.4, heading_deg=90),
            Piece(kind="cupboard", x_m=2.8, y_m=-2.0, heading_deg=90),
        ),
    ),
)


def main() -> None:
    """Writes all rooms."""
    for room in ROOMS:
        save_scene(room.scene(), Path(__file__).parent / room.name)


if __name__ == "__main__":
    main()
