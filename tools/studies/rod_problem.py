"""A problem of clamped rods for several codes: a hook of two wires, or one overhand knot. Imports NumPy only.

Yade runs in a Python of its own, without warpknit, and reads a problem from a file (yade_rods.py). Lengths are over the diameter
d of the rod, forces over B/d^2 with the bending stiffness B, masses over rho A d: B = d = rho A = 1, EA = 16 B/d^2, GJ = B/1.3
(a round rod, Poisson's ratio 0.3), so the time unit is d^2 sqrt(rho A/B).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

RADIUS = 0.5
AXIAL, BENDING, POISSON = 16.0, 1.0, 0.3
YOUNGS_MODULUS = 64.0 / np.pi
DENSITY = 4.0 / np.pi
NEAR = 1e-2  # of a segment, over which tangents are taken


@dataclass(frozen=True)
class Problem:
    """Centre lines between clamps, motion of their ends, and settings of dynamic codes."""

    lines: np.ndarray  # (wire, point, 3) [d] dense, from clamp to clamp, with one clamp segment beyond each
    beyond: float  # [d] arc of a line beyond each clamp
    straight: bool  # natural shape: straight, or as placed
    guided: np.ndarray  # (wire, end) bool: free along y, its direction kept
    move: np.ndarray  # (wire, end, 3) [d] displacement of ends at the last level
    levels: int  # of equal displacement; each is a ramp, then a hold
    relaxes: bool  # whether a level without displacement comes first
    segments: int  # of a wire between its clamps
    level_time: float  # of a level; one half is the ramp
    time_step: float
    damping: float  # PyElastica: rate at which velocities fall; Yade: share of local damping
    stiffness: float  # [B/d^3] of contact

    def save(self, path: Path) -> None:
        np.savez(path, **asdict(self))

    @property
    def length(self) -> float:
        """[d] of a wire between its clamps."""
        return float(arcs(self.lines[0])[-1]) - 2.0 * self.beyond

    def nodes(self, wire: int, straddle: bool) -> np.ndarray:
        """(node, 3) [d] equally spaced: at the clamps, or half a segment before and behind them."""
        step = self.length / self.segments
        along = self.beyond + (np.arange(self.segments + 2) - 0.5 if straddle else np.arange(self.segments + 1)) * step
        arc = arcs(self.lines[wire])
        return np.stack([np.interp(along, arc, x) for x in self.lines[wire].T], axis=1)

    def tangents(self, wire: int) -> np.ndarray:
        """Unit vectors (node, 3) along a line at nodes: at the clamps and equally spaced between."""
        step = self.length / self.segments
        along = self.beyond + np.arange(self.segments + 1) * step
        arc, near = arcs(self.lines[wire]), NEAR * step
        chord = np.stack([np.interp(along + near, arc, x) - np.interp(along - near, arc, x) for x in self.lines[wire].T], axis=1)
        return chord / np.linalg.norm(chord, axis=1)[:, None]

    def levels_at(self) -> list[float]:
        """Shares of the displacement at the end of each level."""
        shares = [k / self.levels for k in range(1, self.levels + 1)]
        return [0.0, *shares] if self.relaxes else shares


def load(path: Path) -> Problem:
    with np.load(path) as given:
        found = {field.name: given[field.name] for field in fields(Problem)}
    kinds = {"beyond": float, "straight": bool, "levels": int, "relaxes": bool, "segments": int, "level_time": float,
             "time_step": float, "damping": float, "stiffness": float}  # fmt: skip
    return Problem(**{name: kinds[name](value) if name in kinds else value for name, value in found.items()})


def arcs(line: np.ndarray) -> np.ndarray:
    """[point] [d] arc length along a line (point, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def frames(points: np.ndarray) -> np.ndarray:
    """Normal, binormal, tangent (segment, 3, 3) as rows of segments between points, without twist."""
    tangent = np.diff(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    found = []
    for k, t in enumerate(tangent):
        if k:
            axis, cos = np.cross(tangent[k - 1], t), tangent[k - 1] @ t
            normal = cos * normal + np.cross(axis, normal) + axis * (axis @ normal) / (1.0 + cos)
        normal = normal - t * (normal @ t)
        normal = normal / np.linalg.norm(normal)
        found.append([normal, np.cross(t, normal), t])
    return np.array(found)
