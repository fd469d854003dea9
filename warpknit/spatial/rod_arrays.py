"""Rods on the device: rest data (`RodArrays`), state (`RodState`), launches, and overloads of the kernels.

In single precision frames, motion, forces and mass factors are float32; positions, lengths, tensions and rest data are float64.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..base.text import short_repr
from ..compute.arrays import DOUBLE, Precision, array, names_of, new_arrays
from ..compute.host import fetch, is_in_place, lanes, store
from ..compute.kept import rows_of
from ..compute.launch import Launch, bind
from ..compute.steering import Steering
from ..kernels import (
    banded_mass,
    contact_checks,
    membrane_transfer,
    rod_border,
    rod_checks,
    rod_clamps,
    rod_forces,
    rod_frames,
    rod_masses,
    rod_motion,
    rod_stress,
    rod_sums,
    rod_turns,
    wire_closest,
    wire_contact_by_batch,
    wire_contact_forces,
    wire_pairs,
)
from ..kernels.banded_mass import BORDERS, FACTORS, factor_borders, factor_masses
from ..kernels.control import CONTROL_COUNT, PARTIAL_COUNT
from ..kernels.rod_blocks import ROD_BLOCK, ROD_LANES
from ..kernels.rod_forces import find_rod_forces
from ..kernels.rod_frames import ALWAYS, update_frames
from ..kernels.rod_motion import MOTION_LANES, move_rods
from .contact_arrays import TouchArrays
from .node_stiffness import node_stiffness
from .rods import Rods

WIRE_PARTS = 64  # of a wire whose masses a GPU factors
OPEN_BORDER = 4  # last nodes of an open wire that have a row in the borders of the masses
# whose arrays have the types of the precision
MODULES = (
    banded_mass, contact_checks, rod_border, rod_checks, rod_clamps, rod_forces, rod_frames, rod_masses, rod_motion, rod_stress,
    rod_sums, rod_turns, wire_closest, wire_contact_by_batch, wire_contact_forces, wire_pairs,
)  # fmt: skip
NUMBERS = ("pending_turn", "spin", "angle", "torque", "turn")  # the other arguments of any type are vectors
OF_FOUR = ("mass_factor", "mass_border", "sweep")


@dataclass(frozen=True)
class RodArrays:
    """Rest data; segment data included. Wires of one shape share the arrays [row]."""

    world_nodes: int  # of each world; worlds stand one behind the other
    wire_first: wp.array = array(wp.int32, "wire")
    wire_count: wp.array = array(wp.int32, "wire")
    wire_closed: wp.array = array(wp.int32, "wire")
    wire_border: wp.array = array(wp.int32, "wire")  # row of the first node in the borders of the masses (kernels/banded_mass.py)
    wire_axial: wp.array = array(wp.float64, "wire")  # [N] EA
    wire_bending: wp.array = array(wp.float64, "wire")  # [N m2] EI
    wire_twist: wp.array = array(wp.float64, "wire")  # [N m2] GJ
    wire_yield: wp.array = array(wp.float64, "wire")  # [1/m] change of curvature at first yield; 0: none
    block_first: wp.array = array(wp.int32, "block")  # see kernels/rod_blocks.py
    block_count: wp.array = array(wp.int32, "block")
    block_wire: wp.array = array(wp.int32, "block")
    node_wire: wp.array = array(wp.int32)
    node_block: wp.array = array(wp.int32)  # by which travel is measured; on a GPU one for all
    previous: wp.array = array(wp.int32)
    following: wp.array = array(wp.int32)
    held: wp.array = array(wp.int32)
    rest_position: wp.array = array(wp.vec3d)  # [m]
    natural_length: wp.array = array(wp.float64)  # [m]
    half_in_clamp: wp.array = array(wp.float64)  # [m] see Rods.half_in_clamp
    bow_weight: wp.array = array(wp.vec2d)  # see Rods.bow_weights
    rest_row: wp.array = array(wp.int32)  # see Rods.row
    rest_edge: wp.array = array(wp.vec3d, "row")  # [m]
    node_length: wp.array = array(wp.float64, "row")  # [m]
    natural_curvature: wp.array = array(wp.vec2d, "row")  # [rad]
    natural_twist: wp.array = array(wp.float64, "row")  # [rad]
    node_stiffness: wp.array = array(wp.float64, "row")  # (row, 6) [N m], see node_stiffness.py
    slope_length: wp.array = array(wp.float64, "row")  # [m] of the segment, where the slope of the moment stores energy; else 0
    moment_turn: wp.array = array(wp.vec2d, "row")  # cosine and sine of the twist between nodes at rest, by which moments turn
    knitted: tuple[np.ndarray, np.ndarray] = (np.zeros((0, 2)), np.zeros(0))  # curvature and twist [row] as knitted, on the host
    forms: RodArrays | None = None  # of Rods.forms, with the same arrays [row]


AS_IN_RODS = "wire_first", "wire_count", "wire_closed", "previous", "following", "held", "natural_length", "half_in_clamp"


@dataclass(frozen=True)
class RodState:
    """Unknowns of the dynamics and what each step computes from them; [node]."""

    __repr__ = short_repr

    displacement: wp.array = array(wp.vec3d)  # [m] from the affine map of the rest shape
    velocity: wp.array = array("vec3")  # [m/s]
    pending_turn: wp.array = array("real")  # [rad] rotation of a section not yet applied to its director
    spin: wp.array = array("real")  # [rad/s] of a section about its tangent
    angle: wp.array = array("real")  # [rad] rotation of a section since the start
    tangent: wp.array = array("vec3")
    director: wp.array = array("vec3")
    tension_offset: wp.array = array(wp.float64)  # [N] augmented Lagrangian multiplier of a segment
    stretch_stiffness: wp.array = array(wp.float64)  # [N] of the dynamics
    # fictitious masses couple neighbours along the wire (kernels/banded_mass.py)
    node_mass: wp.array = array(wp.vec3d)  # [kg] along x, y and z
    next_mass: wp.array = array(wp.float64)  # [kg] coupling with the next node
    second_mass: wp.array = array(wp.float64)  # [kg] coupling with the next but one
    spin_inertia: wp.array = array(wp.float64)  # [kg m2] of a segment
    next_inertia: wp.array = array(wp.float64)  # [kg m2] coupling with the next segment
    mass_factor: wp.array = array("vec4", "node", FACTORS)  # factors of both
    mass_border: wp.array = array("vec4", "border", BORDERS)
    wire_quiet: wp.array = array(wp.int32, "wire")  # see kernels/banded_mass.py
    block_travel: wp.array = array(wp.float64, "block")  # [m] bound on the ways of its nodes and those beside since the search
    block_rest: wp.array = array(wp.int32, "rod_block")  # whether its nodes move, see kernels/rod_blocks.py
    block_speed: wp.array = array(wp.float64, "block")  # [m2/s2] largest square of the speeds of its nodes in the last step
    load_force: wp.array = array(wp.vec3d)  # [N] dead load, see `set_load`
    position: wp.array = array(wp.vec3d)  # [m]
    length: wp.array = array(wp.float64)  # [m]
    curvature: wp.array = array(wp.vec2d)  # [rad] turning vector at a node, along the section directors
    moment: wp.array = array(wp.vec3d)  # [N m] at a node, against turns along the section directors and twist
    twist: wp.array = array(wp.float64)  # [rad]
    bend_energy: wp.array = array(wp.float64)  # [J] of bending and twist at a node, and of the slope of its moment
    plastic_turn: wp.array = array(wp.vec2d, "yielding")  # [rad] plastic part of the turning vector at the last equilibrium
    edge_force: wp.array = array(wp.vec3d)  # [N] of a segment on its first node
    contact_penalty: wp.array = array(wp.float64)  # [N/m] of the contacts at a node
    contact_offset: wp.array = array(wp.float64)  # [m] multiplier of the contacts at a node, over their penalty
    force: wp.array = array("vec3")  # [N]
    torque: wp.array = array("real")  # [N m]
    force_sum: wp.array = array("vec3")  # [N] of all steps since the last convergence check
    sweep: wp.array = array("vec4")  # see kernels/rod_motion.py; between steps bounds on the stiffness of contacts
    control: wp.array = array(wp.float64, "world", CONTROL_COUNT)  # see kernels/control.py
    partial: wp.array = array(wp.float64, "wire", PARTIAL_COUNT)

    def arrays(self, *, copied: bool = True) -> dict[str, np.ndarray]:
        """All arrays on the host, by name; not `copied`: on a CPU valid until the next step."""
        views = {field.name: fetch(getattr(self, field.name)) for field in fields(self)}
        return {name: view.copy() for name, view in views.items()} if copied else views

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Restore what `arrays` returned."""
        for name, value in arrays.items():
            store(getattr(self, name), value)

    def world(self, number: int, count: int) -> RodState:
        """Part of one of `count` worlds, in the same memory."""
        if count == 1:
            return self

        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        return RodState(**{name: array[rows_of(array, number, count)] for name, array in arrays.items()})

    def set_load(self, force: np.ndarray, of_mesh: np.ndarray | None = None) -> None:
        """Put dead loads (node, 3) [N] on the nodes; of_mesh: of all its nodes, default these."""
        store(self.load_force, force)
        square = np.sum(np.square(force if of_mesh is None else of_mesh, dtype=np.float64), axis=1)
        self.steering.set(dead_load=float(np.sqrt(np.mean(square))))

    @property
    def steering(self) -> Steering:
        """The control array by name."""
        return Steering(self.control, 0)

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary, a copy."""
        return np.asarray(self.steering.gradient)


def upload_rods(rods: Rods, device: str, precision: Precision = DOUBLE, worlds: int = 1) -> RodArrays:
    """Rest data on the device, for steps in this precision; natural curvature and twist default to the rest values times the set
    fraction."""
    begin, count, wire = _blocks(rods)
    values: dict[str, Any] = {name: getattr(rods, name) for name in AS_IN_RODS} | {
        "world_nodes": rods.node_count // worlds,
        "wire_border": _borders(rods)[0],
        "wire_axial": rods.of_wires("axial_stiffness"),
        "wire_bending": rods.of_wires("bending_stiffness"),
        "wire_twist": rods.of_wires("twist_stiffness"),
        "wire_yield": rods.of_wires("yield_curvature"),
        "block_first": begin,
        "block_count": count,
        "block_wire": wire,
        "node_wire": rods.wire_of,
        "node_block": np.repeat(np.arange(len(begin), dtype=np.int32) * is_in_place(device), count),
        "rest_position": rods.position,
        "rest_row": rods.row,
        "bow_weight": np.stack(rods.bow_weights, axis=1),
    }
    if rods.forms is not None:
        forms = upload_rods(replace(rods.forms, set_fraction=rods.set_fraction), device, precision, worlds)
        of_forms = {name: getattr(forms, name) for name in (*names_of(RodArrays, "row"), "knitted")}
        return new_arrays(RodArrays, device, {}, values | of_forms | {"forms": forms})
    values |= {name: getattr(rods, name) for name in ("rest_edge", "node_length", "slope_length")}
    values["node_stiffness"] = node_stiffness(rods) if rods.node_stiffness is None else rods.node_stiffness
    arrays = new_arrays(RodArrays, device, {"row": rods.node_count}, values)
    at_rest = rest_state(rods, device, precision, worlds)
    Steering(at_rest.control).set(status=Steering.EVALUATING)
    frames_launch(arrays, at_rest).run(device)
    force_launch(rods, arrays, at_rest, TouchArrays.of(rods.node_count, device, precision)).run(device)
    curvature, twist = fetch(at_rest.curvature).copy(), fetch(at_rest.twist).copy()
    between = 0.5 * (twist + twist[rods.following])
    store(arrays.moment_turn, np.stack([np.cos(between), np.sin(between)], axis=1))
    arrays = replace(arrays, knitted=(curvature, twist))
    set_natural_shape(arrays, rods)
    return arrays


def set_natural_shape(arrays: RodArrays, rods: Rods, released: float = 1.0, rows: slice = slice(None)) -> None:
    """Set natural curvature and twist of some rows; released: share from the knitted to the rods' values."""
    own = rods.of_rows
    for values, knitted, natural in (
        (arrays.natural_curvature, arrays.knitted[0], own.natural_curvature),
        (arrays.natural_twist, arrays.knitted[1], own.natural_twist),
    ):
        target = rods.set_fraction * knitted if natural is None else natural
        store(values[rows], ((1.0 - released) * knitted + released * target)[rows])


