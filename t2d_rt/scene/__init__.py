"""Rooms with doors, windows and furniture, written as Mitsuba/Sionna XML; and movers, which are things that move by themselves."""

from t2d_rt.scene.movers import CeilingFan, Curtain, Door, Mover, OwnMover, Pet, TableFan, mover
from t2d_rt.scene.room import Opening, Piece, Room, Slab
from t2d_rt.scene.xml import save_scene

__all__ = [
    "CeilingFan", "Curtain", "Door", "Mover", "Opening", "OwnMover", "Pet", "Piece", "Room", "Slab", "TableFan", "mover",
    "save_scene",
]  # fmt: skip
