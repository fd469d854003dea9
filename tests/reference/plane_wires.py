"""Meshes made by hand for the verification tests: single wires of any shape, with bodies where a test puts them.

A `Rig` is such a mesh with its state: it takes positions and gives forces, or takes steps. Positions and forces of
nodes and bodies stand in one array (node + body, 2), nodes first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from warpknit.kernels.clamp import CLAMP_NUMBERS
from warpknit.kernels.contact import CLOSEST_POINT_DOUBLE, CURVE_COEFFICIENTS
from warpknit.kernels.wire_forces import BLOCK_SIZE
from warpknit.mesh.panel import END_NODES, Panel
from warpknit.mesh.rest_table import Table, _fit_rest_curve
from warpknit.planar.host_state import evaluation
from warpknit.planar.model import Model, assemble_model
from warpknit.planar.observables import PlanarObservables, read
from warpknit.planar.state import initial_state
from warpknit.planar.world_step import WorldStepper
from warpknit.scene import Scene, make_scene

LEAD = BLOCK_SIZE + 40
CLOSEST_POINT_TOLERANCE = float(CLOSEST_POINT_DOUBLE)  # segments between contact point and closest point
EPSILON = float(np.finfo(np.float64).eps)
DIAMETER = 15e-6  # [m] of every wire here


def scene_with(**solver: object) -> Scene:
    """A scene for its wire and solver tables; the knit in it is not used."""
    return make_scene(
        {
            "wire": {"material": "tungsten", "diameter": "15 um"},
            "model": {"kind": "planar"},
            "solver": {"drive": "ramp", "precision": "double", "axial_softening": 1.0, "multipliers": False, **solver},
        }
    )


def table_of_wires(shapes: Sequence[np.ndarray], closed: bool = False, natural: Sequence[np.ndarray] | None = None) -> Table:
    """Table with one thread a wire; `shapes` are node positions (n, 2) [m]. A closed wire returns to its first node.

    `natural` gives the stress-free shapes where they differ from the ones to start from (same number of nodes). The
    last nodes of an open wire stand for half a segment.
    """
    parts: dict[str, list[np.ndarray]] = {}
    start, nodes, offset = [], [], 0
    for w, shape in enumerate(shapes):
        n = len(shape)
        free = shape if natural is None else natural[w]
        index = np.arange(-LEAD, n + LEAD)
        wrap = np.mod(index, n) if closed else np.clip(index, 0, n - 1)
        step = np.mod(wrap + 1, n) if closed else np.clip(wrap + 1, 0, n - 1)
        back = np.mod(wrap - 1, n) if closed else np.clip(wrap - 1, 0, n - 1)
        edge = shape[step] - shape[wrap]
        e, b = free[step] - free[wrap], free[wrap] - free[back]
        length, before = np.hypot(*e.T), np.hypot(*b.T)
        node_length = 0.5 * (length + before)
        spacing = np.mean(length[length > 0])
        length = np.where(length > 0, length, spacing)  # beyond the ends: never used, but divided by
        before = np.where(before > 0, before, spacing)
        edge = np.where(np.hypot(*edge.T)[:, None] > 0, edge, [[spacing, 0.0]])
        angle = np.arctan2(b[:, 0] * e[:, 1] - b[:, 1] * e[:, 0], np.sum(b * e, axis=1))
        for name, value in dict(  # noqa: C408
            x=shape[wrap, 0], y=shape[wrap, 1], z=0 * length, rest_x=edge[:, 0], rest_y=edge[:, 1], rest_length=length,
            rest_bow=np.zeros(len(wrap)), rest_turn=angle, rest_angle=angle, hinge_length=0.5 * (length + before),
            node_length=node_length, curve=np.zeros((len(wrap), CURVE_COEFFICIENTS)),
        ).items():  # fmt: skip
            parts.setdefault(name, []).append(value)
        start.append(offset + LEAD)
        nodes.append(n)
        offset += len(index)
    spacings = np.array([np.mean(np.hypot(*np.diff(s, axis=0).T)) for s in shapes])
    return Table(
        start=np.array(start), nodes=np.array(nodes), spacing=spacings, lead=LEAD, curve_error=0.0,
        **{name: np.concatenate(value) for name, value in parts.items()},
    )  # fmt: skip


def table_of_circle(radius: float, nodes: int, *, with_curve: bool) -> Table:
    """A closed circle run counter-clockwise; `with_curve` fits the contact curve to the arc, else it is
    Catmull-Rom's."""
    table = table_of_wires([circle(radius, nodes)], closed=True)
    if not with_curve:
        return table
    spacing = 2 * np.pi * radius / nodes

    def centre_line(arc: np.ndarray) -> np.ndarray:
        return radius * np.stack([np.cos(arc / radius), np.sin(arc / radius), 0 * arc], axis=-1)

    coefficients, miss = _fit_rest_curve(centre_line, nodes, spacing)
    entry = np.mod(np.arange(len(table.x)) - LEAD, nodes)
    return Table(**{**vars(table), "curve": coefficients[entry], "curve_error": miss})


