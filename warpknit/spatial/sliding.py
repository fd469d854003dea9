"""Whether friction opposes what the contacts slid from one equilibrium to the next.

Friction is that of the slip since the equilibrium before (kernels/wire_contact_forces.py). It may be lost as a mesh relaxes, as
by a contact that opens for a while. Where a contact slid by s, friction should be mu N against s. With the forces T and N of the
contacts that slid far,

    share = - sum T s/|s| / (mu sum N)        1 where all friction opposes the sliding, 0 where none does

s is the way of one surface over the other since the equilibrium before: of the material points that now touch, rotation of their
sections included, so a wire that rolls does not slide.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..host import fetch
from ..kernels import control as c
from ..measure.strain import stretch
from ..text import percent
from .contact_checks import STICK_SHARE
from .contacts import Contacts
from .model import SpatialModel
from .rod_step import RodStepper
from .wire_contact import WireContact

FAR = 10.0  # elastic slips at the Coulomb limit: what slid by more should have its whole friction against the sliding
COUNTED = 0.1  # of the contact force, which contacts that slid so far carry at least for a share to count
LEAST_SHARE = 0.75  # below which friction is told to be lost


@dataclass(frozen=True)
class Placement:
    """Places of all segments at an equilibrium; [node]."""

    position: np.ndarray  # (node, 3) [m] first node
    edge: np.ndarray  # (node, 3) [m] to the next node
    frame: np.ndarray  # (node, 3, 3) rows: director, director across it, tangent
    gradient: np.ndarray  # (2, 2) deformation gradient

    @staticmethod
    def of(stepper: RodStepper) -> Placement:
        """That of the state last evaluated."""
        state = stepper.state
        director, tangent = fetch(state.director), fetch(state.tangent)
        frame = np.stack([director, np.cross(tangent, director), tangent], axis=1)
        return Placement(
            fetch(state.position).copy(), fetch(state.length)[:, None] * tangent, frame, np.array(state.gradient, copy=True)
        )

    def points(self, segment: np.ndarray, place: np.ndarray) -> np.ndarray:
        """(contact, 3) [m] points of segments at places 0 .. 1."""
        return self.position[segment] + place[:, None] * self.edge[segment]


def slid(before: Placement, now: Placement, t: Contacts, radius: np.ndarray) -> np.ndarray:
    """(contact, 3) [m] way of the surface of the first segment over that of the second; radius [node] [m]."""
    way = np.zeros((len(t.force), 3))
    for segment, place, sign in ((t.first, t.place[:, 0], 1.0), (t.second, t.place[:, 1], -1.0)):
        lever = -sign * radius[segment][:, None] * t.normal
        turn = np.einsum("kij,kil->kjl", now.frame[segment], before.frame[segment])  # from before to now
        lever_before = np.einsum("kjl,kj->kl", turn, lever)
        way += sign * (now.points(segment, place) + lever - before.points(segment, place) - lever_before)
    way[:, :2] -= t.shift[:, :2] @ (now.gradient - before.gradient).T
    return way - np.sum(way * t.normal, axis=1)[:, None] * t.normal


def opposing_share(way: np.ndarray, t: Contacts, friction: float, stick_stiffness: float) -> float:
    """Share of the friction of contacts that slid far that opposes their sliding; nan where hardly any did."""
    distance = np.linalg.norm(way, axis=1)
    is_far = distance * stick_stiffness > FAR * friction * np.abs(t.force)
    force = float(t.force[is_far].sum())
    if force <= COUNTED * float(t.force.sum()):
        return np.nan
    along = np.sum(t.friction * way, axis=1)[is_far] / distance[is_far]
    return -float(along.sum()) / (friction * force)


class Sliding:
    """The check of one level after the other."""

    def __init__(self, model: SpatialModel, stepper: RodStepper, contact: WireContact, notes: list[str]) -> None:
        """notes: for the user, to which lost friction is added once."""
        self.model, self.stepper, self.contact, self.notes = model, stepper, contact, notes
        self.share = np.nan  # of the last equilibrium
        self._before: Placement | None = None
        self._has_noted = False

    def end_level(self) -> None:
        """Compare an equilibrium with the one before."""
        friction = self.contact.friction
        if friction == 0.0:
            return
        now, before = Placement.of(self.stepper), self._before
        self._before, self.share = now, np.nan
        touching = self.contact.read_contacts()
        if before is not None and len(touching.force):
            stick = STICK_SHARE * float(self.stepper.state.read_control()[int(c.CONTACT_STIFFNESS)])
            radius = self.model.rods.wire_radius[self.model.rods.wire_of]
            self.share = opposing_share(slid(before, now, touching, radius), touching, friction, stick)

    def note(self) -> None:
        """Tell the user of friction that is lost in a recorded state."""
        if self._has_noted or not self.share < LEAST_SHARE:
            return
        self._has_noted = True
        weft, warp = (percent(strain, 1) for strain in np.diag(stretch(self.stepper.state.gradient)) - 1.0)
        self.notes.append(
            f"at strains of {weft} in weft and {warp} in warp friction against the sliding of the wires is"
            f" {percent(max(self.share, 0.0), 0)} of its limit, and underestimated; raise output.frames until it does not change"
        )

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint."""
        if self._before is None:
            return {}
        kept = {f"sliding_{name}": array for name, array in vars(self._before).items()}
        return kept | {"sliding": np.array([self.share, self._has_noted])}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        if "sliding" in kept:
            share, has_noted = kept["sliding"].tolist()
            self.share, self._has_noted = share, bool(has_noted)
            self._before = Placement(**{field.name: kept[f"sliding_{field.name}"] for field in fields(Placement)})
