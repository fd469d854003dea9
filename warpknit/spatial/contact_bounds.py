"""Bounds on the stiffness of the contacts, for the masses: the weights of the nodes change until their next update."""

from __future__ import annotations

import numpy as np

from .contacts import Contacts
from .rest_curve import RestCurve
from .rods import Rods

WEIGHT_SUM = 0.25  # sum of the sizes of the weights of a wire, beyond 1, over those of the outer edges in the slopes
MORE_TILT = 0.1  # allowance for the components of the normal; more between wires that do not touch
LEAST_WEIGHT, BEYOND_WEIGHT = 0.5, 0.16  # of the nodes of the segment, at least; of the nodes beyond, over that of their edge


def stiffness_bounds(
    near: Contacts, rods: Rods, curve: RestCurve, penalty: np.ndarray, sticking: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds on the stiffness of contacts: of nodes (node, 3) [N/m] along x, y, z, and of sections [node] [N m].

    near: contacts that touch or may do so. penalty: [node] [N/m] of its segment. sticking [N/m]: tangential stiffness.
    """
    thickness, nodes = rods.section.thickness, rods.node_count
    after, before = rods.following, rods.previous
    own = np.maximum(penalty, penalty[after])
    stiffness = curve.weight_square * np.maximum(own[near.first], own[near.second])
    tilt = MORE_TILT + np.maximum(-near.overlap, 0.0) / thickness
    along = np.abs(near.normal) + tilt[:, None]
    outer = curve.slope_weight[:, [0, 3]]
    total = 2.0 + WEIGHT_SUM * (outer[near.first] + outer[near.second]).sum(axis=1)
    bound = total[:, None] * ((stiffness * along.sum(axis=1))[:, None] * along + sticking)
    there, weights, arms, sections, levers = [], [], [], [], []
    for node, s in ((near.first, near.place[:, 0]), (near.second, near.place[:, 1])):
        beyond = BEYOND_WEIGHT * outer[node].T
        there += [before[node], node, after[node], after[after[node]]]
        weights += [beyond[0], np.maximum(1.0 - s, LEAST_WEIGHT), np.maximum(s, LEAST_WEIGHT), beyond[1]]
        arms += 4 * [sticking * (thickness / rods.natural_length[node]) ** 2]  # tilting segments
        sections += [before[node], node, after[node]]
        levers += 3 * [stiffness * curve.lever**2 + sticking * 0.25 * thickness**2]
    sums = np.concatenate(weights)[:, None] * np.tile(bound, (8, 1)) + np.concatenate(arms)[:, None]
    node_bound = np.stack([_sum_at(np.concatenate(there), sums[:, k], nodes) for k in range(3)], axis=1)
    section_bound = _sum_at(np.concatenate(sections), np.concatenate(levers), nodes)
    return node_bound, section_bound


def _sum_at(node: np.ndarray, values: np.ndarray, nodes: int) -> np.ndarray:
    """[node] sums of the values at their nodes, of which -1 does not exist."""
    return np.bincount(node + 1, values, nodes + 1)[1:]
