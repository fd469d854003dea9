"""A measure and a force of one's own: the stiffness of a stretched patch of tricot against a force across it."""

import numpy as np

import warpknit
from warpknit import measure

FORCE, RADIUS = 1e-4, 0.5e-3  # [N] on the nodes within this distance [m] of the middle
TRICOT = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]

scene = warpknit.load_scene(
    {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": TRICOT, "wales": "26 /inch", "courses": "30 /inch", "repeats": [3, 3]},
        "model": {"kind": "spatial", "boundary": "gripped"},
        "load": {"strain_weft": "6 %", "strain_warp": "3 %"},
        "solver": {"preset": "draft"},
        "output": {"frames": 2},
    }
)
model = warpknit.build_model(scene)
place = model.global_model.rods.position  # (node, 3) [m] as knitted
middle = np.hypot(*(place - place.mean(axis=0))[:, :2].T) < RADIUS  # (node,)
force = np.zeros_like(place)  # (node, 3) [N]
force[middle, 2] = FORCE / middle.sum()


def height(record):
    """[m] mean height of the middle of the mesh."""
    return record.observables.node_position[middle, 2].mean()


free, pushed = warpknit.Simulation(model), warpknit.Simulation(model)
pushed.set_force(force)
print("strain weft [%]   weft tension [N/m]   deflection [um]   stiffness [N/m]")
for before, after in zip(free.run(), pushed.run(), strict=True):
    tension, deflection = measure.mesh_tension(before.observables)[0], height(after) - height(before)
    print(f"{6 * before.load_factor:15.1f}{abs(tension):21.2f}{1e6 * deflection:18.2f}{FORCE / deflection:18.1f}")
