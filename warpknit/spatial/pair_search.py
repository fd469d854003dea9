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
        """Place the segments in the hash where they are now, to search the worlds `rows`; a collective call."""
        stepper = self.stepper
        smallest = np.linalg.svd(stepper.steering.gradient, compute_uv=False).min(axis=1)
        rest_scale = 1.0 / np.minimum(smallest, 1.0)  # bound on distances at rest over those in space
        longer = np.maximum(stepper.steering.length_factor, 1.0)
        store(self._rest_scale, rest_scale)
        store(self._largest_distance, longer * 2.0 * float(stepper.rods.wire_radius.max()) + self._margin)
        searched = np.zeros(stepper.worlds, dtype=np.int32)
        searched[rows] = 1
        store(self.searched, searched)
        stepper.watch_border(self._radius * float(rest_scale.max()))
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
            for part in range(stepper.threads):
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
