"""Combinations of features that are excluded: the rules of the table of compatibilities (capabilities.py)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """A trait that excludes others."""

    trait: str  # whose key the message names
    others: tuple[str, ...]  # all of them together; the first gives the column of the table
    allowed: str  # of the message
    why: str  # reason, for the documents
    refused: bool = True  # else it has no effect

    @property
    def traits(self) -> frozenset[str]:
        return frozenset((self.trait, *self.others))


NOT_BUILT = "not implemented"
SPATIAL = "with model.kind = 'spatial'"
HOOK_LOADS = "only displacement and temperature with [hook]"
WIRE_LOADS = "strains, tensions, shear and temperature with [wires]"
NO_EDGE = "nothing with model.boundary = 'periodic', which has no edge"
NOT_IN_A_RAMP = "nothing with solver.drive = 'ramp'"
STRAINS_ONLY = "strains with friction or yield: a search for tension would be part of the load history"
ON_THE_PATH = "left out for maps and reports (its meshes are elastic, frictionless and uniformly strained)"
ENDS = "only the two upper ends of a hook move"
SIZE = "the size of the mesh is known only when the file is read"
SYMMETRY = "a periodic tile requires a uniform load"
ALONE = "a map strains its mesh uniformly"
REAL_TIME = "only with drive = 'ramp' (a relaxation has no real time)"
FICTITIOUS = "the masses of a relaxation are fictitious"
OWN_CONTACT = "in space wires touch each other directly: there are no bodies"

RULES = (
    # the mesh and its model
    Rule("planar", ("wires",), "'spatial' with [wires], whose wires are curves in space", "its wires are curves in space"),
    Rule("periodic", ("hook",), "'gripped' with [hook]: its ends are held", "its ends are held"),
    Rule("panel", ("hook",), "no [panel] with [hook]: its ends are where its wires end", "it ends where its wires end"),
    Rule("panel", ("wires",), "no [panel] with [wires]", "it ends where its wires end"),
    Rule("sweep", ("hook",), "no [sweep] with [hook]: it has no strains", "it has no strains"),
    Rule("sweep", ("wires",), "no [sweep] with [wires]", NOT_BUILT),
    Rule("ramp", ("wires",), "'relax' with [wires]", NOT_BUILT),
    Rule("file repeats", ("gripped",), "[1, 1] unless model.boundary = 'periodic'", "wires held at their ends do not repeat"),
    Rule(
        "crossing distance",
        ("planar",),
        "left out with model.kind = 'planar', where both wires lie in one plane",
        "both wires lie in one plane",
    ),
    Rule("seeds", ("even loops",), "1 without knit.scatter, as all seeds give the same mesh", "all seeds give the same mesh"),
    # contact
    Rule("treatment", ("spatial",), f"left out {SPATIAL}, whose wires touch each other themselves", OWN_CONTACT),
    Rule(
        "treatment",
        ("knit",),
        "'free-body' for a knit; the others are for the two wires of [hook]",
        "the others are for comparison on a single contact",
    ),
    Rule("body mass", ("spatial",), f"left out {SPATIAL}, whose wires touch each other themselves", OWN_CONTACT),
    Rule(
        "body mass",
        ("relax",),
        "only with solver.drive = 'ramp' (the masses of a relaxation are fictitious)",
        FICTITIOUS,
    ),
    Rule("body radius", ("spatial",), "as only the planar model has contact bodies", OWN_CONTACT, refused=False),
    Rule(
        "friction",
        ("treatment",),
        "0 unless contact.treatment = 'free-body'",
        "each treatment is studied without friction",
    ),
    # friction and yield
    Rule("friction", ("ramp",), "0 with solver.drive = 'ramp'", NOT_BUILT),
    Rule("plastic", ("ramp",), "false with solver.drive = 'ramp'", NOT_BUILT),
    Rule("hardening", ("elastic",), "as it applies only with wire.plastic = true", "the wire stays elastic", refused=False),
    Rule("poisson", ("planar",), "as wires do not twist in the plane", "wires do not twist in the plane", refused=False),
    Rule("seed", ("even loops",), "as it applies only with knit.scatter", "uniform loops need no seed", refused=False),
    # loads
    *(Rule(trait, ("hook",), HOOK_LOADS, ENDS) for trait in ("strain", "tension", "shear", "gradient", "pull", "rotation")),
    *(Rule(trait, ("wires",), WIRE_LOADS, SIZE) for trait in ("displacement", "gradient", "pull")),
    *(Rule(trait, ("periodic",), NO_EDGE, SYMMETRY) for trait in ("gradient", "pull", "rotation")),
    *(Rule(trait, ("ramp",), NOT_IN_A_RAMP, NOT_BUILT) for trait in ("gradient", "pull", "rotation", "cord")),
    Rule("rotation", ("cord",), "nothing with panel.cord, which holds the clamps", "the clamps hang on the cord"),
    Rule("rotation", ("spatial", "pull"), f"0 with pulls {SPATIAL}", NOT_BUILT),
    Rule("rotation and pull", (), "nothing together with a pull", "each of them moves the clamps"),
    Rule(
        "gradient",
        ("no multipliers",),
        "nothing with solver.multipliers = false: the multipliers apply it",
        "the multipliers apply it",
    ),
    *(
        Rule(load, (trait,), STRAINS_ONLY, "a search for tension would be part of the load history")
        for load in ("tension", "sweep by tension")
        for trait in ("friction", "plastic")
    ),
    Rule(
        "path",
        ("sweep",),
        "in `warpknit map` alone, which runs only [load]",
        "each strain of a map is loaded separately",
        refused=False,
    ),
    # the solver
    Rule("single", ("hook",), "'double' with [hook], which has few nodes", "double precision costs nothing with few nodes"),
    Rule("no multipliers", ("spatial",), f"true {SPATIAL}", NOT_BUILT),
    Rule("focal length", ("spatial",), f"left out {SPATIAL}", NOT_BUILT),
    Rule("target time step", ("relax",), REAL_TIME, FICTITIOUS),
    Rule("loading time", ("relax",), REAL_TIME, FICTITIOUS),
    Rule(
        "mass scaling",
        ("relax",),
        "1 with drive = 'relax' (its masses are fictitious), 1 or more with drive = 'ramp'",
        FICTITIOUS,
    ),
    Rule("damping", ("relax",), "as it applies only to a ramp", FICTITIOUS, refused=False),
    Rule("max steps", ("ramp",), "as it applies only to a relaxation", "a ramp ends when its time is over", refused=False),
    # rules for a whole table, after those for its keys
    Rule("periodic", ("panel",), "'gripped' with [panel]: a periodic tile has no outline", "a tile has no outline"),
    # commands
    Rule("wires", ("map",), "[knit] for maps and reports", NOT_BUILT),
    Rule("wires", ("trade",), "[knit] or [hook] for a trade", NOT_BUILT),
    Rule("wires", ("error",), "[knit] or [hook] with --error", "settings are tried on a smaller mesh, which requires a knit"),
    Rule("hook", ("map",), "[knit] for maps and reports", "it has no strains"),
    Rule("hook", ("ranks",), "[knit] for several ranks: run without mpirun", "two wires are too few for several ranks"),
    Rule(
        "no sweep",
        ("map",),
        "a table [sweep] of strains or of tensions, weft and warp, for `warpknit map`",
        "it defines the loads",
    ),
    Rule("ramp", ("map",), "'relax' for maps and reports", "a map consists of equilibria"),
    Rule("ramp", ("error",), "'relax' with --error", "errors are those of equilibria"),
    Rule("spatial", ("error", "hook"), "'planar' for a hook with --error", "its errors were not measured for hooks in space"),
    *(
        Rule(trait, ("spatial", "ranks"), f"{allowed} {SPATIAL} on several ranks: run without mpirun", NOT_BUILT)
        for trait, allowed in (("ramp", "'relax'"), ("cord", "nothing"), ("pull", "nothing"), ("wires", "nothing"))
    ),
    Rule("gripped", ("report",), "'periodic' for a report (a card is for endless cloth)", "a card is for endless cloth"),
    Rule(
        "friction",
        ("report",),
        "0 for a report (a card is for states that do not depend on the load history)",
        "a card is for states that do not depend on the load history",
    ),
    Rule("friction", ("map", "planar"), ON_THE_PATH, NOT_BUILT),
    *(
        Rule(trait, ("map",), ON_THE_PATH, why)
        for trait, why in (
            ("plastic", NOT_BUILT),
            ("pull", ALONE),
            ("rotation", ALONE),
            ("gradient", ALONE),
            ("cord", ALONE),
        )
    ),
    Rule(
        "cuda",
        ("map",),
        "cpu for maps and reports (its small meshes fit the caches of a CPU)",
        "small meshes fit the caches of a CPU",
    ),
    Rule("ranks", ("trade",), "one rank for a trade: run it without mpirun", "its meshes are small"),
    Rule("ranks", ("map",), "one rank for maps and reports: run it without mpirun", "its meshes are small"),
)
