"""Records of a mesh of two classes of contact, A and B, whose forces and stress are linear in its tension, and its answers."""

from types import SimpleNamespace

import pytest

from reference.in_words import ChangingRow as Row
from warpknit.runner import answers as module
from warpknit.runner.answers import Answers, answers_of

CLOSES, SLOPE = {"A": 0.23, "B": 0.61}, 3e-5  # [N/m], and [m] force of a closed contact by tension beyond it
LIMIT, STRESS = 700e6, 1e9  # [Pa] elastic limit, and [Pa m/N] stress by tension
STRAIN = 0.2  # [m/N] by tension


def row(tension: float, *, stage: str = "load", temperature: float = 293.15) -> Row:
    """A state of a mesh of two classes of contact, linear in its tension [N/m], whose load is 1 N/m."""
    force = {f"force_{name}_N": max(0.0, SLOPE * (tension - at)) for name, at in CLOSES.items()}
    active = {f"active_{name}_percent": 100.0 * (tension > at) for name, at in CLOSES.items()}
    return Row(
        stage=stage, load_factor=tension, temperature_K=temperature,
        strain_weft=STRAIN * tension, strain_warp=0.5 * STRAIN * tension,
        tension_weft_N_per_m=tension, tension_warp_N_per_m=tension, stress_max_Pa=STRESS * tension,
        stress_max_part="head of a closed loop", stress_max_wire=1, stress_max_node=7, stress_max_x_m=1e-3, stress_max_y_m=2e-3,
        active_percent=0.25 * active["active_A_percent"] + 0.75 * active["active_B_percent"], **force, **active,
    )  # fmt: skip


def found(
    rows: list[Row],
    monkeypatch: pytest.MonkeyPatch,
    service: float | None = None,
    jumps: list[tuple[Row, Row]] | None = None,
    pairs: tuple[int, int] = (10, 30),
    asked: float | None = None,
    error: float | None = None,
    tolerance: float = 0.02,
) -> Answers:
    """The answers from rows of such a mesh. asked [N/m]: tension that its stages give; error [%]: of its tensions. tolerance:
    distance of two rows, over the load, that gives a place."""
    scene = SimpleNamespace(
        hook=None, wire=SimpleNamespace(yield_stress=LIMIT, expansion=4.5e-6),
        output=SimpleNamespace(service_tension=service, load_tolerance=tolerance),
        solver=SimpleNamespace(residual_tolerance=1e-3),
        stages=[SimpleNamespace(name=name, by_tension=(asked is not None,) * 2, tension_weft=asked, tension_warp=asked)
                for name in ("load", "unload", "cold")],
    )  # fmt: skip
    monkeypatch.setattr(module.measure, "classes_of", lambda _: {"A": pairs[0], "B": pairs[1]})
    monkeypatch.setattr(module.measure, "active_threshold", lambda _: 1e-12)
    monkeypatch.setattr(module.measure, "tension_scale", lambda _: 1.0)
    monkeypatch.setattr(module, "tension_error", lambda _: error)
    answers = answers_of(SimpleNamespace(scene=scene), rows, jumps or ())
    assert answers is not None
    return answers