def panel_of_wires(
    table: Table,
    closed: bool = False,
    held: Sequence[int] = (),
    bodies: np.ndarray | None = None,
    pairs: Sequence[tuple[int, int, int]] = (),
    block_size: int = BLOCK_SIZE,
) -> Panel:
    """Wires of the table, held nodes that move with nothing, and bodies with pairs (wire, segment near the body,
    side)."""
    count = table.nodes
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    blocks = [(w, low) for w in range(len(count)) for low in range(0, count[w], block_size)]
    wire_of, low_of = np.array(blocks).T
    bodies = np.zeros((0, 2)) if bodies is None else np.asarray(bodies, float)
    wire = np.array([p[0] for p in pairs], dtype=int)
    segment = np.array([p[1] for p in pairs], dtype=int)
    around = 2 * count[wire]
    i32: Callable[..., np.ndarray] = lambda a: np.array(a, dtype=np.int32)  # noqa: E731
    return Panel(
        size=np.array([4e-3, 4e-3]),
        low=np.zeros(2),
        boundary="periodic" if closed else "gripped",
        wire_first=i32(first),
        wire_count=i32(count),
        wire_closed=np.full(len(count), closed),
        wire_thread=i32(np.arange(len(count))),
        wire_length=(count - (not closed)) * table.spacing,
        wire_clamp=np.zeros((len(count), 2, CLAMP_NUMBERS)),
        block_first=i32(first[wire_of] + low_of),
        block_count=i32(np.minimum(block_size, count[wire_of] - low_of)),
        block_table=i32(table.start[wire_of] + low_of),
        block_wire=i32(wire_of),
        block_origin=np.zeros((len(blocks), 2)),
        body_clasp=i32(np.zeros(len(bodies))),
        body_rest=bodies,
        body_origin=np.zeros_like(bodies),
        pair_wire=i32(wire),
        pair_seed=i32(first[wire] + segment),
        pair_table=i32(table.start[wire] + segment),
        pair_shift=np.zeros((len(wire), 2)),
        pair_low=i32(-around if closed else END_NODES - segment),
        pair_high=i32(around if closed else count[wire] - 2 - END_NODES - segment),
        pair_side=i32([p[2] for p in pairs]),
        held_node=i32(sorted(held)),
        held_lever=np.zeros((len(held), 2)),
        held_clamp=i32(np.zeros(len(held))),
        clamp_position=np.zeros((1 if len(held) else 0, 2)),
    )


def model_of_wires(table: Table, panel: Panel, device: str = "cpu", **solver: object) -> Model:
    return assemble_model(scene_with(**solver), table, panel, device=device, loop_length=1e-3, displacement_range=4e-3)


def straight(nodes: int, spacing: float, y: float = 0.0) -> np.ndarray:
    """Node positions (nodes, 2) [m] along x."""
    return np.stack([spacing * np.arange(nodes), np.full(nodes, y)], axis=1)


