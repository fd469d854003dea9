"""Knits in the plane under small changes of strain: without friction and yield their tension is the derivative of an energy.

P = dW/dF of the equilibria, so that dP_weft/d(warp strain) = dP_warp/d(weft strain), whatever touches and slides on the way. Both
fail by per cent where a force of the model, its share in the measured tension, or an equilibrium is wrong.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from experiment import SAMPLES, scene_of

from warpknit import measure
from warpknit.knit.named import named_knit
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

STEP = 2e-3  # strain
AXIAL_ERROR = 2e-5  # strain of the arcs within which the lengths of wires are kept
TIGHT = "reverse locknit, 4 x 17 um"
STRAINS = {"double-atlas": (0.13, 0.13), "atlas": (0.1, 0.1), "tricot": (0.08, 0.08), TIGHT: (0.1045, 0.1101)}  # contacts carry


def scene(knit: str) -> Scene:
    """One repeat at residual tolerance 1e-4; the tight mesh is that of the experiment, strained as under 3.4 N/m."""
    if knit == TIGHT:
        mesh = SAMPLES[1]
        return scene_of(mesh, "planar", mesh.spacings["base"], {"solver.residual_tolerance": 1e-4}, (3.4,))
    named = named_knit(knit)
    return make_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "30 um"},
            "knit": {
                "bars": [{"chain": bar.chain, "threading": bar.threading, "shift": bar.shift} for bar in named.bars],
                "wale_spacing": 25.4e-3 / named.wales,
                "course_spacing": 25.4e-3 / named.courses,
            },
            "model": {"kind": "planar", "boundary": "periodic"},
            "load": {"strain_weft": 0.0},
            "solver": {"preset": "draft", "residual_tolerance": 1e-4, "precision": "double"},
            "output": {"frames": 1},
        }
    )


@cache
def around(knit: str) -> tuple[np.ndarray, np.ndarray]:
    """Nominal tensions (5, 2) [N/m] and energy [5] [J/m2] at the strain, by STEP more and less of weft, and of warp."""
    there = np.array(STRAINS[knit])
    strains = [share * there for share in (0.25, 0.5, 0.75, 1.0)]
    strains += [there + STEP * np.array(way) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    stages = [{"strain_weft": float(weft), "strain_warp": float(warp)} for weft, warp in strains]
    records = Simulation(build_model(scene(knit).changed({"load": stages[0], "path": stages[1:]}))).run()
    states = [record.observables for record in records if record.load_factor == 1.0][3:]
    touching = np.stack([measure.pair_active(state) for state in states])
    assert touching[0].any() and (touching == touching[0]).all()  # else the tangent has a kink
    area = states[0].model.panel.area
    stress, energy = map(np.array, zip(*((np.diag(s.nominal_stress), s.energies.stored) for s in states), strict=True))
    return stress, energy / area


@pytest.mark.parametrize("knit", STRAINS)
def test_the_tangent_is_symmetric(knit: str) -> None:
    """By central differences; two tensions of a difference are each within 1e-4, which is 1e-4 N/m / (2 STEP) of a stiffness."""
    stress, _ = around(knit)
    tangent = np.stack([stress[1] - stress[2], stress[3] - stress[4]], axis=1) / (2.0 * STEP)
    assert tangent[0, 1] == pytest.approx(tangent[1, 0], rel=0.005, abs=1e-4 * stress[0].max() / (2.0 * STEP))


@pytest.mark.parametrize("knit", STRAINS)
def test_tension_is_the_derivative_of_the_energy(knit: str) -> None:
    """Simpson's rule over both steps. The energy lacks what arcs strain within their tolerance, at most its share of the step."""
    stress, energy = around(knit)
    for side in (0, 1):
        more, less = 1 + 2 * side, 2 + 2 * side
        work = (stress[less, side] + 4.0 * stress[0, side] + stress[more, side]) * 2.0 * STEP / 6.0
        assert energy[more] - energy[less] == pytest.approx(work, rel=AXIAL_ERROR / STEP)
