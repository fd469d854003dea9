"""The table of measures: names of the values of a record, and where each is written.

history.csv, summary.json, maps and trades draw on it. A new measure is one line: a function of the observables, which returns
None where a model or a mesh has none of it; there is no column and no key then, or an empty field (`may_be_empty`).

Names and meanings; docs/reference/summary.md has them too. A unit is the end of a name. `A` stands for a class of contact.

    index                   number of the record, from 0
    stage                   name of the stage
    load_factor             share of the load of the stage
    strain_weft             strain of the boundary in weft
    strain_warp             strain of the boundary in warp
    shear                   shear of the boundary: off-diagonal entry of F; of a hook, displacement over height
    clamp_rotation          rotation of the clamps [rad]
    clamp_rotation_rad      rotation of the clamps
    temperature_K           temperature of the mesh; the middle of a gradient
    pairs                   pairs of wire and contact body; in space two for each site
    active                  pairs closed with more than the threshold
    active_pairs            pairs closed with more than the threshold
    active_percent          share of the active pairs
    active_A_percent        share of the active pairs of a class
    force_A_N               contact force that half of the pairs of a class reach
    bodies                  contact bodies; in space places where two wires hook, of wires from a file also where they cross or
                            come near each other
    active_bodies           bodies both of whose pairs are active
    active_bodies_percent   share of the bodies both of whose pairs are active
    active_rhombus_percent  share of the active pairs at the central rhombus; empty without one
    at_reach_end            active pairs whose contact has slid to the end of its range along the wire: not reliable
    force_max_N             largest force of a pair, active or not: `contact_force_max_N` of history.csv
    force_mean_N            mean force of the active pairs
    contact_force_sum_N     sum of the contact forces, in the tables of a trade; in space each twice, as pairs
    threshold_N             force above which a pair is active, at least 1e-4 EI/W^2
    near_bodies             in space: sites whose wires are closer than 1.25 diameters
    near_percent            in space: share of the sites whose wires are closer than 1.25 diameters
    elsewhere               in space: active contacts outside these places, as between the stitches of a knit
    contacts_elsewhere      in space: active contacts outside these places
    elsewhere_force_max_N   in space: largest force of a contact outside these places
    central_rhombus         the counts of the bodies around the complete opening nearest to the centre
    tension_weft_N_per_m    force per current width in weft
    tension_warp_N_per_m    force per current width in warp
    fragment_tension_weft_N_per_m  part of the tension in weft of wires of less than a loop, which two grips pull apart
    fragment_tension_warp_N_per_m  part of the tension in warp of wires of less than a loop, which two grips pull apart
    stress_max_Pa           largest stress, bending and tension, with the peaks under contacts
    stress_max_part         part of the loop where the stress is largest: head, leg, foot or underlap; not of wires from a file
    stress_max_node         node where the stress is largest, or the one before it
    stress_max_wire         wire where the stress is largest
    stress_max_x_m          place of the largest stress in weft, from the corner of the mesh
    stress_max_y_m          place of the largest stress in warp, from the corner of the mesh
    stress_p99_Pa           stress that 1 % of the wire exceeds, by length
    shear_stress_max_Pa     in space: largest shear stress of twist, G (d/2) times the change of twist
    yield_stress_Pa         elastic limit of the wire
    yield_stress_assumed    whether the elastic limit is that of the material, which the scene does not give
    yield_fraction          share of the wire, by length, whose stress is above the yield stress
    plastic_fraction        with `wire.plastic`: share of the wire, by length, that has yielded in bending and keeps a set
    plastic_strain_max      with `wire.plastic`: largest plastic strain of a fibre
    axial_strain_max        largest T/EA of a segment
    slid_max_m              largest difference between the mean displacements of two wires of a periodic tile
    contact_force_max_N     largest force of a pair, active or not; in space that of a site
    stress_interior_max_Pa  largest stress away from the edges
    energy_stretch_J        stored in stretch
    energy_bend_J           stored in bending, and in twist
    energy_contact_J        stored in contact
    energy_kinetic_J        kinetic energy, of fictitious masses in a relaxation
    work_J                  work of the load; of a relaxation by monotone curves through the states between jumps, of a ramp
                            step by step
    edge_work_J             part of the work due to pulls, cords and temperature gradients
    dissipated_J            dissipated by the damping of a ramp, by friction and yield
    residual                rms out-of-balance force over the larger of the mean boundary force and EI/W^2
    membrane_left_out       imbalance over many repeats over the tension; 0 if the membrane correction converged
    penetration             largest overlap over the wire diameter
    steps                   time steps since the start
    steady                  True where the level has converged
    nominal_weft_N_per_m    work per strain in weft and area as knitted; of wires from a file the area of the box around them
    nominal_shear_N_per_m   force per reference width, conjugate to the shear
    nominal_warp_N_per_m    force per reference width, conjugate to the strain in warp
    clamp_couple_N_per_m    moment on all clamps per reference area, conjugate to their rotation
    length_factor           1 + alpha (T - T0) of the wires
    thermal_force_J         derivative of the energy by the length factor
    areal_mass_kg_per_m2    mass of wire per current area
    thickness_m             in space: from the lowest to the highest surface of the wires
    displacement_m          of the driven end of a hook
    drive_force_N           force on the driven end of a hook
    force_left_N            force between the body and the left wire of a hook
    force_right_N           force between the body and the right wire of a hook
    arc_left_m              point nearest to the body along the undeformed left wire, from the lower clamp
    arc_right_m             point nearest to the body along the undeformed right wire, from the lower clamp
    slide_left_m            total sliding of the closed contact along the left wire, back and forth
    slide_right_m           total sliding of the closed contact along the right wire, back and forth
    ground_force_N          force of spring or plane on the body of a hook
    body_x_m                place of the body of a hook in weft
    body_y_m                place of the body of a hook in warp
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from .. import measure as m
from ..knit.cloth import CLASS_NAMES
from . import contact_classes, stress_peak
from .observables import Observables


class Record(Protocol):
    """A recorded state, of either model."""

    @property
    def index(self) -> int:
        """Index from 0."""

    @property
    def stage(self) -> str: ...
    @property
    def load_factor(self) -> float: ...
    @property
    def temperature(self) -> float:
        """[K]"""

    @property
    def steps(self) -> int: ...
    @property
    def steady(self) -> bool: ...
    @property
    def work(self) -> float:
        """[J] work of the boundary since the start, in a ramp; 0 in a relaxation, whose work is `work_J` of history.csv."""

    @property
    def dissipated(self) -> float:
        """[J] since the start, by damping of a ramp, friction and yield; 0 in a relaxation without friction and yield."""

    @property
    def edge_work(self) -> float:
        """[J] work of pulls at the edge, cords and uneven temperature."""

    @property
    def membrane_residual(self) -> float:
        """Out-of-balance membrane stress over the tension."""

    @property
    def stations(self) -> np.ndarray:
        """(station, 2) [m] displacement of the rim (mesh/rim.py); empty where it follows the load."""

    @property
    def observables(self) -> Observables: ...


@dataclass(frozen=True)
class Measure:
    """One line of the table."""

    name: str  # with its unit
    of: Callable[[Observables], Any] | str  # or the field of the record
    history: bool = False  # a column of history.csv
    summary: str = ""  # the section of summary.json that has it
    map: str = ""  # the table of a map that has it: "map" of map.csv, "details" of map_details.csv
    over_seeds: Callable[[list[float]], Any] = np.mean  # aggregation over the seeds of a map
    kind: Callable[[str], Any] = float  # type of the column of history.csv
    may_be_empty: bool = False  # None is an empty field of history.csv; else it has no such column then

    def value(self, record: Record) -> Any:
        """Value of a record, or None."""
        return getattr(record, self.of) if isinstance(self.of, str) else self.of(record.observables)


def number_or_none(text: str) -> float | None:
    """The number of a field of history.csv; None of an empty one."""
    return float(text) if text else None


def _is_true(text: str) -> bool:
    return text == "True"


def _rhombus(r: Observables) -> dict[str, Any]:
    found = m.rhombus_contacts(r)
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


def _near(of: Callable[[np.ndarray], Any]) -> Callable[[Observables], Any]:
    return lambda r: None if r.body_near is None else of(r.body_near)


def _elsewhere(of: Callable[[np.ndarray], Any]) -> Callable[[Observables], Any]:
    return lambda r: None if r.contact_elsewhere is None else of(r.contact_elsewhere)


def _hook(name: str) -> Callable[[Observables], Any]:
    """A value of the contact of two hooked wires."""
    return lambda r: None if r.hook_contact is None else float(getattr(r.hook_contact, name))


def _pressed_at(axis: int) -> Callable[[Observables], Any]:
    return lambda r: None if r.hook_contact is None else float(r.hook_contact.body[axis])


def _slide(r: Observables) -> float | None:
    """[m] sliding distance of a hook's contact along its wire, summed in runner/history.py."""
    return None if r.hook_contact is None else 0.0


