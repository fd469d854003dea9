"""Whether friction opposes what contacts slid between two equilibria (warpknit/spatial/sliding.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from warpknit.model import build_model
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation
from warpknit.spatial.contacts import Contacts
from warpknit.spatial.sliding import COUNTED, FAR, LEAST_SHARE, Placement, opposing_share, slid

SCENES = Path(__file__).parents[2] / "scenes"
RADIUS = 0.5


def turned(axis: np.ndarray, angle: float, vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) turned about a unit axis."""
    cross = np.cross(axis, vectors)
    return vectors + np.sin(angle) * cross + (1.0 - np.cos(angle)) * np.cross(axis, cross)


def crossing(move: tuple[float, float, float] = (0.0, 0.0, 0.0), roll: float = 0.0, strain: float = 0.0) -> Placement:
    """A wire along y on top of one along x, each of one segment of length 2; the upper one moved, and rolled about its axis.
    strain: of the load, along x."""
    position = np.array([[move[0], move[1] - 1.0, move[2] + 2.0 * RADIUS], [-1.0, 0.0, 0.0]])
    edge = np.array([[0.0, 2.0, 0.0], [2.0, 0.0, 0.0]])
    frame = np.array([np.roll(np.eye(3), 1, axis=0), np.roll(np.eye(3), 2, axis=0)])  # rows: director, across, tangent
    frame[0] = turned(np.array([0.0, 1.0, 0.0]), roll, frame[0])
    return Placement(position, edge, frame, np.diag([1.0 + strain, 1.0]))


def touch(force: float = 1.0, friction: tuple[float, float, float] = (0.0, 0.0, 0.0), shift: float = 0.0) -> Contacts:
    """The contact in the middle of both; shift: of the second one along x, as its periodic image."""
    one = np.ones(1, dtype=int)
    return Contacts(
        0 * one, one, np.array([[0.5, 0.5]]), np.array([[shift, 0.0, 0.0]]), np.array([force]), np.array([friction]),
        np.array([[0.0, 0.0, 1.0]]), np.array([0.0]),
    )  # fmt: skip


def way(now: Placement, shift: float = 0.0) -> np.ndarray:
    return slid(crossing(), now, touch(shift=shift), np.full(2, RADIUS))[0]


def test_a_wire_that_is_dragged_slides_and_one_that_rolls_does_not() -> None:
    """Dragged by a it slides by a. It rolls by a/r about its axis y as it moves by a along x: its lowest point stays, to the
    square of the angle. A roll alone slides by the radius times its angle."""
    drawn = (0.01, 0.02, 0.0)
    assert way(crossing(drawn)) == pytest.approx(drawn)
    angle = 0.01 / RADIUS
    assert way(crossing((0.01, 0.0, 0.0), angle)) == pytest.approx(np.zeros(3), abs=RADIUS * angle**2)
    assert way(crossing(roll=angle))[0] == pytest.approx(-RADIUS * angle, rel=angle)


def test_what_moves_away_along_the_normal_does_not_slide() -> None:
    assert way(crossing((0.0, 0.0, 0.1))) == pytest.approx(np.zeros(3))


def test_a_periodic_image_moves_with_the_load() -> None:
    """The second wire is 3 on along x: where the load strains by 0.01, its image moves by 0.03, and the first wire over it by the
    opposite."""
    assert way(crossing(strain=0.01), shift=3.0) == pytest.approx([-0.03, 0.0, 0.0])


@pytest.mark.parametrize(("friction", "share"), [((-0.2, 0.0, 0.0), 1.0), ((0.0, 0.2, 0.0), 0.0), ((0.1, 0.0, 0.0), -0.5)])
def test_share_is_one_where_all_friction_opposes_the_sliding(friction: tuple[float, float, float], share: float) -> None:
    assert opposing_share(np.array([[1.0, 0.0, 0.0]]), touch(friction=friction), 0.2, 1e3) == pytest.approx(share)


def test_contacts_that_hardly_slid_do_not_count() -> None:
    """A contact of N slides once it has given way by mu N/k; FAR times that count, and COUNTED of the contact force is needed."""
    one, friction, stiffness = touch(friction=(-0.2, 0.0, 0.0)), 0.2, 1e3
    least = FAR * friction / stiffness
    assert np.isnan(opposing_share(np.array([[0.99 * least, 0.0, 0.0]]), one, friction, stiffness))
    assert opposing_share(np.array([[1.01 * least, 0.0, 0.0]]), one, friction, stiffness) == pytest.approx(1.0)
    large = touch(force=1.1 * (1.0 / COUNTED - 1.0))
    both = Contacts.joined([one, large])
    assert np.isnan(opposing_share(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), both, friction, stiffness))


def run(*overrides: str) -> Simulation:
    """The double atlas in space with friction up to where its first wires touch and slide, in 0.5 % strain an increment."""
    changes = ("model.kind=spatial", "path=[]", "solver.preset=draft", "load.strain_weft=0.055", "load.strain_warp=0.055")
    simulation = Simulation(build_model(load_scene(SCENES / "friction_cycle.toml", (*changes, "output.frames=2", *overrides))))
    for _ in simulation.run():
        pass
    return simulation


def said(simulation: Simulation) -> list[str]:
    return [note for note in simulation.notes if "underestimated" in note]


def test_friction_of_an_increment_opposes_its_whole_slip() -> None:
    """Contacts that have just closed slip to and fro on the way to equilibrium. What an increment begins with is an elastic slip
    at most, and contacts that count slid by FAR of them: friction is off their way by an angle of sine 1/FAR at most."""
    simulation = run()
    assert simulation.mechanics.sliding.share >= np.sqrt(1.0 - FAR**-2)
    assert not said(simulation)


def test_a_run_says_where_friction_was_lost() -> None:
    simulation = run()
    simulation.mechanics.sliding.share = 0.99 * LEAST_SHARE
    for _ in range(2):
        simulation.mechanics.observe()
    (note,) = said(simulation)
    assert "at strains of 5.5 % in weft and 5.5 % in warp" in note and "output.frames" in note


def test_without_friction_nothing_is_said() -> None:
    assert not said(run("contact.friction=0"))


def test_a_checkpoint_keeps_the_equilibrium_before() -> None:
    first, second = run().mechanics, build_model(load_scene(SCENES / "friction_cycle.toml", ("model.kind=spatial",)))
    other = Simulation(second).mechanics.sliding
    other.load_state_dict(first.sliding.state_dict())
    assert other.share == first.sliding.share
    assert np.array_equal(other._before.frame, first.sliding._before.frame)
