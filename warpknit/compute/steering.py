"""The control array of a time step by name: what kernels/control.py declares entry by entry, for one world or for many.

steering = state.steering
steering.set(time_step=1.0, damping=0.1)
steering.damping                                  # float, or [world] where the array has a row a world
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from ..kernels import control as c
from .host import fetch, is_in_place, store_at


class Entry:
    """Entries of the control array from one on; shape () for a single one."""

    def __init__(self, first: Any, *shape: int) -> None:
        self.first, self.shape = int(first), shape
        self.count = int(np.prod(shape, dtype=int))
        self.where: Any = slice(self.first, self.first + self.count) if shape else self.first

    def __get__(self, steering: Steering | None, owner: type | None = None) -> Any:
        if steering is None:
            return self
        found = steering.values[..., self.where]
        found = found.reshape(*found.shape[:-1], *self.shape) if self.shape else found
        return found.copy() if found.ndim else float(found)

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __set__(self, steering: Steering, value: Any) -> None:
        steering.set(**{self.name: value})

    def flat(self, value: Any) -> Any:
        """A value with the entries along one axis."""
        if not self.shape:
            return value
        given = np.asarray(value, dtype=float)
        given = np.broadcast_to(given, self.shape) if given.ndim < len(self.shape) else given
        return given.reshape(*given.shape[: given.ndim - len(self.shape)], self.count)


class Steering:
    """Reads and writes a control array; units as in kernels/control.py."""

    velocity_factor = Entry(c.VELOCITY_FACTOR)
    force_factor = Entry(c.FORCE_FACTOR)
    time_step = Entry(c.TIME_STEP)
    gradient = Entry(c.GRADIENT, 2, 2)
    load = Entry(c.GRADIENT, 5)  # gradient and length factor
    length_factor = Entry(c.LENGTH_FACTOR)
    look_ahead = Entry(c.LOOK_AHEAD)
    contact_stiffness = Entry(c.CONTACT_STIFFNESS)
    bow_moment = Entry(c.BOW_MOMENT)
    body_inverse_mass = Entry(c.BODY_INVERSE_MASS)
    ramp_from = Entry(c.FROM, 5)
    ramp_to = Entry(c.TO, 5)
    ramp_step = Entry(c.RAMP_STEP)
    ramp_steps = Entry(c.RAMP_STEPS)
    ramp_share = Entry(c.RAMP_SHARE)
    ramp_lag = Entry(c.RAMP_LAG)
    is_driven = Entry(c.IS_DRIVEN, 2)
    tension_from = Entry(c.TENSION_FROM, 2)
    tension_to = Entry(c.TENSION_TO, 2)
    strain_speed = Entry(c.STRAIN_SPEED, 2)
    strain_mass = Entry(c.STRAIN_MASS, 2)
    tension = Entry(c.TENSION, 2)
    strain_limit = Entry(c.STRAIN_LIMIT)
    strain_origin = Entry(c.STRAIN_ORIGIN, 2)
    strain_range = Entry(c.STRAIN_RANGE)
    at_limit = Entry(c.AT_LIMIT, 2)
    friction = Entry(c.FRICTION)
    cell_area = Entry(c.CELL_AREA)
    stress_unit = Entry(c.STRESS_UNIT)
    even_ramp = Entry(c.EVEN_RAMP)
    drive = Entry(c.DRIVE)
    damping = Entry(c.DAMPING)
    dead_load = Entry(c.DEAD_LOAD)
    speed_limit = Entry(c.SPEED_LIMIT)
    step_limit = Entry(c.STEP_LIMIT)
    travel = Entry(c.TRAVEL)
    step_travel = Entry(c.STEP_TRAVEL)
    travel_limit = Entry(c.TRAVEL_LIMIT)
    status = Entry(c.STATUS)
    step = Entry(c.STEP)
    last_step = Entry(c.LAST_STEP)
    kinetic_twice = Entry(c.KINETIC_TWICE)
    speed_max = Entry(c.SPEED_MAX)
    force_max = Entry(c.FORCE_MAX)
    force_square = Entry(c.FORCE_SQUARE)
    dissipated = Entry(c.DISSIPATED)
    multiplier_rate = Entry(c.MULTIPLIER_RATE)
    slope_factor = Entry(c.SLOPE_FACTOR)
    evaluated_gap = Entry(c.EVALUATED_GAP)
    near_gap = Entry(c.NEAR_GAP)
    pair_reach = Entry(c.PAIR_REACH)
    extrapolation = Entry(c.EXTRAPOLATION)
    penalty_floor = Entry(c.PENALTY_FLOOR)
    mean_push = Entry(c.MEAN_PUSH)
    loading = Entry(c.IS_LOADING)
    sticking = Entry(c.STICKING)
    weight_square = Entry(c.WEIGHT_SQUARE)
    lever = Entry(c.LEVER)

    RUNNING, STALE, DIVERGED = float(c.STATUS_RUNNING), float(c.STATUS_STALE), float(c.STATUS_DIVERGED)
    EVALUATING, ACCEPTING, WAITING = float(c.STATUS_EVALUATING), float(c.STATUS_ACCEPTING), float(c.STATUS_WAITING)

    def __init__(self, array: wp.array | np.ndarray, world: int | None = None) -> None:
        """array: [CONTROL_COUNT], or (world, CONTROL_COUNT), on a device or on the host; world: index of its row."""
        self.array, self.world = array, world
        in_place = array if isinstance(array, np.ndarray) else fetch(array) if is_in_place(array.device) else None
        self._view = in_place if in_place is None or world is None else in_place[world]  # None: on a GPU

    @property
    def values(self) -> np.ndarray:
        """The array on the host: a view on the CPU, a copy from a GPU."""
        if self._view is not None:
            return self._view
        assert not isinstance(self.array, np.ndarray)
        values = fetch(self.array)
        return values if self.world is None else values[self.world]

    def read(self) -> Steering:
        """The entries of now, read once."""
        return Steering(self.values)

    def set(self, rows: np.ndarray | None = None, **values: Any) -> None:
        """Set entries by name, of one world, of all, or of `rows`; values broadcast to (row, ...)."""
        array: Any = self.array
        entries = {ENTRIES[name]: value for name, value in values.items()}
        if self._view is None and (self.world is not None or array.shape[0] == 1 or array.ndim == 1):
            flat, begin = array.flatten(), (self.world or 0) * c.CONTROL_COUNT
            for entry, value in entries.items():  # of a single world, without waiting for the device
                for k, number in enumerate(np.broadcast_to(value, (1, *entry.shape)).ravel().tolist(), begin + entry.first):
                    flat[k : k + 1].fill_(number)
            return
        host = self.values
        for entry, value in entries.items():
            if host.ndim == 1:
                host[entry.where] = entry.flat(value)
            else:
                host[slice(None) if rows is None else rows, entry.where] = entry.flat(value)
        if self._view is None:
            store_at(array, ..., host)

    @property
    def is_loading(self) -> Any:
        """Whether a load is being applied, of one world or of each."""
        now = self.read()
        return now.ramp_step < now.ramp_steps


ENTRIES = {name: entry for name, entry in vars(Steering).items() if isinstance(entry, Entry)}
