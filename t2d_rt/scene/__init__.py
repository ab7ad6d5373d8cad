"""Rooms: walls with doors and windows, furniture by name, written as Mitsuba/Sionna XML; movers: what moves by itself."""

from t2d_rt.scene.movers import CeilingFan, Curtain, Door, Mover, OwnMover, Pet, TableFan, mover
from t2d_rt.scene.room import Opening, Piece, Room, Slab
from t2d_rt.scene.xml import save_scene

__all__ = [
    "CeilingFan",
    "Curtain",
    "Door",
    "Mover",
    "Opening",
    "OwnMover",
    "Pet",
    "Piece",
    "Room",
    "Slab",
    "TableFan",
    "mover",
    "save_scene",
]
