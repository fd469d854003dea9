"""Free oscillation of a straight wire: central differences shift a frequency, coarse nodes shift it too.

    in time    sin(W dt/2) = w dt/2,  so W = w (1 + (w dt)^2/24 + 3 (w dt)^4/640 + ...)
    stretch    w = (2c/h) sin(b/2),  c = sqrt(EA/mu)              = c m pi/L (1 - b^2/24 + ...)
    bending    w = (4/h^2) S sqrt(1 + 2 S/3) sqrt(EI/mu)          = (m pi/L)^2 sqrt(EI/mu) (1 - 7 b^4/480 + ...)

with b = m pi h/L, S = sin^2(b/2) and mu the mass a length; mode m is cos(m pi x/L) of the free bar, sin(m pi x/L) of the
pinned beam.
The dynamics soften EA by (2h/d)^2, so that bending has the largest w; a bar of this stiffness is as good as another.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from reference.oscillator import step_matrix
from reference.plane_wires import DIAMETER, EPSILON, Rig, panel_of_wires, straight, table_of_wires
from reference.rings import deformed, two_rings
from warpknit.mechanics.numerics import LOOK_AHEAD, MASS_MARGIN

LENGTH = 1e-3
KINDS = ("stretch", "bending")


@dataclass(frozen=True)
class Mode:
    """A wire, an eigenmode of its chain (node, 2) and the frequencies [1/s] of the chain and of the continuum."""

    rig: Rig
    shape: np.ndarray
    frequency: float
    continuum: float

    def amplitude(self) -> float:
        """Of the mode in what the rig has moved, by its masses."""
        moved = (self.rig.position() - self.rig.rest) * self.rig.mass[:, None]
        return float(np.sum(moved * self.shape) / np.sum(self.shape**2 * self.rig.mass[:, None]))


def mode_of(kind: str, segments: int, mode: int, softer: float = 1.0, device: str = "cpu") -> Mode:
    """Mode `mode` of a wire; EA is softened by `softer` beyond (2h/d)^2."""
    h = LENGTH / segments
    table = table_of_wires([straight(segments + 1, h)])
    softening = softer * (2 * h / DIAMETER) ** 2
    held = [] if kind == "stretch" else [0, segments]
    rig = Rig(table, panel_of_wires(table, held=held), device, axial_softening=softening)
    wire = rig.model.scene.wire
    angle = mode * np.pi * np.arange(segments + 1) / segments
    b = mode * np.pi / segments
    shape = np.zeros_like(rig.rest)
    if kind == "stretch":
        shape[:, 0] = np.cos(angle)
        speed = np.sqrt(wire.axial_stiffness / softening / wire.linear_density)
        return Mode(rig, shape, 2 * speed / h * np.sin(b / 2), speed * b / h)
    shape[:, 1] = np.sin(angle)
    shape[[0, -1]] = 0.0
    speed = np.sqrt(wire.bending_stiffness / wire.linear_density)
    square = np.sin(b / 2) ** 2
    return Mode(rig, shape, 4 * speed / h**2 * square * np.sqrt(1 + 2 / 3 * square), speed * (b / h) ** 2)


def measured_frequency(mode: Mode, time_step: float, steps: int) -> float:
    """From q(t + dt) + q(t - dt) = 2 cos(W dt) q(t), by least squares. The amplitude of 1e-5 d keeps the wire linear:
    its stretch shifts a bending frequency by about 4 (1e-5)^2."""
    rig = mode.rig
    rig.set_time_step(time_step)
    rig.place(rig.rest + 1e-5 * DIAMETER * mode.shape)
    q = [mode.amplitude()]
    for _ in range(steps):
        rig.step(1)
        q.append(mode.amplitude())
    q = np.array(q)
    cosine = np.sum((q[2:] + q[:-2]) * q[1:-1]) / (2 * np.sum(q[1:-1] ** 2))
    return float(np.arccos(cosine) / time_step)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("phase", [0.1, 0.3])
def test_time_step_shifts_the_frequency(kind: str, phase: float, device: str) -> None:
    """W/w - 1 = (w dt)^2/24 up to 3 (w dt)^4/640, a fifth more for the terms behind; 1e-8 for the amplitude and
    round-off."""
    mode = mode_of(kind, 20, 8, device=device)
    shift = measured_frequency(mode, phase / mode.frequency, 300) / mode.frequency - 1
    assert abs(shift - phase**2 / 24) < 1.2 * 3 / 640 * phase**4 + 1e-8


@pytest.mark.parametrize(
    ("kind", "order", "coefficient", "following"), [("stretch", 2, 1 / 24, 1 / 1920), ("bending", 4, 7 / 480, 0.00215)]
)
@pytest.mark.parametrize("segments", [20, 40])
def test_nodes_shift_the_frequency(kind: str, order: int, coefficient: float, following: float, segments: int) -> None:
    """1 - w/w_continuum = b^2/24 or 7 b^4/480 up to the next term of the series; the step's own shift is taken out
    exactly."""
    mode = mode_of(kind, segments, 3)
    time_step = 1.0 / mode_of(kind, segments, segments - 1).frequency
    measured = 2 / time_step * np.sin(measured_frequency(mode, time_step, 300) * time_step / 2)
    b = 3 * np.pi / segments
    assert abs(1 - measured / mode.continuum - coefficient * b**order) < following * b ** (order + 2) + 1e-7


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("look_ahead", [0.0, LOOK_AHEAD])
def test_step_is_stable_up_to_its_limit(kind: str, look_ahead: float, device: str) -> None:
    """The highest mode stays bounded for w dt just below 2/sqrt(1 + 2 g), with g = 0 the familiar 2, and grows just
    above.

    Beyond that, its amplitude after n steps is the n-th power of the step's 2 x 2 matrix. Bending is stiffer than the
    softened stretch here, so that its highest mode is the highest of all. Round-off enters at EPSILON L and grows
    along.
    """
    segments, steps = 20, 60
    highest = segments if kind == "stretch" else segments - 1
    for nearness in (-0.004, 0.004):
        mode = mode_of(kind, segments, highest, softer=1.0 if kind == "stretch" else 16.0, device=device)
        rig = mode.rig
        phase = 2 / np.sqrt(1 + 2 * look_ahead) * (1 + nearness)
        rig.set_time_step(phase / mode.frequency)
        rig.control(look_ahead=look_ahead)
        start = 1e-8 * DIAMETER
        rig.place(rig.rest + start * mode.shape)
        expected, seen = [], []
        motion = np.array([start, 0.0])
        for _ in range(steps):
            rig.step(1)
            motion = step_matrix(phase, look_ahead) @ motion
            expected.append(motion[0])
            seen.append(mode.amplitude())
        largest = np.max(np.abs(expected))
        assert np.max(np.abs(np.subtract(seen, expected))) < 1e-3 * largest
        bound = start / np.sqrt(abs(nearness))
        if nearness < 0:
            assert np.max(np.abs(seen)) < bound
        else:
            assert abs(seen[-1]) > 10 * bound


def test_damping_takes_out_what_it_says() -> None:
    """v' = v (1 - q)/(1 + q) with q = c dt/2, which is exp(-c dt) to (c dt)^3/12 and 1 % of that; and c dt m v'^2 a
    step, which is what the motion loses times (1 - q)^2. A wire in free flight has no other forces."""
    rig = mode_of("stretch", 20, 1).rig
    steps, q = 100, 0.01
    rig.set_time_step(1e-9, damping=2 * q / 1e-9)
    rig.set_velocity(np.full_like(rig.rest, 0.3))
    rig.step(steps)
    speed = rig.velocity()
    assert speed == pytest.approx(np.full_like(speed, 0.3 * ((1 - q) / (1 + q)) ** steps), rel=100 * steps * EPSILON, abs=0)
    assert speed[0, 0] == pytest.approx(0.3 * np.exp(-2 * q * steps), rel=1.01 * steps * (2 * q) ** 3 / 12, abs=0)
    lost = np.sum(rig.mass) * (0.3**2 - speed[0, 0] ** 2)
    dissipated = rig.state.steering.dissipated
    assert dissipated == pytest.approx(lost * (1 - q) ** 2, rel=1000 * steps * EPSILON, abs=0)


@pytest.mark.parametrize("bodies", [0, 20])
def test_fictitious_masses_are_stable_at_unit_step(bodies: int) -> None:
    """relax steps by 1 s: the largest eigenvalue of M^-1 K stays under 4/(1 + 2 g), by the margin that was built in.

    A bent and stretched ring with a body on every second segment; M takes MASS_MARGIN of what one mode alone would
    need.
    """
    rig = two_rings(bodies, drive="relax", axial_softening=50.0)
    rig.control(contact_stiffness=rig.model.contact_stiffness)
    x = deformed(rig)
    stiffness = rig.stiffness(x, 1e-5 * rig.model.table.spacing.min())
    mass = np.repeat(rig.mass, 2)
    largest = np.max(np.linalg.eigvals(stiffness / mass[:, None]).real)
    assert bodies == 0 or np.count_nonzero(rig.state.pair_force.numpy()) > bodies
    assert 0.3 * 4 / MASS_MARGIN < largest < 4 / (1 + 2 * LOOK_AHEAD)
