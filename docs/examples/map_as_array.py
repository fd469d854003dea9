"""A contact map as an array: the share of active contacts over strains in weft and warp."""

import numpy as np

import warpknit

strains = [0.04, 0.08, 0.12]
scene = warpknit.load_scene(
    "atlas_cell",  # a scene that ships with warpknit
    {"sweep.strain_weft": strains, "sweep.strain_warp": strains},
    preset="draft",
)
run = warpknit.run_map(scene, "runs/map", quiet=True, force=True)

table = run.tables["map"]
active = table.grid("active_percent", "strain_warp", "strain_weft")  # (warp, weft) [%]
tension = table.grid("tension_weft_N_per_m", "strain_warp", "strain_weft")  # (warp, weft) [N/m]

print(f"active contacts [%]: strain in weft {strains} across, in warp downwards")
print(np.array2string(active, precision=0))
print(f"largest weft tension: {1e3 * tension.max():.1f} mN/m")
warp, weft = np.unravel_index(np.nanargmax(active), active.shape)
print(f"most contacts: {active[warp, weft]:.0f} % at {100 * strains[weft]:.0f} % weft and {100 * strains[warp]:.0f} % warp")
