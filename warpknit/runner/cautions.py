"""Warnings about the input: implausible constants, fast loads, few nodes, large friction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np

from .. import measure
from ..base.text import celsius, engineering, exact, percent
from ..knit.cloth import Cloth
from ..knit.straight_wires import least_length
from ..measure import MeshModel
from ..mechanics.numerics import FOLLOWED_INCREMENT, few_nodes
from ..mesh.layout import smaller_scene
from ..mesh.tight_loops import is_tight
from ..results.finding import ResultWarning
from ..results.row import Row
from ..scene import Scene, Stage
from ..scene.materials import MATERIALS
from .strength import limit_text

METAL_STIFFNESS = (10e9, 600e9)  # [Pa] Young's modulus, from lead to osmium
METAL_DENSITY = (500.0, 23e3)  # [kg/m3] from lithium to osmium
METAL_FRICTION = (0.0, 2.0)  # coefficients of clean metals in vacuum may exceed 1
FRAGMENT_SHARE = 0.1  # of the wire: more in pieces of less than a loop is reported
BARE_KELVIN = 100.0  # [K] a colder temperature without a unit was probably meant in degrees Celsius
CONSTANTS_HOLD = (70.0, 600.0)  # [K] range in which moduli are within a few percent of those at 20 degC
QUASI_STATIC = 0.1  # largest kinetic over stored energy of a quasi-static ramp
BEYOND_ERROR = 1.01  # least length of wire over the longest one, beyond the error of its minimum
FULLY_PLASTIC = 16.0 / (3.0 * math.pi)  # moment of a round section that yields throughout, over first yield


def scene_cautions(scene: Scene, cloth: Cloth | None) -> Iterator[ResultWarning]:
    """Warnings that need no result, one line each. cloth: of the scene, None of a hook or of wires from a file."""
    if scene.is_empty:
        yield ResultWarning("W21", "The scene file is empty.")
    if scene.even_chains:
        yield ResultWarning("W22", f"Chains in even numbers count half needles: {', '.join(scene.even_chains)}.")
    for first, second in combinations(range(len(scene.knit.bars)), 2):
        if scene.knit.bars[first] == scene.knit.bars[second]:
            yield ResultWarning("W23", f"knit.bars[{first}] and knit.bars[{second}] are the same: every loop has both wires.")
    yield from _about_constants(scene)
    if scene.hook is None and scene.sweep is None and not any(_is_loaded(scene, stage) for stage in scene.stages):
        yield ResultWarning("W24", "No load is given.")
    if cloth is not None:
        yield from few_nodes(scene.model.nodes_per_loop)
        yield from _beyond_wires(scene, cloth, scene.stages)
        if scene.model.of_kind.has_branches and not scene.depends_on_path and smaller_scene(scene) is None:
            yield from _about_increments(scene)


def cut_cautions(model: MeshModel) -> Iterator[ResultWarning]:
    """Warning on a patch with much wire in pieces of less than a loop. Grips hold them at both ends."""
    length, is_short = model.panel.wire_length, measure.short_wires(model)
    share = float(length[is_short].sum() / max(length.sum(), 1e-300))
    if share >= FRAGMENT_SHARE:
        pieces = f"{np.count_nonzero(is_short)} of {len(length)} wires"
        text = f"{pieces} ({percent(share, 0)} of the wire length) are shorter than a loop."
        yield ResultWarning("W20", text)


def release_cautions(scene: Scene, cloth: Cloth | None) -> Iterator[ResultWarning]:
    """Warning where no wire of this strength holds the loops against its natural curvature.

    The wire keeps its turns, so its moment is EI (1 - set_fraction) times its mean curvature on average.
    """
    wire = scene.wire
    if cloth is None or wire.plastic or wire.set_fraction == 1.0:
        return
    bent = wire.youngs_modulus * wire.radius * cloth.mean_curvature  # [Pa] nominal stress of the straight wire bent to the loops
    needed, held = (1.0 - wire.set_fraction) * bent, FULLY_PLASTIC * wire.tensile_strength
    if needed > held:
        least = 1.0 - FULLY_PLASTIC * wire.yield_stress / bent
        yield ResultWarning(
            "W36",
            f"wire.set_fraction = {wire.set_fraction:g} needs a bending stress of {engineering(needed, 'Pa')} in the loops;"
            f" a wire with a {limit_text(scene, 'tensile_strength')} holds {engineering(held, 'Pa')}.",
            f"Set wire.set_fraction = {math.ceil(100.0 * least) / 100.0:g} or more.",
        )


def _is_loaded(scene: Scene, stage: Stage) -> bool:
    strained = any((stage.strain_weft, stage.strain_warp, stage.shear, stage.clamp_rotation, stage.pull))
    pulled = stage.tension_weft is not None or stage.tension_warp is not None
    heated = stage.temperature != scene.wire.reference_temperature or any(stage.temperature_gradient)
    return strained or pulled or heated


def sweep_cautions(scene: Scene, cloth: Cloth | None) -> Iterator[ResultWarning]:
    """Warnings about the largest loads of a sweep, one line each; none without one."""
    if cloth is not None and scene.sweep is not None:
        yield from _beyond_wires(scene, cloth, [scene.sweep.stage(scene.stages[0], scene.sweep.pairs[-1])])


def _beyond_wires(scene: Scene, cloth: Cloth, loads: Sequence[Stage]) -> Iterator[ResultWarning]:
    """Tensions and strains that no arrangement of wires below their limits carries or reaches.

    The sum of both tensions is the mean axial force of the wires times their length in an area, which extension makes smaller.
    The bound of strains is for points of hooking; between two of them a wire is shorter by its thickness at most. A direction
    under a given tension may contract to any length.
    """
    wire = scene.wire
    radius = wire.radius + (0.0 if wire.plating is None else wire.plating.thickness)
    most = wire.yield_stress * wire.ends * math.pi * radius**2 * cloth.wire_per_area
    largest = max((load.tension_weft or 0.0) + (load.tension_warp or 0.0) for load in loads)
    if largest > most:
        limit, carried, given = engineering(wire.yield_stress, "Pa"), engineering(most, "N/m"), engineering(largest, "N/m")
        text = f"The tensions of weft and warp add up to {given}; straight wires at their elastic limit of {limit} carry"
        yield ResultWarning("W26", f"{text} {carried}.")

    laid = cloth.wire_length * len(cloth.stitches)
    longest = laid * (1.0 + wire.tensile_strength / wire.youngs_modulus) + 2 * len(cloth.clasps) * wire.thickness
    most = BEYOND_ERROR * longest
    for load in loads:
        weft, warp = (0.0 if strain is None else 1.0 + strain for strain in (load.strain_weft, load.strain_warp))
        shear = load.shear if weft and warp else 0.0
        needed = least_length(cloth, np.array([[weft, shear], [0.0, warp]]), enough=most)
        if needed > most:
            text = f"The strain of {load.name!r} needs wires {needed / longest:.3g} times as long as straight wires at break."
            yield ResultWarning("W27", text)
            return


def _about_constants(scene: Scene) -> Iterator[ResultWarning]:
    wire = scene.wire
    for name, value, unit, (low, high) in (
        ("wire.youngs_modulus", wire.youngs_modulus, "Pa", METAL_STIFFNESS),
        ("wire.density", wire.density, "kg/m^3", METAL_DENSITY),
        ("contact.friction", scene.contact.friction, "", METAL_FRICTION),
    ):
        if not low <= value <= high:
            metals = f"{exact(low, unit)} to {exact(high, unit)}"
            yield ResultWarning("W28", f"{name} = {exact(value, unit)} is outside the range of metals ({metals}).")
    temperatures = [wire.reference_temperature, *(stage.temperature for stage in scene.stages)]
    for bare in sorted({temperature for temperature in scene.bare_temperatures if temperature < BARE_KELVIN}):
        text = f"A temperature without a unit is in kelvin: {bare:g} is {celsius(bare)}."
        yield ResultWarning("W29", text, f"Write '{bare:g} degC' or '{bare:g} K'.")
    hottest, melting = max(temperatures), MATERIALS[wire.material].melting if wire.material in MATERIALS else float("inf")
    if hottest > melting:
        text = f"{wire.material.capitalize()} melts at {celsius(melting)}, below the given {celsius(hottest)}."
        yield ResultWarning("W30", text)
    for temperature in (min(temperatures), hottest):
        if not CONSTANTS_HOLD[0] <= temperature <= CONSTANTS_HOLD[1]:
            text = f"Stiffness, expansion and strength are those at 20 degC, also at {celsius(temperature)}."
            yield ResultWarning("W31", text)


def _about_increments(scene: Scene) -> Iterator[ResultWarning]:
    strains = [np.zeros(2), *(np.array([stage.strain_weft or 0.0, stage.strain_warp or 0.0]) for stage in scene.stages)]
    largest, frames = max(float(np.abs(after - before).max()) for before, after in pairwise(strains)), scene.output.frames
    if not isinstance(frames, str) and largest > FOLLOWED_INCREMENT * frames * (1.0 + 1e-6) and is_tight(scene):
        text = f"Load increments of {percent(largest / frames)} may skip to another equilibrium of a tight knit."
        least = math.ceil(largest / FOLLOWED_INCREMENT - 1e-6)
        yield ResultWarning("W32", text, f"Set output.frames = {least:g} or more, or 'auto'.")


def ramp_cautions(rows: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warnings on a ramp that is not quasi-static."""
    if not rows[-1].steady and rows[-1].load_factor == 1.0:
        text = f"The ramp did not reach equilibrium (residual {rows[-1].residual:.2g}), so the result is not static."
        yield ResultWarning("W34", text)
    if (moving := rows[-1].kinetic_to_internal) > QUASI_STATIC:
        text = f"The load is too fast for a quasi-static result: kinetic energy reached {percent(moving, 0)} of the stored"
        yield ResultWarning("W35", f"{text} energy.")
