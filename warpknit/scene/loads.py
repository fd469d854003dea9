"""The tables [load], [[stage]] and [sweep], as frozen objects in plain SI."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees
from typing import Annotated, Any

from pydantic import Field, model_validator

from warpknit.base.text import celsius, exact
from warpknit.scene.keys import Table, key
from warpknit.scene.values import (
    EdgeLength,
    Name,
    Seeds,
    Shear,
    SignedLength,
    Strain,
    Temperature,
    TemperatureGradient,
    Tension,
    Turn,
    Vector,
    exclusive,
    refused,
)

SIDES = ("weft", "warp")


@dataclass(frozen=True, kw_only=True)
class Pull(Table):
    """[[load.pull]]: a place on the outline that is displaced in addition to the load."""

    at: Vector = key(
        "Position on or near the edge, relative to the centre of the bounding box of the mesh as knitted. Write"
        ' `pull = [{at = ["12 mm", "0 mm"], by = ["1 mm", "0 mm"], width = "10 mm"}]`.'
    )
    by: Vector = key("Displacement in addition to the load of the whole mesh. `pull = []` removes all pulls.")
    width: EdgeLength | None = key(
        "Width of the displaced part of the edge, with a cos^2 profile. Left out with `panel.grip_pitch`: the nearest net node"
        " moves.",
        None,
        left_out="required without net nodes",
    )


@dataclass(frozen=True, kw_only=True)
class Stage(Table):
    """[load] and each [[path]]: one stage of the loading, by its final state. Missing keys are as in the stage before.

    Each direction is driven by strain or by tension; the other of the two is None. A hook is driven by `displacement` alone,
    which its model applies as a shear of its frame (hook.py); for a mesh, `displacement` is converted to strains when it is read.
    """

    name: Name = key("Name of the stage in the results.", None, left_out="`load`, then `stage-2`, ...")
    strain_weft: Strain | None = key(
        "Strain at the end of the stage, relative to the knitted size.", None, left_out="0, then as in the stage before"
    )
    tension_weft: Tension | None = key("Instead of `strain_weft`: force per current width at the end of the stage.", None)
    strain_warp: Strain | None = key("The same in warp.", None, left_out="0, then as in the stage before")
    tension_warp: Tension | None = key("Instead of `strain_warp`.", None)
    displacement: SignedLength | None = key(
        "Instead of both strains: outward displacement of every side. With `[hook]`: displacement of the driven end to the"
        " right.",
        None,
    )
    shear: Shear = key("Weft displacement over warp distance.", None, left_out="0, then as in the stage before")
    clamp_rotation: Turn = key(
        "Counter-clockwise rotation of every clamp about the point where it holds its wire. Gripped meshes with"
        ' `drive = "relax"` only, without cord or pull.',
        None,
        left_out="0, then as in the stage before",
    )
    temperature: Temperature = key(
        "Temperature at the end of the stage, at the middle of the mesh.",
        None,
        left_out="the reference temperature, then as in the stage before",
    )
    temperature_gradient: TemperatureGradient = key(
        'Temperature gradient along weft and warp. Gripped meshes with `drive = "relax"` only.',
        None,
        left_out="none, then as in the stage before",
    )
    pull: tuple[Pull, ...] = key("Displaced places of the edge.", None, left_out="none, then as in the stage before")

    @model_validator(mode="before")
    @classmethod
    def _one_drive_a_direction(cls, data: Any) -> Any:
        return exclusive(data, ("strain_weft", "tension_weft", "displacement"), ("strain_warp", "tension_warp", "displacement"))

    @property
    def by_tension(self) -> tuple[bool, bool]:
        """Whether weft and warp are driven by tension."""
        return self.strain_weft is None, self.strain_warp is None

    @property
    def text(self) -> str:
        """The state at its end in words: what drives weft and warp, or a hook, and the temperature."""
        driven = ((self.strain_weft, self.tension_weft), (self.strain_warp, self.tension_warp))
        sides = [
            f"strain {100.0 * strain:.6g} %" if strain is not None else f"tension {exact(tension or 0.0, 'N/m')}"
            for strain, tension in driven
        ]
        equal = sides[0] == sides[1]
        parts = [f"{sides[0]} in weft and warp"] if equal else [f"{sides[0]} in weft", f"{sides[1]} in warp"]
        if self.displacement is not None:
            parts = [f"displacement {exact(self.displacement, 'm')}"]
        elif self.shear:
            parts.append(f"shear {100.0 * self.shear:.6g} %")
        if self.clamp_rotation:
            parts.append(f"clamps rotated by {degrees(self.clamp_rotation):.6g} deg")
        if self.pull:
            parts.append(f"{len(self.pull)} pull{'s' if len(self.pull) > 1 else ''} of the edge")
        gradient = ", with a gradient" if any(self.temperature_gradient) else ""
        return f"{', '.join(parts)}, at {celsius(self.temperature)}{gradient}"


@dataclass(frozen=True, kw_only=True)
class Sweep(Table):
    """[sweep]: the grid of strains, or of tensions, that `warpknit map` runs."""

    strain_weft: Annotated[tuple[Strain, ...], Field(min_length=1)] | None = key(
        "Weft strains; `warpknit map` combines each with each warp strain.", None, left_out="required, or tensions"
    )
    strain_warp: Annotated[tuple[Strain, ...], Field(min_length=1)] | None = key(
        "Warp strains.", None, left_out="required, or tensions"
    )
    tension_weft: Annotated[tuple[Tension, ...], Field(min_length=1)] | None = key(
        "Instead of both strains: weft tensions, combined with each warp tension.", None
    )
    tension_warp: Annotated[tuple[Tension, ...], Field(min_length=1)] | None = key("Warp tensions.", None)
    seeds: Seeds = key(
        "With `knit.scatter`: number of meshes, with seeds from `knit.seed` on, over which the map is averaged.", 1
    )

    @model_validator(mode="before")
    @classmethod
    def _strains_or_tensions(cls, data: Any) -> Any:
        data = exclusive(data, *((f"strain_{one}", f"tension_{other}") for one in SIDES for other in SIDES))
        if isinstance(data, dict):
            quantity = "tension" if any(f"tension_{side}" in data for side in SIDES) else "strain"
            for side in SIDES:
                if f"{quantity}_{side}" not in data:
                    raise refused(
                        "is missing", "write a list with at least one entry", key=f"{quantity}_{side}", given="the list"
                    )
        return data

    @property
    def by_tension(self) -> bool:
        """Whether the loads are tensions, not strains."""
        return self.tension_weft is not None

    @property
    def quantity(self) -> str:
        """The loads in a word."""
        return "tensions" if self.by_tension else "strains"

    @property
    def axes(self) -> tuple[list[float], list[float]]:
        """Strains, or tensions [N/m], in weft and in warp, each once and in their order."""
        weft, warp = (self.tension_weft, self.tension_warp) if self.by_tension else (self.strain_weft, self.strain_warp)
        return sorted(set(weft or ())), sorted(set(warp or ()))

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """Loads of the map, weft and warp, line by line."""
        weft, warp = self.axes
        return [(x, y) for y in warp for x in weft]

    def stage(self, load: Stage, pair: tuple[float, float]) -> Stage:
        """`load`, with a pair of strains or tensions of the map."""
        strains, tensions = ((None, None), pair) if self.by_tension else (pair, (None, None))
        return replace(
            load, strain_weft=strains[0], strain_warp=strains[1], tension_weft=tensions[0], tension_warp=tensions[1],
            name=f"weft {pair[0]:g}, warp {pair[1]:g}",
        )  # fmt: skip
