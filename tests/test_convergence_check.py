"""When a relaxation has converged, and when it is given up: closed forms of sequences of stresses and ratios."""

import numpy as np
import pytest

from warpknit.compute.kept import Owner, restore, save
from warpknit.mechanics.protocols import Drift
from warpknit.solve.equilibrium import PATIENCE, RESTART_RATIO, Convergence

TOLERANCE = 1e-3
STILL = np.zeros((2, 2))


def convergence(drift: Drift, count: int = 1) -> Convergence:
    return Convergence(drift, count, tolerance=TOLERANCE, least_tension=1e-9, nodes_per_loop=16)


def ratios(made: Convergence, stresses: list[np.ndarray], ratio: float = 0.5) -> list[float]:
    """Of one mesh whose criteria are met at every check."""
    rows = np.array([0])
    return [float(made.with_drift(rows, np.array([ratio]), lambda _, s=s: np.array([s]))[0]) for s in stresses]


def test_the_tension_must_stand_still_for_its_checks() -> None:
    """Constant stress: the ratio is 1 for as many checks as the drift needs, then that of the criteria."""
    for drift, needed in ((Drift(5), 5), (Drift(8, 0.98), 16)):
        found = ratios(convergence(drift), [np.eye(2)] * (needed + 2))
        assert found == [1.0] * needed + [0.5] * 2


def test_what_is_still_to_come_of_a_geometric_sequence_is_known() -> None:
    """T = 1 - q^(k/n) over n checks each moves on by q of the last time: moved/(1 - q) = q^(k/n - 1), which is what was left n
    checks ago; without extrapolation what moved, (1 - q) of that, is taken for it."""
    n, q = 4, 0.7
    left = [q ** (k / n) for k in range(6 * n)]
    stresses = [(1.0 - x) * np.diag([1.0, 0.5]) for x in left]
    found = ratios(convergence(Drift(n, 0.98)), stresses)[-1]
    assert found == pytest.approx(left[-1 - n] / (TOLERANCE * (1.0 - left[-1])), rel=1e-12)
    found = ratios(convergence(Drift(n)), stresses)[-1]
    assert found == pytest.approx((1.0 - q) * left[-1 - n] / (TOLERANCE * (1.0 - left[-1])), rel=1e-12)


def test_a_criterion_that_is_missed_begins_the_wait_anew() -> None:
    made, rows = convergence(Drift(2)), np.array([0])
    stress = np.array([np.eye(2)])
    found = [float(made.with_drift(rows, np.array([r]), lambda _: stress)[0]) for r in (0.5, 0.5, 3.0, 0.5, 0.5, 0.5)]
    assert found == [1.0, 1.0, 3.0, 1.0, 1.0, 0.5]


def test_with_a_larger_ratio_the_drift_does_not_count() -> None:
    made, rows = convergence(Drift(2)), np.array([0])
    for ratio, unmet in ((11.0, 1.1), (5.0, 0.5)):
        assert made.with_drift(rows, np.array([ratio]), lambda _: pytest.fail("no drift"), np.array([10.0]))[0] == unmet


def test_meshes_side_by_side_do_not_know_of_each_other() -> None:
    """A mesh among others answers as alone, whichever of the others is judged with it."""
    random = np.random.default_rng(1)
    stresses, ratio = random.normal(1.0, 1e-3, (30, 3, 2, 2)), random.uniform(0.2, 1.3, (30, 3))
    together, alone = convergence(Drift(2, 0.9), 3), convergence(Drift(2, 0.9))
    for k in range(30):
        rows = np.array([0, 1, 2]) if k % 2 else np.array([1, 2])
        among = together.with_drift(rows, ratio[k, rows], lambda asked, k=k: stresses[k, asked])
        own = alone.with_drift(np.array([0]), ratio[k, 2:], lambda _, k=k: stresses[k, 2:])
        assert among[-1] == own[0]
        assert together.is_stalled(rows, among)[-1] == alone.is_stalled(np.array([0]), own)[0]


def test_a_level_that_gets_no_better_is_stalled_and_a_snap_begins_anew() -> None:
    """After PATIENCE checks without progress by a tenth; a ratio that jumps by more than RESTART_RATIO is another state."""
    made, row = convergence(Drift(2)), np.array([0])
    assert not made.is_stalled(row, np.array([5.0]))[0]
    stalled = [bool(made.is_stalled(row, np.array([4.9]))[0]) for _ in range(PATIENCE + 1)]
    assert stalled == [False] * PATIENCE + [True]
    assert not made.is_stalled(row, np.array([1.01 * RESTART_RATIO * 5.0]))[0]
    assert not made.is_stalled(row, np.array([4.9]))[0]


def test_a_drift_that_falls_is_progress_however_slow() -> None:
    """The tension comes 20 % closer with a time constant of 600 checks: steady after some thousands, never given up before."""
    made, row = convergence(Drift(8, 0.98)), np.array([0])
    for k in range(12_000):
        found = made.with_drift(row, np.array([0.5]), lambda _, k=k: (1.0 + 0.2 * np.exp(-k / 600.0)) * np.eye(2)[None])
        if found[0] < 1.0:
            break
        assert not made.is_stalled(row, found)[0]
    assert found[0] < 1.0
    # the extrapolation takes at most 1/(1 - 0.98) times the drift over 8 checks
    left = 0.2 * np.exp(-k / 600.0)
    assert left < TOLERANCE * (1.0 + left) * (1.0 - 0.98) / np.expm1(8.0 / 600.0)


def test_a_checkpoint_keeps_what_was_seen() -> None:
    made, again = convergence(Drift(3)), convergence(Drift(3))
    stresses = [np.diag([1.0 + 1e-4 * k, 1.0]) for k in range(12)]
    ratios(made, stresses[:7])
    restore(save(Owner(made)), Owner(again))
    assert ratios(again, stresses[7:]) == ratios(made, stresses[7:])


def test_a_mesh_whose_forces_balance_waits_for_its_tension() -> None:
    made, rows = convergence(Drift(2)), np.array([0])
    for ratio, drifts in ((3.0, False), (0.5, True), (3.0, False)):
        made.with_drift(rows, np.array([ratio]), lambda _: np.array([np.eye(2)]))
        assert made.drifts(0) == drifts
