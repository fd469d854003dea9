"""Multipliers of contacts between wires (warpknit/spatial/multipliers.py)."""

from __future__ import annotations

import numpy as np
import pytest

from warpknit import Simulation, build_model, load_scene
from warpknit.compute.host import fetch, store
from warpknit.kernels.contact_checks import PATIENCE
from warpknit.spatial.multipliers import OVERLAP_ERROR


@pytest.mark.parametrize("share", [0.3, 0.49, 0.51, 0.75, 1.5])
def test_penalties_are_raised_wherever_overlaps_that_stall_prevent_convergence(share: float) -> None:
    """Equal overlaps, a share of the allowed error: their rms decides on convergence below the error of a single one."""
    simulation = Simulation(
        build_model(
            load_scene({
                "wire": {"material": "molybdenum", "diameter": "30 um"},
                "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
                "model": {"kind": "spatial", "boundary": "periodic"},
                "contact": {"friction": 0.0},
                "variants": {"count": 1},
                "load": {"strain_weft": 0.06, "strain_warp": 0.06},
                "solver": {"preset": "draft", "precision": "double"},
                "output": {"frames": 1},
            })
        )
    )  # fmt: skip
    list(simulation.run())
    group, row = simulation.mechanics.group, np.array([0])
    contact, multipliers = group.contact, group.multipliers
    group.stepper.evaluate(0.0, rows=row)
    pushes = fetch(contact.touch.touch_normal_force) > 0.0
    assert pushes.any()
    multipliers.stiffen(row)
    for _ in range(int(PATIENCE) + 1):
        store(contact.touch.touch_normal_force, 1e-4 * pushes)
        store(contact.touch.touch_overlap, share * OVERLAP_ERROR * contact.stepper.rods.section.thickness * pushes)
        sums = contact.sums(row)
        multipliers.renew(sums, np.zeros(1), row, loading=np.array([False]))
    is_raised = bool((multipliers.raised > 1.0).any())
    assert is_raised == bool(multipliers.error_ratio(sums)[0] > 1.0)
    assert is_raised == (share > 0.5)
