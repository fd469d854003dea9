"""The mechanics of the spatial model (protocol `Mechanics` of mechanics/protocols.py)."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np

from ..compute.host import Entries, fetch, store
from ..compute.kept import Owner
from ..kernels.rod_blocks import ROD_BLOCK
from ..measure.strain import strain_text
from ..mechanics.numerics import AXIAL_ERROR, FOLLOWED_INCREMENT
from ..mechanics.protocols import Drift, Mechanics
from ..mesh.layout import smaller_scene
from ..mesh.rim import LoadPoint, Rim
from ..wires.overlaps import CLOSEST
from .clamps import Edge
from .convergence import overlap_text, parting_text, refuse_overlaps
from .model import SpatialModel
from .observables import SpatialObservables, read
from .rod_arrays import set_natural_shape
from .rod_step import CHECK_STEPS
from .sites import Sites
from .strip import RodStrip
from .transfer import Fields, Prolongation, SpatialGrid

# steps over which the load of a level is applied, from the first strain on up to the second; in proportion below and beyond
LOAD_STEPS, LOAD_STRAINS = 200, (0.001, 0.03)
MAX_PREDICTION = 0.2  # of the thickness: largest displacement of the prediction
RELEASE = 0.02  # of the curvature as knitted, by which `wire.set_fraction` is applied from one equilibrium to the next
DRIFT = Drift(checks=2, max_decay_ratio=0.95)


class SpatialMechanics(Mechanics):
    """Steps one world of a spatial model."""

    KEPT = ("notes", "edge", "_untested", "_last")

    check_steps = CHECK_STEPS
    can_overlap = True
    drift = DRIFT
    path_increment = FOLLOWED_INCREMENT
    path_ratios = (1.0, 1.0)  # tight knits snap on the way

    def __init__(self, group: Any, model: SpatialModel, world: int) -> None:
        """group: the `SpatialWorlds` (worlds.py) of this world."""
        self.group, self.model, self.world, self.rows = group, model, world, np.array([world])
        scene = model.scene
        self.notes: list[str] = []
        mesh = model.global_model
        measured = mesh if model.ranks.is_first else model
        self.sites = Sites(measured.wires, measured.rods)
        self.stepper, self.contact, self.clamps = group.stepper, group.contact, group.clamps
        self.relaxation, self.multipliers, self.stability = group.relaxation, group.multipliers, group.stability
        self.strip = self.stepper.strip if self.stepper.worlds == 1 else RodStrip.alone(model.rods)
        self.state = self.stepper.state.world(world, self.stepper.worlds)
        self._held = Entries(model.wires.held_node, model.device)
        self.edge = Edge(model, self.stepper.arrays.rest_position) if scene.has_moving_edge else None
        # a large gripped mesh starts from a smaller one that was tested
        self._is_tested = not scene.depends_on_path and (scene.model.boundary == "periodic" or smaller_scene(scene) is None)
        self._release: tuple[float, float] | None = None  # shares of the release before and after the part in progress
        self._untested = 0.0  # strain since the last test whether an equilibrium is stable
        self._last: np.ndarray | None = None  # displacement of the previous level
        if model.ramp is not None:
            self.stepper.set_masses(node_mass=model.ramp.node_mass[:, None], spin_inertia=model.ramp.spin_inertia)
            self.stepper.set_time_step(model.time_step, model.ramp.damping)
            # colliding wires approach by at most half their thickness a step, so that they cannot pass through each other
            self.state.steering.set(drive=1.0, speed_limit=np.inf, step_limit=0.5 * float(model.rods.wire_radius.min()))
            self.contact.list_near_pairs(np.inf)

    @property
    def rim(self) -> Rim | None:
        return None if self.edge is None else self.edge.rim

    @property
    def stations(self) -> np.ndarray:
        return np.zeros((0, 3)) if self.edge is None else self.edge.station_displacement

    def compile(self) -> None:
        """Compile all kernels. Raises `ModelError` where centre lines intersect."""
        self.contact.search(self.rows)
        self.stepper.evaluate(rows=self.rows)
        near = self.contact.read_contacts(0.0, self.world)
        refuse_overlaps(near, self.model.rods, self.strip, parting_text(self.model.scene))
        self.step(2)
        if self.model.ramp is None:
            self.group.check(self.rows, np.ones(1, dtype=int), np.zeros(1, dtype=bool))
            self.stress()
        else:
            self.residual_now()

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        self._untested += self._strain_to(load) if load.tension is None else math.inf
        factor = self._begin_ramp(load, steps, evenly=evenly)
        self.state.steering.ramp_lag = 0.0
        if self.model.ramp is not None:
            return
        self._apply_release()
        self.relaxation.multipliers.set_thermal_strain(self._thermal_strain(load), self.world)
        if self.clamps is None or steps == 0:
            # held nodes move to their places under the load; given stations of the edge move while it is applied
            held, displacement = self.model.wires.held_node, fetch(self.state.displacement).copy()
            displacement[held, :2] = self.model.held_shift(load.gradient, factor)
            if self.edge is not None and load.stations is not None:
                self.edge.set_target(load)
                displacement[held, 2] = 0.0
                displacement[held] += self.edge.mesh_displacement(self.edge.station_displacement)[held]
            store(self.state.displacement, displacement)
        self.group.begin_load(self.world, load)

    def set_dead_load(self, force: np.ndarray) -> None:
        """Put dead loads on the nodes of the mesh of all ranks, (node, 3) [N]."""
        own = force if self.model.strip is None else force[self.model.strip.nodes_of_mesh]
        self.state.set_load(own, force)
        self._untested = np.inf

    @property
    def release_parts(self) -> int:
        rods = self.model.rods
        if rods.natural_curvature is not None or rods.natural_twist is not None:
            return math.ceil(1.0 / RELEASE)
        if self.model.cloth is None:  # wires from a file may be a drawing; and hooks
            return 1
        return max(1, math.ceil((1.0 - self.model.scene.wire.set_fraction) / RELEASE - 1e-9))

    def release(self, begin: float, end: float) -> None:
        if self.release_parts > 1:
            self._release = begin, end
            self._apply_release()

    def go_on_releasing(self, *, loading: bool) -> None:
        """Release up to the next convergence check; the release ends with the load."""
        self._apply_release()
        if not loading:
            self._release = None

    def _apply_release(self) -> None:
        """Release the curvature due up to the next convergence check.

        If it were released at once, wires would move farther in a check than the masses allow for contacts.
        """
        if self._release is None:
            return
        control, (before, after) = self.state.steering.read(), self._release
        ahead = CHECK_STEPS * (1.0 - control.ramp_lag)
        share = min(1.0, float((control.ramp_step + ahead) / max(control.ramp_steps, ahead)))
        rows = self.model.rods.of_rows.node_count
        own = slice(self.world * rows, (self.world + 1) * rows)
        set_natural_shape(self.stepper.arrays, self.stepper.rods, before + share * (after - before), own)

    def tell(self, note: str) -> None:
        """Add a note for the user, once."""
        if note not in self.notes:
            self.notes.append(note)

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        (small, large), strain = LOAD_STRAINS, self._strain_to(load)
        is_slow = self._release is not None or load.tension is not None
        share = max(1.0 if is_slow else min(1.0, strain / small), strain / large)
        return CHECK_STEPS * round(LOAD_STEPS / CHECK_STEPS * share)

    def _strain_to(self, load: LoadPoint) -> float:
        """Strain by which a load differs from the present one."""
        steering, scene = self.state.steering, self.model.scene
        strain = float(np.abs(load.gradient - self.state.gradient).max())
        strain += abs(scene.wire.length_factor(load.temperature) - steering.length_factor)
        if any(any(stage.temperature_gradient) for stage in scene.stages):
            now = self.stepper.part(self.relaxation.multipliers.thermal_strain, self.world)
            strain += self.strip.largest_of_nodes(np.abs(self._thermal_strain(load) - fetch(now)))
        if self.edge is not None and load.stations is not None:
            strain += self.edge.strain_to(load)
        return strain

    def _thermal_strain(self, load: LoadPoint) -> np.ndarray:
        """[node] thermal strain of the segment behind a node; 0 in the middle."""
        rods, wire, panel = self.model.rods, self.model.scene.wire, self.model.panel
        middle = rods.position[:, :2] + 0.5 * rods.rest_edge[:, :2]
        excess = (middle - (np.asarray(panel.low) + 0.5 * np.asarray(panel.size))) @ np.array(load.temperature_gradient)
        return np.asarray(wire.expansion * excess / wire.length_factor(load.temperature))

    def predict(self, ratio: float) -> None:
        displacement = fetch(self.state.displacement).copy()
        if ratio > 0.0 and self._last is not None:
            move = ratio * (displacement - self._last)
            largest = self.strip.largest_of_nodes(np.linalg.norm(move, axis=1))
            limit = MAX_PREDICTION * self.model.rods.section.thickness
            store(self.state.displacement, displacement + move * min(1.0, limit / max(largest, 1e-300)))
        self._last = displacement
        self.relaxation.stop_motion(self.rows)

    def stiffen_contacts(self, factor: float, most: float) -> bool:
        multipliers = self.group.multipliers
        if multipliers is None or factor * multipliers.loading_factor[self.world] > most:
            return False
        multipliers.loading_factor[self.world] *= factor
        return True

    def rub(self, rubs: bool) -> None:
        self.state.steering.set(friction=self.model.scene.contact.friction if rubs else 0.0)

    def advance_history(self) -> None:
        if self.model.ramp is None and (moving := self.group.moving_blocks(self.world)):
            blocks = f"{moving} block{'s' if moving > 1 else ''} of up to {ROD_BLOCK} nodes"
            self.tell(f"at strains of {strain_text(self.state.gradient)}, {blocks} still moved in the equilibrium of the mesh")
        self.stepper.yielding.advance(self.world)
        self.contact.advance_history(self.world)

    @property
    def dissipated(self) -> float:
        self.contact.collect_slip_work()
        return float(self.stepper.yielding.dissipated[self.world] + self.contact.dissipated[self.world])

    # --- steps

    def step(self, count: int) -> None:
        with self.stepper.only(self.rows):
            self.stepper.step(count)

    def deepest_overlap(self) -> str:
        observed, strip, state = self.observe(), self.strip, self.state
        penalty, stretch = (strip.gathered(fetch(array)) for array in (state.contact_penalty, state.stretch_stiffness))
        return strip.ranks.from_first(lambda: overlap_text(observed, penalty, stretch))

    def fastest(self) -> tuple[int, int]:
        rods, strip = self.model.rods, self.strip
        speed = np.nan_to_num(np.linalg.norm(fetch(self.state.velocity)[strip.own], axis=1), nan=np.inf)
        node = strip.nodes[int(np.argmax(speed))]
        wire = int(rods.wire_of[node])
        here = int(strip.wire[wire]), node - int(rods.wire_first[wire])
        return max(strip.ranks.everyone((float(speed.max()), here)))[1]

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        self.contact.pop_max_penetration(self.rows)

    def begin_test(self, *, is_certain: bool) -> None:
        self.stability.has_left[self.world] = False
        if self._is_tested and (is_certain or self._untested >= LOAD_STRAINS[0]):
            self.stability.begin(self.world)
            self._untested = 0.0

    @property
    def has_left(self) -> bool:
        return bool(self.stability.has_left[self.world])

    def raise_edge(self, edge: Edge, *, loading: bool) -> None:
        """Move given stations while the load is applied, then with the strains."""
        if not loading:
            edge.follow(self.state.gradient)
        given = edge.rim.given
        if not loading and np.array_equal(edge.station_displacement[given], edge.target[given]):
            return
        control = self.state.steering.read()
        self._move(edge.move_given(control.ramp_step / max(control.ramp_steps, 1.0) if loading else 1.0))

    def move_stations(self, change: np.ndarray) -> None:
        """Move stations of the edge by (station, 3) [m]; their clamps follow."""
        assert self.edge is not None
        moved = np.zeros((self.model.rods.node_count, 3))
        moved[self.model.wires.held_node] = self.edge.move(change)
        self._move(moved)

    def _move(self, move: np.ndarray) -> None:
        """Move nodes by (node, 3) [m]."""
        moved = self.strip.largest_of_nodes(np.linalg.norm(move, axis=1))
        if moved > 0.0:
            store(self.state.displacement, fetch(self.state.displacement) + move)
            self.contact.refresh(moved, self.rows)
            self.relaxation.damping.reset(self.rows)

    def clamp_forces(self) -> np.ndarray:
        assert self.edge is not None
        return self._held.fetch(self.state.force).reshape(-1, 2, 3).sum(axis=1)

    def clamp_stress(self) -> np.ndarray:
        """(2, 2) [N m] of the forces of the clamps, in the state last evaluated."""
        force = self._held.fetch(self.state.force)[:, :2]
        products = np.einsum("ia,ib->iab", force, self.model.wires.held_lever).reshape(-1, 4)
        return self.strip.ranks.exact_sum(products).reshape(2, 2)

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        wire = self.model.scene.wire
        if self.state.steering.dead_load > 0.0 or not load.is_as_knitted(wire.reference_temperature):
            return False
        self.stepper.evaluate(rows=self.rows)
        found = self.contact.read_contacts(world=self.world)
        overlaps = found.overlap / self.model.rods.touch_distance(found.first, found.second)
        deep = np.concatenate(self.strip.ranks.everyone(overlaps[overlaps > CLOSEST]))
        if len(deep):
            self.notes.append(
                f"as knitted, wires overlap in {len(deep)} place{'s' if len(deep) > 1 else ''}, by up to"
                f" {100 * deep.max():.2g} % of their thickness; they were pushed apart before loading"
            )
            return False
        with self.stepper.only(self.rows):
            state, contacts = self.relaxation.sums(self.rows, of_mean=False), self.contact.sums(self.rows)
        tension = np.abs(self.relaxation.tension()).reshape(self.stepper.worlds, -1)[self.world]
        rods = self.model.rods
        strained = self.strip.largest_of_nodes(tension / rods.of_nodes("axial_stiffness"))
        is_as_drawn = wire.set_fraction == 1.0 and rods.natural_curvature is None and rods.natural_twist is None
        ratio = self.group.residual_ratio(state, contacts, self.rows)[0]
        return bool(is_as_drawn and strained <= AXIAL_ERROR and ratio < 1.0)

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        self.stepper.evaluate()
        step = self.relaxation.stable_time_step()
        self.state.steering.set(time_step=step)
        return step

    def residual_now(self) -> float:
        self.stepper.evaluate()
        sums, contacts = self.relaxation.sums(of_mean=False), self.contact.sums(self.rows)
        return float(self.group.residual(sums, contacts, self.rows)[0])

    # --- meshes of one knit (solve/multilevel.py)

    @cached_property
    def fields(self) -> Fields:
        """Fields for transfer between meshes of one knit."""
        return Fields(self)

    def prolongation(self, smaller: SpatialMechanics) -> Prolongation:
        return Prolongation(self.fields, smaller.fields, self.edge)

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> SpatialGrid:
        return SpatialGrid(self.fields, self.edge, low, cell, cells)

    def state_variables(self) -> dict[str, np.ndarray]:
        return self.fields.read_everywhere()

    def stop(self) -> None:
        self.relaxation.stop_motion(self.rows)

    @property
    def owners(self) -> list[Owner]:
        group = self.group
        of_contact, of_rods = [self.contact, self.multipliers], [self.relaxation, self.clamps, self.stepper.yielding]
        of_worlds = [group, *of_contact, *of_rods, self.stability, group.strains, group.soft_motion]
        of_world = [Owner(one, self.world, self.stepper.worlds) for one in of_worlds if one is not None]
        return [Owner(self.state), *of_world, Owner(self)]

    # --- observation

    def observe(self) -> SpatialObservables:
        return read(self.model, self.sites, self.relaxation, self.contact, self.state, self.world)

    def edge_work_terms(self, observed: SpatialObservables) -> list[tuple[np.ndarray, np.ndarray]]:
        terms = [(observed.thermal_strain_force, observed.thermal_strain)]
        if self.edge is not None and self.model.ranks.is_first:  # which observes the whole mesh
            terms.append((self.edge.grip_forces(observed.force), self.edge.rim.clamps @ self.edge.station_displacement))
        return terms
