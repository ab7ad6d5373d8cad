"""Rooms: walls with doors and windows, furniture by name, written as Mitsuba/Sionna XML."""

from t2d_rt.scene.room import Opening, Piece, Room, Slab
from t2d_rt.scene.xml import save_scene

__all__ = ["Opening", "Piece", "Room", "Slab", "save_scene"]
