"""A mesh cut into strips along the warp, one a rank.

Wires run along the warp and stand in memory side by side, so a strip is a range of whole wires. Nothing but contact bodies
crosses from strip to strip: a body that hooks a wire of one strip to a wire of another is there in both, and its pair on the
other's wire is foreign: its force comes from there (kernels/border.py).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..base.errors import ModelError
from .panel import Panel, as32


@dataclass(frozen=True)
class Neighbour:
    """Another rank whose strip shares bodies with this one; both list the shared bodies in the same order."""

    rank: int
    own_pair: np.ndarray  # [shared body] the pair on a wire of this strip
    foreign_pair: np.ndarray  # [shared body] the pair on a wire of the other


@dataclass(frozen=True)
class Strip:
    """Strip of one rank. In its `panel`, a foreign pair has the wire -1."""

    panel: Panel
    whole: Panel
    wires: slice  # of the whole mesh
    nodes: slice
    body: np.ndarray  # [body of the strip] which body of the mesh it is; those that this rank speaks for come first
    owned_bodies: int  # bodies that this rank speaks for: every body is spoken for once
    pair: np.ndarray  # [pair of the strip on a wire of its own]
    pair_of_whole: np.ndarray  # [the same] which pair of the mesh it is
    neighbours: tuple[Neighbour, ...]


def even_shares(wire_first: np.ndarray, wire_count: np.ndarray, parts: int) -> np.ndarray:
    """First wire of each part, then the number of wires (parts + 1,); similar numbers of nodes."""
    middle = wire_first + 0.5 * wire_count
    return np.asarray(np.searchsorted(middle, wire_count.sum() * np.arange(parts + 1) / parts))


def wires_of_ranks(panel: Panel, ranks: int) -> np.ndarray:
    """First wire of each rank, then the number of wires (ranks + 1,); similar numbers of nodes.

    Raises `ModelError` where there are fewer wires than ranks.
    """
    wires = len(panel.wire_first)
    if wires < ranks:
        raise ModelError(f"knit.repeats: {wires} wires cannot be shared by {ranks} ranks; use more repeats or fewer ranks")
    first = even_shares(panel.wire_first, panel.wire_count, ranks)
    # at least a wire for each
    first = np.maximum.accumulate(first - np.arange(ranks + 1)) + np.arange(ranks + 1)
    return np.minimum(first, wires - ranks + np.arange(ranks + 1))


def cut_strip(panel: Panel, rank: int, ranks: int) -> Strip:
    """The strip of `rank` among `ranks`. Raises `ModelError` where there are fewer wires than ranks."""
    first_wire = wires_of_ranks(panel, ranks)
    wires = slice(int(first_wire[rank]), int(first_wire[rank + 1]))
    first_node = np.append(panel.wire_first, panel.node_count)
    nodes = slice(int(first_node[wires.start]), int(first_node[wires.stop]))

    rank_of_pair = (np.searchsorted(first_wire, panel.pair_wire, side="right") - 1).reshape(-1, 2)
    owned = rank_of_pair[:, 0] == rank
    here = (rank_of_pair == rank).any(axis=1)
    body = np.concatenate([np.nonzero(owned)[0], np.nonzero(here & ~owned)[0]])
    pair = (2 * body[:, None] + np.arange(2)).ravel()
    own = rank_of_pair[body].ravel() == rank

    part = replace(
        _taken(panel_of(panel, np.arange(wires.start, wires.stop)), panel, body=body, pair=pair),
        pair_wire=as32(np.where(own, panel.pair_wire[pair] - wires.start, -1)),
        pair_seed=as32(np.where(own, panel.pair_seed[pair] - nodes.start, 0)),
    )
    return Strip(
        panel=part,
        whole=panel,
        wires=wires,
        nodes=nodes,
        body=body,
        owned_bodies=int(owned.sum()),
        pair=np.nonzero(own)[0],
        pair_of_whole=pair[own],
        neighbours=_neighbours(rank, body, rank_of_pair[body]),
    )


def panel_of(panel: Panel, wires: np.ndarray) -> Panel:
    """Some wires of a panel, in rising order, with clamps and without bodies."""
    count, first_node = panel.wire_count[wires], panel.wire_first[wires]
    first = np.cumsum(count) - count
    number = np.full(len(panel.wire_first), -1)
    number[wires] = np.arange(len(wires))
    shift = np.zeros(len(panel.wire_first), dtype=np.int64)  # of the nodes of each wire
    shift[wires] = first - first_node
    block = number[panel.block_wire] >= 0
    held_wire = np.searchsorted(panel.wire_first, panel.held_node, side="right") - 1
    held = number[held_wire] >= 0
    clamps, held_clamp = np.unique(panel.held_clamp[held], return_inverse=True)
    none = np.zeros(0, dtype=int)
    return replace(
        _taken(panel, panel, wire=wires, block=block, held=held, body=none, pair=none, rhombus=none),
        wire_first=as32(first),
        block_first=as32((panel.block_first + shift[panel.block_wire])[block]),
        block_wire=as32(number[panel.block_wire[block]]),
        held_node=as32((panel.held_node + shift[held_wire])[held]),
        held_clamp=as32(held_clamp.reshape(-1)),
        clamp_position=panel.clamp_position[clamps],
    )


def _taken(part: Panel, panel: Panel, **index: np.ndarray) -> Panel:
    """A panel with entries of arrays of another; index: by the beginning of their names."""
    kinds = {one.name: one.name.partition("_")[0] for one in fields(panel)}
    arrays = {name: getattr(panel, name) for name, kind in kinds.items() if kind in index}
    return replace(part, **{name: array[index[kinds[name]]] for name, array in arrays.items() if len(array)})


def _neighbours(rank: int, body: np.ndarray, rank_of_pair: np.ndarray) -> tuple[Neighbour, ...]:
    """Neighbours with shared bodies (body,) of a strip, from the ranks (body, 2) of their pairs."""
    found = []
    order = np.argsort(body)  # the order in the whole mesh is the same for both sides
    other = rank_of_pair.max(axis=1) + rank_of_pair.min(axis=1) - rank
    for peer in np.unique(other[other != rank]):
        shared = order[other[order] == peer]
        second = rank_of_pair[shared, 1] == rank  # the pair on a wire of this strip is the second of its body
        found.append(Neighbour(int(peer), 2 * shared + second, 2 * shared + 1 - second))
    return tuple(found)
