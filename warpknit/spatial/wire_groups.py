"""Wires that a thread steps group by group, so that the forces of a group stay in its cache until they have moved the nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp

from ..kernels.rod_blocks import ROD_BLOCK
from .rod_arrays import RodState, StepForces
from .rods import Rods

GROUP_NODES = 4096  # of a group, or one longer wire: their forces take 64 B a node


class WireGroup(NamedTuple):
    """Consecutive wires, with their blocks and nodes."""

    wires: range
    blocks: range
    nodes: range


def wire_groups(rods: Rods, part: int, parts: int, *, on_cpu: bool) -> list[WireGroup]:
    """The groups of one thread: whole wires, about as many nodes for each thread; a single group on a GPU."""
    largest = GROUP_NODES if on_cpu else rods.node_count
    middle = rods.wire_first + 0.5 * rods.wire_count
    begin, end = np.searchsorted(middle, rods.node_count * np.arange(part, part + 2) / parts).tolist()
    first_node = np.append(rods.wire_first, rods.node_count)
    first_block = np.concatenate([[0], np.cumsum(-(-rods.wire_count // ROD_BLOCK))])
    groups = []
    while begin < end:
        behind = max(begin + 1, int(np.searchsorted(first_node, first_node[begin] + largest, side="right")) - 1)
        wires = range(begin, min(behind, end))
        blocks, nodes = (range(int(of[wires.start]), int(of[wires.stop])) for of in (first_block, first_node))
        groups.append(WireGroup(wires, blocks, nodes))
        begin = wires.stop
    return groups


def forces_of_groups(groups: list[WireGroup], state: RodState, *, shared: bool) -> list[StepForces]:
    """The arrays for the forces of each group: those of the state, or, `shared`, the same memory for all groups."""
    if not shared or not groups:
        return [StepForces.of(state) for _ in groups]
    nodes = max(len(group.nodes) for group in groups)
    force, torque, sweep = (wp.empty(nodes, dtype=of.dtype, device=of.device) for of in (state.force, state.torque, state.sweep))
    return [StepForces(group.nodes.start, force, torque, sweep) for group in groups]
