"""The hook of a scene: two arcs of wire in place of a knit, what loads them, and how their contact is carried."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from warpknit.scene.file import TREATMENT_KEYS, PanelTable, SceneFile, StageTable
from warpknit.scene.wire import Wire

if TYPE_CHECKING:
    from warpknit.scene.source import Source

SHORTEST = 0.5  # radii of wire
LEAST_OVERLAP = 1.5  # diameters of the wire
LEAST_RADIUS = 4.0  # diameters of the wire
CROSSING = 1.3  # thicknesses of the wire by which hooked wires pass each other at rest, as in a knit


@dataclass(frozen=True, kw_only=True)
class Hook:
    """Two arcs of wire that hook each other; see hook.py."""

    radius: Annotated[float, "m"]
    length: Annotated[float, "m"]  # of each wire
    overlap: Annotated[float, "m"]  # by which each reaches through the other at rest
    crossing_distance: Annotated[float, "m"] | None  # of centre lines where they cross at rest; None: in one plane

    @property
    def height(self) -> float:
        """[m] of the upper ends above the lower ones, at rest."""
        return 2.0 * self.radius * math.sin(0.5 * self.length / self.radius)


def hook_of(source: Source, file: SceneFile, wire: Wire) -> Hook | None:
    """The hook with its defaults, None where there is none. Raises `SceneError` for what a hook cannot be, or have beside it."""
    table = file.hook
    if table is None:
        return None
    length = 2.0 * math.pi / 3.0 * table.radius if table.length is None else table.length
    overlap = 0.2 * table.radius if table.overlap is None else table.overlap
    least = LEAST_RADIUS * wire.diameter
    if table.radius < least:
        raise source.refusal(("hook", "radius"), table.radius, f"four diameters of the wire or more, {least:g} m")
    if not SHORTEST * table.radius <= length <= math.pi * table.radius:
        allowed = f"half a radius to half a circle, {SHORTEST * table.radius:g} to {math.pi * table.radius:g} m"
        raise source.refusal(("hook", "length"), length, allowed)
    rise = table.radius * (1.0 - math.cos(0.5 * length / table.radius))
    least = LEAST_OVERLAP * wire.diameter
    if not least <= overlap <= rise:
        allowed = (
            f"1.5 diameters of the wire to the rise of the arc, {least:g} to {rise:g} m:"
            " the wires must cross twice, with room for a body in between"
        )
        raise source.refusal(("hook", "overlap"), overlap, allowed)
    if file.model.boundary != "gripped":
        raise source.refusal(("model", "boundary"), file.model.boundary, "'gripped' with [hook]: its ends are held")
    if file.solver.precision == "single":
        raise source.refusal(("solver", "precision"), "single", "'double' with [hook], whose few nodes need no less")
    if file.sweep is not None:
        raise source.refusal(("sweep",), {}, "no [sweep] with [hook]: it has no strains")
    if file.panel != PanelTable():
        raise source.refusal(("panel",), {}, "no [panel] with [hook]: its ends are where its wires end")
    crossing = _crossing_distance(source, file, wire, overlap)
    return Hook(radius=table.radius, length=length, overlap=overlap, crossing_distance=crossing)


def _crossing_distance(source: Source, file: SceneFile, wire: Wire, overlap: float) -> float | None:
    """[m] with its default, None in the plane."""
    given, key = file.hook.crossing_distance if file.hook else None, ("hook", "crossing_distance")
    if file.model.kind != "spatial":
        if given is not None:
            raise source.refusal(key, given, "left out with model.kind = 'planar', where both wires lie in one plane")
        return None
    distance = CROSSING * wire.thickness if given is None else given
    if not wire.thickness <= distance <= overlap:
        allowed = f"the thickness of the wire to hook.overlap, {wire.thickness:g} to {overlap:g} m"
        raise source.refusal(key, distance, allowed)
    return distance


def contact_values(source: Source, file: SceneFile, wire: Wire) -> dict[str, Any]:
    """[contact] with the defaults of its treatment; what the treatment does not have is None."""
    table, drive = file.contact, file.solver.drive
    given = table.model_dump()
    if file.hook is None and table.treatment != "free-body":
        allowed = "'free-body' for a knit; the others are for the two wires of [hook]"
        raise source.refusal(("contact", "treatment"), table.treatment, allowed)
    if table.body_mass is not None and drive == "relax":
        allowed = "only with solver.drive = 'ramp' (the masses of a relaxation are fictitious)"
        raise source.refusal(("contact", "body_mass"), table.body_mass, allowed)
    if table.ring_radius is not None and table.ring_radius < wire.radius:
        allowed = f"at least the radius of the wire, {wire.radius:g} m: the wires pass through the ring"
        raise source.refusal(("contact", "ring_radius"), table.ring_radius, allowed)
    if table.friction and table.treatment != "free-body":
        allowed = "0 but with contact.treatment = 'free-body': a study of one thing at a time"
        raise source.refusal(("contact", "friction"), table.friction, allowed)
    defaults = {
        "spring_stiffness": 1e-3,
        "ring_radius": wire.diameter,
        "plane_friction": 0.1,
        "plane_load": 1e-5,
        "contact_point": 0.5,
        "target_share": 1.0,
    }
    for key, value in defaults.items():
        if table.treatment in TREATMENT_KEYS[key] and given[key] is None:
            given[key] = value
    return given


def hook_loads(
    source: Source, stages: Iterator[tuple[tuple[int | str, ...], str, StageTable]], wire: Wire, hook: Hook
) -> Iterator[dict[str, Any]]:
    """Name, displacement, temperature and shear of the frame of each stage, given where it stands in the file, its name and its
    table; a stage takes over from the one before what it leaves out."""
    displacement, temperature = 0.0, wire.reference_temperature
    for location, name, table in stages:
        given = table.model_dump(exclude={"name"}, exclude_none=True)
        for key in given:
            if key not in ("displacement", "temperature"):
                raise source.refusal((*location, key), given[key], "displacement and temperature only with [hook]")
        displacement, temperature = given.get("displacement", displacement), given.get("temperature", temperature)
        if abs(displacement) > hook.length:
            allowed = f"at most the length of a wire, {hook.length:g} m"
            raise source.refusal((*location, "displacement"), displacement, allowed)
        shear = displacement / hook.height
        yield {"name": name, "displacement": displacement, "temperature": temperature, "shear": shear}
