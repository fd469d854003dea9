"""Times of a spatial step: whole, by kernel, in a C loop, and the pair search.

Runs the double atlas of the spatial cell to 10 % and a tight tricot to 6 %, both roughly, then times their steps in the state
reached: free, without contact, and with it. A small mesh is measured on one thread alone. The C loop (rod_loop.c, needs gcc)
steps the same number of rod nodes, turn about with warpknit: free ones, and with plain contact of the same wires in the same
state. Kernels alone are timed with a time step of zero, which keeps the state: times of one thread with its part of the mesh.
Times are in us.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.compute.launch import Launch
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.rod_step import RodStepper

from .turns import best

HERE = Path(__file__).parent
SCENE = HERE.parents[1] / "scenes" / "atlas_cell_spatial.toml"
STEPS = 200
REAL = {"single": (np.float32, ctypes.c_float, "float"), "double": (np.float64, ctypes.c_double, "double")}
NODES_PER_LOOP = 64
OWN_REACH = 4.0  # thicknesses along a wire within which the C loop looks for no contact
TRICOT = [
    'wire.material="molybdenum"', 'wire.diameter="30 um"', 'knit.bars=[{chain = "1-0/1-2"}, {chain = "1-2/1-0"}]',
    'knit.wale_spacing="0.98 mm"', 'knit.course_spacing="0.85 mm"', "load.strain_weft=0.06", "load.strain_warp=0.06",
]  # fmt: skip
KNITS: dict[str, list[str]] = {"double atlas": [], "tricot": TRICOT}
PARTS = {
    "update_frames": "rods",
    "find_rod_forces": "rods",
    "move_rods": "rods",
    "find_followed_contacts": "followed_contacts",
    "find_closest_places": "narrow_phase",
    "find_contact_forces": "contact_forces",
    "update_control": "rods",
    "wait_for_all": "waiting",
}


def at_load(knit: str, repeats: int, overrides: list[str], device: str = "cpu") -> Simulation:
    """A knit at rest under its load, roughly."""
    options = [
        *KNITS[knit],
        "solver.preset=draft",
        "solver.residual_tolerance=0.05",
        "output.frames=3",
        f"model.nodes_per_loop={NODES_PER_LOOP}",
        f"knit.repeats=[{repeats}, {repeats}]",
    ]
    relaxation = Simulation(build_model(load_scene(SCENE, [*options, *overrides]), device))
    for _record in relaxation.run():
        pass
    return relaxation


def repeated(relaxation: Simulation, launches: list[Launch]) -> Callable[[], None]:
    """Launches of one kernel alone, STEPS times."""
    device = relaxation.mechanics.stepper.device
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(STEPS):
            for one in launches:
                one.run(device)
    return lambda: wp.capture_launch(capture.graph)


def kernels_alone(relaxation: Simulation, rounds: int) -> dict[str, float]:
    """[s] of each kernel of a step, on one thread."""
    stepper = relaxation.mechanics.stepper
    kept = stepper.state.steering.time_step
    stepper.state.steering.set(time_step=0.0)
    launches: dict[str, list[Launch]] = {}
    for one in stepper.launches():
        if one.threads and one.kernel.key != "wait_for_all":
            launches.setdefault(one.kernel.key, []).append(one)
    works = {key: repeated(relaxation, ones) for key, ones in launches.items()}
    taken = best(works, rounds, device=stepper.device)
    stepper.state.steering.time_step = kept
    return {name: seconds / STEPS for name, seconds in taken.items()}


class CLoop:
    """rod_loop.c on the nodes of a stepper, as one closed wire."""

    def __init__(self, stepper: RodStepper, folder: Path, own: int = 0) -> None:
        """own: segments along the wire that never touch; 0: without contact."""
        number, self.real, name = REAL[stepper.precision.name]
        library = folder / f"rod_loop_{name}.so"
        if not library.exists():
            command = ["gcc", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC", f"-DREAL={name}"]
            subprocess.run([*command, "-o", str(library), str(HERE / "rod_loop.c"), "-lm"], check=True)
        self.library, rods, state, arrays = ctypes.CDLL(str(library)), stepper.rods, stepper.state, stepper.arrays
        self.nodes = nodes = rods.node_count

        def rows(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.T)

        def zeros(*shape: int) -> np.ndarray:
            return np.zeros((*shape, nodes))

        # mass and inertia make a step of 1 s stable
        bend, spacing = rods.section.bending_stiffness, rods.natural_length
        mass, inertia = 64.0 * bend / spacing**3, 64.0 * bend / spacing
        arrays_in_double = [
            zeros(3), zeros(3), rows(state.tangent.numpy()), rows(state.director.numpy()),
            rows(state.tangent.numpy() * state.length.numpy()[:, None]), zeros(3),
            zeros(), zeros(), zeros(), spacing.copy(), rows(arrays.natural_curvature.numpy()[rods.row]),
            arrays.natural_twist.numpy()[rods.row],
            mass, inertia, np.array([1.0, 0.0, 0.0, 1.0]), rows(state.position.numpy()),
            rods.tile[:2] * np.diag(state.gradient),
        ]  # fmt: skip
        self.arrays = [values.astype(number) for values in arrays_in_double]
        section, self.own = rods.section, own
        # wires that touch would be driven apart: they are not moved
        numbers = [section.thickness if own else 0.0, 1.0, 1e-3 * section.axial_stiffness, section.bending_stiffness]
        self.numbers = [*numbers, section.twist_stiffness, 0.99, 1.0, 0.0 if own else 1.0]
        self.library.take_steps.restype = ctypes.c_int64

    def step(self, steps: int, threads: int) -> int:
        """Take steps; returns the number of segments in contact."""
        addresses = [values.ctypes.data_as(ctypes.c_void_p) for values in self.arrays]
        numbers = map(self.real, self.numbers)
        return self.library.take_steps(ctypes.c_int64(self.nodes), steps, threads, *addresses, self.own, *numbers)


def measure(
    knit: str, repeats: int, precision: str, threads: int, options: argparse.Namespace, folder: Path
) -> Iterator[dict[str, Any]]:
    """Time of a step and its parts; without contact, then with it. Nothing for a mesh too small for its threads."""
    os.environ["WARPKNIT_THREADS"] = str(threads)
    relaxation = at_load(knit, repeats, [*options.overrides, f"solver.precision={precision}"], options.device)
    stepper, contact, steps = relaxation.mechanics.stepper, relaxation.mechanics.contact, relaxation.progress.steps
    rounds, nodes = options.rounds, relaxation.model.rods.node_count
    if stepper.team.threads < threads:
        return
    contact.search()
    stepper.step(1)
    contact.list_near_pairs()  # as checks do, now that the search has found how far pairs are apart
    stepper.state.steering.set(travel_limit=np.inf)
    works, c_contacts = {"step": partial(stepper.step, STEPS)}, 0
    if options.device == "cpu":
        thickness, spacing = relaxation.model.rods.section.thickness, relaxation.model.rods.natural_length.mean()
        touching = CLoop(stepper, folder, own=1 + math.ceil(OWN_REACH * thickness / spacing))
        works["c"] = partial(CLoop(stepper, folder).step, STEPS, threads)
        works["c_contact"] = partial(touching.step, STEPS, threads)
        c_contacts = touching.step(1, threads)
    best(works, 1, device=options.device)
    whole = best(works, rounds, device=options.device)
    parts = kernels_alone(relaxation, rounds)
    stepper.evaluate()  # steps leave no normal forces
    near, pairs = contact.read_contacts(), contact.pair_count
    search = best({"search": contact.search}, rounds, device=options.device)["search"]
    share = dict.fromkeys(PARTS.values(), 0.0)
    for name, seconds in parts.items():
        share[PARTS.get(name, "rods")] += seconds
    common = {"nodes": nodes, "precision": precision, "threads": threads, "device": str(stepper.device)}

    def speeds(taken: dict[str, float]) -> dict[str, Any]:
        one = {name: nodes * STEPS / seconds for name, seconds in taken.items()}
        loops = {"c_loop": "c", "c_loop_with_contact": "c_contact"}
        return {
            "node_steps_per_s": one["step"],
            **{f"{name}_node_steps_per_s": one[key] for name, key in loops.items() if key in one},
            **{f"to_{name}": round(one["step"] / one[key], 3) for name, key in loops.items() if key in one},
        }

    contacts = {
        "pairs": pairs,
        "contacts": int((near.force > 0.0).sum()),
        "c_loop_segments_in_contact": c_contacts,
        "steps": steps,
        "search_us": 1e6 * search,
        "step_us": 1e6 * whole["step"] / STEPS,
        **{f"{name}_us": 1e6 * seconds for name, seconds in share.items()},
        "kernels_us": {name: 1e6 * seconds for name, seconds in parts.items()},
    }
    stepper.contact = None
    works.pop("c_contact", None)
    stepper.state.steering.set(time_step=0.0)  # wires that touch would be driven apart
    best(works, 1, device=options.device)
    yield {"case": f"{knit}, free", **common, **speeds(best(works, rounds, device=options.device))}
    yield {"case": knit, **common, **speeds(whole), **contacts}


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Two dictionaries a knit, size, precision and number of threads. Meshes are square in repeats."""
    with tempfile.TemporaryDirectory() as folder:
        for knit, overrides in KNITS.items():
            one = build_model(load_scene(SCENE, [*overrides, f"model.nodes_per_loop={NODES_PER_LOOP}", "knit.repeats=[3, 3]"]))
            for nodes in options.nodes:
                repeats = max(1 if knit == "double atlas" else 3, round(3.0 * math.sqrt(nodes / one.rods.node_count)))
                for precision, threads in product(options.precision, options.threads if options.device == "cpu" else [1]):
                    yield from measure(knit, repeats, precision, threads, options, Path(folder))