def circle(radius: float, nodes: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(nodes) / nodes
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


class Rig:
    """A mesh made by hand and its state, undamped and unwatched unless a test says otherwise."""

    def __init__(self, table: Table, panel: Panel, device: str = "cpu", *, by_pair: bool | None = None, **solver: object) -> None:
        self.model = model_of_wires(table, panel, device, **solver)
        self.state = initial_state(self.model)
        self.worlds = WorldStepper(self.model, state=self.state, by_pair=by_pair)
        (self.stepper,) = self.worlds.steppers
        entry = self.model.panel.node_entry
        self.rest = np.concatenate([np.stack([table.x[entry], table.y[entry]], axis=1), panel.body_rest])
        body_mass = np.full(panel.body_count, self.model.body_mass)
        self.mass = np.concatenate([1.0 / self.model.rest.inverse_mass.numpy()[entry].astype(float), body_mass])
        self.control(step_limit=np.inf, travel_limit=np.inf)
        self.set_time_step(self.model.time_step)

    @property
    def nodes(self) -> int:
        return self.model.panel.node_count

    def control(self, **values: float | np.ndarray) -> None:
        self.state.steering.set(**values)

    def set_time_step(self, time_step: float, damping: float = 0.0) -> None:
        """Step [s] and mass-proportional damping [1/s]."""
        self.time_step = time_step
        half = 0.5 * damping * time_step
        factors = {"velocity_factor": (1 - half) / (1 + half), "force_factor": time_step / (1 + half)}
        self.control(time_step=time_step, damping=damping, **factors)

    def place(self, position: np.ndarray) -> None:
        """Put nodes and bodies at these positions [m]."""
        s, n = self.state, self.nodes
        counts = self.model.precision.counts(position - self.rest)
        for k, (ux, body_ux) in enumerate(((s.node_ux, s.body_ux), (s.node_uy, s.body_uy))):
            ux[s.parity].assign(counts[:n, k])
            body_ux.assign(counts[n:, k])

    def position(self) -> np.ndarray:
        s = self.state
        x = np.concatenate([s.node_ux[s.parity].numpy(), s.body_ux.numpy()])
        y = np.concatenate([s.node_uy[s.parity].numpy(), s.body_uy.numpy()])
        return self.rest + self.model.precision.unit * np.stack([x, y], axis=1)

    def set_velocity(self, velocity: np.ndarray) -> None:
        s, n = self.state, self.nodes
        for k, (vx, body_vx) in enumerate(((s.node_vx, s.body_vx), (s.node_vy, s.body_vy))):
            vx.assign(velocity[:n, k])
            body_vx.assign(velocity[n:, k])

    def velocity(self) -> np.ndarray:
        """Half a step behind the position."""
        s = self.state
        x = np.concatenate([s.node_vx.numpy(), s.body_vx.numpy()])
        y = np.concatenate([s.node_vy.numpy(), s.body_vy.numpy()])
        return np.stack([x, y], axis=1).astype(float)

    def step(self, count: int) -> None:
        self.stepper.step(count)

    def forces(self, position: np.ndarray | None = None) -> np.ndarray:
        """Forces [N] at these positions, or where things are; zero at held nodes."""
        if position is not None:
            self.place(position)
        self.worlds.probe(np.array([0]))
        s = self.state
        acceleration = np.stack([values.numpy() for values in self.worlds.accelerations[0]], axis=1)
        force = np.zeros_like(self.rest)
        force[: self.nodes] = acceleration * self.mass[: self.nodes, None]
        if self.model.pair_count:
            on_body = np.stack([s.pair_body_x.numpy(), s.pair_body_y.numpy()], axis=1)
            on_body[s.pair_force.numpy() == 0.0] = 0.0  # stale
            force[self.nodes :] = on_body.reshape(-1, 2, 2).sum(axis=1)
        return force

    def observables(self, position: np.ndarray | None = None) -> PlanarObservables:
        if position is not None:
            self.forces(position)
        return read(self.model, self.state)

    def stored_energy(self, position: np.ndarray) -> float:
        return self.observables(position).energies.stored

    def stiffness(self, position: np.ndarray, step: float) -> np.ndarray:
        """Hessian of the energy [N/m] by central differences of the forces."""
        flat = position.ravel()
        rows = []
        for i in range(len(flat)):
            moved = np.zeros_like(flat)
            moved[i] = step
            pull = [self.forces((flat + sign * moved).reshape(-1, 2)).ravel() for sign in (1, -1)]
            rows.append((pull[1] - pull[0]) / (2 * step))
        return np.array(rows)

    def rest_position(
        self, position: np.ndarray, free: np.ndarray, load: np.ndarray | float = 0.0, tolerance: float = 1e-10
    ) -> np.ndarray:
        """Where forces and `load` [N] balance at the `free` components (node + body, 2), by Newton's method from
        `position`.

        `tolerance` [N] is on the largest force.
        """
        x = position.copy()
        spacing = float(self.model.table.spacing.min())
        for _ in range(60):
            out_of_balance = (self.forces(x) + load)[free]
            if np.max(np.abs(out_of_balance)) < tolerance:
                return x
            stiffness = self.stiffness(x, 1e-6 * spacing)[np.ix_(free.ravel(), free.ravel())]
            move = np.linalg.solve(stiffness, out_of_balance)
            x[free] += move * min(1.0, 0.3 * spacing / np.max(np.abs(move)))
        raise AssertionError(f"no rest position: largest force {np.max(np.abs(out_of_balance)):.3g} N is left")


def strains(model, state) -> np.ndarray:
    """[node] strain of the curved segments (kernels/energy.py)."""
    names = ("tension", "turning", "force_x", "force_y", "strain")
    out = {n: wp.zeros(model.panel.node_count, dtype=model.precision.real, device=model.device) for n in names}
    evaluation(model, state, out, (0, len(model.panel.block_first))).run(model.device)
    return out["strain"].numpy().astype(np.float64)
