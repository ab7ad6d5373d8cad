"""A cube on disk as an xarray variable that is read when used. A module of its own: xarray takes longer to load than all else."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint
from xarray.core import indexing

from t2d_rt.core.cube_storage import DIMENSIONS, NAME
from t2d_rt.core.cubes import DiskCube


def lazy_variable(cube: DiskCube) -> xr.Variable:
    """(chirp, antenna, sample); holds the cube, so what is read from it is there as long as the variable or a part of it."""
    return xr.open_dataset(cube, engine=_CubeEngine, cache=False)[NAME].variable  # type: ignore[arg-type]


class _CubeArray(BackendArray):
    """What xarray reads from; it hands over the places that are asked for (xarray's guide "How to add a new backend")."""

    def __init__(self, cube: DiskCube) -> None:
        self.cube, self.shape, self.dtype = cube, cube.shape, cube.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self.cube.outer)


class _CubeEngine(BackendEntrypoint):
    """Opens a cube as a dataset; xarray then sees to it that assignments go to memory."""

    open_dataset_parameters = ("filename_or_obj", "drop_variables")

    def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xr.Dataset:
        values = indexing.LazilyIndexedArray(_CubeArray(filename_or_obj))
        return xr.Dataset({NAME: xr.Variable(DIMENSIONS, values)})
