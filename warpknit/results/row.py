"""One recorded state in numbers, frozen: what history.csv, summary.json, a map, tables and pictures show of it."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import FrozenInstanceError, fields, is_dataclass
from inspect import get_annotations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpknit.base.files import write_aside

__all__ = ["Columns", "Row", "Values", "columns_of", "plain", "read_rows", "valued", "write_json", "write_rows"]

Columns: TypeAlias = Mapping[str, NDArray[Any]]  # by name, a value a row
Kind = TypeVar("Kind", bound="Values")


class Values(SimpleNamespace):
    """Values by name that do not change: `values.name`, or `values[name]` where the name is computed."""

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"{name}: this value is read-only; make a new object with changed({name}=...)")

    def __getitem__(self, name: str) -> Any:
        return self.__dict__[name]

    def __contains__(self, name: str) -> bool:
        return name in vars(self)

    def get(self, name: str, other: Any = None) -> Any:
        """The value of a name; `other` where there is none."""
        return self.__dict__.get(name, other)

    def changed(self: Kind, **values: Any) -> Kind:
        """The same with other or further values."""
        return type(self)(**vars(self) | values)


def plain(value: Any) -> Any:
    """A result as tables, lists, texts and numbers, for JSON: values and dataclasses as tables of their names."""
    if isinstance(value, Values):
        return plain(vars(value))
    if is_dataclass(value) and not isinstance(value, type):
        named = {entry.name: getattr(value, entry.name) for entry in fields(value)}
        return str(value) if "__str__" in vars(type(value)) else plain(named)
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: Path, result: Any) -> None:
    """Write a result to a JSON file, atomically; numbers that are not finite as null."""
    with write_aside(path) as file:
        json.dump(plain(result), file, indent=2, allow_nan=False)


def valued(tree: Mapping[str, Any]) -> Any:
    """Values for a table of JSON and the tables in it: what `plain` was given, but for dataclasses and texts."""

    def of(value: Any) -> Any:
        if isinstance(value, list):
            return [of(one) for one in value]
        return valued(value) if isinstance(value, dict) else value

    return Values(**{name: of(value) for name, value in tree.items()})


class Row(Values):
    """One recorded state: the measures of measure/table.py in SI units by their names, which end in the unit.

    A measure that a mesh or a model does not have is left out. `A` in a name stands for a class of contact:
    `row["active_A_percent"]`.
    """

    index: int  # number of the record, from 0
    stage: str  # name of the load step
    load_factor: float  # share of the load of the load step
    strain_weft: float  # strain of the boundary in weft
    strain_warp: float  # strain of the boundary in warp
    shear: float  # shear of the boundary: off-diagonal entry of F; of a hook, displacement over height
    clamp_rotation: float  # rotation of the clamps [rad]
    clamp_rotation_rad: float  # rotation of the clamps
    temperature_K: float  # temperature of the mesh; the middle of a gradient
    pairs: int  # two for each clasp, one for each of its wires
    active: int  # pairs with a force above the threshold
    active_pairs: int  # pairs with a force above the threshold
    active_percent: float  # share of the active pairs
    bodies: int  # clasps, where two wires hook each other; of wires from a file also where wires cross or come near each other
    active_bodies: int  # clasps with both pairs active
    active_bodies_percent: float  # share of the clasps with both pairs active
    active_rhombus_percent: float | None  # share of the active pairs at the central rhombus; empty without one
    at_reach_end: int  # active pairs whose contact has slid to the end of its range along the wire: not reliable
    force_max_N: float  # largest force of a pair, active or not: `contact_force_max_N` of history.csv
    force_mean_N: float  # mean force of the active pairs
    contact_force_sum_N: float  # sum of the contact forces, in the tables of a trade; spatial: each twice, as pairs
    threshold_N: float  # force above which a pair is active, at least 1e-4 EI/W^2
    near_bodies: int  # spatial: clasps whose wires are closer than 1.25 diameters
    near_percent: float  # spatial: share of the clasps whose wires are closer than 1.25 diameters
    elsewhere: int  # spatial: active contacts between stitches, outside the clasps
    contacts_elsewhere: int  # spatial: active contacts between stitches, outside the clasps
    elsewhere_force_max_N: float  # spatial: largest force of a contact between stitches
    central_rhombus: Mapping[str, float]  # the counts of the clasps around the complete opening nearest to the centre
    tension_weft_N_per_m: float  # force per current width in weft
    tension_warp_N_per_m: float  # force per current width in warp
    fragment_tension_weft_N_per_m: float  # part of the weft tension in wires shorter than a loop, between two grips
    fragment_tension_warp_N_per_m: float  # part of the warp tension in wires shorter than a loop, between two grips
    stress_max_Pa: float  # largest stress, bending and tension, with the peaks under contacts
    stress_max_part: str | None  # part of the loop where the stress is largest: head, leg, foot or underlap; not of wires from a
    # file
    stress_max_node: int  # node where the stress is largest, or the node before this place
    stress_max_wire: int  # wire where the stress is largest
    stress_max_x_m: float  # place of the largest stress in weft, from the corner of the mesh
    stress_max_y_m: float  # place of the largest stress in warp, from the corner of the mesh
    stress_p99_Pa: float  # stress that 1 % of the wire exceeds, by length
    shear_stress_max_Pa: float  # spatial: largest shear stress of twist, G (d/2) times the change of twist
    yield_stress_Pa: float  # elastic limit of the wire
    yield_stress_assumed: bool  # whether the elastic limit is the material's default, not given in the scene
    yield_fraction: float  # share of the wire, by length, whose stress is above the yield stress
    plastic_fraction: float  # with `wire.plastic`: share of the wire, by length, that has yielded in bending and keeps a set
    plastic_strain_max: float  # with `wire.plastic`: largest plastic strain of a fibre
    axial_strain_max: float  # largest T/EA of a segment
    slid_max_m: float  # largest difference between the mean displacements of two wires of a periodic tile
    contact_force_max_N: float  # largest force of a pair, active or not; spatial: of a clasp
    stress_interior_max_Pa: float  # largest stress away from the edges
    energy_stretch_J: float  # stored in stretch
    energy_bend_J: float  # stored in bending, and in twist
    energy_contact_J: float  # stored in contact
    energy_kinetic_J: float  # kinetic energy, of fictitious masses in a relaxation
    work_J: float  # work of the load; of a relaxation by monotone curves through the states between jumps, of a ramp step by step
    edge_work_J: float  # part of the work due to pulls, cords and temperature gradients
    dissipated_J: float  # dissipated by the damping of a ramp, by friction and yield
    residual: float  # rms out-of-balance force over the larger of the mean boundary force and EI/W^2
    membrane_left_out: float  # imbalance of forces over many repeats, relative to the tension; 0 if the correction converged
    penetration: float  # largest overlap over the wire diameter
    steps: int  # time steps since the start
    steady: bool  # True where the level has converged
    nominal_weft_N_per_m: float  # work per strain in weft and area as knitted; of wires from a file the area of the box around
    # them
    nominal_shear_N_per_m: float  # force per reference width, conjugate to the shear
    nominal_warp_N_per_m: float  # force per reference width, conjugate to the strain in warp
    clamp_couple_N_per_m: float  # moment on all clamps per reference area, conjugate to their rotation
    length_factor: float  # 1 + alpha (T - T0) of the wires
    thermal_force_J: float  # derivative of the energy by the length factor
    areal_mass_kg_per_m2: float  # mass of wire per current area
    thickness_m: float  # spatial: from the lowest to the highest surface of the wires
    displacement_m: float  # displacement of the driven end of a hook
    drive_force_N: float  # force on the driven end of a hook
    force_left_N: float  # force between the body and the left wire of a hook
    force_right_N: float  # force between the body and the right wire of a hook
    arc_left_m: float  # point nearest to the body along the undeformed left wire, from the lower clamp
    arc_right_m: float  # point nearest to the body along the undeformed right wire, from the lower clamp
    slide_left_m: float  # total sliding of the closed contact along the left wire, back and forth
    slide_right_m: float  # total sliding of the closed contact along the right wire, back and forth
    ground_force_N: float  # force of spring or plane on the body of a hook
    body_x_m: float  # place of the body of a hook in weft
    body_y_m: float  # place of the body of a hook in warp
    kinetic_to_internal: float  # largest ratio of kinetic to stored energy in the states that count as results
    energy_balance: float  # work less stored, dissipated and kinetic energy, over the larger of stored energy and EI/W a loop
    energy_balance_of_stored: float  # the same over the largest stored energy so far, without steps over which the mesh is slack;
    # needs four `output.frames` or more
    penetration_max: float  # largest overlap of all records, over d
    stress_max_so_far_Pa: float  # largest stress of all records so far
    probes: Mapping[str, float | None]  # last values of the probes of `run`, by their names
    panel: Mapping[str, Any]  # of a panel at the end of a stage (runner/summary.py)

    @property
    def stored(self) -> float:
        """[J]"""
        return float(self.energy_stretch_J + self.energy_bend_J + self.energy_contact_J)

    @property
    def tension(self) -> tuple[float, float]:
        """[N/m] in weft and warp."""
        return self.tension_weft_N_per_m, self.tension_warp_N_per_m

    @property
    def is_hook(self) -> bool:
        """Whether the row is of two hooked wires."""
        return "displacement_m" in self

    @property
    def hook_is_closed(self) -> bool:
        """Whether both contacts of the hook carry force."""
        return bool(self.force_left_N > 0.0 and self.force_right_N > 0.0)


def _number(text: str) -> float | None:
    return float(text) if text else None


def _count(text: str) -> float:
    """A whole number, or the mean of such."""
    return float(text) if "." in text or "e" in text else int(text)


# of a column that is no number; an empty cell of numbers is None
KINDS: dict[str, Callable[[str], Any]] = {"int": _count, "str": str, "bool": "True".__eq__}


def columns_of(rows: Iterable[Mapping[str, object]]) -> Columns:
    """(row,) numbers of each column, nan where there is none; the names of the stages."""
    lines = list(rows)
    names = dict.fromkeys(name for line in lines for name in line)
    columns = {name: np.array([_as_number(line.get(name)) for line in lines]) for name in names if name != "stage"}
    return columns | {"stage": np.array([str(line.get("stage", "")) for line in lines])}


def _as_number(value: Any) -> float:
    return float(value) if isinstance(value, int | float | np.number | np.bool_) else math.nan


def write_rows(path: Path, rows: Iterable[Values], columns: Sequence[str]) -> None:
    """Write these columns of rows to a CSV file, atomically; None is an empty cell."""
    with write_aside(path) as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(vars(row) for row in rows)


def read_rows(path: Path, kind: type[Kind]) -> list[Kind]:
    """The rows that `write_rows` wrote, bit-identical, as values of a `kind`; columns of other names are numbers or None."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    hints = {name: hint for part in (Row, *kind.__mro__[::-1]) for name, hint in get_annotations(part).items()}
    readers = {name: KINDS.get(hint.partition(" ")[0], _number) for name, hint in hints.items()}
    return [kind(**{name: readers.get(name, _number)(text) for name, text in line.items()}) for line in lines]
