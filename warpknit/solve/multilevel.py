"""The drive `relax` of a large mesh: a multilevel start from a smaller mesh, and corrections of the mesh as a membrane.

Both spare steps: what differs slowly over a mesh spreads from repeat to repeat in a number of steps that grows with the square
of its size (membrane.py). An edge that moves by itself moves with the membrane (mesh/rim.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..kernels import control as c
from ..measure import tension_scale
from ..measure.edge_work import EdgeWork
from ..measure.strain import stretch
from ..mechanics import MultilevelMechanics, advance
from ..mesh.load_point import LoadPoint
from ..mesh.rim import Rim, build_rim
from .convergence import TENSION_FLOOR
from .membrane import Correction, Membrane
from .progress import LoadStart, Progress
from .relax import Relaxation, WantedTension

MOVE_STEPS = 200  # steps between parts of a move of the edge
EDGE_TOLERANCE = 0.05  # force on the stations of a cord over what the wires pull at them
CORRECTION_CHECKS = 6  # convergence checks between corrections of the mesh as a membrane
CORRECTION_GAIN = 0.7  # a correction that leaves more of the least imbalance so far was in vain
IN_VAIN = 8  # corrections in vain after which they are given up for the level
TRUST = (0.1, 1.0)  # share of a correction that is taken, least and most
MEMBRANE_TOLERANCE = 0.02  # stress out of balance over the tension, root mean square over the mesh
FOLLOWED_STRAIN = 0.005  # by which the levels of the smallest mesh are apart, at most


class MultilevelRelaxation(Relaxation):
    """Levels of a mesh that has a smaller one, or one periodic repeat, brought to equilibrium before it."""

    def __init__(
        self,
        mechanics: MultilevelMechanics,
        progress: Progress | None = None,
        watch: Callable[[Progress], None] = lambda _: None,
        *,
        smaller: Relaxation | None = None,
        cell: Relaxation | None = None,
    ) -> None:
        """`smaller`: a smaller mesh of the same knit that each level starts from; `cell`: one periodic repeat, which gives the
        stiffness of the cloth to a large gripped mesh. One of them at least."""
        super().__init__(mechanics, progress, watch)
        self.mechanics: MultilevelMechanics = mechanics
        self.smaller = smaller
        self.cell = cell
        self.prolongation = None if smaller is None else mechanics.prolongation(smaller.mechanics)
        repeated = cell or smaller
        assert repeated is not None
        self._response = mechanics.no_response(repeated.model)
        self.membrane: Membrane | None = None
        self._rim: Rim | None = None
        self._stations = np.zeros((0, 2))
        if cell is not None:
            rim = build_rim(self.model.panel, self.scene)
            self.membrane = Membrane(mechanics, rim)
            self._stations = np.zeros((len(rim.arc), 2))
            if self.scene.has_moving_edge:
                self._rim, self.edge_work = rim, EdgeWork()
        self._last_correction = np.zeros(0)

    @property
    def rim(self) -> Rim | None:
        return self._rim

    @property
    def stations(self) -> np.ndarray:
        return self._stations

    def compile(self) -> None:
        if self.smaller is None or self.prolongation is None:
            super().compile()
            if self.cell is not None and self.membrane is not None:
                self.cell.compile()
                kept = self.snapshot()
                self.membrane.warm_up(self._response)
                self.restore(kept)
            return
        # the steps of a large mesh launch what those of the smaller one do
        self.smaller.compile()
        self.prolongation.carry(self._response)
        if self.membrane is not None:
            self.membrane.warm_up(self._response)

    def state_dict(self) -> dict[str, np.ndarray]:
        kept = super().state_dict() | {"last_correction": self._last_correction}
        if self.smaller is not None and self.prolongation is not None:
            kept |= {f"smaller_{name}": value for name, value in self.smaller.snapshot().items()}
            kept |= self.prolongation.state_dict()
        if self.cell is not None:
            kept["stations"] = self.stations
            kept |= {f"cell_{name}": value for name, value in self.cell.snapshot().items()}
            kept |= self._response.state_dict()
        return kept

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        super().load_state_dict(kept)
        self._last_correction = kept["last_correction"]
        if self.smaller is not None and self.prolongation is not None:
            self.smaller.restore(_under("smaller_", kept))
            self.prolongation.load_state_dict(kept)
        if self.cell is not None and self.membrane is not None:
            self._stations = kept["stations"]
            self.cell.restore(_under("cell_", kept))
            self._response = self.mechanics.load_response(kept, self.cell.model)
            self.membrane.renew(self._response)

    def _prepare(self, load: LoadPoint, wanted: WantedTension | None) -> LoadPoint:
        if self.smaller is not None:
            load = self._solve_smaller(self.smaller, load, wanted)
        if self.cell is not None and self.membrane is not None:
            self._response = self.mechanics.find_response(self._cell_at, self.cell.model, load.gradient, load.temperature)
            self.membrane.renew(self._response)
        return load

    def _cell_at(self, gradient: np.ndarray, temperature: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Nominal stress (2, 2) [N/m] of the cell in equilibrium under a load, and the values that describe its state."""
        assert self.cell is not None
        return self.cell.equilibrium_at(gradient, temperature)

    def _solve_smaller(self, smaller: Relaxation, target: LoadPoint, wanted: WantedTension | None) -> LoadPoint:
        """The target, with the strains at which the smaller mesh carries what is wanted."""
        smaller.progress.load_factor, smaller.progress.stage = self.progress.load_factor, self.progress.stage
        if wanted is None and not (isinstance(smaller, MultilevelRelaxation) and smaller.smaller):
            self._follow_path(smaller, target)
        else:
            smaller.solve(target, wanted)
        if wanted is None:
            return target
        return target.strained(wanted.gradient(target.gradient, np.diag(stretch(smaller.state.gradient)) - 1.0))

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
            smallest.solve(LoadPoint(there, temperature + share * (target.temperature - temperature)))
            start.levels += 1.0
        progress.start = LoadStart()

    def _start_level(self, target: LoadPoint) -> None:
        if self.prolongation is None:
            super()._start_level(target)
        else:
            self.prolongation.carry(self._response)
            self.mechanics.stop()
            self.mechanics.set_load(target, 0)
        self._move_edge(target)

    def _move_edge(self, target: LoadPoint) -> None:
        """Move the stations of the rim that are held to where the load has them, the mesh with them as a membrane."""
        if self.rim is None or self.membrane is None or target.stations is None:
            return
        way = np.where(self.rim.given[:, None], target.stations - self.stations, 0.0)
        if not way.any():
            return
        if not self.membrane.tangent.any():
            begin, self._stations = self.stations, self.stations + way
            self.mechanics.move_clamps(self.rim.clamps @ begin, self.rim.clamps @ self.stations)
            self.mechanics.set_load(target, self.mechanics.load_steps(predicted=False))
            return
        left = 1.0
        while left > 0.0:
            followed = self.membrane.follow(left * way, target.gradient, self.stations)
            share = min(1.0, followed.most)
            followed = followed.times(share)
            self.membrane.move(followed)
            self._move_clamps(followed)
            self.mechanics.search()
            left = left * (1.0 - share) if share < 1.0 else 0.0
            if left > 0.0:
                self._step_on(MOVE_STEPS)

    def _begin_solving(self) -> None:
        super()._begin_solving()
        progress = self.progress
        progress.imbalance, progress.least_imbalance, progress.in_vain, progress.trust = 1e30, 1e30, 0, 1.0
        self._last_correction = np.zeros(0)

    def corrected(self, ratio: float) -> float:
        progress, membrane = self.progress, self.membrane
        if membrane is None:
            return ratio
        if progress.checks % CORRECTION_CHECKS == 0 and (progress.trust > 0.0 or membrane.rim.is_free):
            self._move_as_membrane(membrane)
        return max(ratio, progress.imbalance)

    def _step_on(self, steps: int) -> None:
        """Take steps while the edge moves. Raises `Diverged`."""
        taken, diverged = advance(self.mechanics, steps)
        self.progress.steps += taken
        if diverged:
            raise self.divergence()
        self.mechanics.renew_damping()

    @property
    def least_tension(self) -> float:
        """[N/m] what tensions are compared with where the mesh carries less."""
        return TENSION_FLOOR * tension_scale(self.model)

    def _move_as_membrane(self, membrane: Membrane) -> None:
        """Move the mesh towards where it balances as a membrane, unless it is there."""
        progress, rim = self.progress, membrane.rim
        pulled = self.mechanics.clamp_forces() if rim.is_free else np.zeros((0, 2))
        solve = membrane.solve if progress.trust > 0.0 else membrane.solve_rim
        correction, stress = solve(self.state.gradient, self.stations, pulled)
        scale = max(float(np.abs(self.mechanics.checked_stress).max()), self.least_tension)
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
            self.mechanics.search()
        elif progress.in_vain > IN_VAIN:
            # the mesh is not like a membrane of endless cloth: it converges by itself
            self.left_out = max(self.left_out, MEMBRANE_TOLERANCE * progress.imbalance)
            progress.trust, progress.imbalance = 0.0, 1e30 if rim.is_free else 0.0
        else:
            progress.trust = correction.most * self._share_of(correction.numbers)
            correction = correction.times(progress.trust)
            membrane.move(correction)
            self._move_clamps(correction)
            self.mechanics.search()
            self.mechanics.begin_level()

    def _move_clamps(self, correction: Correction) -> None:
        """Move the edge by its part of a correction."""
        if self.rim is not None:
            self._stations = self.stations + correction.stations
            clamps = self.rim.clamps @ self.stations
            self.mechanics.move_clamps(clamps, clamps)

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
