"""Compatibility of meshes, models, drives, boundaries, features and commands, in one table.

`TRAITS` (traits.py) are features that a scene or a command may request, `RULES` (rules.py) the combinations that are excluded.
From these follow the refusals (`refuse`, called when a scene is read and by each command), the keys without effect
(`without_effect`, shown by `warpknit plan`), the kind of model of `model.kind = "auto"` (`kind_of_model`), and
docs/capabilities.md (reference.py).
Limits that depend on a size, a file or values of a model are checked where these are known: in wires/read.py, mesh/,
planar/model.py, spatial/.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from warpknit.errors import SceneError
from warpknit.scene.keys import Table
from warpknit.scene.messages import dotted, scene_error, value_text
from warpknit.scene.options import AUTO, DEFAULT, GIVEN
from warpknit.scene.rules import RULES, Rule
from warpknit.scene.traits import AT_COMMAND, GROUPS, TRAITS, Case, Location, Place, Words

if TYPE_CHECKING:
    from warpknit.scene.file import SceneFile
    from warpknit.scene.scene import Scene
    from warpknit.scene.source import Source


def refuse(
    scene: Scene | SceneFile, command: str = "", *, device: str | None = None, ranks: int = 1, source: Source | None = None
) -> None:
    """Raise `SceneError` for the first rule that excludes this scene or command.

    command: run | map | trade | report | error (`run --error`); empty: what no command takes. device: the one that was named.
    ranks: processes that are to share it. source: for messages with the values as they were written.
    """
    case = Case(scene, command, device, ranks)
    for rule in RULES:
        if rule.refused and bool(command) == bool(rule.traits & AT_COMMAND):
            for location, value in _places(rule, case):
                raise _refusal(case, rule, location, value, source)


def without_effect(scene: Scene) -> Iterator[str]:
    """Keys of the scene without effect, a sentence each."""
    case = Case(scene)
    for rule in RULES:
        if not rule.refused:
            for location, _ in _places(rule, case):
                yield f"without effect: {dotted(location)} ({rule.why})"


def kind_of_model(file: SceneFile, *, command: str = "", ranks: int = 1) -> tuple[str, str]:
    """Kind of model of a scene file, `auto` resolved, and the reason in a few words.

    `auto` is spatial, unless the spatial model lacks a feature of the scene or the command that the planar model has.
    command, ranks: as in `refuse`.
    """
    if file.model.kind != AUTO:
        return file.model.kind, GIVEN
    spatial, planar = (
        [rule for rule in RULES if kind in rule.traits and list(_places(rule, Case(_of_kind(file, kind), command, ranks=ranks)))]
        for kind in ("spatial", "planar")
    )
    if not spatial or any(rule.refused for rule in planar):
        return "spatial", DEFAULT
    return "planar", f"only in the planar model: {', '.join(dict.fromkeys(map(_other_traits, spatial)))}"


def _of_kind(file: SceneFile, kind: str) -> SceneFile:
    return replace(file, model=replace(file.model, kind=kind))


def _other_traits(rule: Rule) -> str:
    """The traits of a rule beside the spatial model, in words."""
    return " with ".join(TRAITS[name].words for name in TRAITS if name in rule.traits - {"spatial"})


def _places(rule: Rule, case: Case) -> Iterable[Place]:
    """The keys that a rule names; none unless the case has all its traits."""
    if any(not list(TRAITS[name].asked(case)) for name in rule.others):
        return ()
    return TRAITS[rule.trait].asked(case)


def _refusal(case: Case, rule: Rule, location: Location, value: Any, source: Source | None) -> SceneError:
    others = " and ".join(TRAITS[name].words for name in rule.others).replace("`", "").replace('"', "'")
    wrong = f"cannot be combined with {others} ({rule.why})"
    if source is not None:
        return source.refusal(location, value, wrong, rule.instead)
    key = dotted(location)
    given = f"[{key}]" if isinstance(value, Table) else value if isinstance(value, Words) else value_text(location, value)
    return scene_error(cast("Scene", case.scene).path, key, f"{given} {wrong}", rule.instead)


def with_needs(names: Iterable[str]) -> frozenset[str]:
    """Traits and all that they imply."""
    found: set[str] = set()
    left = list(names)
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += TRAITS[name].needs
    return frozenset(found)


def goes_together(one: str, other: str) -> str:
    """Whether two traits go together, whatever else a scene has: "yes", "no", "partly" (it depends on a third one), or "no
    effect"."""
    both = with_needs((one, other))
    if any(len(both & set(group)) > 1 for group in GROUPS) or any(rule.refused and rule.traits <= both for rule in RULES):
        return "no"
    between = [rule for rule in RULES if {one, other} == {rule.trait, *rule.others[:1]}]
    if any(rule.refused for rule in between):
        return "partly"
    return "no effect" if between else "yes"
