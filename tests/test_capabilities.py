"""The table of what goes with what: every row is held against what reading a scene and the commands refuse, and the page."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from click.testing import CliRunner
from scene_reference import COLUMNS, capabilities_page, compatibility, with_needs

from warpknit.base.errors import InputError
from warpknit.commands.cli import main
from warpknit.commands.plan import overview_of
from warpknit.compute.ranks import Ranks
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene, make_scene
from warpknit.scene.capabilities import AT_COMMAND, GROUPS, RULES, TRAITS, Case
from warpknit.studies import probe_run, sweep

ROOT = Path(__file__).parent.parent
TAKEN = "is a file; give a directory"  # what a command says of --out once it has taken the scene
BY_SIZE = "about ten a side"  # a limit of size, which is no row of the table
COMMANDS = ("map", "trade", "report")


class Two(Ranks):
    count = 2


def group_of(name: str) -> set[str]:
    return next((set(group) for group in GROUPS if name in group), {name})


def traits_of(*asked: str) -> set[str]:
    """All traits of a scene that asks for these: what they need, unless the asked ones say otherwise, and of each other group the
    first."""
    found = set(asked)
    found |= {name for name in with_needs(asked) if not any(group_of(name) & group_of(one) for one in asked if one != name)}
    return found | {group[0] for group in GROUPS if not found & set(group)}


def is_refused(traits: set[str]) -> bool:
    """What the table says."""
    return any(rule.refused and rule.traits <= traits for rule in RULES)


def scene_of(*asked: str) -> dict[str, Any]:
    """The tables of a scene that asks for these."""
    table: dict[str, Any] = {}
    for name in [*sorted(traits_of(*asked) - set(asked)), *asked]:
        for key, value in TRAITS[name].example.items():
            is_merged = isinstance(value, dict) and name != "sweep by tension"  # whose tensions take the place of strains
            table[key] = {**table.get(key, {}), **value} if is_merged else value
    return table


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With the file of wires, a file where results should go, and no search for settings."""
    shutil.copy(ROOT / "scenes" / "wires" / "plain_knit.csv", tmp_path)
    (tmp_path / "taken").touch()

    def taken(*_: Any) -> None:
        raise InputError(TAKEN)

    monkeypatch.setattr(probe_run, "settings_for_error", taken)
    return tmp_path


def refusal(folder: Path, table: dict[str, Any], traits: set[str]) -> str:
    """What reading the scene or the command among the traits says against it, empty where it is taken."""
    path, out = folder / "scene.toml", folder / "taken"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    command = next((name for name in ("report", "map", "trade", "error") if name in traits), "")
    try:
        if command in ("map", "trade") and {"cuda", "ranks"} & traits:
            loaded = load_scene(path)
            sweep.refuse(loaded, command, device="cuda:0" if "cuda" in traits else None, ranks=2 if "ranks" in traits else 1)
        elif "ranks" in traits:
            run_scene(load_scene(path), out=out, ranks=Two())
        elif command:
            call = [command, str(path)] if command in COMMANDS else ["run", str(path), "--error", "2"]
            done = CliRunner().invoke(main, [*call, "--out", str(out), "--quiet"], prog_name="warpknit")
            assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1, done.output
            said = done.stderr
            return "" if TAKEN in said or BY_SIZE in said else said
        else:
            load_scene(path)
    except InputError as error:
        return "" if TAKEN in str(error) else str(error)
    return ""


def buildable(one: str, other: str) -> bool:
    """Whether a scene can ask for both, if only to be refused: of a group it has one, and keys for one mesh."""
    alternatives = bool(group_of(one) & group_of(other)) or len(with_needs((one, other)) & set(GROUPS[0])) > 1
    return not alternatives and all(len(traits_of(one, other) & set(group)) == 1 for group in GROUPS)


ROWS = [name for name in TRAITS if name not in AT_COMMAND and name != "no sweep"]  # a report adds a sweep


@pytest.mark.parametrize("column", [name for name in COLUMNS if name != "cuda"])
def test_what_the_table_says_is_what_is_refused(folder, column):
    """Each row in each column: refused exactly where a rule says so, and by its words."""
    for name in filter(lambda name: buildable(name, column), ROWS):
        traits = traits_of(name, column)
        said = refusal(folder, scene_of(name, column), traits)
        assert bool(said) == is_refused(traits), f"{name} with {column}: {said or 'taken'}"
        words = [rule.instead for rule in RULES if rule.refused and rule.traits <= traits]
        assert not said or any(said.strip().endswith(f"; {instead}") for instead in words), f"{name} with {column}: {said}"
        shown = compatibility(name, column)
        assert (shown == "no") <= bool(said) and (shown in ("yes", "no effect")) <= (not said or shown_default(name, column))


def shown_default(one: str, other: str) -> bool:
    """Whether the page may say yes to what is refused here: it leaves open what the scene takes by default."""
    return any(
        rule.refused and rule.traits <= traits_of(one, other) and not rule.traits <= with_needs((one, other)) for rule in RULES
    )


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: "+".join((rule.trait, *rule.others)))
def test_every_rule_holds(folder, rule):
    """A scene that asks for all that a rule names is refused, or what it names is said to have no effect."""
    asked = sorted(rule.traits, key=list(TRAITS).index)
    traits = traits_of(*asked)
    table = scene_of(*asked)
    if rule.refused:
        said = refusal(folder, table, traits)
        assert "; " in said and is_refused(traits)
    else:
        planned = overview_of(make_scene(table), "cpu").physics
        assert any(sentence.startswith("without effect: ") and sentence.endswith(f"({rule.why})") for sentence in planned)


def test_a_scene_asks_for_what_its_example_asks_for(folder):
    """Each trait sees itself in its example, and in the scene where it is one of the scene."""
    for name in ROWS:
        scene = traits_of(name)
        if not is_refused(scene):
            (folder / "scene.toml").write_text(tomli_w.dumps(scene_of(name)), encoding="utf-8")
            loaded = load_scene(folder / "scene.toml")
            unseen = {"displacement"} if loaded.hook is None else set()  # turned into strains
            assert name in unseen or list(TRAITS[name].asked(Case(loaded))), name


def test_the_page_is_that_of_the_table():
    text = (ROOT / "docs" / "capabilities.md").read_text(encoding="utf-8")
    assert text == capabilities_page(), "python docs/scene_reference.py"


def test_rules_name_traits():
    assert set().union(*(rule.traits for rule in RULES)) <= set(TRAITS)
    assert {name for trait in TRAITS.values() for name in trait.needs} <= set(TRAITS)
    assert {name for group in GROUPS for name in group} | set(COLUMNS) <= set(TRAITS)
