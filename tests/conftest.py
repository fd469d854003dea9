"""What all tests share: the device they run on, and how processes share the work.

SI values are small: pytest.approx needs `abs=0` beside `rel`, or its own 1e-12 hides a force of a piconewton.
"""

import gc
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # of small matrices more threads are slower, and workers have a core each

import pytest  # noqa: E402
import warp as wp  # noqa: E402

pytest.register_assert_rewrite("reference")

from reference.images import draw_blank  # noqa: E402
from reference.kernel_cache import MODELS, compile_in_processes, compile_kernels  # noqa: E402  (rewritten first)
from reference.solved import FOLDER_KEY  # noqa: E402

wp.config.quiet = True

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


TESTS = Path(__file__).parent
# for work by hand: these need no kernel but one of their own
FAST = """
    export/test_frame export/test_tension_figure export/test_thickness export/test_usd export/test_usd_levels
    export/test_view export/test_vtk
    knit/test_chain knit/test_crossings knit/test_lapping knit/test_lens_width knit/test_openings knit/test_threads
    reflection/test_currents
    studies/test_card_values studies/test_equal_tension studies/test_fe_cards
    test_best_tension test_capabilities test_cli test_closings test_contact_map test_convergence_check test_device
    test_equilibrium test_host test_jumps test_kernel_linter test_launch test_layering test_measures_of_design test_step_sharing
    test_result_types test_run_directory test_scene test_scene_in_code test_scene_keys test_scene_refusals
    test_scene_resolved test_stress_peak test_text test_units
    validation/test_other_codes validation/test_study_pages
    wires/test_bad_files wires/test_curves wires/test_hooks wires/test_overlaps wires/test_repeat
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of FAST, but for slow ones."""
    fast = {TESTS / f"{name}.py" for name in FAST.split()}
    if missing := [path for path in fast if not path.is_file()]:
        raise pytest.UsageError(f"FAST names files that are not there: {missing}")
    for item in items:
        if item.path in fast and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.fast)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Leave what is imported and collected out of garbage collection: it is there to the end, and large."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def no_comparison_with_the_spatial_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the three spatial meshes that a planar tile is compared with, but for their own test."""
    monkeypatch.setattr("warpknit.runner.other_model.NODE_STEPS", 0.0)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A worker a core for `-n auto`; none where tests are asked for by name, which are run sooner than workers start."""
    return 0 if CORES == 1 or any("::" in argument for argument in config.args) else CORES


def pytest_configure(config: pytest.Config) -> None:
    """Before workers start: a folder for what they solve, one thread for each, and the kernels compiled once for all."""
    draw_blank(BLANK)
    os.fsync = lambda _: None  # nothing here ends with the power
    if hasattr(config, "workerinput"):
        compile_kernels(*MODELS)  # loads what was compiled for all; in the same order, so that modules stand in the same form
        return
    os.environ[FOLDER_KEY] = tempfile.mkdtemp(prefix="warpknit_tests_")
    if getattr(config.option, "numprocesses", None):
        os.environ.setdefault("WARPKNIT_THREADS", "1")
        compile_in_processes()


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ.get(FOLDER_KEY, ""), ignore_errors=True)


BLANK = pytest.MonkeyPatch()


@pytest.fixture(scope="module")
def pictures() -> Iterator[None]:
    """Figures are drawn; elsewhere their files are an image of one pixel, see `draw_blank`."""
    BLANK.undo()
    yield
    draw_blank(BLANK)


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> str:
    """Each device in turn; without CUDA the second is skipped."""
    if request.param.startswith("cuda") and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param
