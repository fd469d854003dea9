"""A whole scene file: its tables, checked, in SI.

None means that the value follows from others: `warpknit.scene.scene_loader` fills in what it can, the model chooses the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter, model_validator

from warpknit.scene.hook import Hook
from warpknit.scene.keys import Table, given_values, key
from warpknit.scene.knit import KnitTable
from warpknit.scene.loads import Stage, Sweep
from warpknit.scene.options import Contact, ModelOptions, Output, Solver
from warpknit.scene.panel_options import PanelTable
from warpknit.scene.values import Name, exclusive
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import WiresTable


@dataclass(frozen=True, kw_only=True)
class SceneFile(Table):
    """A whole scene file."""

    name: Name | None = key("Names the run and its directory.", None, left_out="the file's name without .toml")
    wire: Wire = key("What is knitted.", Wire())
    knit: KnitTable = key("How it is knitted.", KnitTable())
    hook: Hook | None = key("In place of `[knit]`: two arcs of wire that hook each other.", None)
    wires: WiresTable | None = key("In place of `[knit]`: a file of centre lines that others made.", None)
    model: ModelOptions = key("What is kept of the mesh.", ModelOptions())
    panel: PanelTable = key("What a gripped mesh is cut along and held by.", PanelTable())
    load: Stage = key("The first stage.", Stage())
    path: tuple[Stage, ...] = key("The stages after it.", ())
    contact: Contact = key("How wires touch.", Contact())
    solver: Solver = key("How the state is found.", Solver())
    output: Output = key("What is written.", Output())
    sweep: Sweep | None = key("What `warpknit map` runs.", None)

    @model_validator(mode="before")
    @classmethod
    def _one_kind_of_mesh(cls, data: Any) -> Any:
        return exclusive(data, ("knit", "hook", "wires"))

    @property
    def stages(self) -> tuple[Stage, ...]:
        """[load], then each [[path]], with what they take over; of a direction, the way that was given last."""
        stages: list[Stage] = []
        so_far: dict[str, Any] = {}
        for table in (self.load, *self.path):
            given = given_values(table)
            for direction in (("strain_weft", "tension_weft"), ("strain_warp", "tension_warp")):
                if "displacement" in given or any(key in given for key in direction):
                    so_far = {key: value for key, value in so_far.items() if key not in direction}
            so_far = {key: value for key, value in so_far.items() if key not in ("name", "displacement")} | given
            stages.append(Stage(**so_far))
        return tuple(stages)


def checked_file(table: dict[str, Any]) -> SceneFile:
    """The file of a table as read from TOML. Raises pydantic's `ValidationError`."""
    return _ADAPTER.validate_python(table)


_ADAPTER = TypeAdapter(SceneFile)
