"""Search for pairs of segments that may touch: by a spatial hash, around the nodes that have moved since the last search.

A search places the segments in the hash, counts the pairs of each, and fills a list with them, in the order of their first
segments. The count keeps up to KEPT pairs of a segment, so the list is filled without another search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from ..compute.arrays import array, new_arrays
from ..compute.host import fetch, number_at, store, store_at
from ..compute.kept import Kept
from ..compute.launch import Launch, bind, replay
from ..kernels.wire_closest import PLACES
from ..kernels.wire_curve import CLOSING_RATE
from ..kernels.wire_near import count_by_second, find_reach, mark_by_second
from ..kernels.wire_pairs import (
    KEPT,
    NOT_SEARCHED,
    find_motion_since_search,
    find_segment_pairs,
    mark_searched,
    place_segments_in_hash,
)
from .contact_arrays import WireArrays
from .rest_curve import RestCurve
from .rod_step import RodStepper
from .rods import Rods

# radii along a wire, below which its segments do not touch each other; bent back onto itself it takes pi
MIN_ARC_SEPARATION = 4.0
SINGLE = 1e-3  # of the search radius: allowance for distances in single precision
# what a checkpoint has of a pair, with its places
PAIR_ARRAYS = (
    "pair_first", "pair_second", "pair_shift", "pair_arc_separation", "pair_wake_travel", "pair_renewal_travel", "pair_found",
    "pair_place",
)  # fmt: skip

SEARCHED_ARRAYS = ("searched_place", "searched_director")

APPROACH = 0.12, 0.5  # of a segment, and of the thickness at least: approach allowed before the next search
# of the motion allowed: a search around the nodes that have moved farther than the first is due once one has moved by the second
MOVED, DUE = 0.2, 0.9
MOST_MOVED = 0.5  # of the nodes; with more a search finds all pairs anew
MAX_OFFSET = 0.25  # thicknesses: most that the multiplier of either wire adds to its radius (multipliers.py)
MAX_SAG = 0.4  # of a segment: bound on the sag of its curve without bumps, 4/27 (1 + MAX_RATIO/3) from either end
STRETCHED = 1.2  # largest length of a segment under load over that at rest
CELL = 0.5  # width of a cell over the radius, which bounds what most segments reach by far
FREE_CELLS = np.array([64, 64, 8])  # fewest along x, y and z in directions without tiles


@dataclass(frozen=True)
class SearchCells:
    """Margin, radius and cells of the search; lengths in m."""

    approach: float  # of two wires, allowed before the next search
    margin: float  # gap up to which pairs are listed: what multipliers push apart, and the approach
    radius: float  # bound on the distance of the midpoints of two segments that may touch before the next search
    count: np.ndarray  # (3,) cells along x, y and z
    size: np.ndarray  # (3,)


def search_cells(rods: Rods, curve: RestCurve) -> SearchCells:
    """Search cells for wires that touch on `curve`, no narrower than the search radius.

    In directions without tiles they hold the mesh at rest without sharing; about a node each.
    """
    segments = rods.natural_length[rods.following >= 0]
    approach = max(APPROACH[0] * float(segments.max()), APPROACH[1] * rods.section.thickness)
    margin = approach + 2.0 * MAX_OFFSET * rods.section.thickness
    reach = STRETCHED * float(((0.5 + MAX_SAG) * curve.length + curve.bulge).max())  # of a curve, from the middle of its chord
    radius = 2.0 * reach + 2.0 * rods.largest_radius + margin
    is_tiled, size = rods.tile > 0, CELL * radius
    needed = np.maximum(FREE_CELLS, np.ceil(np.ptp(rods.position, axis=0) / size) + 2.0)
    free = np.maximum(FREE_CELLS, np.floor(min(1.0, np.sqrt(rods.node_count / np.prod(needed))) * needed))
    count = np.where(is_tiled, np.maximum(np.floor(rods.tile / size), 1), free).astype(int)
    return SearchCells(approach, margin, radius, count, np.where(is_tiled & (count > 1), rods.tile / count, size))


@dataclass
class PairList:
    """At most `capacity` segment pairs that may touch; `number` identifies the list."""

    capacity: int
    number: int
    device: str
    pair_start: wp.array = array(wp.int32)  # where the pairs of each segment begin
    pair_count_of: wp.array = array(wp.int32)  # and how many they are
    pair_count: wp.array = array(wp.int32, "one")  # of all
    pair_first: wp.array = array(wp.int32, "pair")
    pair_second: wp.array = array(wp.int32, "pair")
    pair_shift: wp.array = array(wp.vec3d, "pair")
    pair_arc_separation: wp.array = array(wp.float64, "pair")
    pair_wake_travel: wp.array = array(wp.float64, "pair")
    pair_renewal_travel: wp.array = array(wp.float64, "pair")
    pair_found: wp.array = array(wp.int32, "pair")
    pair_is_near: wp.array = array(wp.int32, "pair")
    pair_place: wp.array = array(wp.vec2d, "place")
    by_second: wp.array = array(wp.int32, "pair")  # the pairs in the order of their second segments
    second_start: wp.array = array(wp.int32)  # where the pairs of each segment begin in that order
    near_before: wp.array = array(wp.int32, "pair")  # see kernels/wire_near.py
    near_by_second: wp.array = array(wp.int32, "pair")
    second_count: wp.array = array(wp.int32)
    # recorded launches: of every thread of `find_segment_pairs` and `mark_near_pairs`; others by name
    find: list[wp.Launch] = field(default_factory=list)
    mark: list[Callable[[], None]] = field(default_factory=list)
    recorded: dict[str, tuple[Any, Callable[[], None]]] = field(default_factory=dict)

    @staticmethod
    def of(capacity: int, nodes: int, device: str, number: int) -> PairList:
        """An empty list."""
        counts: dict[str, Any] = {"node": nodes, "one": 1, "pair": capacity, "place": PLACES * capacity}
        return new_arrays(PairList, device, counts, {"capacity": capacity, "number": number, "device": device})

    def replayed(self, name: str, make: Callable[[], list[Launch]], version: Any = None) -> None:
        """Launch on this list; recorded once by name and version of other arrays."""
        if name not in self.recorded or self.recorded[name][0] != version:
            self.recorded[name] = version, replay(make(), self.device)
        self.recorded[name][1]()

    def order(self, total: int) -> None:
        """Order the `total` pairs by their second segments."""
        count = self.second_count
        store(count, 0)
        self.replayed("count", lambda: [bind(count_by_second, self.capacity, self, count=count)])
        if total > 0:  # a copy of none would be one of all
            key, number = (wp.empty(2 * total, dtype=wp.int32, device=self.device) for _ in range(2))
            wp.copy(key, self.pair_second, count=total)
            wp.copy(number, self.by_second, count=total)
            wp.utils.radix_sort_pairs(key, number, total)
            wp.copy(self.by_second, number, count=total)
        wp.utils.array_scan(count, self.second_start, inclusive=False)

    def take_near(self, total: int) -> int:
        """Number the near pairs among `total`; return their count."""
        if total == 0:
            return 0
        self.replayed("near", lambda: [bind(mark_by_second, self.capacity, self)])
        wp.utils.array_scan(self.near_by_second, self.near_by_second, inclusive=True)
        wp.utils.array_scan(self.pair_is_near, self.near_before, inclusive=True)
        return number_at(self.near_before, total - 1)

    def state_dict(self, begin: int, end: int, nodes: slice) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint of pairs `begin` to `end`, which belong to `nodes`."""
        kept = {name: fetch(getattr(self, name))[_part(name, begin, end)] for name in PAIR_ARRAYS}
        for name in ("pair_first", "pair_second"):
            kept[name] = kept[name] - nodes.start
        return kept | {"pair_count_of": fetch(self.pair_count_of)[nodes]}

    def load_state_dict(self, kept: dict[str, np.ndarray], others: PairList, begin: int, end: int, nodes: slice) -> None:
        """Restore what `state_dict` returned, in place of these pairs of a list `others`; into a list of sufficient capacity."""
        whole = number_at(others.pair_count, 0)
        total = whole - (end - begin) + len(kept["pair_first"])
        for name in PAIR_ARRAYS:
            own = kept[name] + nodes.start if name in ("pair_first", "pair_second") else kept[name]
            before, behind = (fetch(getattr(others, name))[_part(name, *ends)] for ends in ((0, begin), (end, whole)))
            store_at(getattr(self, name), _part(name, 0, total), np.concatenate([before, own, behind]))
        count = fetch(others.pair_count_of).copy()
        count[nodes] = kept["pair_count_of"]
        store(self.pair_count_of, count)
        store(self.pair_start, np.cumsum(count) - count)
        store(self.pair_count, total)
        self.order(total)