# Columns of history.csv stand in the order of the lines.
MEASURES: tuple[Measure, ...] = (
    # of the record, and its load
    Measure("index", "index", history=True, kind=int),
    Measure("stage", "stage", history=True, kind=str),
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
    Measure("active_pairs", lambda r: m.contacts(r).active, history=True, kind=int),
    Measure("active_percent", lambda r: m.contacts(r).active_percent, history=True, summary="contacts", map="map"),
    *(
        Measure(f"active_{name}_percent", partial(contact_classes.active_percent, name=name), history=True)
        for name in CLASS_NAMES
    ),
    *(Measure(f"force_{name}_N", partial(contact_classes.median_force, name=name), history=True) for name in CLASS_NAMES),
    Measure("bodies", lambda r: m.contacts(r).bodies, summary="contacts"),
    Measure("active_bodies", lambda r: m.contacts(r).active_bodies, summary="contacts"),
    Measure("active_bodies_percent", lambda r: m.contacts(r).active_bodies_percent, map="details"),
    Measure(
        "active_rhombus_percent",
        lambda r: _rhombus(r)["active_percent"],
        history=True,
        map="details",
        kind=number_or_none,
        may_be_empty=True,
    ),
    Measure("at_reach_end", m.pairs_at_reach_end, summary="contacts"),
    Measure("force_max_N", m.largest_contact_force, summary="contacts"),
    Measure("force_mean_N", _mean_force, summary="contacts"),
    Measure("contact_force_sum_N", lambda r: float(r.pair_force.sum() + 2.0 * r.elsewhere_force.sum())),
    Measure("threshold_N", lambda r: m.active_threshold(r.model), summary="contacts"),
    Measure("near_bodies", _near(lambda near: int(near.sum())), summary="contacts"),
    Measure("near_percent", _near(lambda near: 100.0 * float(near.mean()) if len(near) else 0.0), summary="contacts"),
    Measure("elsewhere", _elsewhere(len), summary="contacts"),
    Measure("contacts_elsewhere", _elsewhere(len), history=True, kind=int),
    Measure("elsewhere_force_max_N", _elsewhere(lambda force: float(force.max(initial=0.0))), history=True, summary="contacts"),
    Measure("central_rhombus", _rhombus, summary="contacts"),
    # tensions, force per current width
    Measure("tension_weft_N_per_m", lambda r: m.mesh_tension(r)[0], history=True, summary="mesh", map="map"),
    Measure("tension_warp_N_per_m", lambda r: m.mesh_tension(r)[1], history=True, summary="mesh", map="map"),
    Measure("fragment_tension_weft_N_per_m", lambda r: m.fragment_tension(r)[0], history=True, summary="mesh"),
    Measure("fragment_tension_warp_N_per_m", lambda r: m.fragment_tension(r)[1], history=True, summary="mesh"),
    # wires
    Measure("stress_max_Pa", m.largest_stress, history=True, summary="wire", map="map", over_seeds=max),
    Measure("stress_max_part", stress_peak.peak_part, history=True, summary="wire", kind=str),
    Measure("stress_max_node", stress_peak.peak_node, history=True, summary="wire", kind=int),
    Measure(
        "stress_max_wire",
        lambda r: stress_peak.wire_of(r.model, stress_peak.peak_node(r)),
        history=True,
        summary="wire",
        kind=int,
    ),
    Measure("stress_max_x_m", lambda r: float(stress_peak.peak_position(r)[0]), history=True, summary="wire"),
    Measure("stress_max_y_m", lambda r: float(stress_peak.peak_position(r)[1]), history=True, summary="wire"),
    Measure("stress_p99_Pa", m.exceeded_stress, summary="wire"),
    Measure("shear_stress_max_Pa", lambda r: None if r.shear_stress is None else float(r.shear_stress.max()), summary="wire"),
    Measure("yield_stress_Pa", lambda r: r.model.scene.wire.yield_stress, summary="wire"),
    Measure("yield_stress_assumed", lambda r: "wire.yield_stress" in r.model.scene.assumed, summary="wire"),
    Measure("yield_fraction", m.yield_share, summary="wire", map="map"),
    Measure("plastic_fraction", lambda r: m.plastic_extremes(r)[0], summary="wire"),
    Measure("plastic_strain_max", lambda r: m.plastic_extremes(r)[1], summary="wire"),
    Measure("axial_strain_max", lambda r: float(np.max(np.abs(r.axial_strain))), summary="wire"),
    Measure("slid_max_m", m.slid, summary="wire", map="details", over_seeds=max),
    Measure("contact_force_max_N", m.largest_contact_force, history=True, map="details", over_seeds=max),
    Measure("stress_interior_max_Pa", m.interior_stress, history=True, summary="wire", map="details", over_seeds=max),
    # energies and work
    Measure("energy_stretch_J", lambda r: r.energies.stretch, history=True, map="details"),
    Measure("energy_bend_J", lambda r: r.energies.bend, history=True, map="details"),
    Measure("energy_contact_J", lambda r: r.energies.contact, history=True, map="details"),
    Measure("energy_kinetic_J", lambda r: r.energies.kinetic, history=True),
    Measure("work_J", "work", history=True),  # of a relaxation: summed in runner/work.py
    Measure("edge_work_J", "edge_work", history=True),
    Measure("dissipated_J", "dissipated", history=True),
    # quality
    Measure("residual", m.residual, history=True, summary="quality", map="details", over_seeds=max),
    Measure("membrane_left_out", "membrane_residual", summary="quality"),
    Measure("penetration", m.penetration, history=True),
    Measure("steps", "steps", history=True, kind=int),
    Measure("steady", "steady", history=True, kind=_is_true),
    # conjugates of strains, rotation and length
    Measure("nominal_weft_N_per_m", lambda r: float(m.boundary_stress(r)[0, 0]), history=True, map="details"),
    Measure("nominal_shear_N_per_m", lambda r: float(m.boundary_stress(r)[0, 1]), history=True),
    Measure("nominal_warp_N_per_m", lambda r: float(m.boundary_stress(r)[1, 1]), history=True, map="details"),
    Measure("clamp_couple_N_per_m", m.clamp_couple, history=True),
    Measure("length_factor", lambda r: r.length_factor, history=True),
    Measure("thermal_force_J", m.thermal_force, history=True),
    # mesh
    Measure("areal_mass_kg_per_m2", m.areal_mass, summary="mesh"),
    Measure("thickness_m", lambda r: r.thickness, summary="mesh"),
    # two hooked wires
    Measure("displacement_m", _hook("displacement"), history=True, summary="hook"),
    Measure("drive_force_N", _hook("drive_force"), history=True, summary="hook"),
    Measure("force_left_N", _hook("force_left"), history=True, summary="hook"),
    Measure("force_right_N", _hook("force_right"), history=True, summary="hook"),
    Measure("arc_left_m", _hook("arc_left"), history=True, summary="hook"),
    Measure("arc_right_m", _hook("arc_right"), history=True, summary="hook"),
    Measure("slide_left_m", _slide, history=True, summary="hook"),
    Measure("slide_right_m", _slide, history=True, summary="hook"),
    Measure("ground_force_N", _hook("ground_force"), history=True, summary="hook"),
    Measure("body_x_m", _pressed_at(0), history=True, summary="hook"),
    Measure("body_y_m", _pressed_at(1), history=True, summary="hook"),
)


def values(r: Observables, names: Iterable[str]) -> dict[str, Any]:
    """Measures of a state by their names."""
    found = {line.name: line.of for line in MEASURES if not isinstance(line.of, str)}
    return {name: found[name](r) for name in names}
