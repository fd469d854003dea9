"""Solver constants of all models, damping, load throttle, and number of threads."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

import numpy as np

from ..base.errors import InputError
from ..results.finding import ResultWarning
from ..scene import Scene

# --- steps
CHECK_STEPS = 50  # steps between convergence checks of the plane and of a ramp
CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))

# --- dynamic relaxation
LOOK_AHEAD = 0.12  # steps; stable up to 4/(1 + 2 LOOK_AHEAD) of the unit-step mass
MASS_MARGIN = 1.5  # fictitious masses over the smallest ones stable at unit step without look-ahead
FIRST_DAMPING = 0.02  # [1/s]
FASTEST_DAMPING = 0.2  # [1/s]
FOLLOWED_INCREMENT = 0.015  # of the strain in the spatial model; a tricot leaves its load path in increments of 2.7 %
SLOWEST_WAVE = 3.0  # loops of wire: longer bending waves stay overdamped, as they carry almost no force
TURN_ALLOWANCE = 0.3  # [rad] allowance for turns sharpened by the load, in fictitious masses
SPEED_SHARE = 0.05  # of a node spacing: largest displacement a step
TINY = 1e-300  # avoids a division by zero in unused values

# --- convergence of a relaxation
FORCE_FLOOR = 0.05  # of EI/W^2: lower bound of the force in the residual
ENERGY_FLOOR = 1e-5  # of EI/W a loop: lower bound of the stored energy in the residual
LOCAL_ALLOWANCE = 10.0  # allowed largest residual over the tolerance
AXIAL_ERROR = 2e-5  # allowed error of the axial strain of a softened segment
# of errors of segments and of contacts: allowed rms and largest error over the tolerance. In a small mesh the largest is
# about twice the rms; among many thousands, some next to a clamp are still larger while nothing else changes
TYPICAL_ALLOWANCE, OUTLIER_ALLOWANCE = 0.5, 5.0

# --- throttle at which a load or a correction is applied
# overlaps of wires, of the thickness
MAX_OVERLAP = 0.5  # above it they may pass through each other
DEEP, SHALLOW = 0.25, 0.125  # above the first one the throttle is halved, below the second one it is doubled again
LEAST_THROTTLE = 0.125

# --- nodes
FEWEST_NODES = 12  # a loop: the tension error of the double atlas cell is 9 % at 8 nodes, 1 % at 12

# --- ramps
STEP_MARGIN = 0.9  # time step over the bound
LOADING_PERIODS = 10.0  # slowest periods of the default loading time of a ramp


def few_nodes(nodes: int) -> Iterator[ResultWarning]:
    """Warning where a loop has few nodes."""
    if nodes < FEWEST_NODES:
        yield ResultWarning("W25", f"{nodes} nodes a loop are few; tension and contact force may be wrong by over 10 %.")


def slowest_rate(scene: Scene, loop_length: float) -> float:
    """Angular frequency [1/s] of the slowest bending mode: a wave of about three loops of wire.

    w = sqrt(EI/mu) (2 pi/(3 L))^2; the softest mode of the double atlas cell has a wave length of 2.75 L (measured on the
    stiffness matrix of its relaxed state at 10 %).
    """
    wire = scene.wire
    wave = math.sqrt(wire.bending_stiffness / (wire.linear_density * scene.solver.mass_scaling))
    return wave * (2.0 * math.pi / (SLOWEST_WAVE * loop_length)) ** 2


def slowest_damping(bending_stiffness: float, wave_length: float, spacing: float, mass: float) -> float:
    """[1/s] critical damping of a bending wave [m], of nodes `spacing` [m] apart with masses [kg]."""
    wave_number = 2.0 * math.pi / wave_length
    return 2.0 * math.sqrt(bending_stiffness * wave_number**4 * spacing / mass)


def renewed_throttle(throttle: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """Share of the usual increments of a load, at most 1; less while wires overlap deeply.

    overlap: the deepest since the last renewal, over the thickness of the wires.
    """
    faster = np.where(overlap < SHALLOW, np.minimum(2.0 * throttle, 1.0), throttle)
    return np.where(overlap > DEEP, np.maximum(0.5 * throttle, LEAST_THROTTLE), faster)


def renewed_damping(damping: np.ndarray, force: np.ndarray, moved: np.ndarray, slowest: float) -> np.ndarray:
    """Damping [1/s] near critical for the slowest active mode; arrays of any shape.

    From the changes du of displacement and d(f/m) of acceleration between two convergence checks, Rayleigh's quotient is

        lambda = force/moved = - sum m du . d(f/m) / sum m du . du          c -> sqrt(c 2 sqrt(lambda))

    with 2 sqrt(lambda) between `slowest` and FASTEST_DAMPING. Unchanged without motion.
    """
    is_valid = (moved > 0.0) & (force > 0.0)
    mode = 2.0 * np.sqrt(force * is_valid / np.maximum(moved, TINY))
    return np.asarray(np.where(is_valid, np.sqrt(damping * np.minimum(np.maximum(mode, slowest), FASTEST_DAMPING)), damping))


def error_ratio(
    square_sum: np.ndarray | float,
    count: np.ndarray | float,
    largest: np.ndarray | float,
    tolerance: float,
    allowance: float = OUTLIER_ALLOWANCE,
) -> np.ndarray:
    """Errors of `count` constraints over what is allowed: the sum of their squares and the largest.

    allowance: of the largest error over the tolerance.
    """
    typical = np.sqrt(square_sum / np.maximum(count, 1)) / TYPICAL_ALLOWANCE
    return np.asarray(np.maximum(typical, np.asarray(largest) / allowance) / tolerance)


def process_count(work: int, device: str = "cpu") -> int:
    """Number of processes: as threads, but 1 on a GPU, which they would share, and without POSIX, which `worker` needs."""
    return thread_count(work) if device == "cpu" and os.name == "posix" else 1


def thread_count(work: int) -> int:
    """Number of threads or processes: WARPKNIT_THREADS or one a core, at most one a piece of work."""
    given = os.environ.get("WARPKNIT_THREADS", "")
    if given and not given.isdecimal():
        raise InputError(f"WARPKNIT_THREADS: {given!r} is not a number of threads; give a whole number, such as 1")
    wanted = int(given) if given else len(CORES)
    return max(1, min(wanted, len(CORES), work))
