"""Search for the pairs of segments that may touch until the next search, by a spatial hash of the segments.

A search places the segments in the hash, counts the pairs of each, and fills a list with them, in the order of their first
segments. What the count has found is kept, up to KEPT pairs of a segment, so that the list is filled without another search.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store
from ..compute.launch import bind
from ..kernels.wire_near import find_reach
from ..kernels.wire_pairs import KEPT, find_segment_pairs, place_segments_in_hash
from .pair_list import PairList
from .rod_step import RodStepper
from .search_cells import SearchCells
from .wire_arrays import WireArrays

# radii along a wire, below which its segments do not touch each other; bent back onto itself it takes pi
MIN_ARC_SEPARATION = 4.0
SINGLE = 1e-3  # of the search radius: allowance for distances in single precision


class PairSearch:
    """Hash of the segments of a stepper."""

    def __init__(self, stepper: RodStepper, wires: WireArrays, cells: SearchCells) -> None:
        self.stepper, self._wires = stepper, wires
        self._margin, self._radius, self._cell = cells.margin, cells.radius, cells.size
        nodes, device = stepper.rods.node_count, stepper.device
        along_x, along_y, along_z = map(int, cells.count)
        self._grid = wp.HashGrid(along_x, along_y, along_z, device=device)
        self._place = wp.zeros(nodes, dtype=wp.vec3, device=device)
        self._reach = wp.zeros(nodes, dtype=wp.float32, device=device)
        self._longest_reach = wp.zeros(1, dtype=wp.float32, device=device)
        self._partner_count = wp.zeros(nodes, dtype=wp.int32, device=device)
        self._partner = wp.zeros(int(KEPT) * nodes, dtype=wp.int32, device=device)
        self._rest_scale = 1.0  # bound on distances at rest over those in the last search
        self._place_segments = bind(
            place_segments_in_hash, nodes, wires, stepper.arrays, stepper.state, cell=wp.vec3d(*self._cell),
            place=self._place, reach=self._reach, longest_reach=self._longest_reach,
        ).record(device)  # fmt: skip

    def place(self) -> None:
        """Place the segments in the hash where they are now; a collective call."""
        stepper = self.stepper
        smallest = float(np.linalg.svd(stepper.state.gradient, compute_uv=False).min())
        self._rest_scale = 1.0 / min(smallest, 1.0)
        stepper.watch_border(self._radius * self._rest_scale)
        self._longest_reach.zero_()
        self._place_segments.launch()
        store(self._longest_reach, stepper.strip.ranks.largest(fetch(self._longest_reach)))
        self._grid.build(self._place, 1.0)

    def count(self, pairs: PairList) -> int:
        """Count the pairs of each segment, and find where they begin in a list; returns their number."""
        self._find(pairs, filling=False)
        wp.utils.array_scan(pairs.count, pairs.start, inclusive=False)
        return int(fetch(pairs.start)[-1] + fetch(pairs.count)[-1])

    def fill(self, pairs: PairList) -> None:
        """Fill a list with the pairs that were counted."""
        self._find(pairs, filling=True)

    def reach(self, pairs: PairList, total: int) -> float:
        """[m] bound on the distance at rest of two points whose segments form a pair: by what a unit strain moves them apart."""
        device = self.stepper.device
        reach = wp.zeros(1, dtype=wp.float64, device=device)
        bind(find_reach, total, self.stepper.arrays, reach=reach, **pairs.named("first", "second", "shift")).run(device)
        return self._radius + float(self.stepper.strip.ranks.largest(fetch(reach))[0])

    def _find(self, pairs: PairList, *, filling: bool) -> None:
        stepper, rods = self.stepper, self.stepper.rods
        if not pairs.find:
            named = pairs.named("first", "second", "shift", "arc_separation", "wake_travel")
            named |= {"start": pairs.start, "count": pairs.count, "place": self._place}
            named |= {"reach": self._reach, "longest_reach": self._longest_reach}
            named |= {"partner_count": self._partner_count, "partner": self._partner}
            for part in range(stepper.threads):
                first, count = stepper.team.share(rods.node_count, part)
                one = bind(
                    find_segment_pairs, count, self._wires, stepper.arrays, stepper.state, first_segment=first,
                    grid=wp.uint64(self._grid.id), largest_distance=0.0, rest_scale=0.0, is_filling=0,
                    round_off=SINGLE * self._radius, cell=wp.vec3(*self._cell), margin=wp.float64(self._margin),
                    min_arc_separation=wp.float64(MIN_ARC_SEPARATION), tile=wp.vec3d(*rods.tile), **named,
                )  # fmt: skip
                pairs.find.append(one.record(stepper.device))
        longer = max(stepper.state.steering.length_factor, 1.0)
        largest = longer * 2.0 * float(rods.wire_radius.max()) + self._margin
        for find in pairs.find:
            find.set_param_by_name("largest_distance", largest)
            find.set_param_by_name("rest_scale", self._rest_scale)
            find.set_param_by_name("is_filling", int(filling))
        stepper.team.together([find.launch for find in pairs.find])
