"""What all tests share: the device they run on, and how processes share the work.

SI values are small: pytest.approx needs `abs=0` beside `rel`, or its own 1e-12 hides a force of a piconewton.
"""

import os
import shutil
import tempfile

import pytest
import warp as wp

pytest.register_assert_rewrite("reference")

from reference.kernel_cache import compile_kernels  # noqa: E402  (rewritten first)
from reference.solved import FOLDER_KEY  # noqa: E402

wp.config.quiet = True

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A worker a core for `-n auto`; none where tests are asked for by name, which are run sooner than workers start."""
    return 0 if CORES == 1 or any("::" in argument for argument in config.args) else CORES


def pytest_configure(config: pytest.Config) -> None:
    """Before workers start: a folder for what they solve, one thread for each, and the kernels compiled once for all."""
    if hasattr(config, "workerinput"):
        compile_kernels()  # loads what was compiled for all; in the same order, so that modules stand in the same form
        return
    os.environ[FOLDER_KEY] = tempfile.mkdtemp(prefix="warpknit_tests_")
    if getattr(config.option, "numprocesses", None):
        for name in ("WARPKNIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        compile_kernels()


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ.get(FOLDER_KEY, ""), ignore_errors=True)


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> str:
    """Each device in turn; without CUDA the second is skipped."""
    if request.param.startswith("cuda") and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param
