"""Elastic limit and strength of a wire, and effects of higher stress, in words."""

from __future__ import annotations

from ..base.text import engineering
from ..scene import Scene


def assumed_note(key: str, is_assumed: bool) -> str:
    """Note that a dotted key has the material's default; empty where the scene gives it."""
    return f" (assumed; set {key})" if is_assumed else ""


def limit_text(scene: Scene) -> str:
    """Elastic limit with its value, and a note if it is assumed."""
    return f"elastic limit of {engineering(scene.wire.yield_stress, 'Pa')}{assumed_text(scene, 'wire.yield_stress')}"


def strength_text(scene: Scene) -> str:
    """The tensile strength, as `limit_text`."""
    return f"strength of {engineering(scene.wire.tensile_strength, 'Pa')}{assumed_text(scene, 'wire.tensile_strength')}"


def assumed_text(scene: Scene, key: str) -> str:
    """The `assumed_note` of a key of a scene."""
    return assumed_note(key, key in scene.assumed)


def exceeded_text(scene: Scene, stress: float) -> str:
    """Limit that a wire stress [Pa] exceeds, in words; empty within the elastic limit."""
    if stress > scene.wire.tensile_strength:
        return f"above the {strength_text(scene)}"
    if stress > scene.wire.yield_stress:
        return f"above the {limit_text(scene)}"
    return ""
