"""The drive `relax` of a large mesh: its levels start from a smaller mesh, and it comes to rest as a membrane too.

Both spare steps: what differs slowly over a mesh spreads from repeat to repeat in a number of steps that grows with the square
of its size (prolongation.py, membrane.py). An edge that moves by itself moves with the membrane (rim.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .. import measure
from ..kernels import control as c
from ..measure.edge_work import EdgeWork
from ..mesh.rim import build_rim
from ..planar.membrane import Correction, Membrane
from ..planar.model import Model
from ..planar.prolongation import Prolongation
from ..planar.response import find_response, no_response, recall_response
from ..planar.state import State
from .drive import LoadPoint, LoadStart, Progress
from .relax import LEVEL_RAMP_STEPS, Relaxation, WantedTension

MOVE_STEPS = 200  # steps between parts of a move of the edge
EDGE_TOLERANCE = 0.05  # force on the stations of a cord over what the wires pull at them
CORRECTION_LOOKS = 6  # looks between corrections of the mesh as a membrane
CORRECTION_GAIN = 0.7  # a correction that leaves more of the least imbalance so far was in vain
IN_VAIN = 8  # corrections in vain after which they are given up for the level
TRUST = (0.1, 1.0)  # share of a correction that is taken, least and most
MEMBRANE_TOLERANCE = 0.02  # stress out of balance over the tension, root mean square over the mesh
FOLLOWED_STRAIN = 0.005  # by which the levels of the smallest mesh are apart, at most


class LargeRelaxation(Relaxation):
    """Levels of a mesh that has a smaller one, or one periodic repeat, brought to rest before it."""

    def __init__(
        self,
        model: Model,
        state: State,
        progress: Progress,
        watch: Callable[[Progress], None],
        smaller: Relaxation | None = None,
        cell: Relaxation | None = None,
    ) -> None:
        """`smaller`: a smaller mesh of the same knit that each level starts from; `cell`: one periodic repeat, which gives the
        stiffness of the cloth to a large gripped mesh. One of them at least."""
        super().__init__(model, state, progress, watch)
        self.smaller = smaller
        self.cell = cell
        self.prolongation = Prolongation(model, state, smaller.model, smaller.state) if smaller else None
        repeated = cell or smaller
        assert repeated is not None
        self._response = no_response(repeated.model)
        self.membrane: Membrane | None = None
        if smaller is not None:
            self._last = []  # no level starts from the two before it
        if cell is not None:
            rim = build_rim(model.panel, self.scene)
            self.membrane = Membrane(model, state, self.slowest_mode.probe, rim)
            self.stations = np.zeros((len(rim.arc), 2))
            if self.scene.has_moving_edge:
                self.rim, self.edge_work = rim, EdgeWork()
        self._last_correction = np.zeros(0)

    def warm_up(self) -> None:
        if self.smaller is None or self.prolongation is None:
            super().warm_up()
            if self.cell is not None and self.membrane is not None:
                self.cell.warm_up()
                kept = self.everything()
                self.membrane.warm_up(self._response)
                self.put_back(kept)
            return
        # the steps of a large mesh launch what those of the smaller one do
        self.smaller.warm_up()
        self.prolongation.carry(self._response)
        if self.membrane is not None:
            self.membrane.warm_up(self._response)

    def memory(self) -> dict[str, np.ndarray]:
        kept = super().memory() | {"last_correction": self._last_correction}
        if self.smaller is not None and self.prolongation is not None:
            kept |= {f"smaller_{name}": value for name, value in self.smaller.everything().items()}
            kept |= self.prolongation.memory()
        if self.cell is not None:
            kept["stations"] = self.stations
            kept |= {f"cell_{name}": value for name, value in self.cell.everything().items()}
            kept |= self._response.memory()
        return kept

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        super().recall(kept)
        self._last_correction = kept["last_correction"]
        if self.smaller is not None and self.prolongation is not None:
            self.smaller.put_back(_under("smaller_", kept))
            self.prolongation.recall(kept)
        if self.cell is not None and self.membrane is not None:
            self.stations = kept["stations"]
            self.cell.put_back(_under("cell_", kept))
            self._response = recall_response(kept, self.cell.model)
            self.membrane.renew(self._response)

    def _prepare(self, target: LoadPoint, wanted: WantedTension | None) -> LoadPoint:
        if self.smaller is not None:
            target = self._bring_smaller_to_rest(self.smaller, target, wanted)
        if self.cell is not None and self.membrane is not None:
            self._response = find_response(self.cell, target.gradient, target.temperature)
            self.membrane.renew(self._response)
        return target

    def _bring_smaller_to_rest(self, smaller: Relaxation, target: LoadPoint, wanted: WantedTension | None) -> LoadPoint:
        """The target, with the strains at which the smaller mesh carries what is wanted."""
        smaller.progress.load_factor, smaller.progress.stage = self.progress.load_factor, self.progress.stage
        if wanted is None and not (isinstance(smaller, LargeRelaxation) and smaller.smaller):
            self._follow_path(smaller, target)
        else:
            smaller.bring_to_rest(target, wanted)
        if wanted is None:
            return target
        return target.strained(wanted.gradient(target.gradient, np.diag(measure.stretch(smaller.state.gradient)) - 1.0))

    def _follow_path(self, smallest: Relaxation, target: LoadPoint) -> None:
        """Take the smallest mesh to a load by levels near each other: which state a mesh finds may depend on the way there."""
        progress = smallest.progress
        if not progress.start.gradient:
            warmed = (float(smallest.state.read_control()[int(c.LENGTH_FACTOR)]) - 1.0) / max(self.scene.wire.expansion, 1e-12)
            temperature = self.scene.wire.reference_temperature + warmed
            progress.start = LoadStart(smallest.state.gradient.ravel().tolist(), temperature=temperature)
        start = progress.start
        gradient, temperature = np.array(start.gradient).reshape(2, 2), start.temperature
        levels = max(1, math.ceil(float(np.abs(target.gradient - gradient).max()) / FOLLOWED_STRAIN - 1e-9))
        while start.levels < levels:
            share = (start.levels + 1.0) / levels
            there = gradient + share * (target.gradient - gradient)
            smallest.bring_to_rest(LoadPoint(there, temperature + share * (target.temperature - temperature)), None)
            start.levels += 1.0
        progress.start = LoadStart()

    def _start_level(self, target: LoadPoint) -> None:
        if self.prolongation is None:
            super()._start_level(target)
        else:
            self.prolongation.carry(self._response)
            self._begin_at_rest()
            self._set_ramp(target, 0)
        self._move_edge(target)

    def _move_edge(self, target: LoadPoint) -> None:
        """Move the stations of the rim that are held to where the load has them, the mesh with them as a membrane."""
        if self.rim is None or self.membrane is None or target.stations is None:
            return
        way = np.where(self.rim.given[:, None], target.stations - self.stations, 0.0)
        if not way.any():
            return
        if not self.membrane.tangent.any():
            begin, self.stations = self.stations, self.stations + way
            self.state.move_clamps(self.rim.clamps @ begin, self.rim.clamps @ self.stations)
            self._set_ramp(target, LEVEL_RAMP_STEPS)
            return
        left = 1.0
        while left > 0.0:
            followed = self.membrane.follow(left * way, target.gradient, self.stations)
            share = min(1.0, followed.most)
            followed = followed.times(share)
            self.membrane.move(followed)
            self._move_clamps(followed)
            self.neighbours.search()
            left = left * (1.0 - share) if share < 1.0 else 0.0
            if left > 0.0:
                self._advance(MOVE_STEPS)
                self.slowest_mode.look(use=True)

    def _begin_settling(self) -> None:
        super()._begin_settling()
        progress = self.progress
        progress.imbalance, progress.least_imbalance, progress.in_vain, progress.trust = 1e30, 1e30, 0, 1.0
        self._last_correction = np.zeros(0)

    def _left_of_all(self, left: float) -> float:
        progress, membrane = self.progress, self.membrane
        if membrane is None:
            return left
        if progress.looks % CORRECTION_LOOKS == 0 and (progress.trust > 0.0 or membrane.rim.is_free):
            self._move_as_membrane(membrane)
        return max(left, progress.imbalance)

    def _move_as_membrane(self, membrane: Membrane) -> None:
        """Move the mesh towards where it balances as a membrane, unless it is there."""
        progress, rim = self.progress, membrane.rim
        pulled = self.look.clamp_forces() if rim.is_free else np.zeros((0, 2))
        solve = membrane.solve if progress.trust > 0.0 else membrane.solve_rim
        correction, stress = solve(self.state.gradient, self.stations, pulled)
        scale = max(float(np.abs(self._sums.stress).max()), self.least_tension)
        progress.imbalance = stress / (MEMBRANE_TOLERANCE * scale)
        if rim.is_free:
            edge = membrane.edge_imbalance(self.state.gradient, self.stations, pulled, self.least_tension)
            progress.imbalance = max(progress.imbalance, edge / EDGE_TOLERANCE)
        if progress.imbalance <= 1.0:
            return
        progress.in_vain += 1
        if progress.imbalance < CORRECTION_GAIN * progress.least_imbalance:
            progress.least_imbalance, progress.in_vain = progress.imbalance, 0
        if progress.trust == 0.0:
            self._move_clamps(correction.times(correction.most))
            self.neighbours.search()
        elif progress.in_vain > IN_VAIN:
            # the mesh is not like a membrane of endless cloth: it comes to rest by itself
            self.left_out = max(self.left_out, MEMBRANE_TOLERANCE * progress.imbalance)
            progress.trust, progress.imbalance = 0.0, 1e30 if rim.is_free else 0.0
        else:
            progress.trust = correction.most * self._share_of(correction.numbers)
            correction = correction.times(progress.trust)
            membrane.move(correction)
            self._move_clamps(correction)
            self.neighbours.search()
            self.multipliers.begin_level()

    def _move_clamps(self, correction: Correction) -> None:
        """Move the edge by its part of a correction."""
        if self.rim is not None:
            self.stations = self.stations + correction.stations
            clamps = self.rim.clamps @ self.stations
            self.state.move_clamps(clamps, clamps)

    def _share_of(self, correction: np.ndarray) -> float:
        """Share of a correction to take: Aitken's, from what the last one left of itself.

        Where stiffness differs from that of the cloth at the mean load, whole corrections may overshoot.
        """
        last, self._last_correction = self._last_correction, correction
        if len(last) != len(correction):
            return 1.0
        change = correction - last
        share = -self.progress.trust * float(last @ change) / max(float(change @ change), 1e-300)
        return float(np.clip(share, *TRUST))


def _under(prefix: str, kept: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The entries whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): value for name, value in kept.items() if name.startswith(prefix)}
