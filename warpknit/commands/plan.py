"""Estimates of a run without running it: size, physics, memory, time step, steps, time.

    plan = make_plan(load_scene("scenes/atlas_patch.toml"))
    print("\n".join(plan.lines()))

Sizes are exact for small meshes, whose model is built, and those of endless cloth for large ones. planar/estimate.py and
spatial/estimate.py estimate steps and time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..base.text import celsius, duration, engineering, exact, memory, rounded
from ..compute.device import find_device
from ..compute.memory import available_memory, required_memory
from ..design.estimate import report_time
from ..design.findings import report_scene
from ..errors import SceneError
from ..knit.chain import parse_chain
from ..knit.cloth import Cloth, same_cloth
from ..mechanics.estimate import GPU_MEASURED, Size, levels_of_pairs
from ..mesh.layout import knit_scene, refuse_large_mesh
from ..mesh.rim import net_nodes
from ..runner.cautions import release_cautions, scene_cautions, sweep_cautions
from ..scene import Scene
from ..scene.capabilities import without_effect
from ..solve.model import build_model, estimates_of
from ..solve.simulate import Simulation
from ..wires.file_report import WireReport, wire_report

CLOSE_WIRES = 0.1  # thicknesses between centre lines of wires from a file, below which the start of a run is checked
PROGRAM_MEMORY = 430 * 2**20  # [bytes] of a run of few nodes, its libraries included


@dataclass(frozen=True)
class Plan:
    """Result of `make_plan`. `counted`: whether sizes are exact; `wall_s` on a GPU is that of GPU_MEASURED, or None."""

    scene: str
    device: str
    nodes: int
    wires: int
    bodies: int
    pairs: int
    memory_bytes: int
    available_bytes: int
    time_step_s: float
    limited_by: str
    steps: int
    wall_s: float | None
    physics: tuple[str, ...]
    counted: bool
    relaxes: bool
    knit: str
    sweep: str
    accuracy: str
    factor: float  # uncertainty of steps and time
    hooked_by: str  # meaning of the number of bodies, in words
    exception: str  # known exceptions to the estimate, in words
    kind: str  # of model
    kind_reason: str
    report_s: float | None  # of `warpknit report`; None of a scene without one
    report_map_s: float  # of this, the map
    loads: tuple[tuple[str, str], ...]  # heading and load of each stage, in words
    file: WireReport | None = None  # of wires from a file
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The object that `warpknit plan --json` prints."""
        values = asdict(replace(self, file=None))
        for name in ("scene", "device", "available_bytes", "counted", "relaxes", "knit", "sweep", "accuracy", "hooked_by"):
            del values[name]
        for name in ("factor", "exception", "file", "kind", "kind_reason", "warnings", "report_map_s", "loads"):
            del values[name]
        values["model"] = {"kind": self.kind, "kind_reason": self.kind_reason}
        file = {} if self.file is None else self.file.as_dict()
        return file | values | {"physics": list(self.physics)}

    @property
    def _report_text(self) -> str:
        rest = (self.report_s or 0.0) - self.report_map_s
        parts = f"{duration(self.report_map_s)} for its map, {duration(rest)} for curves, material card and page"
        return f"warpknit report takes about {duration(self.report_s or 0.0)} on this CPU: {parts}"

    def lines(self) -> list[str]:
        """The plan as lines of text."""
        about = "" if self.counted else "about "
        step = f"{engineering(self.time_step_s, 's')}, limited by {self.limited_by}"
        if self.relaxes:
            step = "1, stable by fictitious masses"
        if self.wall_s is None:
            time = "not estimated on a GPU"
        else:
            time = f"about {duration(self.wall_s)} on {'this CPU' if self.device == 'cpu' else GPU_MEASURED}, kernels compiled"
        if self.file is not None:
            mesh = self.file.rows()
        else:
            # the pieces of a cut are known once it is laid out
            wires = f" on {self.wires:,} wire{'s' if self.wires != 1 else ''}" if self.counted else ""
            mesh = [
                ("knit", self.knit) if self.knit else ("hook", "two wires, hooked once"),
                ("mesh", f"{about}{self.nodes:,} nodes{wires}"),
                ("contact", f"{about}{self.bodies:,} {self.hooked_by}"),
            ]
        rows = [
            ("scene", f"{self.scene}, on {self.device}"),
            *mesh,
            *self.loads,
            ("model", f"{self.kind} ({self.kind_reason})"),
            ("memory", f"{memory(self.memory_bytes)} of {memory(self.available_bytes)} available"),
            ("time step", step),
            ("steps", f"about {rounded(self.steps):,}"),
            *([("sweep", self.sweep)] if self.sweep else []),
            ("time", time),
            *([] if self.report_s is None else [("report", self._report_text)]),
            ("", f"steps and time within a factor of {self.factor:g}, for meshes like those measured"),
            *([("", self.exception)] if self.exception else []),
            ("accuracy", self.accuracy),
            ("physics", self.physics[0]),
            *(("", sentence) for sentence in self.physics[1:]),
            *(("warning", warning) for warning in self.warnings),
        ]
        return [f"{heading:<11}{text}" for heading, text in rows]


