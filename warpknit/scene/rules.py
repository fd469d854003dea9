"""Combinations of features that are excluded: the rules of the table of compatibilities (capabilities.py)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """A trait that excludes others."""

    trait: str  # whose key the message names
    others: tuple[str, ...]  # all of them together; the first gives the column of the table
    instead: str  # what to write; empty: the combination is accepted, but the trait has no effect
    why: str

    @property
    def traits(self) -> frozenset[str]:
        return frozenset((self.trait, *self.others))

    @property
    def refused(self) -> bool:
        """Whether the combination is refused."""
        return bool(self.instead)


NOT_BUILT = "not implemented"
LEAVE_OUT = "leave it out"
NO_EFFECT = ""
RELAX, GRIPPED, SPATIAL = (f"write '{word}'" for word in ("relax", "gripped", "spatial"))
KNIT, KNIT_OR_HOOK = "use a scene with [knit]", "use a scene with [knit] or [hook]"
ONE_RANK = "run it without mpirun"
ENDS = "only the two upper ends of a hook move"
SIZE = "the size of the mesh is known only when the file is read"
NO_EDGE = "a periodic tile has no edge, and its load is uniform"
ALONE = "a map strains its mesh uniformly"
FICTITIOUS = "the masses of a relaxation are fictitious, and it has no real time"
OWN_CONTACT = "in space wires touch each other directly: there are no bodies"
SEARCHED = "a search for tension would be part of the load history"

RULES = (
    # the mesh and its model
    Rule("planar", ("wires",), SPATIAL, "its wires are curves in space"),
    Rule("periodic", ("hook",), GRIPPED, "both wires of a hook are held at their ends"),
    Rule("panel", ("hook",), LEAVE_OUT, "the wires have no outline"),
    Rule("panel", ("wires",), LEAVE_OUT, "the wires have no outline"),
    Rule("sweep", ("hook",), LEAVE_OUT, "two hooked wires have no strain"),
    Rule("sweep", ("wires",), LEAVE_OUT, NOT_BUILT),
    Rule("ramp", ("wires",), RELAX, NOT_BUILT),
    Rule("file repeats", ("gripped",), "write [1, 1], or model.boundary = 'periodic'", "wires held at their ends do not repeat"),
    Rule("crossing distance", ("planar",), LEAVE_OUT, "both wires lie in one plane"),
    Rule("seeds", ("even loops",), "write 1, or knit.scatter", "all seeds give the same mesh"),
    # contact
    Rule("treatment", ("spatial",), LEAVE_OUT, OWN_CONTACT),
    Rule("treatment", ("knit",), "write 'free-body'", "the other treatments apply to a single contact, in a [hook]"),
    Rule("body mass", ("spatial",), LEAVE_OUT, OWN_CONTACT),
    Rule("body mass", ("relax",), LEAVE_OUT, FICTITIOUS),
    Rule("body radius", ("spatial",), NO_EFFECT, OWN_CONTACT),
    Rule("friction", ("treatment",), "write 0, or contact.treatment = 'free-body'", "each treatment is studied without friction"),
    # friction and yield
    Rule("friction", ("ramp",), "write 0", NOT_BUILT),
    Rule("plastic", ("ramp",), "write false", NOT_BUILT),
    Rule("hardening", ("elastic",), NO_EFFECT, "it applies only with wire.plastic = true"),
    Rule("poisson", ("planar",), NO_EFFECT, "wires do not twist in the plane"),
    Rule("seed", ("even loops",), NO_EFFECT, "it applies only with knit.scatter"),
    # loads
    *(
        Rule(trait, ("hook",), "write displacement and temperature alone", ENDS)
        for trait in ("strain", "tension", "shear", "gradient", "pull", "rotation")
    ),
    *(
        Rule(trait, ("wires",), "write strains, tensions, shear and temperature alone", SIZE)
        for trait in ("displacement", "gradient", "pull")
    ),
    *(Rule(trait, ("periodic",), LEAVE_OUT, NO_EDGE) for trait in ("gradient", "pull", "rotation")),
    *(Rule(trait, ("ramp",), LEAVE_OUT, NOT_BUILT) for trait in ("gradient", "pull", "rotation", "cord")),
    Rule("rotation", ("cord",), LEAVE_OUT, "the clamps hang on the cord"),
    Rule("rotation", ("spatial", "pull"), LEAVE_OUT, NOT_BUILT),
    Rule("rotation and pull", ("pull",), LEAVE_OUT, "each of them moves the clamps"),
    Rule("gradient", ("no multipliers",), LEAVE_OUT, "the multipliers apply it"),
    *(
        Rule(load, (trait,), "write strains", SEARCHED)
        for load in ("tension", "sweep by tension")
        for trait in ("friction", "plastic")
    ),
    Rule("path", ("sweep",), NO_EFFECT, "a map runs only [load]"),
    # the solver
    Rule("single", ("hook",), "write 'double'", "double precision costs nothing with few nodes"),
    Rule("no multipliers", ("spatial",), "write true", NOT_BUILT),
    Rule("focal length", ("spatial",), LEAVE_OUT, NOT_BUILT),
    *(Rule(trait, ("relax",), LEAVE_OUT, FICTITIOUS) for trait in ("target time step", "loading time", "mass scaling")),
    Rule("damping", ("relax",), NO_EFFECT, "it applies only to a ramp"),
    Rule("max steps", ("ramp",), NO_EFFECT, "it applies only to a relaxation"),
    # rules for a whole table, after those for its keys
    Rule("periodic", ("panel",), GRIPPED, "a tile has no outline"),
    # commands
    Rule("wires", ("map",), KNIT, NOT_BUILT),
    Rule("wires", ("trade",), KNIT_OR_HOOK, NOT_BUILT),
    Rule("wires", ("error",), KNIT_OR_HOOK, "settings are tried on a smaller mesh, which requires a knit"),
    Rule("hook", ("map",), KNIT, "two hooked wires have no strain"),
    Rule("hook", ("ranks",), ONE_RANK, "two wires are too few for several ranks"),
    Rule("no sweep", ("map",), "add [sweep], with strains or tensions in weft and warp", "a map reads its loads from [sweep]"),
    Rule("ramp", ("map",), RELAX, "a map consists of equilibria"),
    Rule("ramp", ("error",), RELAX, "errors are estimated for equilibria only"),
    Rule("spatial", ("error", "hook"), "write 'planar'", "errors of hooks in space are not known"),
    *(Rule(trait, ("spatial", "ranks"), ONE_RANK, NOT_BUILT) for trait in ("ramp", "cord", "pull", "wires")),
    Rule("gripped", ("report",), "write 'periodic'", "a card describes endless cloth"),
    Rule("friction", ("report",), "write 0", "a card needs states without load history"),
    Rule("friction", ("map", "planar"), LEAVE_OUT, NOT_BUILT),
    *(
        Rule(trait, ("map",), LEAVE_OUT, why)
        for trait, why in (
            ("plastic", NOT_BUILT),
            ("pull", ALONE),
            ("rotation", ALONE),
            ("gradient", ALONE),
            ("cord", ALONE),
        )
    ),
    Rule("cuda", ("map",), "write --device cpu", "small meshes fit the caches of a CPU"),
    Rule("ranks", ("trade",), ONE_RANK, "its meshes are small"),
    Rule("ranks", ("map",), ONE_RANK, "its meshes are small"),
)
