"""Cases of parametrized tests."""

from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Cases that run with `-m slow` alone; a tuple holds the values of one case."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]