def make_plan(scene: Scene, device: str | None = None) -> Plan:
    """Plan a run of `scene`.

    Raises the errors of a run: `DeviceError`, `MemoryNeeded`, `ModelError`, `KnitError`, `SceneError`.
    """
    if device is not None:
        find_device(device)
    file = None if scene.wires is None else wire_report(scene)
    cloth = knit_scene(scene) if scene.hook is None and scene.wires is None else None
    estimates = estimates_of(scene)
    size, counted = estimates.size_of(scene, cloth)
    name = find_device(device, nodes=lambda: size.nodes)
    if cloth is not None:
        refuse_large_mesh(scene, cloth, name)
    _refuse_intersecting_wires(scene, file)
    cost, notes = estimates.cost_of(scene, size), estimates.notes(scene, size)
    report_s, report_map_s = _report(scene, size)
    return Plan(
        scene=scene.name,
        device=name,
        nodes=size.nodes,
        wires=size.wires,
        bodies=size.bodies,
        pairs=2 * size.bodies,
        memory_bytes=PROGRAM_MEMORY + required_memory(scene, size.nodes),
        available_bytes=min(available_memory(), available_memory(name)),
        time_step_s=size.time_step,
        limited_by=size.limited_by,
        steps=cost.steps,
        wall_s=cost.seconds if name == "cpu" else cost.gpu_seconds,
        physics=(
            *estimates.physics(scene, size),
            *physics_of(scene, size),
            *estimates.limitations(scene, cloth),
            *without_effect(scene),
        ),
        counted=counted,
        relaxes=scene.solver.drive == "relax",
        knit="" if cloth is None else _repeat(scene, cloth),
        sweep=_sweep(scene, size),
        accuracy=notes.accuracy,
        factor=notes.factor,
        hooked_by=notes.hooked_by,
        exception=notes.exception,
        kind=scene.model.kind,
        kind_reason=scene.kind_reason,
        report_s=report_s,
        report_map_s=report_map_s,
        loads=_loads(scene),
        file=file,
        warnings=(
            *(note for note in size.notes if file is None or note not in file.warnings),
            *scene_cautions(scene, cloth),
            *release_cautions(scene, cloth),
            *sweep_cautions(scene, cloth),
            *(() if cloth is None else estimates.overlaps_as_knitted(scene, _one_repeat(scene))),
        ),
    )


def _one_repeat(scene: Scene) -> Cloth:
    """One repeat of the cloth of a scene, with loops of the mean size."""
    return same_cloth(scene.knit.even, scene.wire.thickness, scene.model.merge_lenses)


def _refuse_intersecting_wires(scene: Scene, file: WireReport | None) -> None:
    """Raise `ModelError` where wires of a file pass through each other, as a run does."""
    overlaps = None if file is None else file.overlaps
    if overlaps is not None and overlaps.closest is not None and overlaps.closest < CLOSE_WIRES * overlaps.thickness:
        Simulation(build_model(scene)).compile()


def _loads(scene: Scene) -> tuple[tuple[str, str], ...]:
    """A line for each stage, with its name where there are several or it has one of its own."""
    named = len(scene.stages) > 1 or scene.stages[0].name != "load"
    texts = [f"{stage.name}: {stage.text}" if named else stage.text for stage in scene.stages]
    return tuple(("load" if number == 0 else "", text) for number, text in enumerate(texts))


def _sweep(scene: Scene, size: Size) -> str:
    """The sweep of `warpknit map` in words; empty without one."""
    if scene.sweep is None:
        return ""
    pairs = len(scene.sweep.pairs)
    meshes = f" of {scene.sweep.seeds} meshes" if scene.sweep.seeds > 1 else ""
    levels = levels_of_pairs(scene.sweep.pairs, scene.output.frames)
    seconds = scene.sweep.seeds * estimates_of(scene).map_time(scene, size, levels)
    return (
        f"warpknit map solves {pairs:,} pairs of {scene.sweep.quantity}{meshes} in about {duration(seconds)}; all other values"
        " are for one run of [load]"
    )


def _report(scene: Scene, size: Size) -> tuple[float | None, float]:
    """[s] of a report, and of its map; None and zero of a scene that has none."""
    try:
        by_map, rest = report_time(report_scene(scene), size)
    except SceneError:
        return None, 0.0
    return by_map + rest, by_map


