"""Checks of [reflection] of a scene."""

from __future__ import annotations

import numpy as np

from ..base.errors import InputError, MemoryNeeded
from ..base.text import at_least, engineering, exact, memory
from ..compute.memory import available_memory
from ..knit.cloth import knit_cloth
from ..mesh.layout import mesh_nodes
from ..scene import Scene
from ..scene.options import Reflection
from .impedance import surface_radius, yarn_radius
from .repeat import BRANCHES, LEAST
from .waves import Angles, first_lobe

BYTES = 200  # for each pair of half branches, at normal incidence


def options_of(scene: Scene) -> Reflection:
    """[reflection] of a scene.

    Raises InputError where it has none, for a branch length below a wire diameter, for frequencies with grating lobes, and
    MemoryNeeded for a mesh that is too large.
    """
    options = scene.reflection
    if options is None:
        raise InputError(f"{scene.path}: no [reflection]; give --set 'reflection.frequencies=[\"10 GHz\"]', or add the table")
    least = 2.0 * surface_radius(scene.wire)
    if options.branch_length is not None and options.branch_length < least:
        wrong = f"{exact(options.branch_length, 'm')} is below the wire diameter"
        raise InputError(f"{scene.path}: reflection.branch_length: {wrong}; write {at_least(least, 'm')} or more")
    refuse_lobes(scene, np.diag(np.asarray(scene.knit.size) * (1.0 + _largest_strains(scene))))
    (branches, needed), available = size_of(scene), available_memory()
    if needed > available:
        wrong = f"about {branches:,} branches of wire need {memory(needed)}, {memory(available)} are available"
        raise MemoryNeeded(f"{scene.path}: reflection: {wrong}; write fewer knit.repeats, or a larger reflection.branch_length")
    return options


def _largest_strains(scene: Scene) -> np.ndarray:
    """(2,) largest strains in weft and warp that the scene prescribes, at least 0."""
    strains = [(stage.strain_weft or 0.0, stage.strain_warp or 0.0) for stage in scene.stages]
    if scene.sweep is not None and not scene.sweep.by_tension:
        strains += scene.sweep.pairs
    return np.max([(0.0, 0.0), *strains], axis=0)


def refuse_lobes(scene: Scene, cell: np.ndarray) -> None:
    """Raise InputError for frequencies with grating lobes; cell: periods (rows [m])."""
    options = scene.reflection
    assert options is not None
    limit, highest = first_lobe(cell, Angles(options.theta, options.phi)), max(options.frequencies)
    if highest >= limit:
        raise InputError(
            f"{scene.path}: reflection.frequencies: {engineering(highest, 'Hz')} is beyond the first grating lobe of a repeat, at"
            f" {engineering(limit, 'Hz', 4)}; write lower frequencies, or fewer knit.repeats"
        )


def branch_length(scene: Scene) -> float:
    """[m] longest branch."""
    assert scene.reflection is not None
    if scene.reflection.branch_length is not None:
        return scene.reflection.branch_length
    return max(_loop_length(scene) / BRANCHES, LEAST * yarn_radius(scene.wire))


def _loop_length(scene: Scene) -> float:
    """[m] of wire a loop."""
    return knit_cloth(scene.knit.even, scene.wire.thickness, scene.model.merge_lenses).wire_length


def size_of(scene: Scene) -> tuple[int, int]:
    """Estimated branches of wire in the equation of one state, and its memory [bytes]."""
    assert scene.reflection is not None
    loops = mesh_nodes(scene) / scene.model.nodes_per_loop
    branches = round(loops * _loop_length(scene) / branch_length(scene))
    return branches, BYTES * (2 * branches) ** 2 * (2 if scene.reflection.theta else 1)
