"""Wires that a thread steps group by group, so that the forces of a group stay in its cache until they have moved the nodes."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from ..mesh.strip import even_shares
from .rod_arrays import RodState, StepForces
from .rods import Rods

GROUP_NODES = 4096  # of a group, or one longer wire: their forces take 64 B a node


class WireGroup(NamedTuple):
    """Consecutive wires, with their blocks and nodes."""

    wires: range
    blocks: range
    nodes: range


def wire_groups(rods: Rods, wires: range, block_wire: np.ndarray, parts: int, *, on_cpu: bool) -> list[list[WireGroup]]:
    """The groups of each thread: some of the wires, about as many nodes for each thread; a single group on a GPU.

    block_wire: wire of each block.
    """
    largest = GROUP_NODES if on_cpu else rods.node_count
    first_node = np.append(rods.wire_first, rods.node_count)
    first_block = np.searchsorted(block_wire, np.arange(len(first_node)))

    def group(begin: int, end: int) -> WireGroup:
        blocks, nodes = (range(int(of[begin]), int(of[end])) for of in (first_block, first_node))
        return WireGroup(range(begin, end), blocks, nodes)

    shares: list[list[WireGroup]] = []
    first, count = (values[wires.start : wires.stop] for values in (rods.wire_first, rods.wire_count))
    for begin, end in pairwise((wires.start + even_shares(first - first_node[wires.start], count, parts)).tolist()):
        shares.append([])
        while begin < end:
            behind = int(np.searchsorted(first_node, first_node[begin] + largest, side="right")) - 1
            shares[-1].append(group(begin, min(max(begin + 1, behind), end)))
            begin = shares[-1][-1].wires.stop
    return shares


def shared_forces(groups: list[WireGroup], state: RodState) -> list[StepForces]:
    """The same memory for the forces of all groups of a thread, one after the other."""
    nodes = max((len(group.nodes) for group in groups), default=0)
    force, torque, sweep = (wp.empty(nodes, dtype=of.dtype, device=of.device) for of in (state.force, state.torque, state.sweep))
    return [StepForces(group.nodes.start, force, torque, sweep) for group in groups]