def _blocks(rods: Rods) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First node, number of nodes and wire of each block of nodes."""
    first = [np.arange(f, f + n, ROD_BLOCK) for f, n in zip(rods.wire_first, rods.wire_count, strict=True)]
    wire = np.repeat(np.arange(len(first)), [len(f) for f in first])
    begin = np.concatenate(first)
    end = (rods.wire_first + rods.wire_count)[wire]
    return begin, np.minimum(ROD_BLOCK, end - begin), wire


def _borders(rods: Rods) -> tuple[np.ndarray, int]:
    """Row of a wire's first node in the masses' borders [wire], and number of rows."""
    rows = np.where(rods.wire_closed, rods.wire_count, OPEN_BORDER)
    begin = np.cumsum(rows) - rows
    return begin - np.where(rods.wire_closed, 0, rods.wire_count - OPEN_BORDER), int(rows.sum())


def rest_state(rods: Rods, device: str, precision: Precision = DOUBLE, worlds: int = 1) -> RodState:
    """The rest state, with true masses and stiffnesses."""
    nodes, edge, real = rods.node_count, rods.rest_edge, wp.dtype_to_numpy(precision.real)
    length, mass = np.linalg.norm(edge, axis=1), rods.of_nodes("linear_density") * rods.node_length
    blocks = int(np.sum(-(-rods.wire_count // ROD_BLOCK)))
    counts = {
        "node": nodes,
        "wire": len(rods.wire_first),
        "rod_block": blocks,
        "block": blocks if is_in_place(device) else 1,
        "border": _borders(rods)[1],
        "world": worlds,
    }
    counts["yielding"] = nodes if rods.section.yields else 1
    values = {
        "tangent": (edge / length[:, None]).astype(real),
        "director": rods.director.astype(real),
        "stretch_stiffness": rods.of_nodes("axial_stiffness"),
        "node_mass": np.repeat(mass[:, None], 3, axis=1),
        "spin_inertia": rods.of_nodes("rotary_inertia") * rods.natural_length,
        "position": rods.position.copy(),
        "length": length,
    }
    state = new_arrays(RodState, device, counts, values, precision)
    Steering(state.control).set(
        load=(1.0, 0.0, 0.0, 1.0, 1.0), velocity_factor=1.0, drive=1.0, step_limit=np.inf, speed_limit=np.inf, travel_limit=np.inf
    )
    return state


class StepForces(NamedTuple):
    """Storage of forces and torques of a step, and the sweep of its motion."""

    stored_from: int  # node that the arrays begin with
    force: wp.array  # vec3d [N]
    torque: wp.array  # [N m]
    sweep: wp.array  # vec4d

    @staticmethod
    def of(state: RodState) -> StepForces:
        """The arrays of a state."""
        return StepForces(0, state.force, state.torque, state.sweep)


def frames_launch(arrays: RodArrays, state: RodState, blocks: range | None = None, when: int = ALWAYS) -> Launch:
    """Launch of `update_frames` for some blocks, default all: edges and directors; when: see there."""
    block, threads, a_block = _block_threads(arrays, state, blocks)
    return bind(update_frames, threads, arrays, state, first_block=block, threads_a_block=a_block, when=int(when))


def force_launch(
    rods: Rods,
    arrays: RodArrays,
    state: RodState,
    touch: TouchArrays,
    blocks: range | None = None,
    stored: StepForces | None = None,
) -> Launch:
    """Launch of `find_rod_forces` for some blocks, default all: stretch, bending, twist, and the sum of all forces."""
    block, threads, a_block = _block_threads(arrays, state, blocks)
    stored = stored or StepForces.of(state)
    return bind(
        find_rod_forces, threads, arrays, state, touch, first_block=block, threads_a_block=a_block,
        stored_from=stored.stored_from, force=stored.force, torque=stored.torque,
        hardening=wp.float64(rods.section.hardening),
    )  # fmt: skip


def _block_threads(arrays: RodArrays, state: RodState, blocks: range | None) -> tuple[int, int, int]:
    """First of some blocks, their threads, and threads of a block: one, or more on a GPU (kernels/rod_blocks.py)."""
    blocks = range(len(arrays.block_first)) if blocks is None else blocks
    a_block = lanes(ROD_LANES, state.control.device)
    return blocks.start, len(blocks) * a_block, a_block


def factor_launches(arrays: RodArrays, state: RodState, wires: range) -> list[Launch]:
    """Launches that factor the masses of some wires, after they have changed (kernels/banded_mass.py)."""
    parts = lanes(WIRE_PARTS, state.control.device)
    return [
        bind(factor_masses, len(wires) * parts, arrays, state, first_wire=wires.start, parts=parts),
        bind(factor_borders, len(wires), arrays, state, first_wire=wires.start),
    ]


def motion_launch(arrays: RodArrays, state: RodState, wires: range, stored: StepForces) -> Launch:
    """Launch of `move_rods` for some wires: accelerations and update."""
    a_wire = lanes(MOTION_LANES, state.control.device)
    return bind(
        move_rods, len(wires) * a_wire, arrays, state, first_wire=wires.start, threads_a_block=a_wire, **stored._asdict()
    )  # fmt: skip


@cache
def declare_overloads(precision: Precision) -> None:
    """Declare overloads of the kernels of MODULES, before the first launch.

    A module is compiled with the overloads that are known when it is loaded, and anew for each one that comes later.
    """
    kernels = [kernel for module in MODULES for kernel in vars(module).values() if isinstance(kernel, wp.Kernel)]
    declared = [(kernel, precision) for kernel in (*kernels, membrane_transfer.gather_forces) if kernel.is_generic]
    for kernel, types in (*declared, (rod_sums.sum_mass_products, DOUBLE)):  # the last one of motions between checks
        arrays: dict[str, wp.array] = {}
        for argument in kernel.adj.args:
            name = argument.label
            kind = types.real if name in NUMBERS else types.vec4 if name in OF_FOUR else types.vec3
            if isinstance(argument.type, wp.array) and argument.type.dtype is Any:
                arrays[name] = wp.array(dtype=kind, ndim=argument.type.ndim)
        wp.overload(kernel, arrays)
