"""What can be known of a GPU without one: runs that take its way on the CPU, and what the CUDA compiler makes of the kernels.

reference/emulated_gpu.py and the tests that need a GPU (test_gpu.py) run in processes of their own.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from reference import emulated_gpu

TESTS = Path(__file__).parents[1]
KERNELS = TESTS.parent / "kernels"
ON_THE_CPU = {
    "find_contact_forces_by_batch", "step_worlds", "wait_for_all",
}  # fmt: skip
TABLE = Path(__file__).parent / "cuda_resources.json"  # at sm_90, of each kernel and its overloads, as `Resources`
Resources = tuple[int, int, int]  # registers and stack [B] a thread, shared memory [B] a block
BUDGET: Resources = (64, 0, 16_384)  # half of the threads that a multiprocessor can hold, and shared memory for all of them
CONTACT: Resources = (96, 0, 16_384)
OF_CONTACT = ("contact.", "contact_search.", "wire_closest.", "wire_contact_", "wire_pairs.")  # modules
# kernels beyond their budget, with what they take: they may shrink, and leave when they are within it
EXCESS: dict[str, Resources] = {
    "banded_mass.factor_borders[vec4d]": (168, 0, 2048),
    "banded_mass.factor_borders[vec4f]": (168, 0, 2048),
    "banded_mass.factor_masses[vec4d]": (96, 0, 2048),
    "banded_mass.factor_masses[vec4f]": (94, 0, 2048),
    "contact.find_contact_forces[float32, int32]": (125, 0, 2048),
    "contact.find_contact_forces[float64]": (163, 0, 2048),
    "contact_checks.bound_contact_stiffness[vec4d]": (72, 0, 2048),
    "contact_checks.bound_contact_stiffness[vec4f]": (72, 0, 2048),
    "control.update_control": (92, 0, 2048),  # of one thread a world, with strains that tensions drive
    "control.update_controls": (114, 0, 2048),
    "energy.evaluate_wires[float64]": (62, 0, 21632),
    "membrane_transfer.spread_to_bodies[float32]": (54, 16, 2048),
    "membrane_transfer.spread_to_bodies[int32]": (54, 16, 2048),
    "membrane_transfer.spread_to_nodes[float32, int32]": (56, 16, 2048),
    "membrane_transfer.spread_to_nodes[float32]": (56, 16, 2048),
    "rod_checks.sum_states[vec3d]": (96, 0, 2048),
    "rod_checks.sum_states[vec3f]": (96, 0, 2048),
    "rod_forces.find_rod_forces[float32, vec3f]": (66, 0, 11016),  # with yield
    "rod_forces.find_rod_forces[float64, vec3d]": (122, 0, 19752),
    "rod_frames.update_frames[float32, vec3f]": (40, 32, 3464),
    "rod_frames.update_frames[float64, vec3d]": (58, 40, 3464),
    "rod_motion.move_rods[float32, vec3f, vec4f]": (64, 72, 9728),
    "rod_motion.move_rods[float64, vec3d, vec4d]": (64, 232, 15360),
    "rod_stress.count_contact_stress": (71, 0, 2048),
    "rod_stress.sum_contact_stress": (71, 0, 2048),
    "rod_turns.turn_sections[vec3d]": (50, 40, 2048),
    "rod_turns.turn_sections[vec3f]": (50, 40, 2048),
    "sums.sum_distances_from_chords[float32, int32]": (72, 0, 2048),
    "sums.count_stress_of_pairs[float32, int32]": (72, 0, 2048),
    "sums.count_stress_of_pairs[float64]": (74, 0, 2048),
    "sums.sum_pairs[float32, int32]": (84, 0, 2048),
    "sums.sum_pairs[float64]": (90, 0, 2048),
    "wire_closest.find_closest_places[vec3d]": (255, 1448, 2048),
    "wire_closest.find_closest_places[vec3f]": (255, 1448, 2048),
    "wire_closest.mark_near_pairs[vec3d]": (255, 808, 2048),
    "wire_closest.mark_near_pairs[vec3f]": (255, 808, 2048),
    "wire_contact_by_batch.find_followed_contacts[vec3d]": (168, 216, 30720),
    "wire_contact_by_batch.find_followed_contacts[vec3f]": (168, 216, 30720),
    "wire_contact_forces.find_contact_forces[float32, vec3f]": (255, 1992, 2048),
    "wire_contact_forces.find_contact_forces[float64, vec3d]": (255, 2032, 2048),
    "wire_pairs.find_segment_pairs[vec3d]": (255, 1288, 2048),
    "wire_pairs.find_segment_pairs[vec3f]": (255, 1288, 2048),
    "wires.step_wires[float64]": (66, 0, 25888),
}


def emulated(folder: Path, *options: str) -> dict[str, Any]:
    """The result of a process with a kernel cache of its own."""
    result = folder / "result.json"
    own = {"WARP_CACHE_PATH": str(folder / "cache")}
    command = [sys.executable, emulated_gpu.__file__, str(result), *options]
    said = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr[-4000:]
    found: dict[str, Any] = json.loads(result.read_text())
    return found


def gpu_tests(*chosen: str) -> str:
    """What pytest says of tests that need a GPU, in a process with an emulated one."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-m", "gpu", "-p", "reference.emulated_device", *chosen]
    said = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": str(TESTS)}, cwd=TESTS.parent, capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stdout[-4000:] + said.stderr[-2000:]
    return said.stdout


