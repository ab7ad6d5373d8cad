"""On a machine with a CUDA device the cubes are those that a CPU computes."""

import numpy as np
import pytest

from validation.gpu.cases import CASES, ERROR_LIMIT_DB, REFERENCE, error_db


@pytest.mark.gpu
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::t2d_rt.T2DWarning")
@pytest.mark.parametrize("name", CASES)
def test_a_gpu_computes_what_a_cpu_does(name):
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.CUDA):
        pytest.skip("no CUDA device")
    assert error_db(CASES[name]("gpu"), name) < ERROR_LIMIT_DB


@pytest.mark.slow
def test_the_reference_is_what_a_cpu_computes_today():
    """After a change of the physics `python -m validation.gpu make` writes it again."""
    name = "mesh without occlusion, 1 s"
    assert set(np.load(REFERENCE).files) == set(CASES)
    assert error_db(CASES[name]("cpu"), name) < ERROR_LIMIT_DB
