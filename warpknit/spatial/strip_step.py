"""Steps of a strip of rods; ranks exchange borders between the parts of a step.

    frames, contact, forces and motion of the own wires, clamps -> border and sums to the other ranks -> control

Copies of other ranks' wires receive all that contact reads, and every rank adds the rows of sums of all wires in the same order,
so states equal a run on one rank, bit by bit. Sums of convergence checks are exact (strip.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from ..base.errors import ModelError
from ..compute.host import Mirror, fetch, is_in_place, store
from ..compute.launch import Launch, bind, fewer_rows, replay
from ..compute.steering import Steering
from ..kernels.control import PARTIAL_COUNT, update_controls
from ..kernels.rod_border import BORDER_VALUES, copy_nodes, copy_travel
from .model import BORDER, SpatialModel
from .rod_arrays import RodArrays, RodState
from .rod_step import RodStepper
from .rods import Rods
from .strip import RodStrip, weft_range, within


class Border:
    """Buffers for the exchange with neighbours, one after the other."""

    def __init__(self, strip: RodStrip, rods: Rods, arrays: RodArrays, state: RodState) -> None:
        self._device: str = str(state.control.device)
        self._by_block = is_in_place(self._device)  # on a GPU travel is the fastest node's
        self._block_wire = fetch(arrays.block_wire)
        self._rods = rods
        sent, collect = self._part([one.sent for one in strip.neighbours])
        received, distribute = self._part([one.received for one in strip.neighbours])
        self._sent, self._received = (Mirror((part[-1],), wp.float64, self._device) for part in (sent, received))
        peers = [(one.rank, slice(*sent[k : k + 2]), slice(*received[k : k + 2])) for k, one in enumerate(strip.neighbours)]
        self._swap = strip.ranks.channel(self._sent.host, self._received.host, peers)
        self.collect = self._launches(collect, state, collects=1, values=self._sent.array)
        self.distribute = self._launches(distribute, state, collects=0, values=self._received.array)

    def _part(self, wires: list[np.ndarray]) -> tuple[list[int], dict[str, np.ndarray]]:
        """Begins of each neighbour's values; nodes and blocks of all, with their places."""
        begins, nodes, blocks, node_place, block_place = [0], [], [], [], []
        for own in wires:
            node = self._rods.nodes_of(own)
            block = np.flatnonzero(np.isin(self._block_wire, own)) if self._by_block else np.zeros(0, dtype=np.int64)
            begin, behind = begins[-1], begins[-1] + BORDER_VALUES * len(node)
            nodes.append(node)
            blocks.append(block)
            node_place.append(begin + BORDER_VALUES * np.arange(len(node)))
            block_place.append(behind + np.arange(len(block)))
            begins.append(behind + len(block))
        lists = {"border_node": nodes, "border_place": node_place, "border_block": blocks, "block_place": block_place}
        return begins, {name: np.concatenate([np.zeros(0, dtype=np.int64), *parts]) for name, parts in lists.items()}

    def _launches(self, lists: dict[str, np.ndarray], state: RodState, **named: object) -> list[Launch]:
        """Launches that copy the values of the nodes and blocks of `lists` (see `_part`)."""
        places: dict[str, wp.array] = {}
        for name, numbers in lists.items():
            places[name] = wp.array(numbers, dtype=wp.int32, device=self._device)
        node = {name: places[name] for name in ("border_node", "border_place")}
        block = {name: places[name] for name in ("border_block", "block_place")}
        return [
            bind(copy_nodes, len(lists["border_node"]), state, **named, **node),
            bind(copy_travel, len(lists["border_block"]), state, **named, **block),
        ]

    def exchange(self) -> None:
        """Swap what was collected with the neighbours."""
        self._sent.copy_to_host()
        self._swap()
        self._received.copy_to_device()


class StripRodStepper(RodStepper):
    """Takes steps of the own wires of a strip, together with the other ranks."""

    def __init__(self, model: SpatialModel, state: RodState) -> None:
        rods, device = model.rods, model.device
        super().__init__(rods, device, state, model.precision, model.strip)
        ranks = self.strip.ranks
        self._border = Border(self.strip, rods, self.arrays, self.state)
        if len({is_in_place(place) for place in ranks.everyone(str(device))}) > 1:
            raise ModelError("--device: some ranks run on CPUs and others on GPUs; use --device cpu, or a GPU for each rank")
        # rows of sums, for the wires of all ranks in order; equally many a rank, the last ones of some empty
        own = slice(self.strip.wires.start, self.strip.wires.stop)
        wires = ranks.everyone(len(self.strip.wires))
        columns = int(PARTIAL_COUNT)
        self._row, self._rows = (Mirror((count, columns), wp.float64, device) for count in (max(wires), sum(wires)))
        self._own_rows = self._row.array[: len(self.strip.wires)], self.state.partial[own]
        self._received = np.zeros((len(wires) * max(wires), columns))
        self._collect_rows = ranks.table(self._row.host, self._received)
        self._is_of_wire = (np.arange(max(wires)) < np.array(wires)[:, None]).ravel()
        sums, rows = fewer_rows(self._rows.array)
        control = bind(
            update_controls, 1, control=self.state.control, wire_partial=rows, first_world=0, world_rows=len(rows),
            stress_rows=len(self.stress_count), stress_count=self.stress_count,
        )  # fmt: skip
        self._control = replay([*sums, control], device)
        self._collect = replay(self._border.collect, device)
        self._distribute = replay(self._border.distribute, device)
        self._move_clamps: Callable[[], None] | None = None

    def sync(self) -> None:
        self._collect()
        self._border.exchange()
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
        self._rows.host[:] = self._received[self._is_of_wire]
        self._rows.copy_to_device()
        if self.step_stress is not None:  # whole numbers, whose sum is exact
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


def stepper_of(model: SpatialModel, state: RodState) -> RodStepper:
    """The stepper of a model: of the mesh, or of a strip with the other ranks."""
    if model.strip is not None:
        return StripRodStepper(model, state)
    return RodStepper(model.rods, model.device, state, model.precision)
