"""When and how the neighbour search is done; the kernels are in kernels/neighbours.py."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.neighbours import find_nearest_segments, place_nodes_in_hash
from ..launch import bind
from .model import Model, block_threads
from .state import State

SAG = 0.15  # of the node spacing: how far a wire may bulge beyond the chord between two nodes (a radius of 0.8 spacings)
RAMP_SHARE = 0.2  # of the margin: kept for the affine motion between two searches of a ramp
MARGIN = 0.1  # in course spacings: how much closer a body and a wire may come before the next search


class NeighbourSearch:
    """The hash of a model's nodes and the search for the segment that each pair starts from."""

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self.margin = MARGIN * model.scene.knit.course_spacing
        # a body touches a segment whose nearer node is at most half a (stretched) spacing along the wire
        self.radius = model.contact_reach + self.margin + 0.75 * float(model.table.spacing.max())
        self.searches = 0
        size = np.asarray(model.panel.size)
        cells = np.maximum(1, np.floor(size / (1.25 * self.radius))).astype(int)
        self._cell = size / cells
        if model.panel.boundary != "periodic":
            cells = cells + 4
        self._grid = wp.HashGrid(int(cells[0]), int(cells[1]), 1, device=model.device)
        self._position = wp.zeros(model.panel.node_count, dtype=wp.vec3, device=model.device)
        self._expected = 0.0
        self._gradient = np.array([1.0, 0.0, 0.0, 1.0])

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {"searches": np.array([self.searches]), "expected": np.array([self._expected, *self._gradient])}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        self.searches = int(kept["searches"][0])
        self._expected, self._gradient = float(kept["expected"][0]), kept["expected"][1:].copy()

    def follow(self, gradient: np.ndarray) -> None:
        """Search again when the load has used up half of what was kept for it since the last search; see `expect`."""
        moved = 2.0 * float(np.abs(gradient - self._gradient).max()) * self.radius
        if moved > 0.5 * self._expected:
            self.expect(RAMP_SHARE * self.margin)

    def expect(self, motion: float) -> None:
        """Search, and keep `motion` [m] of the margin for what the load itself will do until the next call."""
        self._expected = motion
        self.search()

    def search(self) -> None:
        """Build the hash, seed every pair that is not in touch, and start a new travel budget.

        The few pairs of other treatments are never asleep, and walk along their wires from where they were.
        """
        if self.model.pair_count and self.model.treatment.is_free:
            self._search()
        self.searches += 1
        self._gradient = self.state.gradient.ravel()
        budget = max(0.5 * self.margin - self._expected, 0.1 * self.margin)
        self.state.write_control(
            {c.TRAVEL: 0.0, c.TRAVEL_LIMIT: budget, c.STATUS: 0.0} if self.model.pair_count else
            {c.TRAVEL: 0.0, c.TRAVEL_LIMIT: np.inf, c.STATUS: 0.0}
        )  # fmt: skip

    def _search(self) -> None:
        model, state = self.model, self.state
        real, now = model.precision.real, state.parity
        spacing = float(model.table.spacing.max())
        narrowest = float(np.linalg.svd(state.gradient, compute_uv=False).min())
        cell_x, cell_y = wp.float64(self._cell[0]), wp.float64(self._cell[1])
        sources = (model.rest, model.mesh, state, model.constants)
        named = {"cell_x": cell_x, "cell_y": cell_y, "ux": state.node_ux[now], "uy": state.node_uy[now]}
        bind(place_nodes_in_hash, block_threads(model), *sources, hash_position=self._position, **named).run(model.device)
        self._grid.build(self._position, 1.0)
        bind(
            find_nearest_segments, model.pair_count, *sources, grid=wp.uint64(self._grid.id),
            hash_radius=self.radius / narrowest / float(self._cell.min()), radius=real(self.radius),
            half_chord=real(0.6 * spacing), sag=real(SAG * spacing), reach=real(model.contact_reach),
            expected=real(self._expected), **named,
        ).run(model.device)  # fmt: skip
