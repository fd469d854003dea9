"""Scenes of accuracy.py: of its presets, planar and spatial, and of its estimates."""

from __future__ import annotations

TRICOT = '[{chain = "1-0/1-2"}, {chain = "2-3/1-0"}]'
MOLYBDENUM = ('wire.material="molybdenum"', 'wire.diameter="30 um"')
LOOPS = ("knit.loop.closed_radius=0.55", "knit.loop.open_half_width=0.3")
FULL_ATLAS = 'knit.bars=[{chain = "1-0/1-2/2-3/2-1"}, {chain = "2-3/2-1/1-0/1-2"}]'
STRAINS = (0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.25)
TIGHT_KNITS = {
    "closed tricot of two bars": '[{chain = "1-0/1-2"}, {chain = "1-2/1-0"}]',
    "locknit": TRICOT,
}
JAMMED_KNITS = {  # of thick wire at 26 wales and 30 courses an inch
    **TIGHT_KNITS,
    "single atlas": '[{chain = "1-0/1-2/2-3/2-1"}]',
    "reverse locknit": '[{chain = "2-3/1-0"}, {chain = "1-0/1-2"}]',
}


def both(weft: float, warp: float) -> tuple[str, str]:
    return f"load.strain_weft={weft}", f"load.strain_warp={warp}"


# --- presets


def scenes() -> dict[str, tuple[str, tuple[str, ...]]]:
    """The scenes by name: file and overrides."""
    cell: dict[str, tuple[str, ...]] = {f"cell {100 * e:g} %": both(e, e) for e in STRAINS}
    tension = both(0.15, 0.15)
    cell |= {
        "cell 20 / 8 %": both(0.2, 0.08),
        "cell 8 / 20 %": both(0.08, 0.2),
        "cell 15 %, lenses unmerged": (*tension, "model.merge_lenses=false"),
        "cell 12 %, friction 0.1": (*both(0.12, 0.12), "contact.friction=0.1"),
        "cell 12 %, friction 0.3": (*both(0.12, 0.12), "contact.friction=0.3"),
        "cell 15 %, 30 um": (*tension, 'wire.diameter="30 um"'),
        "locknit 10 %": (f"knit.bars={TRICOT}", *both(0.1, 0.1)),
        "locknit 5 %": (f"knit.bars={TRICOT}", *both(0.05, 0.05)),
        "cord 10 %": ('knit.bars=[{chain = "1-0/2-3"}]', *both(0.1, 0.1)),
        "closed tricot 10 %": ('knit.bars=[{chain = "1-0/1-2"}]', *both(0.1, 0.1)),
    }
    found = {name: ("atlas_cell.toml", overrides) for name, overrides in cell.items()}
    once = "output.frames=1"
    found["hook"] = ("hook_free_body.toml", ())
    found["hook, half as far"] = ("hook_free_body.toml", ('load.displacement="0.4 mm"',))
    found["patch 2 x 2, 10 %"] = ("atlas_patch.toml", ("knit.repeats=[2, 2]", once))
    found["patch 4 x 4, 10 %"] = ("atlas_patch.toml", ("knit.repeats=[4, 4]", once))
    found["patch 7 x 6, 10 %"] = ("atlas_patch.toml", (once,))
    return found


def scenes_in_space() -> dict[str, tuple[str, ...]]:
    """The same for spatial tiles: overrides by name."""
    left_out = ("friction", "unmerged")  # states that depend on the path; lenses are of the plane
    found = {
        name: overrides
        for name, (_, overrides) in scenes().items()
        if name.startswith("cell") and not any(word in name for word in left_out)
    }
    for name, bars in TIGHT_KNITS.items():
        for e in (0.02, 0.05):
            found[f"{name} {100 * e:g} %"] = (f"knit.bars={bars}", "knit.repeats=[3, 2]", *both(e, e))
    tight = (*MOLYBDENUM, "knit.wale_spacing='0.98 mm'", "knit.course_spacing='0.85 mm'")
    for name, bars in JAMMED_KNITS.items():
        found[f"{name}, 30 um, 6 %"] = (f"knit.bars={bars}", *tight, *both(0.06, 0.06))
    return found


# --- the estimate of an error

CHECKED = {
    "cell 13 / 11 %": ("atlas_cell.toml", both(0.13, 0.11)),
    "cell 18 %, molybdenum 30 um": ("atlas_cell.toml", (*both(0.18, 0.18), *MOLYBDENUM)),
    "cell 18 / 4 %": ("atlas_cell.toml", both(0.18, 0.04)),
    "cell 14 %, other loops": ("atlas_cell.toml", (*both(0.14, 0.14), *LOOPS)),
    "cell 11 %, lenses unmerged": ("atlas_cell.toml", (*both(0.11, 0.11), "model.merge_lenses=false")),
    "tile of 3 x 2, 17 %": ("atlas_cell.toml", (*both(0.17, 0.17), "knit.repeats=[3, 2]")),
    "full double atlas 12 %": ("atlas_cell.toml", (*both(0.12, 0.12), FULL_ATLAS)),
    "locknit 7 %": ("atlas_cell.toml", (*both(0.07, 0.07), f"knit.bars={TRICOT}")),
    "patch 5 x 5, 12 %": ("atlas_patch.toml", (*both(0.12, 0.12), "knit.repeats=[5, 5]")),
    "hook, molybdenum": ("hook_free_body.toml", ('wire.material="molybdenum"', 'load.displacement="0.6 mm"')),
}  # fmt: skip
