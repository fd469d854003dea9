"""The drive `relax` of a large mesh: multilevel start, and membrane corrections.

Both save steps: long-wave errors decay in a number of steps that grows with the square of the mesh size. An edge on cords moves
with the membrane (mesh/rim.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..base.errors import Diverged, NoProgress, Overlapped
from ..compute.kept import Kept, Owner, strip_prefix
from ..measure.strain import EdgeWork, strain_text
from ..mechanics.numerics import renewed_throttle
from ..mechanics.protocols import Mechanics
from ..mechanics.response import find_response, zero_response
from ..mesh.rim import LoadPoint, Rim, build_rim
from ..scene import Stage
from .membrane import (
    BALANCE_CHECKS,
    CORRECTION_STEPS,
    Aitken,
    Correction,
    EdgeState,
    Membrane,
    is_settled,
)
from .progress import UNKNOWN, LoadStart, Progress
from .relax import Relaxation, Unsolved
from .stage_load import strained

MOVE_STEPS = 200  # steps between increments of an edge displacement
MIN_IMBALANCE = 0.3  # over the tolerance, corrected while the mesh is not converged: it would decay slowly
MAX_PARTS, PART_STEPS = 6, 10  # of a correction that is too large to be applied at once, and time steps between them
EDGE_TOLERANCE = 0.01  # of the sag of a cord: error of the places of its stations
STIFFER, MOST_STIFFER = 4.0, 16.0  # factor of contacts where a start from a smaller mesh overlaps wires too deeply, and the most
MEMBRANE_TOLERANCE = 0.02  # rms stress out of balance over the tension


class MultilevelRelaxation(Relaxation):
    """A relaxation with a smaller mesh, or one periodic repeat, that is solved first."""

    KEPT = (*Relaxation.KEPT, "_correction", "_lift", "_stations", "_own", "_keeps_own", "_is_like_repeat")

    def __init__(
        self,
        mechanics: Mechanics,
        progress: Progress | None = None,
        monitor: Callable[[Progress], None] = lambda _: None,
        *,
        smaller: Relaxation | None = None,
        cell: Relaxation | None = None,
    ) -> None:
        """`smaller`: a smaller mesh of the same knit, the start of each level; `cell`: one periodic repeat, for the membrane
        stiffness of a large gripped mesh. At least one of them is given."""
        super().__init__(mechanics, progress, monitor)
        self.smaller = smaller
        self.cell = cell
        self.prolongation = None if smaller is None else mechanics.prolongation(smaller.mechanics)
        repeated = cell or smaller
        assert repeated is not None
        self._response = zero_response(repeated.mechanics, self.model.device)
        self.membrane: Membrane | None = None
        self._rim: Rim | None = None
        self._stations = np.zeros((0, 2))
        if cell is not None:
            rim = mechanics.rim or build_rim(self.model.panel, self.scene)
            if self.scene.has_moving_edge and mechanics.rim is None:
                self._rim, self.edge_work = rim, EdgeWork()
            self.membrane = Membrane(mechanics, rim)
            self._stations = np.zeros((len(rim.arc), 2))
        self._correction, self._lift = Aitken(), Aitken()
        self._own: Kept = {}  # load before this level started from the smaller mesh, to return to where it fails
        self._keeps_own = False  # levels of this load step start from the mesh's own state, as one failed from one repeat
        self._is_like_repeat = False  # the mesh has started from one repeat: so it was loaded as that

    @property
    def rim(self) -> Rim | None:
        return self._rim or super().rim

    @property
    def stations(self) -> np.ndarray:
        return self._stations if super().rim is None else super().stations

    @property
    def notes(self) -> list[str]:
        if self.smaller is None:
            return super().notes
        columns, rows = self.smaller.scene.knit.repeats
        return [*super().notes, *(f"smaller mesh of {columns} x {rows} repeats: {note}" for note in self.smaller.notes)]

    def compile(self) -> None:
        if self.smaller is None or self.prolongation is None:
            super().compile()
            if self.cell is not None:
                self.cell.compile()
        else:  # the smaller mesh uses the same kernels, where it is on the same device
            smaller = self.smaller
            smaller.compile()
            is_same = smaller.model.device == self.model.device
            if not is_same:
                super().compile()
            alike = smaller if is_same and isinstance(smaller, MultilevelRelaxation) else None
            if alike is None or alike.prolongation is None:
                self.prolongation.carry(self._response)
            if alike is not None and alike.membrane is not None:
                return
        if self.membrane is not None:
            self.membrane.warm_up(self._response)

    @property
    def owners(self) -> list[Owner]:
        return [*super().owners, Owner(self._response), *([] if self.prolongation is None else [Owner(self.prolongation)])]

    @property
    def _others(self) -> dict[str, Relaxation]:
        """The relaxations of smaller meshes."""
        named = {"smaller": self.smaller if self.prolongation is not None else None, "cell": self.cell}
        return {name: one for name, one in named.items() if one is not None}

    def state_dict(self, *, copied: bool = True) -> Kept:
        kept = super().state_dict(copied=copied)
        for name, one in self._others.items():
            kept |= {f"{name}_{key}": value for key, value in one.snapshot().items()}
        return kept

    def load_state_dict(self, kept: Kept) -> None:
        super().load_state_dict(kept)
        for name, one in self._others.items():
            one.restore(strip_prefix(f"{name}_", kept))
        if self.membrane is not None:
            self.membrane.renew(self._response)

    def release(self, begin: float, end: float) -> None:
        super().release(begin, end)
        for smaller in (self.smaller, self.cell):
            if smaller is not None:
                smaller.release(begin, end)

    def stages(self) -> Iterator[Stage]:
        for stage in super().stages():
            yield stage
            self._keeps_own = False

    def reach(self, load: LoadPoint, to_ratio: float = 1.0) -> Iterator[Unsolved]:
        yield from super().reach(load, to_ratio)
        self._own = {}
        if self.prolongation is not None:
            self.prolongation.forget()

    def _prepare(self, load: LoadPoint) -> LoadPoint:
        self._own = {}
        prepared = super()._prepare(load)
        if self.smaller is not None:
            prepared = self._solve_smaller(self.smaller, load)
        if self.cell is not None and self.membrane is not None:
            gradient, temperature = prepared.gradient, prepared.temperature
            if self.smaller is not None and self.smaller.scene.depends_on_path:
                # the repeat with the friction of the mesh: contacts that stick make cloth stiffer, six times in shear
                repeat, at, present = self.smaller, self.smaller.equilibrium_beside, self.smaller.stress_and_state()
            else:
                repeat, at, present = self.cell, self.cell.equilibrium_at, self.cell.equilibrium_at(gradient, temperature)
            self._response = find_response(present, at, repeat.model, gradient, temperature, self.model.device)
            self.membrane.renew(self._response)
        return prepared

    def _solve_smaller(self, smaller: Relaxation, target: LoadPoint) -> LoadPoint:
        """Solve the smaller mesh; return the target with its strains."""
        smaller.progress.load_factor, smaller.progress.stage = self.progress.load_factor, self.progress.stage
        if target.tension is None and not (isinstance(smaller, MultilevelRelaxation) and smaller.smaller):
            self._follow_path(smaller, target)
        else:
            smaller.solve(target)
            smaller.keep_history()
        return strained(target, smaller.state.gradient)

    def _follow_path(self, smallest: Relaxation, target: LoadPoint) -> None:
        """Load the smallest mesh in small increments: the equilibrium may depend on the load path."""
        progress = smallest.progress
        if not progress.start.gradient:
            now = _load_of(smallest)
            progress.start = LoadStart(now.gradient.ravel().tolist(), temperature=now.temperature)
        start = progress.start
        gradient, temperature = np.array(start.gradient).reshape(2, 2), start.temperature
        increment = min(self.mechanics.path_increment, smallest.scene.history_increment)
        levels = max(1, math.ceil(float(np.abs(target.gradient - gradient).max()) / increment - 1e-9))
        while start.levels < levels:
            share = (start.levels + 1.0) / levels
            there = gradient + share * (target.gradient - gradient)
            load = LoadPoint(there, temperature + share * (target.temperature - temperature))
            smallest.solve(load, to_ratio=self.mechanics.path_ratios[int(start.levels + 1.0 >= levels)])
            smallest.keep_history()
            start.levels += 1.0
        progress.start = LoadStart()

    @property
    def _starts_from_smaller(self) -> bool:
        """Whether the next level starts from the smaller mesh; not a loaded mesh with friction or yield."""
        goes_on = self.scene.depends_on_path and not np.array_equal(self.state.gradient, np.eye(2))
        return self.smaller is not None and not self._keeps_own and not goes_on

    def _parts_of_level(self, stage: Stage, factor: float, width: float) -> int:
        return 1 if factor > 0.0 and self._starts_from_smaller else super()._parts_of_level(stage, factor, width)

    def _apply(self, target: LoadPoint) -> None:
        progress = self.progress
        if self.prolongation is None or not self._starts_from_smaller:
            if self.prolongation is not None:
                self.prolongation.taken()  # and left out: the mesh follows on its own
                progress.is_prolonged = False
            super()._apply(target)
        else:
            begin = _load_of(self)
            self._own = {"gradient": begin.gradient.copy(), "temperature": np.array(begin.temperature)}
            self.mechanics.set_load(replace(target, tension=None), 0)
            is_prolonged = self.prolongation.carry(self._response)
            if not is_prolonged and self.scene.depends_on_path:
                raise Diverged("wires of the start from one repeat overlap too deeply")  # to go on in increments, see `_cut`
            if not is_prolonged:
                self._put_back()
                self._keep_own(target.gradient)
            progress.is_prolonged = is_prolonged
            self._is_like_repeat = is_prolonged
            self.mechanics.stop()
            self.mechanics.search()
            if target.tension is not None or self.mechanics.rim is not None or not progress.is_prolonged:
                self.mechanics.set_load(target, self.mechanics.load_steps(target, predicted=False))
        self._move_edge(target)

    def _put_back(self) -> bool:
        """Return to the state before this level started from the smaller mesh; whether that mesh returned, too."""
        assert self.prolongation is not None
        own, self._own = self._own, {}
        if self._before and not self.prolongation.replaces:
            self._go_back(self._before)
            return True
        self.prolongation.put_back()
        self.mechanics.set_load(LoadPoint(own["gradient"], float(own["temperature"])), 0)
        self.mechanics.stop()
        return False

    def _keep_own(self, failed: np.ndarray) -> None:
        """Let the load step go on from the mesh's own state; a gripped smaller mesh is tried again at the next level.

        failed: (2, 2) deformation gradient of the start from the smaller mesh.
        """
        assert self.prolongation is not None
        self._keeps_own, self._is_like_repeat = not self.prolongation.replaces, False
        note = "the mesh started from its own state, because a start from a smaller mesh would overlap its wires too deeply"
        self.mechanics.notes.append(f"at strains of {strain_text(failed)} {note}")

    def _cut(self, error: Diverged) -> None:
        lasts = error.is_final or isinstance(error, NoProgress)
        if lasts or not self._own or self.prolongation is None or self.prolongation.replaces:
            super()._cut(error)
            return
        failed = self.state.gradient.copy()
        both_returned = self._put_back()
        if isinstance(error, Overlapped) and self.mechanics.stiffen_contacts(STIFFER, MOST_STIFFER):
            if not both_returned:
                self.prolongation.repeat()
        else:
            self._keep_own(failed)
        self.progress.solving = self.progress.is_kept = False  # stiffer contacts are kept, too

    def _move_edge(self, target: LoadPoint) -> None:
        """Move held stations of the rim to prescribed places; the mesh follows as a membrane."""
        if self._rim is None or self.membrane is None or target.stations is None:
            return
        displacement = np.where(self._rim.given[:, None], target.stations - self.stations, 0.0)
        if not displacement.any():
            return
        if not self.membrane.tangent.any():
            begin, self._stations = self.stations, self.stations + displacement
            self.mechanics.move_clamps(self._rim.clamps @ begin, self._rim.clamps @ self.stations)
            self.mechanics.set_load(target, self.mechanics.load_steps(target, predicted=False))
            return
        remaining = 1.0
        while remaining > 0.0:
            followed = self.membrane.follow(remaining * displacement, EdgeState(target.gradient, self.stations, np.zeros((0, 2))))
            share = min(1.0, followed.max_factor)
            followed = followed.scaled(share)
            self.membrane.move(followed)
            self._move_clamps(followed)
            self.mechanics.search()
            remaining = remaining * (1.0 - share) if share < 1.0 else 0.0
            if remaining > 0.0:
                self.advance(MOVE_STEPS)
                self.mechanics.renew_damping()

    def _begin_solving(self, to_ratio: float) -> None:
        super()._begin_solving(to_ratio)
        progress = self.progress
        # what was before counts: only a mesh that is like its repeat is moved by other than its load
        has_history = self.scene.depends_on_path or self.scene.knit.scatter > 0.0
        is_like = progress.is_prolonged or (has_history and self._is_like_repeat)
        is_unlike = has_history and self.mechanics.rim is not None and not (self.smaller and is_like)
        progress.is_uncorrected = is_unlike or not (is_like or self._keeps_own)
        if self.membrane is not None and not progress.is_uncorrected:
            self.mechanics.group.let_rest()
        progress.ratio, progress.imbalance = UNKNOWN, UNKNOWN
        if progress.is_uncorrected and not (self.membrane and self.membrane.rim.is_free):
            progress.imbalance = 0.0
        progress.next_balance, progress.next_correction = BALANCE_CHECKS, 0
        self._correction.begin()
        self._lift.begin()

    def corrected(self, ratio: float) -> tuple[float, bool]:
        progress, membrane, (ratio, moved) = self.progress, self.membrane, super().corrected(ratio)
        if membrane is None or math.isinf(ratio):
            return ratio, moved
        residual = progress.residual / self.scene.solver.residual_tolerance
        is_due = progress.checks >= progress.next_balance and is_settled(residual, progress.ratio)
        progress.ratio = residual
        if is_due and (membrane.rim.is_free or not progress.is_uncorrected):
            progress.next_balance = progress.checks + BALANCE_CHECKS
            moved |= self._correct_as_membrane(membrane, ratio)
        return max(ratio, progress.imbalance), moved

    def _correct_as_membrane(self, membrane: Membrane, ratio: float) -> bool:
        """Apply a membrane correction unless the mesh is balanced; return whether it moved.

        ratio: of its residual; above 1 the correction balances it to a smaller imbalance, and across the mesh too.
        """
        progress, rim = self.progress, membrane.rim
        pulled = self.mechanics.clamp_forces() if rim.is_free else np.zeros((0, 3))
        membrane.imbalance()
        edge = EdgeState(self.state.gradient, self.stations, pulled)
        solve = membrane.solve_rim if progress.is_uncorrected else membrane.solve
        correction, stress = solve(edge)
        scale = max(float(np.abs(self.mechanics.checked_stress).max()), self.equilibrium.convergence.least_tension)
        progress.imbalance = stress / (MEMBRANE_TOLERANCE * scale)
        if rim.is_free:
            progress.imbalance = max(progress.imbalance, membrane.edge_error(correction, edge) / EDGE_TOLERANCE)
        # within its tolerance only a mesh that still moves, and only by what may be applied at once
        least = MIN_IMBALANCE if ratio > 1.0 and correction.max_factor == 1.0 else 1.0
        moves = progress.checks >= progress.next_correction and progress.imbalance > least
        if moves:
            progress.next_correction = progress.checks + CORRECTION_STEPS // self.mechanics.check_steps
        if moves and progress.is_uncorrected:
            of_edge = correction.scaled(self._correction.next_factor(correction.vector, correction.max_factor))
            self._move_clamps(of_edge)
            if self.mechanics.rim is not None:
                self.mechanics.move_stations(of_edge.in_space)
        elif moves:
            # what moves far for a small imbalance is a soft mode, in which the mesh answers by other than its tangent
            most = min(1.0, min(MAX_PARTS, progress.imbalance) * correction.max_factor)
            share = self._correction.next_factor(correction.vector, most)
            self._move_in_parts(membrane, correction if share == 1.0 else membrane.solve(edge, share)[0])
        lift = None
        if ratio > 1.0 and self.lift is None:
            lift = membrane.solve_across(edge, self.mechanics.checked_stress)
        lifts = lift is not None and float(np.abs(lift.grid).max()) >= membrane.grid.least_lift
        if lift is not None and lifts:
            lift = lift.scaled(self._lift.next_factor(lift.vector, lift.max_factor))
            membrane.grid.spread_across(lift.grid[:, 0], lift.in_space)
        if moves or lifts:
            self.mechanics.search()
        return moves or lifts

    def _move_in_parts(self, membrane: Membrane, correction: Correction) -> None:
        """Move the mesh by a correction, in parts of allowed size; parts are smaller after a deep overlap."""
        throttle = 1.0
        while (part := throttle * correction.max_factor) < 1.0 - 1e-9:
            self._move(membrane, correction.scaled(part))
            self.mechanics.search()
            self.advance(PART_STEPS)
            throttle = float(renewed_throttle(np.array(throttle), np.array(self.mechanics.overlap())))
            correction = correction.scaled(1.0 - part)
        self._move(membrane, correction)

    def _move(self, membrane: Membrane, correction: Correction) -> None:
        """Move the mesh by a correction of allowed size."""
        membrane.move(correction)
        self._move_clamps(correction)
        self.mechanics.begin_level()

    def _move_clamps(self, correction: Correction) -> None:
        if self._rim is not None:
            self._stations = self.stations + correction.stations
            clamps = self._rim.clamps @ self.stations
            self.mechanics.move_clamps(clamps, clamps)


def _load_of(relaxation: Relaxation) -> LoadPoint:
    """Gradient and temperature of its mesh now."""
    wire, length = relaxation.scene.wire, relaxation.state.steering.length_factor
    temperature = wire.reference_temperature + (length - 1.0) / max(wire.expansion, 1e-12)
    return LoadPoint(relaxation.state.gradient, temperature)
