"""Contact between wires: the lists of pairs that may touch, the contact launches of a step, and sums of a convergence check."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from ..base.errors import OutOfResources
from ..compute.host import fetch, number_at, store, store_at, zeros
from ..compute.launch import Launch, bind, replay
from ..compute.memory import available_memory
from ..compute.steering import Steering
from ..kernels import contact_checks as k
from ..kernels.rod_stress import count_contact_stress, sum_contact_stress, sum_segment_stress
from ..kernels.wire_closest import (
    NOT_NEAR,
    ONE_PLACE,
    PLACES,
    empty_pair_lists,
    find_closest_places,
    list_awake_pairs,
    mark_near_pairs,
)
from ..kernels.wire_contact_by_batch import QUAD, QUADS_A_BLOCK, find_followed_contacts
from ..kernels.wire_contact_forces import find_contact_forces
from ..kernels.wire_curve import CLOSING_RATE
from ..kernels.wire_friction import take_elastic_slip, transfer_elastic_slip
from ..kernels.wire_near import carry_pairs, find_near_starts, list_near_pairs
from .contact_arrays import SLIPS, Contacts, SlipArrays, TouchArrays, WireArrays, take_turns
from .pair_search import DUE, MIN_ARC_SEPARATION, PairList, PairSearch, SearchCells, search_cells
from .rest_curve import RestCurve, catmull_rom
from .rod_step import RodStepper

# memory of one pair, its elastic slips, and of a pair that may touch
PAIR_BYTES, SLIP_BYTES = 8 * (3 + 3 + PLACES * 2) + 4 * 11, 2 * SLIPS * 4 * (3 + 2 + 1)
TOUCH_BYTES = 8 * (3 * (8 + 6) + PLACES * (3 + 2 * 3)) + 4 * 7
STICK_SHARE = 0.5  # tangential over normal stiffness
CACHE_LINE = 8  # numbers
PAIRS_A_THREAD = 8  # of a list that a GPU filters for pairs not asleep
LEAST_THREADS = 32_768  # fewer pairs on a GPU take a thread each
NEXT_TRAVEL = 0.1  # of the thickness, most travel before near pairs are listed again
LEAST_READ = 4096  # pairs whose contacts are read at once, at least
CAPACITY_MARGIN = 1.1  # of a list over the pairs found
PAIRS_A_NODE, SMALL_LIST = 2, 20_000  # capacity of a new list, at most: to record launches again takes longer than small steps


# the equilibrium before, which friction needs (kernels/wire_friction.py); arrays of the state
BEFORE = ("position", "length", "tangent", "director", "control")


@dataclass(frozen=True)
class ContactSums:
    """Sums over the contacts with a force in the state last evaluated; [world] of the requested worlds."""

    mean_push: np.ndarray  # [N] mean force of those that push; 0 without any
    pushing: np.ndarray  # contacts that push
    overlap_max: np.ndarray  # [m] largest overlap or gap; of forces below the mean, in proportion; not of saddles
    overlap_square: np.ndarray  # [m2] squares of the same, summed


class WireContact:
    """Contact of all wires of a stepper with each other and themselves. Sets itself as the stepper's contact."""

    def __init__(
        self,
        stepper: RodStepper,
        stiffness: float,
        *,
        friction: float | np.ndarray = 0.0,
        curve: RestCurve | None = None,
        cells: SearchCells | None = None,
    ) -> None:
        """stiffness [N/m]: penalty, also of friction; curve: default Catmull-Rom; cells: default: the rods'."""
        self.stepper = stepper
        self.friction = float(np.max(friction))
        rods, device, worlds = stepper.rods, stepper.device, stepper.worlds
        self.dissipated = np.zeros(worlds)  # [world] [J] by friction, over all ranks; see `collect_slip_work`
        curve = catmull_rom(rods) if curve is None else curve
        self.cells = cells or search_cells(rods, curve)
        self._wires = WireArrays.of(rods, curve, device)
        self._search = PairSearch(stepper, self._wires, self.cells, has_friction=self.friction > 0.0)
        self._thicknesses = {
            "thickness": wp.float64(rods.section.thickness),
            "thickest": wp.float64(max(2.0 * rods.radius_beside, float(rods.of_wires("thickness").max()))),
        }
        stepper.steering.set(weight_square=curve.weight_square, lever=curve.lever)
        self._recorded: dict[tuple[int, ...], Callable[..., None]] = {}  # launches of checks, by version
        blocks = len(stepper.arrays.block_first)
        self._segment_stress, self._contact_stress = (zeros(blocks, wp.vec4d, device) for _ in range(2))
        self._partial = zeros((blocks, int(k.CONTACT_COLUMNS)), wp.float64, device)
        # [m] of each world, or each thread of a single one, CACHE_LINE numbers apart, since the last `pop_max_penetration`
        self.max_penetration = zeros((max(stepper.team.threads, worlds), CACHE_LINE), wp.float64, device)
        self._travel = np.full(worlds, NEXT_TRAVEL * rods.section.thickness)  # [world] [m] until near pairs are listed again
        least = min(PAIRS_A_NODE * rods.node_count, SMALL_LIST)
        self.touch = self._new_touch(least)
        self.pairs = self._new_list(least, 0)
        # the list before, for its elastic slips and for segments that are not searched
        self._has_two_lists = self.friction > 0.0 or worlds > 1
        self.slips = self._other_slips = SlipArrays.of(least if self.friction > 0.0 else 0, device)
        if self.friction > 0.0 and worlds > 1:  # whose steps differ by odd numbers
            self._other_slips = SlipArrays.of(least, device)
        self._other = self._new_list(least, 1) if self._has_two_lists else self.pairs
        now = {f"before_{name}": getattr(stepper.state, name) for name in BEFORE}
        self._before = SimpleNamespace(**{name: wp.clone(x) if self.friction > 0.0 else x for name, x in now.items()})
        stepper.steering.set(contact_stiffness=stiffness, friction=friction)
        store(stepper.state.contact_penalty, stiffness)
        stepper.contact = self

    @property
    def version(self) -> tuple[int, int, int]:
        """The arrays that the launches use; recorded launches are reused for the same version."""
        return (self.pairs.number, self.touch.capacity, self.slips.capacity)

    @property
    def pair_count(self) -> int:
        """Segment pairs in the list."""
        return number_at(self.pairs.pair_count, 0)

    def launches(self, part: int = 0, parts: int = 1) -> list[Launch]:
        """Launches that find a part of the contact forces, first for continuing pairs.

        On a GPU they use lists of pairs: awake, to search, without forces.
        """
        pairs, touch = self.pairs, self.touch
        sources = (self._wires, self.stepper.arrays, self.stepper.state, touch, pairs, self.slips)
        share = self._share(part, parts)
        constants: dict[str, Any] = {
            "min_arc_separation": wp.float64(MIN_ARC_SEPARATION),
            "stick_share": wp.float64(STICK_SHARE),
            "max_penetration": self.max_penetration,
        }
        on_cpu = self.stepper.device == "cpu"
        threads = 1 if on_cpu else max(math.ceil(touch.capacity / PAIRS_A_THREAD), min(touch.capacity, LEAST_THREADS))
        lists, quads = {"touch_is_listed": int(not on_cpu)}, 1 if on_cpu else QUAD * threads
        first = [bind(
            find_followed_contacts, quads, *sources, self._before, threads=quads,
            threads_a_block=min(quads, QUAD * QUADS_A_BLOCK), **share, **constants, **lists,
        )]  # fmt: skip
        if not on_cpu:
            asleep = bind(list_awake_pairs, touch.capacity, *sources, threads=touch.capacity)
            first = [bind(empty_pair_lists, 1, touch), asleep, *first]
        return [
            *first,
            bind(find_closest_places, threads, *sources, threads=threads, **share, **lists),
            bind(
                find_contact_forces, threads, *sources, self._before, threads=threads, **share, **constants, **lists,
            ),
        ]  # fmt: skip

    def stress_launch(self, blocks: range, **named: Any) -> Launch:
        """Launch that sums the nominal stress of contacts of blocks of nodes."""
        sources = (self._wires, self.stepper.arrays, self.stepper.state, self.touch, self.pairs)
        named |= {"first_block": blocks.start, "has_friction": int(self.friction > 0.0)}
        return bind(count_contact_stress, len(blocks), *sources, **named)

    def _share(self, part: int, parts: int) -> dict[str, int]:
        """Work of a thread: a part of the pairs of a single world, or all pairs of its worlds."""
        nodes = range(self.stepper.rods.node_count)
        if self.stepper.worlds > 1:
            nodes, part, parts = self.stepper.share_of(nodes, part), 0, 1
        return {"first_node": nodes.start, "end_node": nodes.stop, "part": part, "parts": parts}

    def _new_list(self, capacity: int, number: int) -> PairList:
        return PairList.of(capacity, self.stepper.rods.node_count, self.stepper.device, number)

    def _new_touch(self, capacity: int) -> TouchArrays:
        stepper = self.stepper
        has_friction = self.friction > 0.0
        return TouchArrays.of(stepper.rods.node_count, stepper.device, stepper.precision, capacity, with_friction=has_friction)

    def search(self, rows: np.ndarray | None = None) -> None:
        """Search all pairs of all worlds or `rows` anew. Raises `OutOfResources`."""
        with self.stepper.only(rows) as own:
            self.stepper.update_frames(own)
            self._renew_pairs(own, np.full(len(own), -1.0))

    def _renew_pairs(self, own: np.ndarray, limit: np.ndarray) -> None:
        """Search worlds `own` around nodes that have moved by more than `limit` [row] [m].

        All segments are searched anew where it is below 0.
        """
        stepper, state = self.stepper, self.stepper.state
        with stepper.only(own):
            anew = own[limit < 0.0]
            stepper.steering.set(anew, travel=0.0, step_travel=0.0)
            if state.block_travel.shape[0] > 1:
                fetch(state.block_travel).reshape(stepper.worlds, -1)[anew] = 0.0
            self._search.place(own, limit)
            before, pairs = self.pairs, self._other
            total = self._search.count(pairs, before)
            if total > pairs.capacity:
                larger = self._new_list(self._capacity(total, PAIR_BYTES), pairs.number + 2)
                wp.copy(larger.pair_start, pairs.pair_start)
                wp.copy(larger.pair_count_of, pairs.pair_count_of)
                pairs = larger
            store(pairs.pair_count, total)
            self._search.find(pairs, before, filling=True)
            store(pairs.pair_found, int(NOT_NEAR))
            store(pairs.pair_renewal_travel, 0.0)  # nothing is known of these pairs yet
            slips_before, self.slips = self.slips, self._other_slips
            if self.friction > 0.0 and total > self.slips.capacity:
                self.slips = SlipArrays.of(self._capacity(total, SLIP_BYTES), stepper.device)
            nodes, version = stepper.rods.node_count, (before.number, slips_before.capacity, self.slips.capacity)
            of_before = vars(slips_before) | vars(before)
            old: dict[str, Any] = {f"old_{name.removeprefix('pair_')}": value for name, value in of_before.items()}
            old["searched"] = self._search.searched

            def go_over(kernel: wp.Kernel) -> list[Launch]:
                known = {argument.label for argument in kernel.adj.args}
                own = {name: value for name, value in old.items() if name in known}
                return [bind(kernel, nodes, stepper.arrays, state, pairs, self.slips, **own)]

            if len(anew) < stepper.worlds:
                pairs.replayed("carry", lambda: go_over(carry_pairs), version)
            if self.friction > 0.0:
                pairs.replayed("slip", lambda: go_over(transfer_elastic_slip) + go_over(take_elastic_slip), version)
            pairs.order(total)
            self.pairs, self._other = pairs, before if self._has_two_lists else pairs
            self._other_slips = slips_before if stepper.worlds > 1 else self.slips
            stepper.steering.set(own, pair_reach=self._search.reach(pairs)[own] / float(CLOSING_RATE))
            self.list_near_pairs(rows=own)

    def list_near_pairs(self, travel: Any = None, rows: np.ndarray | None = None) -> None:
        """List the pairs that may touch within a travel [m] or [row] from the present positions; default: the last one given.

        The travel is at most NEXT_TRAVEL thicknesses. It excludes the look-ahead of the steps, less than a quarter of a step's
        motion: pairs that this brings together touch a step later.
        """
        stepper = self.stepper
        stepper.sync()
        with stepper.only(rows) as own:
            if travel is not None:
                self._travel[own] = np.minimum(travel, NEXT_TRAVEL * stepper.rods.section.thickness)
            self._mark_near(float(CLOSING_RATE) * self._travel[own], own)
            self._take_near_pairs()
            left = np.minimum(self._travel[own], self._search.allowed - self._search.motion(own))
            stepper.steering.set(own, travel_limit=stepper.steering.travel[own] + left, status=Steering.RUNNING)

    def _mark_near(self, gap: Any, own: np.ndarray) -> None:
        """Mark the pairs within a gap [m] at present positions, without offsets."""
        stepper, state, pairs = self.stepper, self.stepper.state, self.pairs
        stepper.steering.set(own, near_gap=gap)
        if not pairs.mark:
            threads = 1 if stepper.device == "cpu" else pairs.capacity
            sources = (self._wires, stepper.arrays, state, pairs)
            for part in range(stepper.parts):
                share = self._share(part, stepper.parts)
                mark = bind(mark_near_pairs, threads, *sources, threads=threads, **share)
                pairs.mark.append(replay([mark], stepper.device))
        stepper.team.each(pairs.mark, stepper.threads_of(1))

    def _take_near_pairs(self, which: np.ndarray | None = None) -> None:
        """Use marked near pairs, or `which` pairs, in the next steps."""
        pairs, total = self.pairs, self.pair_count
        self.collect_slip_work()
        if which is not None:
            is_near = np.zeros(pairs.capacity, dtype=np.int32)
            is_near[which] = 1
            store(pairs.pair_is_near, is_near)
        count = pairs.take_near(total)
        if count > self.touch.capacity:
            self.touch = self._new_touch(self._capacity(count, TOUCH_BYTES))
        nodes, touch = self.stepper.rods.node_count, self.touch

        def listing() -> list[Launch]:
            return [bind(list_near_pairs, pairs.capacity, pairs, touch), bind(find_near_starts, nodes + 1, pairs, touch)]

        pairs.replayed("list near", listing, touch.capacity)
        store(self.touch.touch_count, count)

    def refresh(self, moved: float | np.ndarray = 0.0, rows: np.ndarray | None = None) -> None:
        """Search again where nodes have moved too far, else list near pairs again; moved as for `follow`."""
        rest = self.follow(moved, rows)
        if len(rest):
            self.list_near_pairs(rows=rest)

    def follow(self, moved: float | np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """Search again where nodes have moved too far; returns the other worlds.

        moved [m] or [row]: by which all may have moved, outside of steps.
        """
        with self.stepper.only(rows) as own:
            self.stepper.steering.set(own, travel=self.stepper.steering.travel[own] + moved)
            self.stepper.update_frames(own)
            far = self._search.motion(own) > DUE * self._search.allowed
            if far.any():
                # meshes without friction have no list of the pairs before, unless they stand beside others
                keeps = self.stepper.steering.friction[own[far]] > 0.0
                self._renew_pairs(own[far], np.where(keeps, self._search.moved_limit(own[far]), -1.0))
            return own[~far]

    def carry(self, motion: np.ndarray, strain: float) -> float:
        """As `PairSearch.carry`: pairs hold while a single world follows a smooth motion (node, 3) [m]."""
        return self._search.carry(motion, strain)

    def state_dict(self, world: int = 0) -> dict[str, np.ndarray]:
        """Arrays of a world for a checkpoint, on a CPU views: the pair list with its elastic slips."""
        near, (begin, end) = self.near_pairs(), self._pairs_of(world)
        kept = self.pairs.state_dict(begin, end, self._nodes_of(world)) | self.slips.state_dict(begin, end)
        kept["pairs_near"] = near[(near >= begin) & (near < end)] - begin
        if self.friction > 0.0:
            kept |= {name: self.stepper.by_world(array)[world] for name, array in vars(self._before).items()}
        if self._in_real_time:
            kept["slip_work"] = fetch(self.touch.touch_slip_work)[: PLACES * len(near)]
        of_world = (self._penetration(), self._travel, self.dissipated)
        return kept | self._search.state_dict(world) | {"contact": np.array([values[world] for values in of_world])}

    def load_state_dict(self, kept: dict[str, np.ndarray], world: int = 0) -> None:
        """Restore what `state_dict` returned."""
        begin, end = self._pairs_of(world)
        near = self.near_pairs()
        change = len(kept["pair_first"]) - (end - begin)
        near = np.concatenate([near[near < begin], kept["pairs_near"] + begin, near[near >= end] + change])
        pairs = self._new_list(max(self._capacity(self.pair_count + change, PAIR_BYTES), 1), self.pairs.number + 2)
        pairs.load_state_dict(kept, self.pairs, begin, end, self._nodes_of(world))
        slips = self.slips
        if self.friction > 0.0 and pairs.capacity > slips.capacity:
            self.slips = SlipArrays.of(pairs.capacity, self.stepper.device)
        if self.stepper.worlds == 1:
            self._other_slips = self.slips
        self.slips.load_state_dict(kept, slips, begin, end)
        self.pairs = pairs
        if not self._has_two_lists:
            self._other = pairs
        if self.friction > 0.0:
            for name, array in vars(self._before).items():
                store(self.stepper.part(array, world), kept[name])
        penetration, self._travel[world], self.dissipated[world] = kept["contact"].tolist()
        self._search.load_state_dict(kept, world)
        store(self.stepper.part(self.max_penetration, world), penetration)
        store(self.touch.touch_slip_work, 0.0)
        self._take_near_pairs(near)
        if self._in_real_time:
            store_at(self.touch.touch_slip_work, slice(len(kept["slip_work"])), kept["slip_work"])

    def _nodes_of(self, world: int) -> slice:
        each = self.stepper.arrays.world_nodes
        return slice(world * each, (world + 1) * each)

    def _pairs_of(self, world: int) -> tuple[int, int]:
        """First pair of a world, and the pair after its last."""
        if self.stepper.worlds == 1:
            return 0, self.pair_count
        start, nodes = fetch(self.pairs.pair_start), self._nodes_of(world)
        return int(start[nodes.start]), int(start[nodes.stop]) if nodes.stop < len(start) else self.pair_count

    # --- convergence checks, the same for any number of threads

    def launch(self, kernel: wp.Kernel, *sources: object, **named: Any) -> None:
        """Launch a kernel for the own blocks or nodes, on the present lists."""
        version = self.version
        if version not in self._recorded:
            self._recorded = {one: launches for one, launches in self._recorded.items() if take_turns(one, version)}
            self._recorded[version] = self.stepper.launcher()
        self._recorded[version](kernel.key, kernel, self._wires, self.touch, self.pairs, *sources, **named)

    def sums(self, rows: np.ndarray | None = None) -> ContactSums:
        """Sums over contacts with a force in the last evaluated state; all worlds or `rows`."""
        sums = self.stepper.sums
        rows = self.stepper.rows if rows is None else rows

        def total() -> np.ndarray:
            self.launch(k.sum_contacts, contact_partial=self._partial)
            return sums.total(fetch(self._partial), rows)

        pushing, force = total()[:, [int(k.PUSHING), int(k.PUSH_SUM)]].T
        mean = np.divide(force, pushing, out=np.zeros(len(rows)), where=pushing > 0.0)
        self.stepper.steering.set(rows, mean_push=np.maximum(mean, 1e-300))
        square = total()[:, int(k.ERROR_SQUARE)]
        return ContactSums(mean, pushing, sums.largest(fetch(self._partial), rows)[:, int(k.ERROR_MAX)], square)

    def stress(self, rows: np.ndarray) -> np.ndarray:
        """(world, 2, 2) [N m] of segments and contacts, in the state last evaluated (kernels/rod_stress.py)."""
        self.launch(sum_segment_stress, segment_stress=self._segment_stress)
        self.launch(sum_contact_stress, contact_stress=self._contact_stress, has_friction=int(self.friction > 0.0))
        parts = np.concatenate([fetch(self._segment_stress), fetch(self._contact_stress)], axis=1)
        total = self.stepper.sums.total(parts, rows)
        return np.asarray(total[:, :4] + total[:, 4:]).reshape(-1, 2, 2)

    def bound_stiffness(self, rows: np.ndarray) -> None:
        """Write bounds on the stiffness of contacts into `sweep` of the state. Up to the gap of the last evaluation."""
        steering = self.stepper.steering
        steering.set(rows, sticking=STICK_SHARE * steering.contact_stiffness[rows] if self.friction > 0.0 else 0.0)
        self.launch(k.bound_contact_stiffness, **self._thicknesses)

    def _capacity(self, total: int, size: int) -> int:
        """Capacity of a list of `total` pairs of `size` bytes."""
        capacity = round(CAPACITY_MARGIN * total)
        needed, available = size * capacity, available_memory(self.stepper.device)
        if needed > available:
            raise OutOfResources(
                f"memory ran out: {total:,} pairs of neighbouring segments need {needed / 2**20:,.0f} MiB,"
                f" available: {available / 2**20:,.0f} MiB"
            )
        return capacity

    def advance_history(self, world: int = 0) -> None:
        """Accept the equilibrium of a world: scale elastic slip back at the Coulomb limit, and begin the next increment.

        Friction dissipates the work of its present forces on the slip beyond that limit. The evaluation counts as a step, so that
        slips left from before are older than the increment.
        """
        if self.friction == 0.0:
            return
        stepper, touch, rows = self.stepper, self.touch, np.array([world])
        store(touch.touch_slip_work, 0.0)
        stepper.evaluate(0.0, accepting=True, rows=rows)
        near = self.near_pairs()
        begin, end = np.searchsorted(near, self._pairs_of(world)).tolist()
        work = fetch(touch.touch_slip_work)[PLACES * begin : PLACES * end].reshape(-1, PLACES).sum(axis=1)
        of_node = np.bincount(fetch(self.pairs.pair_first)[near[begin:end]], work, stepper.rods.node_count)
        self.dissipated[world] += stepper.sums.of_nodes(of_node, rows)[0]
        step = stepper.steering.step[rows]
        self.slips.keep(int(step[0]) % 2, *self._pairs_of(world))
        stepper.steering.set(rows, step=step + 1.0)
        self.begin_increment(rows)

    def begin_increment(self, rows: np.ndarray) -> None:
        """Take the present states of worlds for their equilibria before."""
        for name, array in vars(self._before).items():
            now = self.stepper.by_world(getattr(self.stepper.state, name.removeprefix("before_")))
            self.stepper.store_rows(array, rows, now[rows])

    @property
    def _in_real_time(self) -> bool:
        """Whether slips are real-time slips: a ramp with friction."""
        return bool(self.friction > 0.0 and self.stepper.steering.drive[0] > 0.0)

    def collect_slip_work(self) -> None:
        """Add the friction work since the last call to `dissipated`; real time, single world."""
        if self._in_real_time:
            self.dissipated[0] += fetch(self.touch.touch_slip_work).sum()
            store(self.touch.touch_slip_work, 0.0)

    def _penetration(self) -> np.ndarray:
        """[world] [m] largest penetration of the contacts here."""
        return fetch(self.max_penetration).reshape(self.stepper.worlds, -1).max(axis=1)

    def pop_max_penetration(self, rows: np.ndarray | None = None) -> np.ndarray:
        """[row] [m] largest penetration of the mesh since the last call; resets it."""
        rows = self.stepper.rows if rows is None else rows
        max_penetration = self._penetration()[rows]
        self.stepper.store_rows(self.max_penetration, rows, 0.0)
        return np.asarray(self.stepper.strip.ranks.largest(max_penetration))

    def near_pairs(self) -> np.ndarray:
        """Numbers of the pairs that the steps look at."""
        return fetch(self.touch.touch_pair)[: number_at(self.touch.touch_count, 0)].copy()

    def find_contacts(self, distance: float, world: int = 0) -> Contacts:
        """Contacts of a world with a gap below `distance` [m], in the last evaluated state. Up to 2 MAX_OFFSET thicknesses.

        Some pairs at a time, so that a large mesh needs no more memory than for its steps.
        """
        stepped, rows, (begin, end) = self.near_pairs(), np.array([world]), self._pairs_of(world)
        with self.stepper.only(rows):
            self._mark_near(distance, rows)
            near = begin + np.flatnonzero(fetch(self.pairs.pair_is_near)[begin:end])
            found, size = [], max(self.touch.capacity, LEAST_READ)
            times = int(self.stepper.strip.ranks.largest(np.array([math.ceil(len(near) / size), 1])).max())
            for first in range(0, times * size, size):
                self._take_near_pairs(near[first : first + size])
                self.stepper.evaluate(distance, rows=rows)
                found.append(self.read_contacts(distance, world))
            self._take_near_pairs(stepped)
            self.stepper.evaluate(rows=rows)
        return Contacts(*(np.concatenate(values) for values in zip(*(vars(part).values() for part in found), strict=True)))

    def read_contacts(self, distance: float | None = None, world: int = 0) -> Contacts:
        """Contacts of a world, in the state last evaluated: those with a force, or those with a gap below `distance` [m].

        Of a strip those whose first segments are its own.
        """
        stepper = self.stepper
        pairs, touch, near = self.pairs, self.touch, self.near_pairs()
        nodes = stepper.strip.own if stepper.worlds == 1 else self._nodes_of(world)
        before = nodes.start if stepper.worlds > 1 else 0
        found, of_first = fetch(pairs.pair_found)[near][:, None], fetch(pairs.pair_first)[near]
        is_own = (of_first >= nodes.start) & (of_first < nodes.stop)
        is_there = is_own[:, None] & (found > int(NOT_NEAR)) & (np.arange(PLACES) < np.where(found == int(ONE_PLACE), 1, PLACES))
        force, overlap = (fetch(x)[: PLACES * len(near)] for x in (touch.touch_normal_force, touch.touch_overlap))
        kept = force != 0.0 if distance is None else (force != 0.0) | (overlap > -distance)
        which = np.flatnonzero(kept & is_there.ravel())
        pair = near[which // PLACES]
        first, second, shift = (fetch(x)[pair] for x in (pairs.pair_first, pairs.pair_second, pairs.pair_shift))
        place = fetch(pairs.pair_place)[PLACES * pair + which % PLACES]
        normal = fetch(touch.touch_normal)[which]
        friction = fetch(touch.touch_friction)[which] if self.friction > 0.0 else np.zeros_like(normal)
        return Contacts(first - before, second - before, place, shift, force[which], friction, normal, overlap[which])
