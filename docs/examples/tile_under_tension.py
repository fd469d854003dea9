"""A tile of tricot under tension: strain, active contacts and wire stress up to 2 N/m in weft and warp."""

import warpknit

TRICOT = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]  # two guide bars, back to front

scene = warpknit.load_scene(
    {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": TRICOT, "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic"},  # a tile of an endless mesh
        "load": {"tension_weft": "2 N/m", "tension_warp": "2 N/m"},
        "solver": {"preset": "draft"},
        "variants": {"count": 1},  # without it: the mean of up to 16 meshes of scattered loops
        "output": {"frames": 4},
    }
)
run = warpknit.run(scene, "runs/tile", quiet=True, force=True)

history = run.history
print("tension [N/m]   strain weft, warp [%]   active contacts [%]   largest stress [MPa]")
for level in range(history.rows):
    print(
        f"{history['tension_weft_N_per_m'][level]:13.2f}"
        f"{100 * history['strain_weft'][level]:13.2f}{100 * history['strain_warp'][level]:11.2f}"
        f"{history['active_percent'][level]:22.0f}"
        f"{history['stress_max_Pa'][level] / 1e6:23.0f}"
    )
print(f"pictures and tables: {run.directory}")
