"""Centre lines of knots and clasps, and scenes that hold their ends and pull."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpknit.scene import Scene, make_scene

DIAMETER = 1e-3  # [m]; only ratios to it count
YOUNGS_MODULUS = 1e9  # [Pa] does not count either
LOOP_SIZE = 12.0  # diameters: sets the penalty of contact in the relaxation
APART = 1.1  # distance of the strands over the diameter at first


def overhand(turns: int, radius: float, tail: float) -> np.ndarray:
    """Points (m, 3) [d] along a loose overhand knot; loop radius and length of the tails [d].

    Tail, strand of the braid, loop, other strand, tail: two strands wind round each other by 2 turns + 1 half-turns along x.
    """
    half_turns, a = 2 * turns + 1, 0.5 * APART
    length = 0.5 * (turns + 1) * half_turns * np.sqrt(radius)
    x = np.linspace(-0.5 * length, 0.5 * length, 60 * half_turns)
    angle = half_turns * np.pi * (x / length + 0.5) - 0.5 * np.pi
    up, side = a * np.sin(angle), a * np.cos(angle)
    t = np.linspace(0.0, 1.0, 400)[1:-1]
    loop = [length * (0.5 - t) + radius * np.sin(2 * np.pi * t), a + radius * (1.0 - np.cos(2 * np.pi * t)), 0 * t]
    along = np.linspace(0.0, tail, 80)
    left = [along[:-1] - tail - 0.5 * length, np.full(79, -a), np.zeros(79)]
    right = [along[1:] + 0.5 * length, np.full(79, -a), np.zeros(79)]
    parts = (left, [x, up, side], loop, [x, -up, -side], right)
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def clasp(arm: float, bend: float = 1.0) -> list[np.ndarray]:
    """Points (m, 3) [d] of two hooked wires: one in xy with its arms towards -x, one in xz with its arms towards x.

    arm: length of the straight arms; bend: radius of both turns. The inner sides of the turns face each other at the origin.
    """
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 60)
    straight = np.linspace(0.0, arm, 40)[1:]
    centre = 0.5 * APART - bend  # of the turn of the first wire
    along = np.concatenate([centre - straight[::-1], centre + bend * np.cos(angle), centre - straight])
    across = np.concatenate([np.full(39, -bend), bend * np.sin(angle), np.full(39, bend)])
    zero = np.zeros(len(along))
    return [np.stack([along, across, zero], axis=1), np.stack([-along, zero, across], axis=1)]


def pulled(
    folder: Path,
    wires: Sequence[np.ndarray],
    *,
    spacing: float,
    friction: float,
    strains: Sequence[float],
    levels: int,
    tolerance: float,
    diameter: float = 1.0,
    shear: float = 0.0,
    penalty: float | None = None,
) -> Scene:
    """Scene of wires (m, 3) [d], straight without load, with ends pulled along x. The ends are clamped and moved apart by strains
    of their distance.

    The strains follow each other as stages of `levels` levels each, and then the shear. diameter [d]: of the wire of the scene.
    penalty [B/d^3]: of contact; too soft a one lets wires pass through each other in level 0, which relaxes the shape.
    """
    np.savez(folder / "wires.npz", *(DIAMETER * points for points in wires))
    table: dict[str, Any] = {
        "wires": {"file": "wires.npz", "unit": "m", "node_spacing": spacing * DIAMETER, "loop_size": LOOP_SIZE * DIAMETER},
        "wire": {"diameter": diameter * DIAMETER, "set_fraction": 0.0, "youngs_modulus": YOUNGS_MODULUS, "poissons_ratio": 0.3},
        "model": {"kind": "spatial"},
        "contact": {"friction": friction},
        "load": {"strain_weft": strains[0], "strain_warp": 0.0},
        "path": [{"strain_weft": strain} for strain in strains[1:]],
        "solver": {"residual_tolerance": tolerance},
        "output": {"frames": levels},
    }
    if penalty is not None:
        table["contact"]["stiffness"] = penalty * YOUNGS_MODULUS * np.pi / 64.0 * (diameter * DIAMETER) ** 4 / DIAMETER**3
    if shear:
        table["path"].append({"shear": shear})
    if not table["path"]:
        del table["path"]
    return make_scene(table, path=folder / "scene.toml")
