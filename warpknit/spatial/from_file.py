"""Wires from a file (`warpknit.wires`) as rods: periodic wires and rings are closed, open wires clamped at both ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..base.errors import ModelError
from ..kernels.clamp import CLAMP_NUMBERS
from ..mechanics.numerics import few_nodes
from ..mesh.layout import SLIDE_ALLOWANCE
from ..mesh.panel import Panel
from ..wires.centre_lines import Wires, dot
from ..wires.hooks import Places, find_places
from ..wires.overlaps import close_places
from .node_stiffness import node_stiffness
from .placed_wires import SpatialWires
from .rods import Rods, Section, rods_of
from .sites import NOWHERE, Sites

MIN_NODES = 5  # of an open wire; its clamps hold four


def panel_of_wires(sections: Sequence[Section], wires: Wires, loop_length: float) -> tuple[Panel, SpatialWires, Rods]:
    """The wires as a panel with bodies at possible contacts, their clamps, and rods.

    Places are hooks and other crossings (wires/hooks.py), and other places where wires come near each other.

    Natural lengths, curvature and twist come from the file where it has them. sections [wire]: of each wire. loop_length [m]:
    approximate length of wire in a loop. Raises `ModelError`.
    """
    count = np.array([len(points) for points in wires.points], dtype=np.int32)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int32)
    is_open = np.array([kind == "open" for kind in wires.kinds])
    if (count[is_open] < MIN_NODES).any():
        number = int(np.flatnonzero(is_open & (count < MIN_NODES))[0])
        wrong = f"wire {number + 1} has {count[number]} nodes, fewer than {MIN_NODES} (its clamps hold four)"
        raise ModelError(f"wires.node_spacing: {wrong}; write a smaller spacing")
    if wires.period is None and not is_open.any():
        raise ModelError("wires.file: all wires are closed rings; add an open wire, or write wires.period")
    places, slack = find_places(wires, loop_length), SLIDE_ALLOWANCE * loop_length
    placed = _place_wires(wires, places, slack, first[is_open], count[is_open])
    thinnest = min(sections, key=lambda section: section.thickness)
    rods = rods_of(thinnest, wires.points, [None if end else wires.closing(w) for w, end in enumerate(is_open)], tile=placed.tile)
    if any(section != thinnest for section in sections):
        rods = replace(rods, sections=tuple(sections))
    if wires.rest_lengths is not None:
        own = rods.natural_length.copy()
        own[rods.following >= 0] = np.concatenate(wires.rest_lengths)
        rods = replace(rods, natural_length=own, natural_arc=own * rods.natural_arc / rods.natural_length)
    rods = _with_natural_shape(rods, wires)
    rods = rods.holding(placed.held_node.tolist(), placed.held_section.tolist())
    placed = _with_close_places(wires, placed, rods, slack)
    nodes_per_loop = round(loop_length * float(wires.segment_counts.sum() / wires.lengths.sum()))
    return _panel(wires, placed, rods, places, nodes_per_loop), placed, rods


def _with_natural_shape(rods: Rods, wires: Wires) -> Rods:
    """Rods with natural curvature and twist of a file, if any. Components along the directors at rest."""
    if wires.natural_turns is None and wires.twist_strains is None:
        return rods
    rods = replace(rods, node_stiffness=node_stiffness(rods))
    if wires.natural_turns is not None:
        turn, d1, before = np.concatenate(wires.natural_turns), rods.director, rods.previous
        d2 = np.cross(rods.rest_edge, d1) / np.linalg.norm(rods.rest_edge, axis=1)[:, None]
        along = [0.5 * dot(d2[before] + d2, turn), -0.5 * dot(d1[before] + d1, turn)]
        rods = replace(rods, natural_curvature=np.stack(along, axis=1))
    if wires.twist_strains is not None:
        rods = replace(rods, natural_twist=rods.rest_twist - np.concatenate(wires.twist_strains))
    return rods


def _place_wires(wires: Wires, places: Places, slack: float, first: np.ndarray, count: np.ndarray) -> SpatialWires:
    """Clamps of open wires, in the middle of end segments, and sites of places.

    first, count: of the nodes of open wires; slack [m]: reach of a site beyond both ends of its place.
    """
    held = np.stack([first, first + 1, first + count - 2, first + count - 1], axis=1).astype(np.int64)
    ends = np.concatenate(wires.points)[held][..., :2]
    middle = np.repeat(ends.reshape(-1, 2, 2, 2).mean(axis=2), 2, axis=1)
    arcs = (places.low, places.high, 0.5 * (places.low + places.high))
    low, high, seed = (_node_places(wires, places.wire, arc) for arc in arcs)
    is_closed = np.array([kind != "open" for kind in wires.kinds])[places.wire]
    slack_nodes = _segments_in(wires, places.wire, slack)
    return SpatialWires(
        tile=np.zeros(3) if wires.period is None else np.array([*wires.period, 0.0]),
        held_node=held.ravel(),
        held_lever=(ends - middle).reshape(-1, 2),
        site_wire=places.wire,
        site_seed=np.where(is_closed, np.mod(seed, wires.segment_counts[places.wire]), seed),
        site_low=low - seed - slack_nodes,
        site_high=high - seed + slack_nodes,
    )


def _with_close_places(wires: Wires, placed: SpatialWires, rods: Rods, slack: float) -> SpatialWires:
    """Add sites where wires are near each other and no site reaches."""
    near = close_places(wires, 2.0 * rods.wire_radius)
    if near is None or not len(near.wire):
        return placed
    nodes = rods.wire_first[near.wire] + near.segment
    site, _sign = Sites(placed, rods).of(nodes[:, 0], nodes[:, 1], wires.shift(near.repeat), near.on)
    new = site == NOWHERE
    wire, reach = near.wire[new], near.segments[new] + _segments_in(wires, near.wire[new], slack)
    return replace(
        placed,
        site_wire=np.concatenate([placed.site_wire, wire]),
        site_seed=np.concatenate([placed.site_seed, (near.segment + near.on)[new]]),
        site_low=np.concatenate([placed.site_low, -reach]),
        site_high=np.concatenate([placed.site_high, reach]),
    )


def _segments_in(wires: Wires, wire: np.ndarray, length: float) -> np.ndarray:
    """(place, 2) number of segments in a length [m] of wires (place, 2)."""
    return np.asarray(length / (wires.lengths / wires.segment_counts)[wire])


def _node_places(wires: Wires, wire: np.ndarray, arc: np.ndarray) -> np.ndarray:
    """(hook, 2) node numbers along wires at arc lengths (hook, 2) [m], continued beyond the ends."""
    places = np.empty(arc.shape)
    for w in np.unique(wire):
        begin, end = wires.ends(w)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - begin, axis=1))])
        here = arc[wire == w]
        rounds = np.zeros(here.shape) if wires.kinds[w] == "open" else np.floor(here / along[-1])
        places[wire == w] = np.interp(here - rounds * along[-1], along, np.arange(len(along))) + rounds * len(begin)
    return places


def _panel(wires: Wires, placed: SpatialWires, rods: Rods, places: Places, nodes_per_loop: int) -> Panel:
    points, first, count = rods.position[:, :2], rods.wire_first, rods.wire_count
    site_wire = placed.site_wire[len(places) :, 0]
    nearest = first[site_wire] + placed.site_seed[len(places) :, 0].astype(int)
    clamps = (points[placed.held_node] - placed.held_lever)[::2]
    size, clamp_share = wires.period, np.ones(2)
    if size is None:
        size, distance = np.maximum(np.ptp(points, axis=0), rods.section.thickness), np.ptp(clamps, axis=0)
        clamp_share = np.where(distance > rods.section.thickness, distance / size, 1.0)  # both ends on one side hold no width
    return Panel(
        size=size,
        low=points.min(axis=0) if wires.period is None else np.zeros(2),
        boundary="gripped" if wires.period is None else "periodic",
        wire_first=first,
        wire_count=count,
        wire_closed=np.array([kind != "open" for kind in wires.kinds]),
        wire_thread=np.zeros(len(count), dtype=np.int32),
        wire_length=wires.lengths,
        clamp_position=clamps,
        clamp_share=clamp_share,
        wire_clamp=np.zeros((len(count), 2, int(CLAMP_NUMBERS))),
        body_rest=np.concatenate([places.position, points[nearest]]),
        body_origin=np.zeros((len(placed.site_wire), 2)),
        pair_wire=placed.site_wire.ravel().astype(np.int32),
        warnings=(*wires.warnings, *(few_nodes(nodes_per_loop) if places.hooks else ())),
    )
