"""Recorded data of a run: one `WireLayout`, and one `Frame` for each recorded state.

NumPy arrays in SI units, independent of the solver and of Warp. x is weft, y is warp, z > 0 the technical
face.

A frame's mean deformation carries a rest vector (X, Y) of the cloth to

    x = (1 + strain_weft) X + shear Y
    y = (1 + strain_warp) Y
"""

import os
import zipfile
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.files import write_arrays
from ..base.text import short_repr

POINTS_A_LOOP = 128  # of the drawn curve of small meshes, about
MOST_PARTS = 8  # between two nodes
POINTS_DRAWN = 20_000  # largest number of points of all drawn curves; beyond, nodes only

Kind = TypeVar("Kind", bound="Archived")
Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.integer[Any]]


def state_file(directory: Path, index: int) -> Path:
    """The file of a recorded state in the directory of a run."""
    return directory / "states" / f"state_{index:06d}.npz"


@dataclass(frozen=True, eq=False, repr=False)
class Archived:
    """Arrays that are kept in an .npz file."""

    __repr__ = short_repr

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an .npz atomically."""
        write_arrays(path, {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)})

    @classmethod
    def load(cls: type[Kind], path: str | os.PathLike[str]) -> Kind:
        """Read an .npz. Raises ValueError where it holds something else."""
        try:
            with np.load(path, allow_pickle=False) as archive:
                wanted = [f.name for f in fields(cls) if f.name in archive or f.default_factory is MISSING]
                values = {name: archive[name] for name in wanted}
        except (KeyError, OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            if isinstance(error, FileNotFoundError):
                raise
            raise ValueError(f"{path}: not a saved {cls.__name__}") from error
        return cls(**{name: value if value.ndim else value.item() for name, value in values.items()})


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WireLayout(Archived):
    """Nodes, wires and bodies; the same for every frame of a run.

        wire_start        [wire + 1]          nodes of wire w are wire_start[w]:wire_start[w + 1]
        wire_closed       [wire]              whether a wire continues at its first node, shifted by wire_closing
        wire_closing      [wire, 2] [m]       that shift
        period            [2] [m]             width and height of the tile at rest
        repeats           [2]                 of the knit in weft and warp; 0 where unknown
        diameter          [m]                 of the yarn, with plating and parallel ends; where wires differ, of the thickest
        wire_diameter     [wire] [m]          of each wire
        body_radius       [m]                 of a contact body
        body_wires        [body, 2]           the wires of pairs 2b and 2b + 1, which belong to body b
        body_class        [body]              class of the contact: 0 = A, 1 = B, ...; empty where unknown
        rhombus_bodies    [k]                 bodies around the central opening; may be empty
        curve_parts                           straight pieces of the drawn curve between two nodes
        wire_count, node_count, body_count, in_space

    A body is a place where two wires hook each other; of wires from a file also where they cross or come near each other.
    """

    wire_start: Integers  # [wire + 1]  nodes of wire w are wire_start[w]:wire_start[w + 1]
    wire_closed: NDArray[np.bool_]  # [wire]  a closed wire continues at its first node, shifted by wire_closing
    period: Floats  # [2] [m]  width and height of the tile at rest
    diameter: float  # [m]  of the yarn: `Wire.thickness`, plating and parallel ends included; wires are drawn as thick as this
    body_radius: float  # [m]
    body_wires: Integers  # [body, 2]  the wires of pairs 2b and 2b + 1
    rhombus_bodies: Integers  # [k]  bodies around the central opening; may be empty
    repeats: Integers = field(default_factory=lambda: np.zeros(2, dtype=np.int64))  # [2]  of the knit; 0 where unknown
    wire_closing: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # [wire, 2] [m]  left out: one period up the warp
    wire_diameter: Floats = field(default_factory=lambda: np.zeros(0))  # [wire] [m]  left out: `diameter`
    curve_parts: int = field(default_factory=lambda: 1)  # straight pieces of the drawn curve between two nodes
    body_class: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # [body]  class of contact; empty: unknown

    def __post_init__(self) -> None:
        for name, kind, shape in (
            ("wire_start", np.int64, (-1,)),
            ("wire_closed", np.bool_, (-1,)),
            ("period", np.float64, (2,)),
            ("body_wires", np.int64, (-1, 2)),
            ("rhombus_bodies", np.int64, (-1,)),
            ("repeats", np.int64, (2,)),
            ("wire_closing", np.float64, (-1, 2)),
            ("wire_diameter", np.float64, (-1,)),
            ("body_class", np.int64, (-1,)),
        ):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=kind).reshape(shape))
        if self.wire_start.size < 2 or self.wire_start[0] != 0 or np.any(np.diff(self.wire_start) < 1):
            raise ValueError("wire_start: must begin with 0 and increase")
        if not self.wire_closing.size:
            object.__setattr__(self, "wire_closing", np.outer(self.wire_closed, (0.0, self.period[1])))
        if not self.wire_diameter.size:
            object.__setattr__(self, "wire_diameter", np.full(self.wire_count, self.diameter))
        for name in ("wire_diameter", "wire_closing", "wire_closed", "body_class"):
            count, given = self.body_count if name == "body_class" else self.wire_count, len(getattr(self, name))
            if given != count and (given or name != "body_class"):  # classes may be unknown
                raise ValueError(f"{name}: {given} values, not {count}")
        for name, count in (("body_wires", self.wire_count), ("rhombus_bodies", self.body_count)):
            values = getattr(self, name)
            if np.any((values < 0) | (values >= count)):
                raise ValueError(f"{name}: must lie in 0 .. {count - 1}")

    @property
    def wire_count(self) -> int:
        return self.wire_start.size - 1

    @property
    def node_count(self) -> int:
        return int(self.wire_start[-1])

    @property
    def body_count(self) -> int:
        return int(self.body_wires.shape[0])

    @property
    def in_space(self) -> bool:
        """Whether wires touch without bodies between them, and so also where no wires hook."""
        return self.body_radius == 0.0

    @cached_property
    def curve_node(self) -> Integers:
        """[point]  the node at each point of the drawn curves; a closed wire repeats its first node at its end."""
        first, end = self.wire_start[:-1][self.wire_closed], self.wire_start[1:][self.wire_closed]
        return np.asarray(np.insert(np.arange(self.node_count), end, first))

    @cached_property
    def curve_closing(self) -> Integers:
        """[closed wire]  the points of the drawn curves that close a wire, shifted by one period."""
        end = self.wire_start[1:][self.wire_closed]
        return end + np.arange(end.size)

    @cached_property
    def curve_start(self) -> Integers:
        """[wire + 1]  points of the drawn curve of wire w are curve_start[w]:curve_start[w + 1]."""
        return self.wire_start + np.concatenate(([0], np.cumsum(self.wire_closed)))

    @cached_property
    def curve_segment(self) -> Integers:
        """[segment]  the first point of every segment of the drawn curves; its second is the next point."""
        is_first = np.ones(int(self.curve_start[-1]), dtype=bool)
        is_first[self.curve_start[1:] - 1] = False
        return np.flatnonzero(is_first)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Frame(Archived):
    """One recorded state.

        index                                 counts the records of a run from 0
        stage, load_factor                    name of the stage, and share of its load, 0 to 1
        strain_weft, strain_warp, shear       of the mesh as a whole, relative to its size as knitted
        temperature       [K]
        node_position     [node, 3] [m]       weft, warp, normal; in the planar model z is the height as knitted
        node_stress       [node] [Pa]         largest stress of the wire at a node
        body_position     [body, 3] [m]       places where two wires hook each other
        pair_force        [pair] [N]          normal contact force where wires hook; pairs 2b and 2b + 1 belong to body b
        pair_active       [pair]              whether the force of a pair exceeds the threshold
        body_force        [body] [N]          the smaller force of the two pairs
        body_active       [body]              whether both pairs are active
        deformation       [2, 2]              mean deformation gradient, of strains and shear
        between           [node, curve_parts - 1, 3] [m]  points of the drawn curve to the next node, relative to the node
        elsewhere_position  [contact, 3] [m]  active contacts between stitches; empty in planar models and old files
        elsewhere_force     [contact] [N]     their normal force
        elsewhere_wires     [contact, 2]      the wires that touch; twice the same where a wire touches itself
        contact_force     [place] [N]         active contacts of a periodic mesh; empty otherwise and in old files
        contact_wires     [place, 2]          the wires that touch
        contact_share     [place, 2]          where along each wire, in shares of its length from its first node

    Nodes, wires and bodies belong to the `WireLayout` of the run. The number of contacts between stitches differs from record to
    record. On a periodic tile such a contact lies where its first wire is drawn; its second may be an image.
    """

    index: int  # counts the records of a run from 0
    stage: str
    load_factor: float  # 0 .. 1 within the stage
    strain_weft: float
    strain_warp: float
    shear: float
    temperature: float  # [K]
    node_position: Floats  # [node, 3] [m]  z is the rest height in the planar model
    node_stress: Floats  # [node] [Pa]
    body_position: Floats  # [body, 3] [m]
    pair_force: Floats  # [pair] [N]  pairs 2b and 2b + 1 belong to body b
    pair_active: NDArray[np.bool_]  # [pair]
    # [node, curve_parts - 1, 3] [m]  points on the curve to the next node, relative to the node; empty for nodes only
    between: Floats = field(default_factory=lambda: np.zeros((0, 0, 3), dtype=np.float32))
    elsewhere_position: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # [contact, 3] [m]  at no body
    elsewhere_force: Floats = field(default_factory=lambda: np.zeros(0))  # [contact] [N]
    elsewhere_wires: Integers = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))  # [contact, 2]
    contact_force: Floats = field(default_factory=lambda: np.zeros(0))  # [place] [N]  active contacts of a periodic mesh
    contact_wires: Integers = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))  # [place, 2]
    contact_share: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # [place, 2]  of the length of each wire

    def __post_init__(self) -> None:
        nodes, bodies, elsewhere = (len(x) for x in (self.node_position, self.body_position, self.elsewhere_position))
        places = len(self.contact_force)
        for name, shape in (
            ("node_position", (nodes, 3)),
            ("node_stress", (nodes,)),
            ("body_position", (bodies, 3)),
            ("pair_force", (2 * bodies,)),
            ("pair_active", (2 * bodies,)),
            ("between", (nodes if np.size(self.between) else 0, np.shape(self.between)[1], 3)),
            ("elsewhere_position", (elsewhere, 3)),
            ("elsewhere_force", (elsewhere,)),
            ("elsewhere_wires", (elsewhere, 2)),
            ("contact_wires", (places, 2)),
            ("contact_share", (places, 2)),
        ):
            array = np.asarray(getattr(self, name), dtype=np.bool_ if name == "pair_active" else None)
            if array.shape != shape:
                raise ValueError(f"{name}: shape {array.shape}, expected {shape}")
            object.__setattr__(self, name, array)
        if self.index < 0:
            raise ValueError(f"index: {self.index} is negative")

    @property
    def deformation(self) -> Floats:
        """[2, 2]  the mean deformation gradient, see the top of this file."""
        return np.array([[1.0 + self.strain_weft, self.shear], [0.0, 1.0 + self.strain_warp]])

    @property
    def body_active(self) -> NDArray[np.bool_]:
        """[body]  a body is active when both its pairs are."""
        return np.asarray(self.pair_active.reshape(-1, 2).all(axis=1))

    @property
    def body_force(self) -> Floats:
        """[body] [N]  the force between the two wires: the smaller one of the two pairs."""
        return np.asarray(self.pair_force.reshape(-1, 2).min(axis=1))

    def require_finite(self) -> None:
        """Raise ValueError where a value is not finite."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not isinstance(value, str) and not np.all(np.isfinite(value)):
                where = f" at {tuple(map(int, np.argwhere(~np.isfinite(value))[0]))}" if np.ndim(value) else ""
                raise ValueError(f"frame {self.index}: {entry.name} is not finite{where}")

    def require_layout(self, layout: WireLayout) -> None:
        """Raise ValueError where the counts differ from the layout's."""
        nodes, bodies = len(self.node_position), len(self.body_position)
        if (nodes, bodies) != (layout.node_count, layout.body_count):
            expected = f"{layout.node_count} and {layout.body_count}"
            raise ValueError(f"frame {self.index}: {nodes} nodes and {bodies} bodies, but the layout has {expected}")
        if np.any((self.elsewhere_wires < 0) | (self.elsewhere_wires >= layout.wire_count)):
            raise ValueError(f"frame {self.index}: elsewhere_wires must lie in 0 .. {layout.wire_count - 1}")
        if layout.curve_parts > 1 and self.between.shape[1] != layout.curve_parts - 1:
            raise ValueError(f"frame {self.index}: {self.between.shape[1]} places between nodes, not {layout.curve_parts - 1}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an .npz atomically. Raises ValueError rather than writing a number that is not finite."""
        self.require_finite()
        super().save(path)


def curve_parts(nodes: int, nodes_per_loop: int) -> int:
    """Straight pieces between two nodes for a smooth drawn curve; 1 in large meshes."""
    return max(1, min(-(-POINTS_A_LOOP // nodes_per_loop), MOST_PARTS, POINTS_DRAWN // max(nodes, 1)))


def drawn_layout(layout: WireLayout) -> WireLayout:
    """The layout with the points of the drawn curves as nodes."""
    if layout.curve_parts == 1:
        return layout
    last = ~layout.wire_closed
    points = (np.diff(layout.wire_start) - last) * layout.curve_parts + last
    return replace(layout, wire_start=np.concatenate([[0], np.cumsum(points)]), curve_parts=1)


def drawn_frame(layout: WireLayout, frame: Frame) -> Frame:
    """The frame of `drawn_layout`, with stress interpolated linearly between nodes."""
    if layout.curve_parts == 1:
        return frame
    frame.require_layout(layout)
    first, last = layout.wire_start[:-1], layout.wire_start[1:] - 1
    following = np.arange(layout.node_count) + 1
    following[last] = np.where(layout.wire_closed, first, last)
    kept = np.ones((layout.node_count, layout.curve_parts), dtype=bool)
    kept[last[~layout.wire_closed], 1:] = False
    node = np.asarray(frame.node_position)[:, None]
    position = np.concatenate([node, node + frame.between], axis=1)
    share = np.arange(layout.curve_parts) / layout.curve_parts
    stress = np.asarray(frame.node_stress)[:, None]
    stress = stress + share * (stress[following] - stress)
    return replace(frame, node_position=position[kept], node_stress=stress[kept], between=np.zeros((0, 0, 3), dtype=np.float32))


def curve_position(layout: WireLayout, frame: Frame) -> Floats:
    """[point, 3] [m]  the drawn curves: the nodes, and at the end of each closed wire its shifted first node."""
    frame.require_layout(layout)
    if not layout.curve_closing.size:
        return frame.node_position
    position = frame.node_position[layout.curve_node]
    position[layout.curve_closing, :2] += layout.wire_closing[layout.wire_closed] @ frame.deformation.T
    return position
