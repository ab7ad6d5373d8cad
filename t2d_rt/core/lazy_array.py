"""A cube on disk as an xarray variable that is read when used. A module of its own: xarray takes longer to load than all else."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from t2d_rt.core.cube_storage import DIMENSIONS
from t2d_rt.core.cubes import DiskCube


def lazy_variable(cube: DiskCube) -> xr.Variable:
    """(chirp, antenna, sample); holds the cube, so what is read from it is there as long as the variable or a part of it.

    Assignments go to memory.
    """
    read_when_used: Any = indexing.LazilyIndexedArray(_CubeArray(cube))
    return xr.Variable(DIMENSIONS, indexing.CopyOnWriteArray(read_when_used))


class _CubeArray(BackendArray):
    """What xarray reads from; it hands over the places that are asked for (xarray's guide "How to add a new backend")."""

    def __init__(self, cube: DiskCube) -> None:
        self.cube, self.shape, self.dtype = cube, cube.shape, cube.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self.cube.outer)
