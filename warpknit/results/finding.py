"""What a result says: findings, warnings, and the table of both."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ..base.text import counted, engineering

SHOWN = 3  # warnings of the short table
INVALID, LIMITED, INPUT = range(3)  # ranks: do not use the result, use it with care, check the scene
SPATIAL = 'Set model.kind = "spatial".'
LARGER = 'Use a larger patch, or model.boundary = "periodic".'
KINDS = {  # rank and advice by code; docs/reference/warnings.md says what each means
    "W01": (INVALID, SPATIAL),
    "W02": (INVALID, SPATIAL),
    "W03": (INPUT, "Compare the file with the scene."),
    "W04": (INVALID, "Reduce the load, or give wire.yield_stress and wire.tensile_strength of the real wire."),
    "W05": (LIMITED, LARGER),
    "W06": (INVALID, "Choose strains or tensions that pull in both directions."),
    "W07": (INVALID, "Choose strains or tensions that pull in both directions."),
    "W09": (LIMITED, LARGER),
    "W10": (LIMITED, "Use a smaller panel, or a longer panel.focal_length."),
    "W11": (INVALID, 'Compare with model.kind = "spatial".'),
    "W12": (INVALID, "Raise wire.set_fraction."),
    "W13": (LIMITED, 'Set wires.overlaps = "at rest", or draw the wires apart.'),
    "W14": (LIMITED, "Use a thinner wire, a wider knit, or other chains."),
    "W15": (INVALID, "Use a smaller load.displacement."),
    "W18": (LIMITED, "Compare with other output.frames, solver.residual_tolerance = 1e-4 and more knit.repeats."),
    "W19": (LIMITED, "Use more load levels (output.frames)."),
    "W20": (LIMITED, LARGER),
    "W21": (INPUT, "Write a scene with warpknit new."),
    "W22": (INPUT, "Check the chains in figures/knit.png."),
    "W23": (INPUT, "For one yarn of parallel wires set wire.ends."),
    "W24": (INPUT, "Give a strain, a tension or a temperature in [load]."),
    "W25": (LIMITED, "Use a solver.preset, or at least 12 model.nodes_per_loop."),
    "W26": (INVALID, "Reduce the tensions."),
    "W27": (INVALID, "Reduce the strains."),
    "W28": (INPUT, "Check the value and its unit."),
    "W29": (INPUT, "Write the unit, such as '20 degC'."),
    "W30": (INVALID, "Reduce the temperature."),
    "W31": (LIMITED, "Give wire.youngs_modulus, wire.expansion and wire.yield_stress."),
    "W32": (LIMITED, "Set output.frames = 'auto'."),
    "W34": (INVALID, "Raise solver.loading_time or solver.damping."),
    "W35": (INVALID, "Raise solver.loading_time."),
    "W36": (INVALID, "Raise wire.set_fraction."),
    "W39": (INVALID, "map_details.csv has the reasons."),
    "W40": (LIMITED, "Compare with a run along your load history."),
    "W42": (LIMITED, "Continue the map with --resume."),
    "W43": (LIMITED, "Extend [sweep]."),
    "W44": (LIMITED, "Choose a load farther from the snap-through."),
    "W45": (LIMITED, "Run the scene with two values of solver.preset and compare."),
    "W46": (LIMITED, "Use --preset reference."),
    "W50": (INVALID, "Choose a larger --tension, or strains with more active contacts."),
    "W52": (LIMITED, "Choose another --tension."),
    "W53": (LIMITED, "Load the real mesh in the same order."),
    "W54": (LIMITED, "Compare the stiffness of both equilibria."),
    "W55": (LIMITED, "Use an anisotropic card, such as MAT2 of nastran."),
    "W56": (INVALID, "Choose a smaller --tension."),
    "W57": (LIMITED, "Use the linear card, MESH, near its tension."),
    "W58": (LIMITED, 'Set solver.preset = "reference".'),
    "W59": (INVALID, 'Reduce the load, or set solver.preset = "reference".'),
    "W60": (LIMITED, "Reduce the load or variants.scatter."),
    "W61": (LIMITED, "Raise variants.count or knit.repeats."),
    "W62": (INPUT, "Leave out --device to use all GPUs."),
    "W63": (INPUT, "Check --out."),
    "W64": (INPUT, "Run without mpirun."),
    "W65": (INPUT, "See the documentation of Warp."),
}
WITH_CODE = re.compile(r"(W\d\d) (.*)", re.DOTALL)


@dataclass(frozen=True)
class Finding:
    """One finding of a result: a line of the table of a command, of a report or a notebook.

        Finding("largest stress", 1.48e8, "Pa", where=", 31 % of yield (assumed)").text

    value: a number; or words, without a unit.
    """

    name: str
    value: float | str
    unit: str = ""  # SI; numbers are shown with a prefix
    where: str = ""  # where, when, beside what and how sure, as it stands behind the value
    short: bool = False  # whether it belongs to the short table; --verbose shows all

    @property
    def text(self) -> str:
        """Value and place in words."""
        shown = self.value if isinstance(self.value, str) else engineering(self.value, self.unit)
        return f"{shown}{self.where}"


@dataclass(frozen=True)
class ResultWarning:
    """A limit to the use of a result: a fact and an advice, one sentence each."""

    code: str  # W01, W02, ..., of KINDS; empty where it was read from an older file
    text: str  # what is the case
    advice: str | None = None  # what to do; None: the advice of its kind

    def __str__(self) -> str:
        advice = KINDS[self.code][1] if self.advice is None and self.code else self.advice
        return " ".join(part for part in (self.code, self.text, advice) if part)

    @property
    def rank(self) -> int:
        """0 for the gravest kinds."""
        return KINDS[self.code][0] if self.code else 0

    @classmethod
    def of(cls, line: str) -> ResultWarning:
        """The warning with this text."""
        found = WITH_CODE.fullmatch(line)
        return cls(found[1], found[2], "") if found and found[1] in KINDS else cls("", line, "")


@dataclass(frozen=True)
class ResultTable:
    """What a command prints at its end."""

    findings: tuple[Finding, ...]
    warnings: tuple[ResultWarning, ...] = ()
    file: str = "summary.json"  # which has all warnings

    def lines(self, *, verbose: bool = False) -> Iterator[Finding]:
        """The findings and the gravest warnings of the short table, or all of both."""
        yield from (finding for finding in self.findings if verbose or finding.short)
        warnings = sorted(self.warnings, key=lambda warning: warning.rank)
        shown = warnings if verbose else warnings[:SHOWN]
        for warning in shown:
            yield Finding(warning.code or "warning", str(warning).removeprefix(warning.code).strip())
        if more := len(warnings) - len(shown):
            yield Finding("", f"{counted(more, 'more warning')}: --verbose, or {self.file}")
