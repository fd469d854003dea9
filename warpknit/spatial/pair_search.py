"""Search for pairs of segments that may touch before the next search. By a spatial hash of the segments.

A search places the segments in the hash, counts the pairs of each, and fills a list with them, in the order of their first
segments. What the count has found is kept, up to KEPT pairs of a segment, so that the list is filled without another search.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from ..compute.host import fetch, number_at, store, zeros
from ..compute.launch import Launch, bind
from ..kernels.wire_closest import PLACES
from ..kernels.wire_near import count_by_second, find_reach, mark_by_second
from ..kernels.wire_pairs import KEPT, find_segment_pairs, place_segments_in_hash
from .contact_arrays import WireArrays
from .rod_step import RodStepper
from .search_cells import SearchCells

# radii along a wire, below which its segments do not touch each other; bent back onto itself it takes pi
MIN_ARC_SEPARATION = 4.0
SINGLE = 1e-3  # of the search radius: allowance for distances in single precision
PAIR_ARRAYS = ("first", "second", "shift", "arc_separation", "wake_travel", "renewal_travel", "found")
SLIP_ARRAYS = ("slip_step", "slip_place", "elastic_slip")
NODE_ARRAYS = ("start", "count")


class PairList:
    """Device arrays of at most `capacity` segment pairs that may touch; `number` identifies the list."""

    def __init__(self, capacity: int, nodes: int, device: str, number: int, *, with_slip: bool) -> None:
        def make(dtype: type, count: int = capacity) -> wp.array:
            return zeros(count, dtype, device)

        self.capacity, self.number, self.device = capacity, number, device
        self.start, self.count = make(wp.int32, nodes), make(wp.int32, nodes)
        self.total = make(wp.int32, 1)
        self.first, self.second = make(wp.int32), make(wp.int32)
        self.shift = make(wp.vec3d)
        self.arc_separation, self.wake_travel = make(wp.float64), make(wp.float64)
        self.renewal_travel, self.found, self.is_near = make(wp.float64), make(wp.int32), make(wp.int32)
        # recorded launches: of every thread of `find_segment_pairs` and `mark_near_pairs`; of the
        # lists of near pairs, the last one by the capacity of that list
        self.find: list[wp.Launch] = []
        self.mark: list[Callable[[], None]] = []
        self._recorded: dict[str, Callable[[], None]] = {}
        self._sorted = make(wp.int32, nodes), make(wp.int32, 2 * capacity), make(wp.int32, 2 * capacity)
        self.list_near: tuple[int, Callable[[], None]] | None = None
        self.by_second = make(wp.int32)  # the pairs in the order of their second segments
        self.second_start = make(wp.int32, nodes)  # where the pairs of each segment begin
        self.near_before, self.near_by_second = make(wp.int32), make(wp.int32)  # see kernels/wire_near.py
        self.place = make(wp.vec2d, PLACES * capacity)
        # elastic slip of friction: two contacts a pair, double-buffered by the parity of the step
        slips = (2, 2 * capacity if with_slip else 0)
        self.slip_step = wp.full(slips, -1, dtype=wp.int32, device=device)
        self.slip_place = zeros(slips, wp.vec2d, device)
        self.elastic_slip = zeros(slips, wp.vec3d, device)

    def replayed(self, name: str, make: Callable[[], Launch]) -> None:
        """Launch on this list, by a launch that is recorded once by name."""
        if name not in self._recorded:
            self._recorded[name] = make().replay(self.device)
        self._recorded[name]()

    def order(self, total: int) -> None:
        """Order the `total` pairs by their second segments."""
        count, number, key = self._sorted
        store(count, 0)
        named = self.named("second") | {"pair_count": self.total, "count": count, "pair_number": number}
        self.replayed("count", lambda: bind(count_by_second, self.capacity, **named))
        if total > 0:  # a copy of none would be one of all
            wp.copy(key, self.second, count=total)
            wp.utils.radix_sort_pairs(key, number, total)
            wp.copy(self.by_second, number, count=total)
        wp.utils.array_scan(count, self.second_start, inclusive=False)

    def take_near(self, total: int) -> int:
        """Number the near pairs among `total`; return their count."""
        if total == 0:
            return 0
        self.replayed("near", lambda: bind(mark_by_second, self.capacity, self, pair_count=self.total, **self.named("is_near")))
        wp.utils.array_scan(self.near_by_second, self.near_by_second, inclusive=True)
        wp.utils.array_scan(self.is_near, self.near_before, inclusive=True)
        return number_at(self.near_before, total - 1)

    def named(self, *names: str) -> dict[str, wp.array]:
        """Arrays by the names of the kernel arguments."""
        return {f"pair_{name}": getattr(self, name) for name in names}

    def state_dict(self, pairs: tuple[int, int], nodes: slice) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint with the elastic slips of `pairs`, which belong to `nodes`."""
        begin, end = pairs
        kept = {f"pairs_{name}": fetch(getattr(self, name))[begin:end].copy() for name in PAIR_ARRAYS}
        for name in ("first", "second"):
            kept[f"pairs_{name}"] -= nodes.start
        kept["pairs_place"] = fetch(self.place)[PLACES * begin : PLACES * end].copy()
        kept |= {f"pairs_{name}": fetch(getattr(self, name))[:, 2 * begin : 2 * end].copy() for name in SLIP_ARRAYS}
        kept |= {f"pairs_{name}": fetch(getattr(self, name))[nodes].copy() for name in NODE_ARRAYS}
        kept["pairs_start"] -= begin
        return kept

    def load_state_dict(self, kept: dict[str, np.ndarray], others: PairList, pairs: tuple[int, int], nodes: slice) -> None:
        """Restore what `state_dict` returned, in place of these pairs of a list `others`; into a list of sufficient capacity."""
        (begin, end), whole = pairs, int(fetch(others.total)[0])
        total = whole - (end - begin) + len(kept["pairs_first"])
        for name in (*PAIR_ARRAYS, "place", *SLIP_ARRAYS):
            each = PLACES if name == "place" else 2 if name in SLIP_ARRAYS else 1
            axis = int(name in SLIP_ARRAYS)
            now, own = fetch(getattr(others, name)), kept[f"pairs_{name}"]
            own = own + nodes.start if name in ("first", "second") else own
            before, _, behind, _ = np.split(now, [each * begin, each * end, each * whole], axis=axis)
            values = np.concatenate([before, own, behind], axis=axis)
            filled = fetch(getattr(self, name)).copy()
            if axis:
                filled[:, : values.shape[1]] = values
            else:
                filled[: len(values)] = values
            store(getattr(self, name), filled)
        count = fetch(others.count).copy()
        count[nodes] = kept["pairs_count"]
        store(self.count, count)
        store(self.start, np.cumsum(count) - count)
        store(self.total, total)
        self.order(total)


