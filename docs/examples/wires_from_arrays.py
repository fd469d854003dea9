"""A plain weave drawn with NumPy, without a file: its tension and contacts under a strain of 0.1 %."""

import numpy as np

import warpknit
from warpknit import measure

DIAMETER, PITCH, COUNT = 100e-6, 1e-3, 3  # [m] of the wire, between wires; wires in weft and in warp

along = PITCH * np.linspace(-0.5, COUNT - 0.5, 121)  # [m] places of points
wires = []
for number in range(COUNT):
    across = np.full_like(along, number * PITCH)
    height = 0.51 * DIAMETER * np.cos(np.pi * (along / PITCH + number))  # over one wire, under the next
    wires.append(np.stack([along, across, height], axis=1))  # weft: x, y, z [m]
    wires.append(np.stack([across, along, -height], axis=1))  # warp

scene = warpknit.load_scene(
    {
        "wires": warpknit.wires_from_arrays(wires, node_spacing="50 um"),
        "wire": {"material": "molybdenum", "diameter": DIAMETER},
        "load": {"strain_weft": "0.1 %", "strain_warp": "0.1 %"},
        "solver": {"preset": "draft"},
        "output": {"frames": 2},
    }
)
print("load [%]   weft tension [N/m]   crossings in contact   largest contact force [N]")
for record in warpknit.Simulation(warpknit.build_model(scene)).run():
    state = record.observables
    print(
        f"{100 * record.load_factor:8.0f}{measure.mesh_tension(state)[0]:21.1f}"
        f"{measure.contacts(state).active_bodies:23d}{measure.largest_contact_force(state):28.3f}"
    )
