"""A cube on disk as an xarray variable that is read when it is used. A separate module, as xarray takes longer to load than
everything else."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from t2d_rt.core.cube_storage import DIMENSIONS
from t2d_rt.core.cubes import DiskCube


def lazy_variable(cube: DiskCube) -> xr.Variable:
    """The cube as a variable (chirp, antenna, sample). It holds a reference to the cube, so that samples can be read as long as the
    variable or a part of it exists.

    Assignments change a copy in memory.
    """
    read_when_used: Any = indexing.LazilyIndexedArray(_CubeArray(cube))
    return xr.Variable(DIMENSIONS, indexing.CopyOnWriteArray(read_when_used))


class _CubeArray(BackendArray):
    """The array that xarray reads from; it passes the indices on to the cube (xarray's guide "How to add a new backend")."""

    def __init__(self, cube: DiskCube) -> None:
        self.cube, self.shape, self.dtype = cube, cube.shape, cube.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self.cube.outer)