class PairSearch:
    """Hash of the segments of a stepper."""

    def __init__(self, stepper: RodStepper, wires: WireArrays, cells: SearchCells) -> None:
        self.stepper, self._wires = stepper, wires
        self._margin, self._radius, self._cell = cells.margin, cells.radius, cells.size
        nodes, device = stepper.rods.node_count, stepper.device
        along_x, along_y, along_z = map(int, cells.count)
        self._grid = wp.HashGrid(along_x, along_y, along_z * stepper.worlds, device=device)
        self._place = wp.zeros(nodes, dtype=wp.vec3, device=device)
        self._reach = wp.zeros(nodes, dtype=wp.float32, device=device)
        self._longest_reach, self._rest_scale, self._largest_distance = (
            wp.zeros(stepper.worlds, dtype=wp.float32, device=device) for _ in range(3)
        )
        self._pair_reach = wp.zeros(stepper.worlds, dtype=wp.float64, device=device)
        self.searched = wp.full(stepper.worlds, 1, dtype=wp.int32, device=device)  # [world] int, in the last search
        self._partner_count = wp.zeros(nodes, dtype=wp.int32, device=device)
        self._partner = wp.zeros(int(KEPT) * nodes, dtype=wp.int32, device=device)
        self._place_segments = bind(
            place_segments_in_hash, nodes, wires, stepper.arrays, stepper.state, cell=wp.vec3d(*self._cell),
            cells_across=float(along_z), place=self._place, reach=self._reach, longest_reach=self._longest_reach,
        ).record(device)  # fmt: skip

    def place(self, rows: np.ndarray) -> None:
        """Place the segments in the hash, to search the worlds `rows`; a collective call."""
        stepper = self.stepper
        smallest = np.linalg.svd(stepper.steering.gradient, compute_uv=False).min(axis=1)
        rest_scale = 1.0 / np.minimum(smallest, 1.0)  # bound on distances at rest over present distances
        longer = np.maximum(stepper.steering.length_factor, 1.0)
        store(self._rest_scale, rest_scale)
        store(self._largest_distance, longer * 2.0 * stepper.rods.largest_radius + self._margin)
        searched = np.zeros(stepper.worlds, dtype=np.int32)
        searched[rows] = 1
        store(self.searched, searched)
        stepper.check_border(self._radius * float(rest_scale.max()))
        self._longest_reach.zero_()
        self._place_segments.launch()
        store(self._longest_reach, stepper.strip.ranks.largest(fetch(self._longest_reach)))
        self._grid.build(self._place, 1.0)

    def count(self, pairs: PairList, before: PairList) -> int:
        """Count the pairs of each segment, and find where they begin in a list; returns their number.

        before: the list of now, whose counts worlds keep that are not searched.
        """
        self._find(pairs, before, filling=False)
        wp.utils.array_scan(pairs.count, pairs.start, inclusive=False)
        return int(fetch(pairs.start)[-1] + fetch(pairs.count)[-1])

    def fill(self, pairs: PairList, before: PairList) -> None:
        """Fill a list with the pairs that were counted."""
        self._find(pairs, before, filling=True)

    def reach(self, pairs: PairList) -> np.ndarray:
        """[world] [m] bound on the distance at rest of two points whose segments form a pair: by what a unit strain moves them
        apart."""
        stepper, reach = self.stepper, self._pair_reach
        store(reach, 0.0)
        named = pairs.named("first", "second", "shift") | {"pair_count": pairs.total, "reach": reach}
        pairs.replayed("reach", lambda: bind(find_reach, pairs.capacity, stepper.arrays, **named))
        return np.asarray(self._radius + stepper.strip.ranks.largest(fetch(reach)))

    def _find(self, pairs: PairList, before: PairList, *, filling: bool) -> None:
        stepper = self.stepper
        if not pairs.find:
            named = pairs.named("first", "second", "shift", "arc_separation", "wake_travel")
            named |= {"start": pairs.start, "count": pairs.count, "old_count": before.count, "place": self._place}
            named |= {"reach": self._reach, "longest_reach": self._longest_reach, "rest_scale": self._rest_scale}
            named |= {"partner_count": self._partner_count, "partner": self._partner, "searched": self.searched}
            for part in range(stepper.team.threads):
                first, count = stepper.team.share(stepper.rods.node_count, part)
                one = bind(
                    find_segment_pairs, count, self._wires, stepper.arrays, stepper.state, first_segment=first,
                    grid=wp.uint64(self._grid.id), is_filling=0, largest_distance=self._largest_distance,
                    round_off=SINGLE * self._radius, cell=wp.vec3(*self._cell), margin=wp.float64(self._margin),
                    min_arc_separation=wp.float64(MIN_ARC_SEPARATION), tile=wp.vec3d(*stepper.rods.tile), **named,
                )  # fmt: skip
                pairs.find.append(one.record(stepper.device))
        for find in pairs.find:
            find.set_param_by_name("is_filling", int(filling))
            find.set_param_by_name("old_count", before.count)
        stepper.team.together([find.launch for find in pairs.find])
