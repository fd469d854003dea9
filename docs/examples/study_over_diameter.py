"""A study over wire diameter: contacts and wire stress of a tile of tricot. The tensions of a diameter run side by side."""

import warpknit
from warpknit import measure

TENSIONS = [0.5, 1.0, 2.0]  # [N/m] in weft and warp
TRICOT = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]

tile = warpknit.load_scene(
    {
        "wire": {"material": "molybdenum"},
        "knit": {"bars": TRICOT, "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic"},
        "load": {"tension_weft": 1.0, "tension_warp": 1.0},
        "solver": {"preset": "draft"},
        "output": {"frames": 4},  # fewer increments of the load may skip to another equilibrium
    }
)
print("     diameter   tension [N/m]   active contacts [%]   largest stress [MPa]")
for diameter in ("20 um", "25 um", "30 um"):
    scene = tile.changed({"wire.diameter": diameter})
    worlds = [scene.changed({"load.tension_weft": tension, "load.tension_warp": tension}) for tension in TENSIONS]
    simulation = warpknit.Simulation(warpknit.build_model(scene), worlds=worlds)
    last = {record.world: record.observables for record in simulation.run()}  # the state at the full load of each world
    for world, tension in enumerate(TENSIONS):
        active = measure.contacts(last[world]).active_percent
        stress = measure.largest_stress(last[world]) / 1e6
        print(f"{diameter:>13}{tension:16.1f}{active:22.0f}{stress:23.0f}")
