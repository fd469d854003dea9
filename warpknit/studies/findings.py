"""Findings of a report, and their selection for page and terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..base.text import celsius, engineering, exact
from ..measure import Observables
from ..results.finding import Finding, ResultWarning
from ..results.row import Row
from ..runner.answers import Answers
from ..runner.answers_table import answer_findings
from ..runner.branches import Jump as RowJump
from ..runner.estimates import FRICTIONS, MESHES
from ..runner.strength import exceeded_text
from ..scene import Scene, Sweep
from ..scene.capabilities import refuse
from ..scene.units import tidy
from .card import MaterialCard
from .card_files import card_warnings
from .contact_map import Jump, MapRow, Optimum, axes_of, load_texts
from .curves import missing_points
from .equal_tension import EqualTensionPath, ServicePoint, branches_at
from .fe_codes import limit_of_curves
from .heat import HeatedMesh, later_temperatures
from .load_path import Mesh
from .mean_card import MeanCard
from .opening_size import OpeningSize

DEFAULT_STRAINS = tuple(round(0.02 * k, 2) for k in range(11))
DEFAULT_SWEEP = Sweep(strain_weft=DEFAULT_STRAINS, strain_warp=DEFAULT_STRAINS)
DEFAULT_SHARES = (0.5, 1.0, 1.5, 2.0)  # of the tensions of a scene that is loaded by tension


def default_sweep(scene: Scene) -> Sweep:
    """The map of a scene without [sweep]: tensions about its own, or strains."""
    load = scene.stages[0]
    if not load.tension_weft or not load.tension_warp:
        return DEFAULT_SWEEP
    weft, warp = (tuple(tidy(share * one) for share in DEFAULT_SHARES) for one in (load.tension_weft, load.tension_warp))
    return Sweep(tension_weft=weft, tension_warp=warp)


def report_scene(scene: Scene, *, ranks: int = 1) -> Scene:
    """`scene`, with the default sweep if it has none. Raises `SceneError` for a scene without a report."""
    scene = replace(scene, sweep=scene.sweep or default_sweep(scene))
    refuse(scene, "report", ranks=ranks)
    return scene


@dataclass(frozen=True)
class Findings:
    """The content of the page."""

    scene: Scene
    notes: Sequence[str]  # how the scene was fitted
    model: Mesh
    rows: Sequence[MapRow]
    optimum: Optimum | None
    jumps: Sequence[Jump]  # of the map
    requested: float | None  # [N/m] tension requested for the card
    path: EqualTensionPath
    path_jumps: Sequence[RowJump]
    answers: Answers | None  # that it gives (runner/answers.py)
    heated: Sequence[HeatedMesh]  # at one tension, while its temperature changes
    no_heat: str  # why there is none
    service: Sequence[ServicePoint]
    curves: Sequence[Row]
    where: str  # state of the card, in words; or why there is none
    card: MaterialCard | None
    mean: MeanCard | None  # mean card, where meshes are several
    loading: Sequence[Row]  # states from the mesh as knitted to the card and beyond, up to the first jump
    tensioned: Observables | None  # the mesh of the card
    knitted: Observables | None  # the mesh as knitted
    openings: Mapping[str, Sequence[OpeningSize]]  # by state, in words; without states that have none
    model_warnings: Sequence[ResultWarning]  # where the states are outside the validity of their model
    earlier_kept: bool  # nothing was written: there is no card, and the directory has an earlier report with one
    codes: Sequence[str]  # FE codes that get the card
    times: Mapping[str, float] = field(default_factory=dict)  # [s] of the stages of the report
    of_map: Sequence[Finding] = ()  # lines on the optimum of the map with other frictions
    reflection: Sequence[Finding] = ()  # lines on the reflection loss of the states of the map
    file_notes: tuple[str, ...] = ()  # FE codes without a card and why, and files that were removed

    @property
    def found_again(self) -> bool:
        """Whether the state of the card at the optimum was found again; True without one."""
        return self.requested is not None or self.card is not None

    @property
    def of_meshes(self) -> str:
        """The meshes of answers and service tensions, in words; empty where the scene has one mesh."""
        if self.scene.variants.count == 1:
            return ""
        counts = [row.meshes for row in self.path.rows if "meshes" in row]
        if not counts:
            return "means of several meshes"
        return f"means of {' to '.join(map(str, sorted({min(counts), max(counts)})))} meshes"

    def friction_name(self, friction: str) -> str:
        """The name of another friction on the page."""
        return f"friction {FRICTIONS[friction] * self.scene.contact.friction:g}"

    @property
    def friction_text(self) -> str:
        """Source of the values with other frictions, after a space; or nothing."""
        if not any(point.friction_texts for point in self.service):
            return ""
        return f" With another friction {MESHES} of the meshes ran again. Their mean change is added to the means."

    @property
    def by_tension(self) -> bool:
        """Whether the map prescribes tensions."""
        return any(row.by_tension for row in self.rows)

    def place_in_map(self, point: ServicePoint) -> tuple[float, float] | None:
        """The load of a service point, by the axes of the map; None without one, or outside the map."""
        load = (point.tension, point.tension) if point.strains and self.by_tension else point.strains
        weft, warp = axes_of(self.rows)
        within = load is not None and weft[0] <= load[0] <= weft[-1] and warp[0] <= load[1] <= warp[-1]
        return load if within else None

    @property
    def sweep_text(self) -> str:
        """The loads of the map, and their source."""
        axes = zip(("weft", "warp"), axes_of(self.rows), strict=True)
        ends = " and ".join(f"{' to '.join(load_texts((axis[0], axis[-1]), self.by_tension))} in {side}" for side, axis in axes)
        default = self.scene.sweep == default_sweep(self.scene)
        source = "the default of a report; a table [sweep] in the scene changes them" if default else "of [sweep] in the scene"
        return f"{len(self.rows)} pairs of {'tensions' if self.by_tension else 'strains'}, {ends}: {source}"

    @property
    def card_state(self) -> str:
        """State and temperature of the card; or why there is none."""
        if self.card is not None:
            beyond = exceeded_text(self.scene, self.card.stress_max)
            stress = f", with a wire stress of {engineering(self.card.stress_max, 'Pa')}, {beyond}" if beyond else ""
            ahead = f"; {self.card.ahead}" if self.card.ahead else ""
            return f"{self.where}, at {celsius(self.card.temperature)}{stress}{ahead}"
        return self.where + ("; the earlier report in the directory, with its card, is kept" if self.earlier_kept else "")

    @property
    def answer_lines(self) -> Iterator[Finding]:
        """The answers under equal tensions, for a terminal."""
        if self.answers is not None:
            of = f"; {self.of_meshes}" if self.of_meshes else ""
            yield Finding("equal tensions", f"followed {self.path.end_text}{of}", short=True)
            yield from answer_findings(self.answers, self.scene.wire.yield_stress, failed=self.path.failed)
            yield from self._friction_lines
        if self.heat_note:
            yield Finding("heat", self.heat_note)
        if self.no_heat and later_temperatures(self.scene):
            yield Finding("heat", f"not shown: {self.no_heat}")

    @property
    def _friction_lines(self) -> Iterator[Finding]:
        """The requested tension, or the middle service tension, with other frictions."""
        known = [point for point in self.service if point.friction_texts]
        point = next((one for one in known if one.tension == self.requested), known[len(known) // 2] if known else None)
        if point is not None:
            for friction, (strains, active, stress) in point.friction_texts.items():
                text = f"at {point.name} strain {strains}, {active} active, {stress}"
                yield Finding(f"  with {self.friction_name(friction)}", text, short=True)

    @property
    def heat_note(self) -> str:
        """Note on heat at another tension than requested; or empty."""
        if not self.heated or self.requested is None or self.requested in self.path.states:
            return ""
        return f"shown at the best tension, because the mesh does not reach {exact(self.requested, 'N/m')}"

    @property
    def limit_of_curves(self) -> list[ResultWarning]:
        """Warning on curves of the FE cards; none if complete, or without a card."""
        if self.card is None:
            return []
        at_jump = bool(self.path_jumps and self.loading and self.loading[-1] is self.path_jumps[0][0])
        return list(limit_of_curves(self.card, self.loading, self.codes, at_jump=at_jump))

    @property
    def branch_notes(self) -> list[ResultWarning]:
        """Service tensions with another equilibrium on the map; the card has its own warnings."""
        others = (tension for tension in self.path.at if self.card is None or tension != self.requested)
        texts = (branches_at(tension, self.path.at[tension], self.rows) for tension in others)
        return [ResultWarning("W54", text) for text in texts if text]

    @property
    def warnings(self) -> list[ResultWarning]:
        """Limits to the use of card and curves, for a terminal."""
        of_card = [] if self.card is None else list(card_warnings(self.card, self.scene))
        return [*of_card, *self.branch_notes, *self.limit_of_curves, *missing_points(self.curves)]
