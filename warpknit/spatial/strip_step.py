"""Steps of a strip of rods; ranks exchange borders between the parts of a step.

    frames, contact, forces and motion of the own wires, clamps -> border and sums to the other ranks -> control

Copies of other ranks' wires receive all that contact reads, and every rank adds the rows of sums of all wires in the same order,
so states equal a run on one rank, bit by bit. Sums of convergence checks are exact (strip.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import warp as wp

from ..base.errors import ModelError
from ..compute.host import Mirror, fetch, is_in_place, store
from ..compute.launch import Launch, bind, replay
from ..compute.steering import Steering
from ..kernels.control import PARTIAL_COUNT
from ..kernels.rod_border import BORDER_VALUES, copy_nodes, copy_travel
from .model import BORDER, SpatialModel
from .rod_arrays import RodState
from .rod_step import RodStepper
from .strip import weft_range, within


class StripRodStepper(RodStepper):
    """Takes steps of the own wires of a strip, together with the other ranks."""

    def __init__(self, model: SpatialModel, state: RodState | None) -> None:
        rods, device = model.rods, model.device
        super().__init__(rods, device, state, model.precision, model.strip)
        ranks = self.strip.ranks
        # of what contact reads, one neighbour after the other
        neighbours = self.strip.neighbours
        sent, self._sent, self._collect = self._side([one.sent for one in neighbours], collects=1)
        received, self._received, self._distribute = self._side([one.received for one in neighbours], collects=0)
        peers = [(one.rank, slice(*sent[k : k + 2]), slice(*received[k : k + 2])) for k, one in enumerate(neighbours)]
        self._swap = ranks.channel(self._sent.host, self._received.host, peers)
        if len({is_in_place(place) for place in ranks.everyone(str(device))}) > 1:
            raise ModelError("--device: some ranks run on CPUs and others on GPUs; use --device cpu, or a GPU for each rank")
        # rows of sums, for the wires of all ranks in order; equally many a rank, the last ones of some empty
        own = slice(self.strip.wires.start, self.strip.wires.stop)
        wires = ranks.everyone(len(self.strip.wires))
        columns = int(PARTIAL_COUNT)
        self._row, self._rows = (Mirror((count, columns), wp.float64, device) for count in (max(wires), sum(wires)))
        self._own_rows = self._row.array[: len(self.strip.wires)], self.state.partial[own]
        self._all_rows = np.zeros((len(wires) * max(wires), columns))
        self._collect_rows = ranks.table(self._row.host, self._all_rows)
        self._is_of_wire = (np.arange(max(wires)) < np.array(wires)[:, None]).ravel()
        self._control = replay(self._control_launches(self._rows.array, range(1)), device)
        self._move_clamps: Callable[[], None] | None = None

    def _side(self, wires: list[np.ndarray], collects: int) -> tuple[list[int], Mirror, Callable[[], None]]:
        """Begins of each neighbour's values, their buffer, and a function that copies them."""
        state, device, block_wire = self.state, self.device, fetch(self.arrays.block_wire)
        by_block = is_in_place(device)  # on a GPU travel is the fastest node's
        begins, parts = [0], [[np.zeros(0, dtype=np.int64)] for _ in range(4)]
        for own in wires:
            node = self.rods.nodes_of(own)
            block = np.flatnonzero(np.isin(block_wire, own)) if by_block else np.zeros(0, dtype=np.int64)
            begin, behind = begins[-1], begins[-1] + BORDER_VALUES * len(node)
            places = (node, begin + BORDER_VALUES * np.arange(len(node)), block, behind + np.arange(len(block)))
            for part, numbers in zip(parts, places, strict=True):
                part.append(numbers)
            begins.append(behind + len(block))
        values = Mirror((begins[-1],), wp.float64, device)
        numbers = [wp.array(np.concatenate(part), dtype=wp.int32, device=device) for part in parts]
        lists = SimpleNamespace(**dict(zip(("border_node", "border_place", "border_block", "block_place"), numbers, strict=True)))
        launches = [
            bind(kernel, len(count), state, lists, collects=collects, values=values.array)
            for kernel, count in ((copy_nodes, lists.border_node), (copy_travel, lists.border_block))
        ]
        return begins, values, replay(launches, device)

    def sync(self) -> None:
        self._collect()
        self._sent.copy_to_host()
        self._swap()
        self._received.copy_to_device()
        self._distribute()

    def update_frames(self, rows: np.ndarray | None = None) -> None:
        self.sync()
        super().update_frames(rows)

    def _replay(self, steps: int, times: int) -> None:
        self.sync()
        if steps == 0:
            super()._replay(steps, times)
            return
        if self._move_clamps is None:
            self._move_clamps = replay([] if self.clamps is None else [*self.clamps.launches(range(1))], self.device)
        for _ in range(times):
            for k in range(steps):
                self._share_step(is_first=k == 0, is_last=k == steps - 1)
            if self.state.steering.status != Steering.RUNNING:
                return

    def _share_step(self, *, is_first: bool, is_last: bool) -> None:
        """A step of all ranks; nothing moves where the state is frozen."""
        assert self._move_clamps is not None

        def launches_of(part: int) -> list[list[Launch]]:
            return [self._motion_launches(part, is_first=is_first, is_last=is_last)]

        graphs = self._graphs_of((is_first, is_last), launches_of)
        self.team.together([partial(wp.capture_launch, graph) for graph in graphs])
        self._move_clamps()
        wp.copy(*self._own_rows)
        self._row.copy_to_host()
        self._collect_rows()
        self._rows.host[:] = self._all_rows[self._is_of_wire]
        self._rows.copy_to_device()
        if self.counts_stress:  # whole numbers, whose sum is exact
            counts = np.zeros_like(fetch(self.stress_count))
            counts[0] = self.strip.ranks.sum(fetch(self.stress_count).sum(axis=0))
            store(self.stress_count, counts)
        self.sync()
        self._control()

    def check_border(self, reach: float) -> None:
        """Check that unknown wires stay farther than `reach` [m at rest] along the weft. Raises `ModelError`."""
        rods, strip, state = self.rods, self.strip, self.state
        place = np.linalg.solve(state.gradient, fetch(state.position)[:, :2].T)[0]
        own = slice(strip.wires.start, strip.wires.stop)
        low, high = (np.concatenate(strip.ranks.everyone(side[own])) for side in weft_range(rods, place))
        here = strip.wire[own]
        is_near = within(low, high, low[here].min() - reach, high[here].max() + reach, float(rods.tile[0]))
        is_near[strip.wire] = False
        if strip.ranks.any(bool(is_near.any())):
            raise ModelError(
                f"mpirun: between the strips of {strip.ranks.count} ranks wires have moved by more than {BORDER:g} of"
                " knit.wale_spacing; run without mpirun"
            )
