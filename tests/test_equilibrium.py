"""The loop of a relaxation, with meshes that only say what it is to hear."""

from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.mechanics.protocols import Check, Drift
from warpknit.solve import equilibrium
from warpknit.solve.equilibrium import Equilibrium
from warpknit.solve.progress import Progress


class OneMesh:
    """A group of one mesh, whose convergence checks find `ratio`."""

    def __init__(self, ratio: float) -> None:
        scene = SimpleNamespace(solver=SimpleNamespace(residual_tolerance=0.01), model=SimpleNamespace(nodes_per_loop=16))
        self.model, self.ratio = SimpleNamespace(scene=scene), ratio
        self.members = [SimpleNamespace(drift=Drift(1), can_overlap=False, check_steps=50)]
        self.strains = SimpleNamespace(
            is_endless=lambda rows: np.zeros(len(rows), dtype=bool),
            at_limit=lambda rows: np.zeros((len(rows), 2), dtype=bool),
            found=lambda _rows: None,
        )
        self.touches = np.array([True])
        self.moves_all = False

    def advance(self, _rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        return np.array([steps]), np.array([False])

    def is_loading(self, _rows: np.ndarray) -> np.ndarray:
        return np.array([False])

    def check(self, _rows: np.ndarray, _checks: np.ndarray, _loading: np.ndarray) -> Check:
        return Check(np.array([0.01 * self.ratio]), np.array([self.ratio]))

    def move_all(self, _rows: np.ndarray) -> None:
        self.moves_all = True

    def converged_stress(self, _rows: np.ndarray) -> np.ndarray:
        return np.ones((1, 2, 2))


@pytest.mark.parametrize(("ratio", "converges"), [(0.5, True), (2.0, False), (np.nan, False)])
def test_only_a_number_below_one_has_converged(ratio: float, converges: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equilibrium, "tension_scale", lambda _model: 1.0)
    relaxation = SimpleNamespace(progress=Progress(), step_limit=1000, corrected=lambda ratio: (ratio, False))
    mesh = OneMesh(ratio)
    loop = Equilibrium(mesh, [relaxation])  # type: ignore[arg-type]
    found = [loop.advance(np.array([0]))[0] for _ in range(3)]
    assert (found[-1] == [0]) == converges == mesh.moves_all


def test_progress_counts_decades_to_convergence() -> None:
    """Of 10,000, 100 and 10 times the tolerance: half and three quarters of the way; a larger ratio takes nothing back. Next to
    the tolerance nine tenths, as the drift of the tension has still to be watched."""
    progress = Progress()
    shares = []
    for ratio in (1e4, 1e2, 10.0, 1e3, np.inf, np.nan, 0.5):
        progress.approach(ratio)
        shares.append(progress.level_share)
    assert shares == pytest.approx([0.0, 0.5, 0.75, 0.75, 0.75, 0.75, 0.75])
    progress.approach(1.001)
    assert progress.level_share == 0.9
    progress.begin_level()
    assert progress.level_share == 0.0