def _repeat(scene: Scene, cloth: Cloth) -> str:
    """One repeat in words, with the number of links of each bar."""
    links = [len(parse_chain(bar.chain)) for bar in scene.knit.bars]
    text = f"a repeat of {cloth.wales} x {cloth.courses} stitches (wales x courses)"
    plan_view = engineering(cloth.stitch_length, "m")
    text += f", {engineering(cloth.wire_length, 'm')} of wire a loop ({plan_view} in plan view)"
    if len(set(links)) > 1:
        text += f"; chains of {' and '.join(map(str, links))} links, each over and over"
    return text


# --- physics ----------------------------------------------------------------------------------------------------------


def physics_of(scene: Scene, size: Size) -> Iterator[str]:
    """Physics that panel, wire, stages and solver switch on and why, one sentence each."""
    if scene.hook is None:
        yield from _panel_physics(scene)
    wire, solver = scene.wire, scene.solver
    if wire.set_fraction != 1.0:
        yield f"rest curvature: {wire.set_fraction:g} of the knitted one, given and not computed from yield, wire.set_fraction"
    if wire.plating is not None:
        coat = f"{1e6 * wire.plating.thickness:g} um of {wire.plating.material}"
        yield f"plating: {coat} adds stiffness, mass and thickness, wire.plating"
    if wire.ends > 1:
        yield f"ends: {wire.ends} wires side by side make one yarn, wire.ends"
    hot = [stage for stage in scene.stages if stage.temperature != wire.reference_temperature]
    if hot:
        names = ", ".join(f"{celsius(stage.temperature)} in {stage.name!r}" for stage in hot)
        yield f"thermal strain: {names}, zero at {celsius(wire.reference_temperature)}"
    if scene.hook is None and any(stage.shear for stage in scene.stages):
        yield "shear: given in a stage, load.shear"
    if any(stage.clamp_rotation for stage in scene.stages):
        yield "rotated clamps: given in a stage, load.clamp_rotation"
    if any(any(stage.by_tension) for stage in scene.stages):
        yield "tension search: a direction is given by tension; strains are varied until the equilibrium carries it"
    if scene.contact.friction:
        yield f"friction: bodies stick to their wires up to {scene.contact.friction:g} times the contact force, contact.friction"
    if wire.plastic:
        yield f"yield: plastic bending above {exact(wire.yield_stress, 'Pa')}, with a permanent set, wire.plastic"
    if scene.depends_on_path:
        yield "path: strain increments of at most 0.5 %, as results depend on the load history"
    elif solver.drive == "relax":
        path = "; a tight mesh may have several, of which the load path decides"
        if scene.hook is not None:
            by_plane = scene.contact.treatment == "friction-plane"
            path = f", independent of the load path{' (except by the friction of the plane)' if by_plane else ''}"
        yield f"relaxation: one equilibrium a load level{path}, solver.drive = 'relax'"
    else:
        yield f"ramp: {engineering(size.loading_time, 's')} of real time a stage, solver.drive = 'ramp'"
    if solver.drive == "ramp" and solver.mass_scaling != 1.0:
        yield f"mass scaling: all masses multiplied by {solver.mass_scaling:g}, solver.mass_scaling"
    if solver.drive == "ramp" and solver.target_time_step is not None:
        step = exact(solver.target_time_step, "s")
        yield f"mass scaling: masses raised for a stable step of {step}, solver.target_time_step"
    if solver.precision == "single":
        positions = "float64" if scene.model.kind == "spatial" else "32-bit fixed point"
        yield f"single precision: displacements are {positions}, the rest is float32, solver.precision"
    else:
        yield "double precision: float64 throughout, solver.precision"


def _panel_physics(scene: Scene) -> Iterator[str]:
    """Physics that [panel] and uneven loads switch on."""
    panel = scene.panel
    if panel.outline != "rectangle":
        yield f"outline: the mesh is cut along a {panel.outline}, panel.outline"
    if panel.cord is not None and panel.grip_pitch is not None:
        nodes, spacing = net_nodes(panel.shape(scene.knit.size), panel.grip_pitch)
        yield (
            f"cords: {nodes} net nodes hold the edge, at most {engineering(spacing, 'm')} apart, with a cord between them at"
            f" {exact(panel.cord.tension, 'N')} tension, panel.cord"
        )
    if any(stage.pull for stage in scene.stages):
        yield "pulls: prescribed displacements of places at the edge, [[load.pull]]"
    if any(any(stage.temperature_gradient) for stage in scene.stages):
        yield "temperature gradient: thermal strain varies from wire to wire, load.temperature_gradient"
    if panel.focal_length is not None:
        yield f"surface: shape of a panel under tension on a paraboloid of f = {exact(panel.focal_length, 'm')}"
