"""Changes of means over meshes with nodes, friction, and an overshoot of the load.

Each change runs on two of the meshes. It is compared with the same two, so that their scatter drops out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ..base.text import listed
from ..results.finding import ResultWarning
from ..results.row import Row, Values
from ..scene import Scene
from .changed_meshes import FRICTIONS, NODES, Beside, Check, changed_rows, changes_of, fewer_nodes
from .summary import Estimate
from .variants import MeshValues, mesh_values

MESHES = 2  # by which a change is measured
ORDER = 2  # of the errors of discretisation: they fall with the square of the nodes
WORDS = {NODES: "fewer nodes", "friction_half": "half the friction", "friction_double": "twice the friction"}


class Change(Values):
    """Changes of the means by figure, `strain_weft`, as fractions of them; of `active_percent` of all contacts."""


class Sensitivity:
    """Runs the changes of a scene on two meshes that have been run."""

    def __init__(self, scene: Scene, device: str, rows: Mapping[int, Row], scale: float, beside: Beside | None = None) -> None:
        """rows: the last one of each mesh, by number; scale [N/m]: of a small tension; beside: has begun with the changes."""
        self.scene, self.device, self.scale, self._beside = scene, device, scale, beside
        self.numbers = list(rows)[:MESHES]
        self.rows = {number: rows[number] for number in self.numbers}
        self.seen = self._mesh_values(rows)

    def _mesh_values(self, rows: Mapping[int, Row]) -> MeshValues:
        return mesh_values(self.scene.stages[-1].by_tension, list(rows.values()), self.scale)

    def changes(self, check: Check) -> dict[str, Change]:
        """Changes of the means by name, where all meshes run to the end."""
        found = None if self._beside is None else self._beside.rows(self.numbers, check)
        if found is None:
            found = changed_rows(self.scene, self.device, self.numbers, check)
        before = {name: self.rows if name == NODES else found.get(NODES, {}) for name in found}
        changes = {name: self._change(before[name], rows) for name, rows in found.items()}
        return {name: change for name, change in changes.items() if change is not None}

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
