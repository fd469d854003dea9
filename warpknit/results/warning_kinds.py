"""The kinds of warnings about a result: what each code means, and what to do.

`docs/reference/warnings.md` is written from this table, by `python docs/summary_keys.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KINDS", "WarningKind"]

INVALID, LIMITED, INPUT = range(3)  # ranks: the gravest warnings print first
SPATIAL = 'Set model.kind = "spatial".'
LARGER = 'Use a larger patch, or model.boundary = "periodic".'
OTHER_LEVELS = "Compare with other output.frames, solver.residual_tolerance = 1e-4 and more knit.repeats."


@dataclass(frozen=True)
class WarningKind:
    """One kind of warning."""

    rank: int  # INVALID: do not use the result, LIMITED: use it with care, INPUT: check the scene
    title: str
    meaning: str
    advice: str  # one sentence; a warning may give its own


KINDS = {
    "W01": WarningKind(INVALID, "Wires slid along each other",
        "In the planar model nothing keeps one guide bar from sliding along the other. Here the bars slid by more than a wire"
        " diameter, so the result is not valid.",
        SPATIAL),
    "W02": WarningKind(INVALID, "Tight loops in the planar model",
        "In a tight knit, wires touch long before the planar model closes their contact. The planar tension is too small.",
        SPATIAL),
    "W03": WarningKind(INPUT, "Part of the wire file is not used",
        "The file has curves, arrays, widths or units that the run does not read, or reads in another way.",
        "Compare the file with the scene."),
    "W04": WarningKind(INVALID, "Stress above the strength or the elastic limit",
        "The largest wire stress, bending and tension together, is above a limit of the wire. Above the strength a real wire"
        " breaks; the model has no fracture. Above the elastic limit a real wire keeps a permanent set, which only"
        " `wire.plastic` computes. Clamps bend wires sharply, so look at the stress away from the grips too. Both limits are"
        " assumed unless the scene gives them.",
        "Reduce the load, or give wire.yield_stress and wire.tensile_strength of the real wire."),
    "W05": WarningKind(LIMITED, "Cut wire ends at the grips carry load",
        "A gripped patch has wires with less than one loop between two grips. They are almost straight, so they carry more"
        " than their share of the tension, or become taut. The larger the patch, the smaller their part.",
        LARGER),
    "W06": WarningKind(INVALID, "The mesh is compressed",
        "A strain of the load is negative by more than 0.5 %. A real mesh wrinkles out of its plane.",
        "Choose strains or tensions that pull in both directions."),
    "W07": WarningKind(INVALID, "The mesh pushes outward",
        "A direction that is held pushes against its grips. A real mesh wrinkles out of its plane.",
        "Choose strains or tensions that pull in both directions."),
    "W08": WarningKind(LIMITED, "Equilibrium as a membrane did not converge",
        "The mesh is slack or uneven, and its stress over many repeats is not in balance.",
        "Load the mesh further, so that it is taut everywhere."),
    "W09": WarningKind(LIMITED, "Uneven tension over the panel",
        "The edges carry the given tension, but the middle of the panel carries much less. Short wires between grips carry"
        " more than their share. W05 replaces this warning where both apply.",
        LARGER),
    "W10": WarningKind(LIMITED, "Steep paraboloid",
        "The shape of the panel is computed for small slopes.", "Use a smaller panel, or a longer panel.focal_length."),
    "W11": WarningKind(INVALID, "Contacts at the end of their sliding range",
        "In the planar model a contact slides along its wires within a range. At its end the contact force is not valid.",
        'Compare with model.kind = "spatial".'),
    "W12": WarningKind(INVALID, "The natural curvature is too strong",
        "`wire.set_fraction` below 1 lets the loops spring open. Here this stresses the wire above its strength, or shortens"
        " the mesh, before any load.",
        "Raise wire.set_fraction."),
    "W13": WarningKind(LIMITED, "Prestressed before loading",
        "Wires of a file overlap, or are not in equilibrium as drawn. Pushing them apart leaves a stress in all results.",
        'Set wires.overlaps = "at rest", or draw the wires apart.'),
    "W14": WarningKind(LIMITED, "Contacts closed as knitted",
        "The yarn is too thick for its loops, guide bars lap through each other, or loops spring open.",
        "Use a thinner wire, a wider knit, or other chains."),
    "W15": WarningKind(INVALID, "Hooked wires lost contact",
        "The contact slid off the wire. Later records are of two wires that do not touch.", "Use a smaller load.displacement."),
    "W18": WarningKind(LIMITED, "Snap-through to another equilibrium",
        "Several equilibria exist under one load, and the result depends on the load history.", OTHER_LEVELS),
    "W19": WarningKind(LIMITED, "Work and energy do not balance",
        "The work of the load differs from the stored and dissipated energy. Either the mesh snapped through between two load"
        " levels, or the levels are too far apart to integrate the work.",
        "Use more load levels (output.frames)."),
    "W20": WarningKind(LIMITED, "Small patch",
        "A tenth of the wire or more is in pieces shorter than a loop, gripped at both ends. The result depends on the grips"
        " as much as on the knit. W05 replaces this warning where these pieces carry load.",
        LARGER),
    "W21": WarningKind(INPUT, "Empty scene", "All values are defaults or overrides.", "Write a scene with warpknit new."),
    "W22": WarningKind(INPUT, "Chains in even numbers",
        "Some machines number every second gap. The chain is read in half needles.", "Check the chains in figures/knit.png."),
    "W23": WarningKind(INPUT, "The same bar twice",
        "Two guide bars have the same chain and threading, so every loop has both wires.",
        "For one yarn of parallel wires set wire.ends."),
    "W24": WarningKind(INPUT, "No load",
        "The run computes the mesh as knitted.", "Give a strain, a tension or a temperature in [load]."),
    "W25": WarningKind(LIMITED, "Few nodes a loop",
        "The curvature of a loop is not resolved. Tension and contact force may be wrong by more than 10 %.",
        "Use a solver.preset, or at least 12 model.nodes_per_loop."),
    "W26": WarningKind(INVALID, "Tension beyond the wires",
        "Straight wires at their elastic limit carry less than the sum of the given tensions in weft and warp.",
        "Reduce the tensions."),
    "W27": WarningKind(INVALID, "Strain beyond straight wires",
        "At this strain, wires that are straight and slide freely would be longer than at break.", "Reduce the strains."),
    "W28": WarningKind(INPUT, "Not a metal",
        "Young's modulus, density or friction is outside the range of metals.", "Check the value and its unit."),
    "W29": WarningKind(INPUT, "Temperature without a unit", "A bare number is in kelvin.", "Write the unit, such as '20 degC'."),
    "W30": WarningKind(INVALID, "The wire melts", "A given temperature is above the melting point.", "Reduce the temperature."),
    "W31": WarningKind(LIMITED, "Constants far from room temperature",
        "Stiffness, expansion and strength are those at 20 degC for all temperatures.",
        "Give wire.youngs_modulus, wire.expansion and wire.yield_stress."),
    "W32": WarningKind(LIMITED, "Large load increments",
        "A tight knit may skip to another equilibrium where load levels are far apart.", "Set output.frames = 'auto'."),
    "W34": WarningKind(INVALID, "The ramp did not reach equilibrium",
        "At the end of the ramp the forces are not in balance, so the result is not static.",
        "Raise solver.loading_time or solver.damping."),
    "W35": WarningKind(INVALID, "The ramp is too fast",
        "The kinetic energy is a large part of the stored energy, so inertia is part of the result.",
        "Raise solver.loading_time."),
    "W36": WarningKind(INVALID, "wire.set_fraction is too small",
        "No wire of this strength holds the loops against its natural curvature.", "Raise wire.set_fraction."),
    "W39": WarningKind(INVALID, "Pairs of a map did not converge",
        "These pairs have no result.", "map_details.csv has the reasons."),
    "W40": WarningKind(LIMITED, "Snap-through inside a map",
        "Several equilibria exist under one load. Values on the two sides belong to different equilibria.",
        "Compare with a run along your load history."),
    "W42": WarningKind(LIMITED, "Incomplete map",
        "The optimum is the best of the finished pairs.", "Continue the map with --resume."),
    "W43": WarningKind(LIMITED, "Optimum at the edge of the map",
        "A load outside the map may have more active contacts.", "Extend [sweep]."),
    "W44": WarningKind(LIMITED, "Optimum beside a snap-through",
        "With slightly other strains, or another load history, the mesh may have fewer active contacts.",
        "Choose a load farther from the snap-through."),
    "W45": WarningKind(LIMITED, "No error estimate",
        "Some or all runs for the error estimate did not converge.",
        "Run the scene with two values of solver.preset and compare."),
    "W46": WarningKind(LIMITED, "Error above the request",
        "The estimated error of the run is above the given `--error`.", "Use --preset reference."),
    "W50": WarningKind(INVALID, "Unstable material card",
        "The stiffness matrix of the card is not positive definite.",
        "Choose a larger --tension, or strains with more active contacts."),
    "W52": WarningKind(LIMITED, "Uncertain material card",
        "Stiffness and expansion from strain steps of different size disagree. Near this tension contacts close or open, or"
        " there is a snap-through. With friction, the stiffness depends on the size of a load cycle.",
        "Choose another --tension."),
    "W53": WarningKind(LIMITED, "Snap-through below the card",
        "The mesh snaps through to another equilibrium on its way to the tension of the card.",
        "Load the real mesh in the same order."),
    "W54": WarningKind(LIMITED, "Two equilibria at one tension",
        "The map has another equilibrium at this tension than the load path of equal tensions.",
        "Compare the stiffness of both equilibria."),
    "W55": WarningKind(LIMITED, "Shear and extension are coupled",
        "An orthotropic card has no term for this coupling.", "Use an anisotropic card, such as MAT2 of nastran."),
    "W56": WarningKind(INVALID, "Card above the elastic limit",
        "At the tension of the card the wire would yield or break.", "Choose a smaller --tension."),
    "W57": WarningKind(LIMITED, "Curves of the card end or are missing",
        "The tension-strain curves of the FE files end near the tension of the card, or a file has none.",
        "Use the linear card, MESH, near its tension."),
    "W58": WarningKind(LIMITED, "States of a curve are missing",
        "These states did not converge.", 'Set solver.preset = "reference".'),
    "W59": WarningKind(INVALID, "A small mesh fails",
        "`warpknit plan` runs a small mesh of the scene for a moment. This mesh did not converge.",
        'Reduce the load, or set solver.preset = "reference".'),
    "W60": WarningKind(LIMITED, "Meshes left out of the mean",
        "Some scattered meshes did not converge.", "Reduce the load or variants.scatter."),
    "W61": WarningKind(LIMITED, "The mean is not known well enough",
        "The standard error of the means is above `variants.standard_error`.", "Raise variants.count or knit.repeats."),
    "W62": WarningKind(INPUT, "All ranks on one GPU",
        "`--device` puts all ranks of `mpirun` on one GPU.", "Leave out --device to use all GPUs."),
    "W63": WarningKind(INPUT, "No checkpoint to resume", "`--resume` found no checkpoint, so a new run begins.", "Check --out."),
    "W64": WarningKind(INPUT, "A small mesh on ranks",
        "A small mesh is slower on several ranks than without `mpirun`.", "Run without mpirun."),
    "W65": WarningKind(INPUT, "A message of Warp",
        "Warp's library wrote this line at its start.", "See the documentation of Warp."),
}  # fmt: skip
