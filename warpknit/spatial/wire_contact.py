"""Contact between wires: search for segment pairs that may touch, and the contact launches of a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..errors import OutOfResources
from ..kernels import control as c
from ..kernels.wire_closest import NOT_NEAR, ONE_PLACE, PLACES, find_closest_places
from ..kernels.wire_contact_forces import add_contact_forces
from ..kernels.wire_curve import CLOSING_RATE
from ..kernels.wire_friction import transfer_elastic_slip
from ..kernels.wire_pairs import find_segment_pairs, place_segments_in_hash
from ..launch import Launch, bind
from ..memory import available_memory
from .rest_curve import RestCurve, catmull_rom
from .rod_step import RodStepper
from .rods import Rods
from .search_cells import search_cells

MIN_ARC_SEPARATION = (
    4.0  # radii along a wire, below which its segments do not touch each other; bent back onto itself it takes pi
)
SEARCH_RATIO = 1.3  # of the contact distance, up to which an evaluation finds the closest points of a pair
STICK_SHARE = 0.5  # tangential over normal stiffness
# bounds on the stiffness of a contact, whose weights change until the next update of the masses
WEIGHT_SUM = 2.5  # sum of the sizes of the weights of both wires: 5/4 in the middle of a segment
MORE_TILT = 0.1  # allowance for the components of the normal; more between wires that do not touch
LEAST_WEIGHT, BEYOND_WEIGHT = 0.5, 0.08  # of the nodes of the segment, at least, and of the nodes beyond
# memory of one pair; two lists exist while a search runs
PAIR_BYTES = 8 * (3 + 3 + PLACES * (2 * 3 + 2 + 2) + 2 * 2 * (3 + 2)) + 4 * (3 + 2 * 2)
CAPACITY_MARGIN = 1.3  # capacity of a list over the pairs found
PAIR_ARRAYS = ("first", "second", "shift", "arc_separation", "wake_travel", "renewal_travel", "found")
SLIP_ARRAYS = ("slip_step", "slip_place", "elastic_slip")
NODE_ARRAYS = ("start", "count")


@dataclass(frozen=True)
class Contacts:
    """Contacts on the host; arrays [contact]. `first` and `second` are the first nodes of the two segments.

    Two contacts of the same segments with different shifts are contacts with different periodic images.

    A saddle between two contacts of a pair counts as a contact with a negative force (kernels/wire_weights.py).
    """

    first: np.ndarray
    second: np.ndarray
    place: np.ndarray  # (contact, 2) on the segments, 0 .. 1
    shift: np.ndarray  # (contact, 3) [m] at rest, periodic shift of the second segment next to the first
    force: np.ndarray  # [N] normal
    friction: np.ndarray  # (contact, 3) [N] on the first
    normal: np.ndarray  # (contact, 3) towards the first
    overlap: np.ndarray  # [m] negative: gap


@dataclass(frozen=True)
class _WireArrays:
    """Rest data for contact; [node] unless noted."""

    node_wire: wp.array
    node_arc: wp.array  # [m]
    node_radius: wp.array  # [m]
    rest_slope: wp.array
    rest_bump: wp.array
    rest_bulge: wp.array
    wire_closed: wp.array  # [wire]
    wire_length: wp.array  # [wire] [m]
    wire_period: wp.array  # [wire] [m]


def _upload_wires(rods: Rods, curve: RestCurve, device: str) -> _WireArrays:
    return _WireArrays(
        node_wire=wp.array(rods.wire_of, dtype=wp.int32, device=device),
        node_arc=wp.array(rods.arc, dtype=wp.float64, device=device),
        node_radius=wp.array(rods.wire_radius[rods.wire_of], dtype=wp.float64, device=device),
        rest_slope=wp.array(curve.slope, dtype=wp.vec2d, device=device),
        rest_bump=wp.array(curve.bump, dtype=wp.vec4d, device=device),
        rest_bulge=wp.array(curve.bulge, dtype=wp.float64, device=device),
        wire_closed=wp.array(rods.wire_closed, dtype=wp.int32, device=device),
        wire_length=wp.array(rods.wire_length, dtype=wp.float64, device=device),
        wire_period=wp.array(rods.wire_period, dtype=wp.vec3d, device=device),
    )


class _PairList:
    """Device arrays of a list of at most `capacity` segment pairs; `number` identifies the list."""

    def __init__(self, capacity: int, nodes: int, device: str, number: int) -> None:
        def make(dtype: type, count: int = capacity) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=device)

        self.capacity, self.number = capacity, number
        self.start, self.count = make(wp.int32, nodes), make(wp.int32, nodes)
        self.total = make(wp.int32, 1)
        self.first, self.second = make(wp.int32), make(wp.int32)
        self.shift = make(wp.vec3d)
        self.arc_separation, self.wake_travel = make(wp.float64), make(wp.float64)
        self.renewal_travel, self.found = make(wp.float64), make(wp.int32)
        self.friction, self.normal = make(wp.vec3d, PLACES * capacity), make(wp.vec3d, PLACES * capacity)
        self.overlap, self.force = make(wp.float64, PLACES * capacity), make(wp.float64, PLACES * capacity)
        self.place = make(wp.vec2d, PLACES * capacity)
        # elastic slip of friction: two contacts a pair, double-buffered by the parity of the step
        self.slip_step = wp.full((2, 2 * capacity), -1, dtype=wp.int32, device=device)
        self.slip_place = wp.zeros((2, 2 * capacity), dtype=wp.vec2d, device=device)
        self.elastic_slip = wp.zeros((2, 2 * capacity), dtype=wp.vec3d, device=device)

    def named(self, *names: str) -> dict[str, wp.array]:
        """Arrays by the names of the kernel arguments."""
        return {f"pair_{name}": getattr(self, name) for name in names}


class WireContact:
    """Contact of all wires of a stepper with each other and themselves. Sets itself as the stepper's contact."""

    def __init__(
        self,
        stepper: RodStepper,
        stiffness: float,
        *,
        friction: float = 0.0,
        curve: RestCurve | None = None,
    ) -> None:
        """stiffness [N/m]: penalty, and that of friction; curve: default Catmull-Rom."""
        self.stepper = stepper
        self.friction = friction
        rods, device = stepper.rods, stepper.device
        self.searches = 0
        self._expected = 0.0  # [m] approach by the affine motion of the load, in addition to the travel
        curve = catmull_rom(rods) if curve is None else curve
        self._curve, self._after, self._before = curve, rods.following, rods.previous
        cells = search_cells(rods, curve)
        self.margin, self._radius, self._max_sag, self._cell = cells.margin, cells.radius, cells.max_sag, cells.size
        along_x, along_y, along_z = map(int, cells.count)
        self._grid = wp.HashGrid(along_x, along_y, along_z, device=device)
        self._hash_place = wp.zeros(rods.node_count, dtype=wp.vec3, device=device)
        self._wires = _upload_wires(rods, curve, device)
        self.max_penetration = wp.zeros(1, dtype=wp.float64, device=device)  # [m] since the last `pop_max_penetration`
        self._list, self._other = (_PairList(64, rods.node_count, device, number) for number in (0, 1))
        stepper.state.write_control({c.CONTACT_STIFFNESS: stiffness})
        stepper.state.contact_penalty.fill_(stiffness)
        stepper.contact = self

    @property
    def version(self) -> int:
        """The list that the launches use; recorded launches are reused for the same version."""
        return self._list.number

    @property
    def pair_count(self) -> int:
        """Segment pairs in the list."""
        return int(self._list.total.numpy()[0])

    def launches(self) -> list[Launch]:
        """Launches that add the contact forces."""
        stepper, pairs = self.stepper, self._list
        sources = (self._wires, stepper.arrays, stepper.state)
        named = pairs.named("first", "second", "shift", "found", "place") | {"pair_count": pairs.total}
        own = pairs.named("start", "arc_separation", "overlap", "force", "friction", "normal") | {"pair_count_of": pairs.count}
        slip = {name: getattr(pairs, name) for name in SLIP_ARRAYS}
        return [
            bind(
                find_closest_places, pairs.capacity, *sources, search_ratio=wp.float64(SEARCH_RATIO),
                **named, **pairs.named("wake_travel", "renewal_travel"),
            ),
            bind(
                add_contact_forces, pairs.capacity, *sources, min_arc_separation=wp.float64(MIN_ARC_SEPARATION),
                friction=wp.float64(self.friction), stick_share=wp.float64(STICK_SHARE), max_penetration=self.max_penetration,
                **named, **own, **slip,
            ),
        ]  # fmt: skip

    @property
    def expected(self) -> float:
        """[m] approach by the affine motion of the load, reserved by `expect`."""
        return self._expected

    def expect(self, strain: float) -> None:
        """Search, and from now on reserve a margin for the affine motion of a load that strains the mesh by `strain`."""
        self._expected = 2.0 * strain * self._radius
        self.search()

    def wake_all(self) -> None:
        """Wake all pairs; sleeping ones did not take the motion of a new load into account."""
        self._list.wake_travel.zero_()

    def strain_within(self, share: float) -> float:
        """Strain of a load whose affine motion uses `share` of the search margin."""
        return share * self.margin / (2.0 * self._radius)

    def search(self) -> None:
        """Search all pairs, and start a new travel budget. Raises `OutOfResources`."""
        stepper, state, device = self.stepper, self.stepper.state, self.stepper.device
        nodes = stepper.rods.node_count
        stepper.evaluate()
        narrowest = float(np.linalg.svd(state.gradient, compute_uv=False).min())
        bind(place_segments_in_hash, nodes, state, cell=wp.vec3d(*self._cell), place=self._hash_place).run(device)
        self._grid.build(self._hash_place, 1.0)
        before, pairs = self._list, self._other
        longer = max(float(state.read_control()[int(c.LENGTH_FACTOR)]), 1.0)
        radius = longer * self._radius / min(narrowest, 1.0) / float(self._cell.min())
        self._find(pairs, radius, filling=False)
        wp.utils.array_scan(pairs.count, pairs.start, inclusive=False)
        total = int(pairs.start.numpy()[-1] + pairs.count.numpy()[-1])
        if total > pairs.capacity:
            larger = _PairList(self._capacity(total), nodes, device, pairs.number + 2)
            wp.copy(larger.start, pairs.start)
            wp.copy(larger.count, pairs.count)
            pairs = larger
        pairs.total.fill_(total)
        self._find(pairs, radius, filling=True)
        bind(
            transfer_elastic_slip, pairs.capacity, step=int(state.read_control()[int(c.STEP)]),
            old_start=before.start, old_count=before.count, old_second=before.second, old_shift=before.shift,
            old_step=before.slip_step, old_place=before.slip_place, old_elastic_slip=before.elastic_slip,
            pair_count=pairs.total, slip_step=pairs.slip_step, slip_place=pairs.slip_place, elastic_slip=pairs.elastic_slip,
            **pairs.named("first", "second", "shift"),
        ).run(device)  # fmt: skip
        pairs.found.fill_(int(NOT_NEAR))
        self._list, self._other = pairs, before
        self.searches += 1
        budget = max((self.margin - self._expected) / float(CLOSING_RATE), 0.025 * self.margin)
        state.write_control({c.TRAVEL: 0.0, c.TRAVEL_LIMIT: budget, c.STATUS: 0.0})

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint: the pair list with its elastic slips."""
        pairs, count = self._list, self.pair_count
        kept = {f"pairs_{name}": getattr(pairs, name).numpy()[:count].copy() for name in PAIR_ARRAYS}
        kept["pairs_place"] = pairs.place.numpy()[: PLACES * count].copy()
        kept |= {f"pairs_{name}": getattr(pairs, name).numpy()[:, : 2 * count].copy() for name in SLIP_ARRAYS}
        kept |= {f"pairs_{name}": getattr(pairs, name).numpy().copy() for name in NODE_ARRAYS}
        return kept | {"contact": np.array([self._expected, self.searches, self.max_penetration.numpy()[0]])}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        total = len(kept["pairs_first"])
        pairs = _PairList(max(self._capacity(total), 1), self.stepper.rods.node_count, self.stepper.device, self._list.number + 2)
        for name in (*PAIR_ARRAYS, "place", *SLIP_ARRAYS):
            array, values = getattr(pairs, name), kept[f"pairs_{name}"]
            filled = array.numpy().copy()
            if name in SLIP_ARRAYS:
                filled[:, : values.shape[1]] = values
            else:
                filled[: len(values)] = values
            array.assign(filled)
        for name in NODE_ARRAYS:
            getattr(pairs, name).assign(kept[f"pairs_{name}"])
        pairs.total.fill_(total)
        self._list = pairs
        self._expected, self.searches = float(kept["contact"][0]), int(kept["contact"][1])
        self.max_penetration.fill_(float(kept["contact"][2]))

    def stiffness_bounds(self, approach: float) -> tuple[np.ndarray, np.ndarray]:
        """Bounds on the stiffness of the contacts: of nodes (node, 3) [N/m] along x, y, z, and of sections [node] [N m].

        Contacts count that touch or may do so after an approach [m] of at most the thickness.
        """
        rods, state = self.stepper.rods, self.stepper.state
        thickness, nodes = rods.section.thickness, rods.node_count
        near = self.read_contacts(min(approach, thickness))
        after, before = self._after, self._before
        penalty = state.contact_penalty.numpy()
        own = np.maximum(penalty, penalty[after])
        sticking = 0.0 if self.friction == 0.0 else STICK_SHARE * float(state.read_control()[int(c.CONTACT_STIFFNESS)])
        stiffness = self._curve.weight_square * np.maximum(own[near.first], own[near.second])
        tilt = MORE_TILT + np.maximum(-near.overlap, 0.0) / thickness
        along = np.abs(near.normal) + tilt[:, None]
        bound = WEIGHT_SUM * ((stiffness * along.sum(axis=1))[:, None] * along + sticking)
        node_bound, section_bound = np.zeros((nodes, 3)), np.zeros(nodes)
        for node, s in ((near.first, near.place[:, 0]), (near.second, near.place[:, 1])):
            arm = sticking * (thickness / rods.natural_length[node]) ** 2  # tilting segments
            beyond = np.full(len(s), BEYOND_WEIGHT)
            last = after[after[node]]
            weights = (beyond, np.maximum(1.0 - s, LEAST_WEIGHT), np.maximum(s, LEAST_WEIGHT), beyond)
            for there, weight in zip((before[node], node, after[node], last), weights, strict=True):
                kept = there >= 0
                for k in range(3):
                    node_bound[:, k] += np.bincount(there[kept], (weight * bound[:, k] + arm)[kept], nodes)
            lever = stiffness * self._curve.lever**2 + sticking * 0.25 * thickness**2
            for there in (before[node], node, after[node]):
                section_bound += np.bincount(there[there >= 0], lever[there >= 0], nodes)
        return node_bound, section_bound

    def _capacity(self, total: int) -> int:
        capacity = round(CAPACITY_MARGIN * total)
        needed, available = 2 * PAIR_BYTES * capacity, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: {total:,} pairs of neighbouring segments need {needed / 2**20:,.0f} MiB,"
                f" available: {available / 2**20:,.0f} MiB"
            )
        return capacity

    def _find(self, pairs: _PairList, radius: float, *, filling: bool) -> None:
        stepper, rods = self.stepper, self.stepper.rods
        bind(
            find_segment_pairs, rods.node_count, self._wires, stepper.arrays, stepper.state,
            grid=wp.uint64(self._grid.id), hash_radius=radius, margin=wp.float64(self.margin),
            expected_approach=wp.float64(self._expected), min_arc_separation=wp.float64(MIN_ARC_SEPARATION),
            max_sag=wp.float64(self._max_sag),
            tile=wp.vec3d(*rods.tile), is_filling=int(filling), place=self._hash_place,
            start=pairs.start, count=pairs.count, **pairs.named("first", "second", "shift", "arc_separation", "wake_travel"),
        ).run(stepper.device)  # fmt: skip

    def advance(self, steps: int) -> int:
        """Take steps, with a new search whenever the travel budget is used up.

        Returns the steps taken, fewer than asked for where the state diverged.
        """
        state, taken = self.stepper.state, 0
        while taken < steps:
            before = int(state.read_control()[int(c.STEP)])
            self.stepper.step(steps - taken)
            control = state.read_control()
            taken += int(control[int(c.STEP)]) - before
            if control[int(c.STATUS)] == 1.0:
                self.search()
            elif control[int(c.STATUS)] != 0.0:
                break
        return taken

    def pop_max_penetration(self) -> float:
        """[m] largest penetration since the last call; resets it."""
        max_penetration = float(self.max_penetration.numpy()[0])
        self.max_penetration.zero_()
        return max_penetration

    def read_contacts(self, distance: float | None = None) -> Contacts:
        """Contacts of the state last evaluated: those with a force, or all with a gap below `distance` [m]."""
        pairs, count = self._list, self.pair_count
        found = pairs.found.numpy()[:count, None]
        is_there = (found > int(NOT_NEAR)) & (np.arange(PLACES) < np.where(found == int(ONE_PLACE), 1, PLACES))
        force, overlap = (values.numpy()[: PLACES * count] for values in (pairs.force, pairs.overlap))
        kept = force != 0.0 if distance is None else (force != 0.0) | (overlap > -distance)
        which = np.flatnonzero(kept & is_there.ravel())
        of_pair = {name: getattr(pairs, name).numpy()[which // PLACES] for name in ("first", "second", "shift")}
        names = ("place", "force", "friction", "normal", "overlap")
        return Contacts(**of_pair, **{name: getattr(pairs, name).numpy()[which] for name in names})
