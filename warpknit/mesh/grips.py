"""Clamps at the cut ends of the wires, and their held nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kernels import clamp
from ..kernels.bend import BOW
from ..knit.cloth import Cloth
from .rest_table import Table
from .strands import Strands
from .thread_curve import ThreadCurve

TANGENT_SHARE = 1e-3  # of a node spacing, either side of a clamp: where its direction is taken from


@dataclass(frozen=True)
class Grips:
    """Two clamps per wire and their held nodes."""

    node: np.ndarray  # [held]
    lever: np.ndarray  # [held, 2] [m]
    position: np.ndarray  # [clamp, 2] [m]
    numbers: np.ndarray  # [wire, 2, CLAMP_NUMBERS]


def no_clamps(wires: int) -> Grips:
    """Empty grips of closed wires."""
    return Grips(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((wires, 2, clamp.CLAMP_NUMBERS)))


def clamps(cloth: Cloth, table: Table, strands: Strands, used: np.ndarray, first: np.ndarray, set_fraction: float) -> Grips:
    """The clamps of the kept wires, with their numbers for kernels/clamp.py."""
    thread, begin, count = strands.thread[used], strands.begin[used], strands.count[used]
    spacing = table.spacing[thread]
    arc = np.stack([strands.arc_begin[used], strands.arc_end[used]], axis=1)
    # the clamp, points a little before and behind it, and the five nodes at its end of the wire, the outermost first
    inward = np.array([1, -1])
    local = np.stack([np.zeros_like(count), count - 1], axis=1)[:, :, None] + inward[:, None] * np.arange(5)
    node_arc = (begin[:, None, None] + local) * spacing[:, None, None]
    apart = TANGENT_SHARE * spacing[:, None]
    at = np.concatenate([np.stack([arc, arc - apart, arc + apart], axis=2), node_arc], axis=2)
    place = np.zeros((*at.shape, 2))
    for t, line in enumerate(cloth.threads):
        here = thread == t
        place[here] = ThreadCurve(line, cloth.size[1])(at[here].ravel())[:, :2].reshape(*at[here].shape, 2)
    place[..., 0] += (strands.column[used] * cloth.size[0])[:, None, None]
    centre, node = place[:, :, 0], place[:, :, 3:]
    tangent = place[:, :, 2] - place[:, :, 1]
    tangent /= np.linalg.norm(tangent, axis=2)[:, :, None]

    # edges from the clamp inwards, and turned so that they run along the wire at both ends
    edge = np.diff(np.concatenate([centre[:, :, None], node[:, :, 2:]], axis=2), axis=2) * inward[:, None, None]
    length = np.linalg.norm(edge, axis=3)
    turn = np.stack([_turn(tangent, edge[:, :, 0], inward), _turn(edge[:, :, 0], edge[:, :, 1], inward)], axis=2)
    first_arc = np.abs(node_arc[..., 2] - arc)
    hinge = np.stack([0.5 * first_arc, 0.5 * (first_arc + spacing[:, None])], axis=2)
    # table entries [wire, end, hinge] of the two nodes
    entry = np.mod(begin[:, None, None] + local[:, :, 1:3], table.nodes[thread][:, None, None])
    entry += table.start[thread][:, None, None]
    in_table = table.rest_turn[entry]
    numbers = np.zeros((len(used), 2, clamp.CLAMP_NUMBERS))
    lever = centre - node[:, :, 1]
    numbers[..., [clamp.LEVER_X, clamp.LEVER_Y]] = -lever * inward[:, None]
    numbers[..., [clamp.TANGENT_X, clamp.TANGENT_Y]] = tangent
    numbers[..., clamp.LENGTH] = length[..., 0]
    numbers[..., [clamp.ANGLE, clamp.NEXT_ANGLE]] = set_fraction * turn
    numbers[..., [clamp.HINGE, clamp.NEXT_HINGE]] = table.hinge_length[entry] / hinge
    own = (length[..., :1] / hinge) ** 2
    beyond = (length[..., 1] / hinge[..., 1]) ** 2
    numbers[..., [clamp.BOW_WEIGHT, clamp.NEXT_BOW_WEIGHT]] = own - 1.0
    numbers[..., clamp.BEYOND_BOW_WEIGHT] = beyond - 1.0
    numbers[..., clamp.BOW_CHANGE] = BOW * (own * turn**2 - in_table**2).sum(axis=2)
    numbers[..., clamp.NEXT_BOW_CHANGE] = BOW * (beyond * turn[..., 1] ** 2 - in_table[..., 1] ** 2)
    held = (first[:, None, None] + np.sort(local[:, :, :2], axis=2)).reshape(-1)
    held_place = np.where((inward < 0)[:, None, None], node[:, :, 1::-1], node[:, :, :2])
    return Grips(
        node=held,
        lever=(held_place - centre[:, :, None]).reshape(-1, 2),
        position=centre.reshape(-1, 2),
        numbers=numbers,
    )


def _turn(a: np.ndarray, b: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Turning angle [wire, end] [rad] from edge a to b (wire, end, 2) at the near end; from b to a at the far one."""
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.arctan2(inward * cross, np.sum(a * b, axis=-1))