def _part(name: str, begin: int, end: int) -> slice:
    """The part of an array for pairs from `begin` to `end`."""
    each = PLACES if name == "pair_place" else 1
    return slice(each * begin, each * end)


@dataclass(frozen=True)
class SearchArrays:
    """Data of the segments for a search; see kernels/wire_pairs.py."""

    place: wp.array = array(wp.vec3)  # in the hash
    reach: wp.array = array(wp.float32)  # of the curve, from there
    longest_reach: wp.array = array(wp.float32, "world")
    rest_scale: wp.array = array(wp.float32, "world")  # bound on distances at rest over present distances
    largest_distance: wp.array = array(wp.float32, "world")
    moved_limit: wp.array = array(wp.float32, "world")
    searched: wp.array = array(wp.int32)
    motion: wp.array = array(wp.float32)
    searched_place: wp.array = array(wp.vec3)
    searched_director: wp.array = array(wp.vec3)
    pair_reach: wp.array = array(wp.float64, "world")  # see `PairSearch.reach`
    partner_count: wp.array = array(wp.int32)
    partner: wp.array = array(wp.int32, "kept")


class PairSearch:
    """Hash of the segments of a stepper."""

    def __init__(self, stepper: RodStepper, wires: WireArrays, cells: SearchCells, *, has_friction: bool) -> None:
        self.stepper, self._wires, self.cells, self._has_friction = stepper, wires, cells, has_friction
        nodes, device = stepper.rods.node_count, stepper.device
        along_x, along_y, along_z = map(int, cells.count)
        self._grid = wp.HashGrid(along_x, along_y, along_z * stepper.worlds, device=device)
        counts = {"node": nodes, "world": stepper.worlds, "kept": int(KEPT) * nodes}
        self._arrays = new_arrays(SearchArrays, device, counts, {})
        self.searched = self._arrays.searched
        store(self._arrays.searched_place, np.inf)  # never yet
        sources = (wires, stepper.arrays, stepper.state, self._arrays)
        self._place_segments = bind(
            place_segments_in_hash, nodes, *sources, cell=wp.vec3d(*cells.size), cells_across=float(along_z),
        ).record(device)  # fmt: skip
        self._find_motion = bind(find_motion_since_search, nodes, *sources).record(device)
        self._how = {
            "grid": wp.uint64(self._grid.id), "round_off": SINGLE * cells.radius, "cell": wp.vec3(*cells.size),
            "tile": wp.vec3d(*stepper.rods.tile),
        }  # fmt: skip
        shares = [stepper.team.share(nodes, part) for part in range(stepper.team.threads)]
        self._mark = [
            bind(mark_searched, count, *sources, first_segment=first, **self._how).record(device) for first, count in shares
        ]
        # [world] load in the last search of all segments
        self._gradient, self._length_factor = np.zeros((stepper.worlds, 2, 2)), np.ones(stepper.worlds)
        self._carried = np.zeros(stepper.worlds)  # [world] strain of the smooth motions since then, see `carry`

    @property
    def allowed(self) -> float:
        """[m] motion of nodes and load for which the pairs of a search hold.

        With friction a pair may be left out after both nodes and load have moved by MOVED of it; the way back from there counts.
        """
        back_and_forth = 1.0 + 2.0 * MOVED if self._has_friction else 1.0
        return self.cells.approach / (float(CLOSING_RATE) * back_and_forth)

    def motion(self, rows: np.ndarray) -> np.ndarray:
        """[row] [m] largest motion since the search of what has moved; a collective call."""
        self._find_motion.launch()
        moved = self.stepper.by_world(self._arrays.motion)[rows].max(axis=1).astype(float)
        return np.asarray(self.stepper.strip.ranks.largest(moved) + self._load_motion(rows))

    def _load_motion(self, rows: np.ndarray) -> np.ndarray:
        """[row] [m] the part of the motion that the load and smooth motions add."""
        steering = self.stepper.steering
        strain = np.abs(steering.gradient - self._gradient).sum(axis=(1, 2)) + self._carried
        strain += np.abs(steering.length_factor - self._length_factor)
        return np.asarray((steering.pair_reach * strain)[rows])

    def carry(self, motion: np.ndarray, strain: float) -> float:
        """Let the places of the last search follow a smooth motion (node, 3) [m] in one world.

        strain: bound on the sum of its derivatives along x and y at rest. Returns the motion [m] that it counts as.
        """
        place = self._arrays.searched_place
        store(place, fetch(place) + motion.astype(np.float32))
        self._carried += strain
        return float(self.stepper.steering.pair_reach[0]) * strain

    def moved_limit(self, rows: np.ndarray) -> np.ndarray:
        """[row] [m] motion beyond which nodes are searched around, after `motion`; below 0 for all; a collective call."""
        stepper, limit = self.stepper, MOVED * self.allowed
        own = slice(None) if stepper.worlds > 1 else stepper.strip.own
        count = (stepper.by_world(self._arrays.motion)[:, own] > limit).sum(axis=1)
        most = MOST_MOVED * stepper.strip.whole.node_count / stepper.worlds
        is_most = (stepper.strip.ranks.sum(count)[rows] > most) | (self._load_motion(rows) > limit)
        return np.where(is_most, -1.0, limit)

    def place(self, rows: np.ndarray, limit: np.ndarray) -> None:
        """Place the segments in the hash, to search worlds `rows` around some nodes; a collective call.

        limit [row] [m]: of the motion of nodes that are left out; below 0: all segments are searched anew.
        """
        stepper = self.stepper
        steering = stepper.steering
        smallest = np.linalg.svd(steering.gradient, compute_uv=False).min(axis=1)
        rest_scale = 1.0 / np.minimum(smallest, 1.0)
        longer = np.maximum(steering.length_factor, 1.0)
        arrays, cells = self._arrays, self.cells
        store(arrays.rest_scale, rest_scale)
        store(arrays.largest_distance, longer * 2.0 * stepper.rods.largest_radius + cells.margin)
        stepper.check_border(cells.radius * float(rest_scale.max()))
        arrays.longest_reach.zero_()
        self._place_segments.launch()
        store(arrays.longest_reach, stepper.strip.ranks.largest(fetch(arrays.longest_reach)))
        self._grid.build(arrays.place, 1.0)
        moved_limit = np.full(stepper.worlds, np.inf)
        moved_limit[rows] = limit
        store(arrays.moved_limit, moved_limit)
        store(arrays.searched, int(NOT_SEARCHED))
        stepper.team.together([mark.launch for mark in self._mark])
        anew = rows[limit < 0.0]
        self._gradient[anew], self._length_factor[anew] = steering.gradient[anew], steering.length_factor[anew]
        self._carried[anew] = 0.0

    def reach(self, pairs: PairList) -> np.ndarray:
        """[world] [m] bound on the distance at rest of two points whose segments form a pair: by what a unit strain moves them
        apart."""
        stepper, reach = self.stepper, self._arrays.pair_reach
        store(reach, 0.0)
        pairs.replayed("reach", lambda: [bind(find_reach, pairs.capacity, stepper.arrays, pairs, reach=reach)])
        return np.asarray(self.cells.radius + stepper.strip.ranks.largest(fetch(reach)))

    def state_dict(self, world: int) -> Kept:
        """Arrays of a world for a checkpoint."""
        place, director = (self.stepper.by_world(getattr(self._arrays, name))[world] for name in SEARCHED_ARRAYS)
        at = np.array([*self._gradient[world].ravel(), self._length_factor[world], self._carried[world]])
        return {"searched_place": place, "searched_director": director, "searched_load": at}

    def load_state_dict(self, kept: Kept, world: int) -> None:
        """Restore what `state_dict` returned."""
        for name in SEARCHED_ARRAYS:
            self.stepper.store_rows(getattr(self._arrays, name), np.array([world]), kept[name])
        load = kept["searched_load"]
        self._gradient[world], self._length_factor[world], self._carried[world] = load[:4].reshape(2, 2), load[4], load[5]

    def find(self, pairs: PairList, before: PairList, *, filling: bool) -> None:
        """Count the pairs of each segment, or fill a list with them.

        before: the present list; segments that are not searched keep its counts.
        """
        stepper = self.stepper
        if not pairs.find:
            sources, cells = (self._wires, stepper.arrays, stepper.state, self._arrays, pairs), self.cells
            for part in range(stepper.team.threads):
                first, count = stepper.team.share(stepper.rods.node_count, part)
                one = bind(
                    find_segment_pairs, count, *sources, first_segment=first, old_count=before.pair_count_of, is_filling=0,
                    margin=wp.float64(cells.margin), min_arc_separation=wp.float64(MIN_ARC_SEPARATION), **self._how,
                )  # fmt: skip
                pairs.find.append(one.record(stepper.device))
        for find in pairs.find:
            find.set_param_by_name("is_filling", int(filling))
            find.set_param_by_name("old_count", before.pair_count_of)
        stepper.team.together([find.launch for find in pairs.find])

    def count(self, pairs: PairList, before: PairList) -> int:
        """Number of pairs; finds where the pairs of each segment begin in a list."""
        self.find(pairs, before, filling=False)
        wp.utils.array_scan(pairs.pair_count_of, pairs.pair_start, inclusive=False)
        last = self.stepper.rods.node_count - 1
        return number_at(pairs.pair_start, last) + number_at(pairs.pair_count_of, last)
