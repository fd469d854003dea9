"""Contact between wires: the list of segment pairs that may touch, renewed as things move, and what each step does with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..errors import OutOfResources
from ..kernels import control as c
from ..kernels.wire_closest import NOT_NEAR, ONE_PLACE, PLACES, find_closest_places
from ..kernels.wire_contact import push_wires_apart
from ..kernels.wire_curve import CLOSING
from ..kernels.wire_pairs import find_segment_pairs, place_segments_in_hash
from ..kernels.wire_stick import keep_slips
from ..launch import Launch, bind
from ..memory import available_memory
from .rest_curve import RestCurve, catmull_rom
from .rod_step import RodStepper
from .rods import Rods
from .search_cells import search_cells

APART = 4.0  # radii along a wire below which its segments do not touch each other: bent back onto itself it takes pi
REACH = 1.3  # distances of touching wires up to which a pair is measured to the end
STICK_SHARE = 0.5  # tangential over normal stiffness
# of one pair, kept twice while a list is renewed
PAIR_BYTES = 8 * (3 + 3 + PLACES * (2 * 3 + 2 + 2) + 2 * 2 * (3 + 2)) + 4 * (3 + 2 * 2)
ROOM = 1.3  # pairs that a list has room for, over those that it holds
KEPT_OF_PAIRS = ("first", "second", "shift", "way", "wake", "renewal", "found")
KEPT_OF_STUCK = ("stuck_step", "stuck_place", "slip")
KEPT_OF_NODES = ("start", "count")


@dataclass(frozen=True)
class TouchingPairs:
    """Contacts that carry a force; arrays [contact]. `first` and `second` are nodes that begin the segments.

    A saddle between two contacts of a pair is one of them, with a force below zero (kernels/wire_shares.py).
    """

    first: np.ndarray
    second: np.ndarray
    place: np.ndarray  # (contact, 2) on the segments, 0 .. 1
    shift: np.ndarray  # (contact, 3) [m] at rest, that moves the second next to the first
    force: np.ndarray  # [N] normal
    friction: np.ndarray  # (contact, 3) [N] on the first
    normal: np.ndarray  # (contact, 3) towards the first
    overlap: np.ndarray  # [m]; negative: how far apart


@dataclass(frozen=True)
class _Wires:
    """What contact knows of nodes and wires; [node] unless said."""

    node_wire: wp.array
    node_arc: wp.array  # [m]
    node_radius: wp.array  # [m]
    rest_slope: wp.array
    rest_bump: wp.array
    rest_bulge: wp.array
    wire_closed: wp.array  # [wire]
    wire_length: wp.array  # [wire] [m]
    wire_period: wp.array  # [wire] [m]


def _upload_wires(rods: Rods, rest: RestCurve, device: str) -> _Wires:
    return _Wires(
        node_wire=wp.array(rods.wire_of, dtype=wp.int32, device=device),
        node_arc=wp.array(rods.arc, dtype=wp.float64, device=device),
        node_radius=wp.array(rods.wire_radius[rods.wire_of], dtype=wp.float64, device=device),
        rest_slope=wp.array(rest.slope, dtype=wp.vec2d, device=device),
        rest_bump=wp.array(rest.bump, dtype=wp.vec4d, device=device),
        rest_bulge=wp.array(rest.bulge, dtype=wp.float64, device=device),
        wire_closed=wp.array(rods.wire_closed, dtype=wp.int32, device=device),
        wire_length=wp.array(rods.wire_length, dtype=wp.float64, device=device),
        wire_period=wp.array(rods.wire_period, dtype=wp.vec3d, device=device),
    )


class _List:
    """Arrays of a list of pairs with room for `room`; `number` tells lists apart."""

    def __init__(self, room: int, nodes: int, device: str, number: int) -> None:
        def make(dtype: type, count: int = room) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=device)

        self.room, self.number = room, number
        self.start, self.count = make(wp.int32, nodes), make(wp.int32, nodes)
        self.total = make(wp.int32, 1)
        self.first, self.second = make(wp.int32), make(wp.int32)
        self.shift = make(wp.vec3d)
        self.way, self.wake = make(wp.float64), make(wp.float64)
        self.renewal, self.found = make(wp.float64), make(wp.int32)
        self.friction, self.normal = make(wp.vec3d, PLACES * room), make(wp.vec3d, PLACES * room)
        self.overlap, self.force = make(wp.float64, PLACES * room), make(wp.float64, PLACES * room)
        self.place = make(wp.vec2d, PLACES * room)
        # a pair may touch in two points; what sticks, by whether the step is odd
        self.stuck_step = wp.full((2, 2 * room), -1, dtype=wp.int32, device=device)
        self.stuck_place = wp.zeros((2, 2 * room), dtype=wp.vec2d, device=device)
        self.slip = wp.zeros((2, 2 * room), dtype=wp.vec3d, device=device)

    def named(self, *names: str) -> dict[str, wp.array]:
        """Arrays as kernels call them."""
        return {f"pair_{name}": getattr(self, name) for name in names}


class WireContact:
    """Contact of all wires of a stepper, each with each and with itself. Sets itself as the stepper's contact.

    Raises:
        ModelError: a tile is so small that a segment would meet two copies of another.
    """

    def __init__(
        self,
        stepper: RodStepper,
        stiffness: float,
        *,
        friction: float = 0.0,
        curve: RestCurve | None = None,
    ) -> None:
        """stiffness [N/m] penalty; curve: Catmull-Rom's where left out."""
        self.stepper = stepper
        self.friction = friction
        rods, device = stepper.rods, stepper.device
        self.searches = 0
        self._expected = 0.0  # [m] by which the load brings things nearer beside their own travel
        rest = catmull_rom(rods) if curve is None else curve
        cells = search_cells(rods, rest)
        self.margin, self._radius, self._most_sag, self._cell = cells.margin, cells.radius, cells.most_sag, cells.size
        along_x, along_y, along_z = map(int, cells.count)
        self._grid = wp.HashGrid(along_x, along_y, along_z, device=device)
        self._hash_place = wp.zeros(rods.node_count, dtype=wp.vec3, device=device)
        self._wires = _upload_wires(rods, rest, device)
        self.deepest = wp.zeros(1, dtype=wp.float64, device=device)  # [m] overlap since it was last taken
        self._list, self._other = (_List(64, rods.node_count, device, number) for number in (0, 1))
        stepper.state.write_control({c.CONTACT_STIFFNESS: stiffness})
        stepper.contact = self

    @property
    def version(self) -> int:
        """Which arrays the launches use: launches recorded for one version do for it whenever it comes again."""
        return self._list.number

    @property
    def pair_count(self) -> int:
        """Segment pairs that are looked at."""
        return int(self._list.total.numpy()[0])

    def launches(self) -> list[Launch]:
        """What adds the forces of contact."""
        stepper, pairs = self.stepper, self._list
        sources = (self._wires, stepper.arrays, stepper.state)
        named = pairs.named("first", "second", "shift", "found", "place") | {"pair_count": pairs.total}
        own = pairs.named("start", "way", "overlap", "force", "friction", "normal") | {"pair_count_of": pairs.count}
        stuck = {"stuck_step": pairs.stuck_step, "stuck_place": pairs.stuck_place, "stuck_by": pairs.slip}
        return [
            bind(find_closest_places, pairs.room, *sources, reach=wp.float64(REACH), **named, **pairs.named("wake", "renewal")),
            bind(
                push_wires_apart, pairs.room, *sources, apart=wp.float64(APART),
                friction=wp.float64(self.friction), stick_share=wp.float64(STICK_SHARE), deepest=self.deepest,
                **named, **own, **stuck,
            ),
        ]  # fmt: skip

    @property
    def expected(self) -> float:
        """[m] by which the load brings things nearer beside their own travel, as told."""
        return self._expected

    def expect(self, strain: float) -> None:
        """Search, and until the next call keep room for what the load itself will do, which strains the mesh by so much."""
        self._expected = 2.0 * strain * self._radius
        self.search()

    def wake(self) -> None:
        """Have all pairs looked at: those that went to sleep while no load came on did not reckon with one."""
        self._list.wake.zero_()

    def strain_within(self, share: float) -> float:
        """Strain by which the load brings things nearer by `share` of the margin of a search."""
        return share * self.margin / (2.0 * self._radius)

    def search(self) -> None:
        """Renew the list of pairs, and start a new travel budget. Raises OutOfResources."""
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
        if total > pairs.room:
            grown = _List(self._room(total), nodes, device, pairs.number + 2)
            wp.copy(grown.start, pairs.start)
            wp.copy(grown.count, pairs.count)
            pairs = grown
        pairs.total.fill_(total)
        self._find(pairs, radius, filling=True)
        bind(
            keep_slips, pairs.room, step=int(state.read_control()[int(c.STEP)]),
            old_start=before.start, old_count=before.count, old_second=before.second, old_shift=before.shift,
            old_step=before.stuck_step, old_place=before.stuck_place, old_slip=before.slip,
            pair_count=pairs.total, stuck_step=pairs.stuck_step, stuck_place=pairs.stuck_place, stuck_by=pairs.slip,
            **pairs.named("first", "second", "shift"),
        ).run(device)  # fmt: skip
        pairs.found.fill_(int(NOT_NEAR))
        self._list, self._other = pairs, before
        self.searches += 1
        budget = max((self.margin - self._expected) / float(CLOSING), 0.025 * self.margin)
        state.write_control({c.TRAVEL: 0.0, c.TRAVEL_LIMIT: budget, c.STATUS: 0.0})

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint needs: the list of pairs, as it was when it was found, with what sticks."""
        pairs, count = self._list, self.pair_count
        kept = {f"pairs_{name}": getattr(pairs, name).numpy()[:count].copy() for name in KEPT_OF_PAIRS}
        kept["pairs_place"] = pairs.place.numpy()[: PLACES * count].copy()
        kept |= {f"pairs_{name}": getattr(pairs, name).numpy()[:, : 2 * count].copy() for name in KEPT_OF_STUCK}
        kept |= {f"pairs_{name}": getattr(pairs, name).numpy().copy() for name in KEPT_OF_NODES}
        return kept | {"contact": np.array([self._expected, self.searches, self.deepest.numpy()[0]])}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        total = len(kept["pairs_first"])
        pairs = _List(max(self._room(total), 1), self.stepper.rods.node_count, self.stepper.device, self._list.number + 2)
        for name in (*KEPT_OF_PAIRS, "place", *KEPT_OF_STUCK):
            array, values = getattr(pairs, name), kept[f"pairs_{name}"]
            filled = array.numpy().copy()
            if name in KEPT_OF_STUCK:
                filled[:, : values.shape[1]] = values
            else:
                filled[: len(values)] = values
            array.assign(filled)
        for name in KEPT_OF_NODES:
            getattr(pairs, name).assign(kept[f"pairs_{name}"])
        pairs.total.fill_(total)
        self._list = pairs
        self._expected, self.searches = float(kept["contact"][0]), int(kept["contact"][1])
        self.deepest.fill_(float(kept["contact"][2]))

    def _room(self, total: int) -> int:
        room = round(ROOM * total)
        needed, available = 2 * PAIR_BYTES * room, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: {total:,} pairs of segments near each other need {needed / 2**20:,.0f} MiB,"
                f" {available / 2**20:,.0f} MiB are available"
            )
        return room

    def _find(self, pairs: _List, radius: float, *, filling: bool) -> None:
        stepper, rods = self.stepper, self.stepper.rods
        bind(
            find_segment_pairs, rods.node_count, self._wires, stepper.arrays, stepper.state,
            grid=wp.uint64(self._grid.id), hash_radius=radius, margin=wp.float64(self.margin),
            expected=wp.float64(self._expected), apart=wp.float64(APART), most_sag=wp.float64(self._most_sag),
            tile=wp.vec3d(*rods.tile), is_filling=int(filling), place=self._hash_place,
            start=pairs.start, count=pairs.count, **pairs.named("first", "second", "shift", "way", "wake"),
        ).run(stepper.device)  # fmt: skip

    def advance(self, steps: int) -> int:
        """Take steps, searching whenever things have travelled farther than the list holds for; returns how many were taken,
        fewer where the state diverged."""
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

    def take_deepest(self) -> float:
        """[m] largest overlap since this was last asked."""
        deepest = float(self.deepest.numpy()[0])
        self.deepest.zero_()
        return deepest

    def near(self, distance: float | None = None) -> TouchingPairs:
        """Contacts of the state last evaluated: those that carry a force, or all whose surfaces are within `distance` [m]."""
        pairs, count = self._list, self.pair_count
        found = pairs.found.numpy()[:count, None]
        is_there = (found > int(NOT_NEAR)) & (np.arange(PLACES) < np.where(found == int(ONE_PLACE), 1, PLACES))
        force, overlap = (values.numpy()[: PLACES * count] for values in (pairs.force, pairs.overlap))
        kept = force != 0.0 if distance is None else overlap > -distance
        which = np.flatnonzero(kept & is_there.ravel())
        of_pair = {name: getattr(pairs, name).numpy()[which // PLACES] for name in ("first", "second", "shift")}
        names = ("place", "force", "friction", "normal", "overlap")
        return TouchingPairs(**of_pair, **{name: getattr(pairs, name).numpy()[which] for name in names})
