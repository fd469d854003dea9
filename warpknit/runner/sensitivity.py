"""Changes of means over meshes with nodes, friction, and an overshoot of the load.

Each change runs on two of the meshes. It is compared with the same two, so that their scatter drops out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.text import listed
from ..errors import ModelError
from ..knit.lapping import KnitError
from ..results.finding import ResultWarning
from ..results.row import Row, Values
from ..scene import Scene
from ..scene.options import Stage
from ..solve.variant_models import VariantModels, last_records
from .history import row_of
from .summary import Estimate
from .variants import MeshValues, mesh_values

MESHES = 2  # by which a change is measured
COARSENING = 1.4  # nodes a loop of the run over the comparison's
ORDER = 2  # of the errors of discretisation: they fall with the square of the nodes
NODES = "nodes"
FRICTIONS = {"friction_half": 0.5, "friction_double": 2.0}  # factors by which it is uncertain
WORDS = {NODES: "fewer nodes", "friction_half": "half the friction", "friction_double": "twice the friction"}


@dataclass(frozen=True)
class Mesh:
    """One that is run again."""

    change: str  # name of what is changed
    number: int
    model: Any


class Change(Values):
    """Changes of the means by figure, `strain_weft`, as fractions of them; of `active_percent` of all contacts."""


def changes_of(scene: Scene) -> dict[str, Scene]:
    """Scenes by what they change: the nodes a loop, and with these, which cost less, one thing more each."""
    friction, overshoot, nodes = scene.contact.friction, scene.variants.overshoot, fewer_nodes(scene)
    coarse = replace(scene, model=replace(scene.model, nodes_per_loop=nodes))
    found = {NODES: coarse}
    if friction > 0.0:
        for name, factor in FRICTIONS.items():
            found[name] = replace(coarse, contact=replace(scene.contact, friction=factor * friction))
    if overshoot > 0.0:
        found["overshoot"] = replace(coarse, stages=(_overshot(scene.stages[0], overshoot), *scene.stages))
    return found


def fewer_nodes(scene: Scene) -> int:
    """Nodes a loop of the comparison."""
    return round(scene.model.nodes_per_loop / COARSENING)


def _overshot(stage: Stage, overshoot: float) -> Stage:
    """The first load step, further by a share of its strains and tensions."""
    names = ("strain_weft", "strain_warp", "tension_weft", "tension_warp")
    driven = {name: (1.0 + overshoot) * value for name in names if (value := getattr(stage, name)) is not None}
    return replace(stage, name="overshoot", **driven)


class Sensitivity:
    """Runs the changes of a scene on two meshes that have been run."""

    def __init__(self, scene: Scene, device: str, rows: Mapping[int, Row], scale: float) -> None:
        """rows: the last one of each mesh, by number; scale [N/m]: of a small tension."""
        self.scene, self.device, self.scale = scene, device, scale
        self.numbers = list(rows)[:MESHES]
        self.rows = {number: rows[number] for number in self.numbers}
        self.seen = self._mesh_values(rows)

    def _mesh_values(self, rows: Mapping[int, Row]) -> MeshValues:
        return mesh_values(self.scene.stages[-1].by_tension, list(rows.values()), self.scale)

    def changes(self, monitor: Callable[[int], None]) -> dict[str, Change]:
        """Changes of the means by name, where all meshes run to the end. monitor: called at every check, may raise to stop."""
        found: dict[str, dict[int, Row]] = {}
        every = list(self._meshes())
        for place, record in last_records([mesh.model for mesh in every], monitor):
            found.setdefault(every[place].change, {})[every[place].number] = row_of(record)
        before = {name: self.rows if name == NODES else found.get(NODES, {}) for name in found}
        changes = {name: self._change(before[name], rows) for name, rows in found.items()}
        return {name: change for name, change in changes.items() if change is not None}

    def _meshes(self) -> Iterator[Mesh]:
        """The meshes of each change whose loops fit."""
        for name, scene in changes_of(self.scene).items():
            variants = VariantModels(scene, self.device)
            for number in self.numbers:
                with suppress(KnitError, ModelError):
                    yield Mesh(name, number, variants.model(number))

    def _change(self, before: Mapping[int, Row], after: Mapping[int, Row]) -> Change | None:
        """From the rows of some meshes to other rows of the same; None where no mesh is in both."""
        if not (both := before.keys() & after.keys()):
            return None
        first, second = (self._mesh_values({number: rows[number] for number in sorted(both)}).values for rows in (before, after))
        relative = (second - first).mean(axis=0) / self.seen.scale
        return Change(**dict(zip(self.seen.names, relative.tolist(), strict=True)))

    def estimate(self, changes: Mapping[str, Change]) -> Estimate:
        """Estimated errors of the means: of their number of meshes, of nodes and of friction, root of the sum of squares.

        With a warning of changes that are not known, as none of their meshes runs to the end.
        """
        seen = self.seen
        parts = {"standard_error": seen.values.std(axis=0, ddof=1) / math.sqrt(len(seen.values)) / seen.scale}
        values = {name: np.array([change[figure] for figure in seen.names]) for name, change in changes.items()}
        if NODES in values:
            parts["nodes"] = np.abs(values[NODES]) / self._change_of_error
        if friction := [values[name] for name in FRICTIONS if name in values]:
            parts["friction"] = np.sqrt(np.mean(np.square(friction), axis=0))
        weft, warp, active, stress = np.sqrt(sum(part**2 for part in parts.values())).tolist()
        tension = max(weft, warp)
        strains = [error for error, name in zip((weft, warp), seen.names, strict=False) if name.startswith("strain")]
        largest = {name: float(part.max()) for name, part in parts.items()}
        return Estimate(
            max(tension, active, stress), 100.0 * active, tension, stress=stress, standard_error=largest["standard_error"],
            nodes=largest.get("nodes"), friction=largest.get("friction"), warning=self._lacking(changes),
            strain=max(strains, default=None), changes=Values(**changes),
        )  # fmt: skip

    def _lacking(self, changes: Mapping[str, Change]) -> ResultWarning | None:
        names = [WORDS[name] for name in changes_of(self.scene) if name in WORDS and name not in changes]
        if not names:
            return None
        return ResultWarning("W45", f"The estimated error leaves out {listed(names)}, with which no mesh converged.")

    @property
    def _change_of_error(self) -> float:
        """Change of a figure with fewer nodes over the scene's error (Richardson)."""
        return float((self.scene.model.nodes_per_loop / fewer_nodes(self.scene)) ** ORDER - 1.0)