@pytest.mark.slow
def test_a_run_on_an_emulated_gpu() -> None:
    """A thread a pair, and copies on the host, lead to the equilibrium that blocks and shared memory lead to. Small
    meshes of a large start stay on the CPU, and no launch takes arrays of two devices."""
    ends = ("has_the_figures_of_the_cpu[planar cell-cuda:0]", "has_the_figures_of_the_cpu[spatial cell-cuda:0]")
    tests = [f"test_a_run_{end}" for end in ends] + ["test_small_meshes_of_a_large_start_run_on_the_cpu"]
    assert "4 passed" in gpu_tests(*(f"{TESTS / 'test_gpu.py'}::{name}" for name in tests))


@pytest.mark.slow
def test_all_that_needs_a_gpu_passes_on_an_emulated_one() -> None:
    assert "skipped" not in gpu_tests(str(TESTS / "test_gpu.py"))


@pytest.mark.slow
@pytest.mark.parametrize(("order", "only"), [("reversed", ""), ("permuted", "cell"), ("permuted", "patch")])
def test_states_do_not_depend_on_the_order_of_the_threads(order: str, only: str, tmp_path: Path) -> None:
    """Every array of the last state, the sums over the mesh included, has the same bits."""
    (tmp_path / order).mkdir()
    forward = emulated(tmp_path, "--only", only)["states"]
    other = emulated(tmp_path / order, "--only", only, "--order", order)["states"]
    assert forward
    assert {name: {key for key in arrays if arrays[key] != other[name][key]} for name, arrays in forward.items()} == {
        name: set() for name in forward
    }


def exceeds(used: Resources, limit: Resources) -> bool:
    return any(one > most for one, most in zip(used, limit, strict=True))


def table() -> dict[str, Resources]:
    return {name: tuple(used) for name, used in json.loads(TABLE.read_text()).items()}


def test_kernels_keep_their_budgets_of_registers_stack_and_shared_memory() -> None:
    """By the table; all that exceed theirs are listed with what they take, and nothing else is."""
    beyond = {name: used for name, used in table().items() if exceeds(used, CONTACT if name.startswith(OF_CONTACT) else BUDGET)}
    assert set(beyond) == set(EXCESS)
    assert {name: used for name, used in beyond.items() if exceeds(used, EXCESS[name])} == {}


def test_the_table_has_every_kernel_that_a_gpu_launches() -> None:
    """Those that run on the CPU alone are left out: kernels of blocks, batches, threads and worlds."""
    source = {name for path in KERNELS.glob("*.py") for name in re.findall(r"@wp.kernel.*\ndef (\w+)", path.read_text())}
    assert source - {name.split(".")[1].split("[")[0] for name in table()} == ON_THE_CPU


@pytest.mark.slow
def test_modules_compile_for_cuda(tmp_path: Path) -> None:
    """For the oldest and a recent GPU; no kernel needs more than the table says. To renew the table:
    `python tests/reference/emulated_gpu.py RESULT.json --arch 90`, and copy `kernels` of it."""
    found = emulated(tmp_path, "--arch", "75", "90")["kernels"]["90"]
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        pytest.skip("compiled, but cuobjdump is packaged for Linux x86-64 alone")
    assert {name.split("[")[0] for name in found} == {name.split("[")[0] for name in table()}
    assert set(found) <= set(table())
    assert {name: used for name, used in found.items() if exceeds(used, table()[name])} == {}
