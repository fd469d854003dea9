"""The table of measures: names of the values of a record, and where each is written.

history.csv, summary.json, maps and trades draw on it. A new measure is one line: a function of the observables, which returns
None where a model or a mesh has none of it; there is no column and no key then, or an empty field (`may_be_empty`).

docs/reference/summary.md has their meanings; types that are not float stand at the class `Row` (results/row.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .. import measure as m
from ..base.text import short_repr
from ..knit.cloth import CLASS_NAMES
from .observables import HookContact, Observables

LIGHT = 0.1  # of the mean contact force


@dataclass(frozen=True)
class Record:
    """A recorded state: its place in the load history and its observables.

        record = next(Simulation(build_model(scene)).run())
        record.load_factor, record.observables.node_position         # 0 to 1 within the stage, (node, 3) [m]

    The observables are the state on the host, the same quantities in both models (measure/observables.py).
    """

    __repr__ = short_repr

    index: int
    stage: str
    stage_index: int
    load_factor: float
    temperature: float  # [K]
    steps: int
    steady: bool
    work: float  # [J] done by the boundary since the start (ramp; a relaxation leaves it 0)
    dissipated: float  # [J] since the start, by damping of a ramp, friction and yield; else 0
    edge_work: float  # [J] work of pulls at the edge, cords and uneven thermal strain
    stations: np.ndarray  # (station, 2 or 3) [m] displacement of the rim (rim.py); empty where it follows the load
    observables: Observables
    world: int = 0  # of many side by side


@dataclass(frozen=True)
class Measure:
    """One line of the table."""

    name: str  # with its unit
    of: Callable[[Observables], Any] | str | None  # or the field of the record; None: from all records (runner/history.py)
    history: bool = False  # a column of history.csv
    summary: str = ""  # the section of summary.json that has it
    map: str = ""  # the table of a map that has it: "map" of map.csv, "details" of map_details.csv
    may_be_empty: bool = False  # None is an empty field of history.csv; else it has no such column then

    def value(self, record: Record) -> Any:
        """Value of a record, or None."""
        if self.of is None:
            return None
        return getattr(record, self.of) if isinstance(self.of, str) else self.of(record.observables)


def _rhombus(r: Observables) -> dict[str, float | None]:
    found = m.contacts(r, r.model.panel.rhombus_bodies)
    return {
        "bodies": found.bodies,
        "pairs": found.pairs,
        "active": found.active,
        "active_percent": found.active_percent if found.bodies else None,
        "active_bodies": found.active_bodies,
    }


def _mean_force(r: Observables) -> float:
    force = m.active_forces(r)
    return float(force.mean()) if len(force) else 0.0


def _light_percent(r: Observables) -> float:
    """Share of the pairs that are active below LIGHT of the mean force."""
    force = m.active_forces(r)
    return 100.0 * int(np.sum(force < LIGHT * force.mean())) / len(r.pair_force) if len(force) else 0.0


def _largest(values: np.ndarray) -> float:
    return float(values.max(initial=0.0))


def _part(name: str, of: Callable[[Any], Any]) -> Callable[[Observables], Any]:
    """A value of a quantity that a mesh or a model may not have; None without it."""

    def value(r: Observables) -> Any:
        return None if (part := getattr(r, name)) is None else of(part)

    return value


# of the contact of two hooked wires
HOOK: dict[str, Callable[[HookContact], float]] = {
    "displacement_m": lambda hook: hook.displacement,
    "drive_force_N": lambda hook: hook.drive_force,
    "force_left_N": lambda hook: hook.force_left,
    "force_right_N": lambda hook: hook.force_right,
    "arc_left_m": lambda hook: hook.arc_left,
    "arc_right_m": lambda hook: hook.arc_right,
    "slide_left_m": lambda _: 0.0,  # sliding distances are summed in runner/history.py
    "slide_right_m": lambda _: 0.0,
    "ground_force_N": lambda hook: hook.ground_force,
    "body_x_m": lambda hook: float(hook.body[0]),
    "body_y_m": lambda hook: float(hook.body[1]),
}

# Columns of history.csv stand in the order of the lines.
MEASURES: tuple[Measure, ...] = (
    # of the record, and its load
    Measure("index", "index", history=True),
    Measure("stage", "stage", history=True),
    Measure("load_factor", "load_factor", history=True),
    Measure("strain_weft", lambda r: float(r.stretch[0, 0] - 1.0), history=True, summary="mesh"),
    Measure("strain_warp", lambda r: float(r.stretch[1, 1] - 1.0), history=True, summary="mesh"),
    Measure("shear", lambda r: float(r.stretch[0, 1]), history=True, summary="mesh"),
    Measure("clamp_rotation", lambda r: r.clamp_rotation, history=True),  # [rad]
    Measure("clamp_rotation_rad", lambda r: r.clamp_rotation, summary="mesh"),
    Measure("temperature_K", "temperature", history=True, summary="mesh"),
    # contacts
    Measure("pairs", lambda r: m.contacts(r).pairs, summary="contacts"),
    Measure("active", lambda r: m.contacts(r).active, summary="contacts"),
    Measure("active_pairs", lambda r: m.contacts(r).active, history=True),
    Measure("active_percent", lambda r: m.contacts(r).active_percent, history=True, summary="contacts", map="map"),
    *(Measure(f"active_{name}_percent", partial(m.class_active_percent, name=name), history=True) for name in CLASS_NAMES),
    *(Measure(f"force_{name}_N", partial(m.class_median_force, name=name), history=True) for name in CLASS_NAMES),
    Measure("bodies", lambda r: m.contacts(r).bodies, summary="contacts"),
    Measure("active_bodies", lambda r: m.contacts(r).active_bodies, summary="contacts"),
    Measure("active_bodies_percent", lambda r: m.contacts(r).active_bodies_percent, map="details"),
    Measure("active_rhombus_percent", lambda r: _rhombus(r)["active_percent"], history=True, map="details", may_be_empty=True),
    Measure("at_reach_end", lambda r: r.pairs_at_reach_end, summary="contacts"),
    Measure("force_max_N", m.largest_contact_force, summary="contacts"),
    Measure("force_mean_N", _mean_force, summary="contacts"),
    Measure("light_percent", _light_percent, summary="contacts"),
    Measure("contact_force_sum_N", lambda r: float(r.pair_force.sum() + 2.0 * r.elsewhere_force.sum())),
    Measure("threshold_N", lambda r: m.active_threshold(r.model), summary="contacts"),
    Measure("near_bodies", _part("body_near", lambda near: int(near.sum())), summary="contacts"),
    Measure(
        "near_percent", _part("body_near", lambda near: 100.0 * float(near.mean()) if len(near) else 0.0), summary="contacts"
    ),
    Measure("elsewhere", _part("contact_elsewhere", len), summary="contacts"),
    Measure("contacts_elsewhere", _part("contact_elsewhere", len), history=True),
    Measure("elsewhere_force_max_N", _part("contact_elsewhere", _largest), history=True, summary="contacts"),
    Measure("central_rhombus", _rhombus, summary="contacts"),
    # tensions, force per current width
    Measure("tension_weft_N_per_m", lambda r: m.mesh_tension(r)[0], history=True, summary="mesh", map="map"),
    Measure("tension_warp_N_per_m", lambda r: m.mesh_tension(r)[1], history=True, summary="mesh", map="map"),
    Measure("fragment_tension_weft_N_per_m", lambda r: m.fragment_tension(r)[0], history=True, summary="mesh"),
    Measure("fragment_tension_warp_N_per_m", lambda r: m.fragment_tension(r)[1], history=True, summary="mesh"),
    # wires
    Measure("stress_max_Pa", m.largest_stress, history=True, summary="wire", map="map"),
    Measure("stress_max_part", m.peak_part, history=True, summary="wire"),
    Measure("stress_max_node", m.peak_node, history=True, summary="wire"),
    Measure("stress_max_wire", m.peak_wire, history=True, summary="wire"),
    Measure("stress_max_x_m", lambda r: float(m.peak_position(r)[0]), history=True, summary="wire"),
    Measure("stress_max_y_m", lambda r: float(m.peak_position(r)[1]), history=True, summary="wire"),
    Measure("stress_p99_Pa", m.exceeded_stress, summary="wire"),
    Measure("shear_stress_max_Pa", _part("shear_stress", _largest), summary="wire"),
    Measure("yield_stress_Pa", lambda r: r.model.scene.wire.yield_stress, summary="wire"),
    Measure("yield_stress_assumed", lambda r: "wire.yield_stress" in r.model.scene.assumed, summary="wire"),
    Measure("yield_fraction", m.yield_share, summary="wire", map="map"),
    Measure("plastic_fraction", lambda r: m.plastic_extremes(r)[0], summary="wire"),
    Measure("plastic_strain_max", lambda r: m.plastic_extremes(r)[1], summary="wire"),
    Measure("axial_strain_max", lambda r: float(np.max(np.abs(r.axial_strain))), summary="wire"),
    Measure("slid_max_m", m.slid, summary="wire", map="details"),
    Measure("contact_force_max_N", m.largest_contact_force, history=True, map="details"),
    Measure("stress_interior_max_Pa", m.interior_stress, history=True, summary="wire", map="details"),
    Measure("stress_max_so_far_Pa", None, summary="wire"),
    # energies and work
    Measure("energy_stretch_J", lambda r: r.energies.stretch, history=True, map="details"),
    Measure("energy_bend_J", lambda r: r.energies.bend, history=True, map="details"),
    Measure("energy_contact_J", lambda r: r.energies.contact, history=True, map="details"),
    Measure("energy_kinetic_J", lambda r: r.energies.kinetic, history=True),
    Measure("work_J", "work", history=True),  # of a relaxation: summed in runner/branches.py
    Measure("edge_work_J", "edge_work", history=True),
    Measure("dissipated_J", "dissipated", history=True),
    # quality
    Measure("residual", m.residual, history=True, summary="quality", map="details"),
    *(
        Measure(name, None, summary="quality")
        for name in ("kinetic_to_internal", "energy_balance", "energy_balance_of_stored", "penetration_max")
    ),
    Measure("penetration", lambda r: r.penetration, history=True),
    Measure("steps", "steps", history=True),
    Measure("steady", "steady", history=True),
    # conjugates of strains, rotation and length
    Measure("nominal_weft_N_per_m", lambda r: float(m.boundary_stress(r)[0, 0]), history=True, map="details"),
    Measure("nominal_shear_N_per_m", lambda r: float(m.boundary_stress(r)[0, 1]), history=True),
    Measure("nominal_warp_N_per_m", lambda r: float(m.boundary_stress(r)[1, 1]), history=True, map="details"),
    Measure("clamp_couple_N_per_m", m.clamp_couple, history=True),
    Measure("length_factor", lambda r: r.length_factor, history=True),
    Measure("thermal_force_J", lambda r: r.thermal_force, history=True),
    # mesh
    Measure("areal_mass_kg_per_m2", m.areal_mass, summary="mesh"),
    Measure("thickness_m", lambda r: r.thickness, summary="mesh"),
    # two hooked wires
    *(Measure(name, _part("hook_contact", of), history=True, summary="hook") for name, of in HOOK.items()),
)


def values(r: Observables, names: Iterable[str]) -> dict[str, float]:
    """Measures of a state by their names."""
    found = {line.name: line.of for line in MEASURES if callable(line.of)}
    return {name: found[name](r) for name in names}
