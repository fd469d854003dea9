"""Elastic limit and strength of a wire, and effects of higher stress, in words."""

from __future__ import annotations

from ..base.text import engineering
from ..scene import Scene

LIMITS = {"tensile_strength": "strength", "yield_stress": "elastic limit"}  # of a wire, the graver first


def assumed_note(key: str, is_assumed: bool) -> str:
    """Note on the material's default of a dotted key; empty where the scene gives it."""
    return f" (assumed; set {key})" if is_assumed else ""


def assumed_text(scene: Scene, key: str) -> str:
    """The `assumed_note` of a key of a scene."""
    return assumed_note(key, key in scene.assumed)


def limit_text(scene: Scene, name: str = "yield_stress") -> str:
    """Elastic limit, or strength (`tensile_strength`), with its value, and a note if it is assumed."""
    return f"{LIMITS[name]} of {engineering(getattr(scene.wire, name), 'Pa')}{assumed_text(scene, f'wire.{name}')}"


def exceeded_text(scene: Scene, stress: float) -> str:
    """Limit that a wire stress [Pa] exceeds, in words; empty within the elastic limit."""
    exceeded = [f"above the {limit_text(scene, name)}" for name in LIMITS if stress > getattr(scene.wire, name)]
    return exceeded[0] if exceeded else ""
