"""Contents of a file of wires, for `warpknit plan` and as an object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpknit.base.text import short_percent
from warpknit.results.finding import ResultWarning
from warpknit.scene import Scene
from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import Places, find_places
from warpknit.wires.overlaps import Overlaps, find_overlaps
from warpknit.wires.read import drawn_wires, rest_wires, thickness_of


@dataclass(frozen=True)
class WireReport:
    """Wires of a scene at rest, and their overlaps in the file."""

    file: str
    wires: Wires
    overlaps: Overlaps
    places: Places
    thickness: np.ndarray  # (wire,) [m] in the run
    is_prestressed: bool  # by overlaps

    @property
    def warnings(self) -> list[ResultWarning]:
        """What to look at before a run."""
        found = list(self.wires.warnings)
        if self.is_prestressed and (self.overlaps.crowded or self.overlaps.places):
            closest, touch = self.overlaps.closest, self.overlaps.thickness
            depth = "" if closest is None else f", by up to {short_percent(1.0 - closest / touch)} of their thickness"
            found.append(ResultWarning("W13", f"Wires overlap as drawn{depth}; pushing them apart prestresses the mesh."))
        return found

    def as_dict(self) -> dict[str, object]:
        """Plain numbers in SI, for scripts."""
        wires, overlaps = self.wires, self.overlaps
        return {
            "nodes": wires.node_count,
            "wires": len(wires.points),
            **{kind: wires.kinds.count(kind) for kind in ("open", "closed", "periodic")},
            "wire_length_m": float(wires.lengths.sum()),
            "repeat_m": None if wires.period is None else wires.period.tolist(),
            "extent_m": self._extent().tolist(),
            "file_thickness_m": None if wires.radius is None else _one_or_each(2.0 * wires.radius),
            "thickness_m": _one_or_each(self.thickness),
            "closest_m": overlaps.closest,
            "hooks": None if self.places.crowded else self.places.hooks,
            "crossings": None if self.places.crowded else len(self.places) - self.places.hooks,
            "overlaps": None if overlaps.crowded else overlaps.places,
            "warnings": [*map(str, self.warnings)],
        }

    def rows(self) -> list[tuple[str, str]]:
        """The same as text, under headings."""
        wires = self.wires
        kinds = ", ".join(f"{count:,} {kind}" for kind in ("open", "closed", "periodic") if (count := wires.kinds.count(kind)))
        spacing = float(wires.lengths.sum()) / int(wires.segment_counts.sum())
        rows = [
            ("file", self.file),
            ("wires", f"{len(wires.points):,} ({kinds}), {_millimetres(float(wires.lengths.sum()))} long together"),
            ("nodes", f"{wires.node_count:,}, {_millimetres(spacing)} apart"),
            ("extent", " x ".join(map(_millimetres, self._extent()))),
        ]
        if wires.period is not None:
            rows.append(("repeat", " x ".join(map(_millimetres, wires.period))))
        if wires.natural_turns is not None or wires.twist_strains is not None:
            blocks = [name for name, used in (("*RK", wires.natural_turns), ("*RT", wires.twist_strains)) if used is not None]
            rows.append(("natural", f"curvature and twist from {' and '.join(blocks)} of the file"))
        if np.ptp(self.thickness) > 0.0:
            low, high = _millimetres(self.thickness.min()), _millimetres(self.thickness.max())
            rows.append(("thickness", f"{low} to {high}, from the file"))
        rows.append(("hooks", self.places.line()))
        rows.append(("contact", self.overlaps.line()))
        return rows

    def _extent(self) -> np.ndarray:
        """(3,) [m] of the box around the wires."""
        return np.ptp(np.concatenate(self.wires.points), axis=0)


def wire_report(scene: Scene) -> WireReport:
    """Read the wires of a scene and find where they overlap. Raises `SceneError`."""
    wires = rest_wires(scene)
    assert scene.wires is not None
    places, thickness = find_places(wires, scene.wires.loop_length), thickness_of(scene, wires)
    overlaps = find_overlaps(drawn_wires(scene), thickness)
    return WireReport(scene.wires.path.name, wires, overlaps, places, thickness, scene.wires.overlaps == "prestress")


def _one_or_each(values: np.ndarray) -> float | list[float]:
    """One value where all are the same, else each."""
    return float(values[0]) if np.ptp(values) == 0.0 else values.tolist()


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.4g} mm"
