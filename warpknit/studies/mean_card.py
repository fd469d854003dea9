"""The material card of a tile of unequal loops: the mean of the cards of the meshes of `[variants]`, and their spread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from ..base.errors import Diverged
from ..base.processes import messages
from ..compute.device import start_warp
from ..mechanics.numerics import process_count
from ..results.row import Row
from ..runner.history import row_of
from ..runner.variants import Spread, first_meshes, spread_of
from ..scene import Scene, Stage
from ..solve.variant_models import VariantModels
from .card import MaterialCard, find_card
from .card_files import card_values
from .load_path import FEWEST, MeshesPath, PathState, exact, mean_of, part_of, tolerances_of, under_strain, under_tension

AHEAD = 1.01  # of the load of a card: the way on, along which a mesh with friction or yield is loaded
BEYOND = 13.0 / 12.0  # of the load of the card: last point of its loading curves
MESHES_A_PROCESS = 2  # fewer take little more time than the start of a process
OF_ONE = ("jumps", "branch")  # texts on the path of one mesh


OfMesh: TypeAlias = tuple[Any, PathState, Stage, Stage]  # model, a state near its card, load of the card, and a load ahead


@dataclass(frozen=True)
class MeanCard:
    """A mean card, and the cards at the ends of its range of stiffness."""

    card: MaterialCard
    meshes: int  # how many cards it is the mean of
    spread: Mapping[str, Spread]  # of each value of a card, by name
    softest: MaterialCard  # of the least C11 + C22
    stiffest: MaterialCard
    loading: Sequence[Row]  # mean states from the meshes as knitted to the card and beyond


def loads_of_card(scene: Scene, row: Row, tension: float | None) -> tuple[Stage, Stage, Stage]:
    """Loads at a state, a little ahead of it, and BEYOND it.

    The load is a `tension` [N/m] both ways, or else the strains.
    """
    strains = np.array([[row.strain_weft, row.shear], [0.0, row.strain_warp]])
    here, *more = (under_strain(scene, np.eye(2) + factor * strains) for factor in (1.0, AHEAD, BEYOND))
    ahead, beyond = more if tension is None else (under_tension(scene, factor * tension) for factor in (AHEAD, BEYOND))
    return here, ahead, beyond


def find_mean(
    scene: Scene, load: Stage, tension: float | None, base: MaterialCard, monitor: Callable[[float], None] = lambda _: None
) -> MeanCard | None:
    """The mean over the cards of the meshes under a load; None where fewer than FEWEST of them converge.

    base: card of the mesh of even loops, for the texts of the mean. `monitor` is called with the completed share. A larger
    tolerance is tried where fewer than half of the meshes have a card.
    """
    wanted = first_meshes(scene.variants)
    for tolerance in tolerances_of(scene):
        cards, loading = _cards(meshes_of(scene, tolerance), load, tension, monitor)
        if len(cards) >= max(FEWEST, 0.5 * wanted):
            break
    if len(cards) < FEWEST:
        return None
    values = [{name: value for name, value, _unit, _meaning in card_values(card)} for card in cards]
    common = [name for name in values[0] if all(name in each for each in values)]
    spread = {name: spread_of([each[name] for each in values]) for name in common}
    ordered = sorted(cards, key=lambda card: float(np.trace(card.stiffness[:2, :2])))
    return MeanCard(_mean(base, cards), len(cards), spread, ordered[0], ordered[-1], loading)


def meshes_of(scene: Scene, tolerance: float) -> list[Any]:
    """Models of the first meshes of `[variants]`.

    They are in double precision, with this residual tolerance at most.
    """
    variants = VariantModels(replace(exact(scene, tolerance), stages=scene.stages[:1], sweep=None))
    return [variants.model(number) for number in variants.take(first_meshes(scene.variants))]


def _cards(
    meshes: Sequence[Any], load: Stage, tension: float | None, monitor: Callable[[float], None]
) -> tuple[list[MaterialCard], list[Row]]:
    """Cards of the meshes that converge, and mean states on the way."""
    way = MeshesPath(meshes)
    scene = way.scene
    try:
        ends = list(way.beside(load, scene.output.frames, part_of(monitor, 0, 2)))
    except Diverged:
        return [], []
    loading = [mean_of(records) for records in ends]
    of_meshes = []
    for record, (place, state) in zip(ends[-1], way.state.items(), strict=True):
        here, ahead, _ = loads_of_card(scene, row_of(record), tension)
        of_meshes.append((way.models[place], state, here, ahead))
    cards = _cards_of(of_meshes, part_of(monitor, 1, 2))
    with suppress(Diverged):
        *_, beyond = way.rows(loads_of_card(scene, loading[-1], tension)[2], 1)
        loading.append(beyond)
    return cards, loading


def _cards_of(of_meshes: Sequence[OfMesh], monitor: Callable[[float], None]) -> list[MaterialCard]:
    """Cards of the meshes that converge, found in several processes."""
    count = process_count(len(of_meshes) // MESHES_A_PROCESS)
    found: dict[int, MaterialCard] = {}

    def note(card: tuple[int, MaterialCard]) -> None:
        found[card[0]] = card[1]
        monitor(len(found) / len(of_meshes))

    numbered = list(enumerate(of_meshes))
    if count == 1:
        send_cards(note, numbered, lambda share: monitor((len(found) + share) / len(of_meshes)))
    else:
        calls = [(send_cards, numbered[part::count]) for part in range(count)]
        for card in messages(calls, lambda: monitor(len(found) / len(of_meshes))):
            note(card)
    return [card for _, card in sorted(found.items())]


def send_cards(
    send: Callable[[tuple[int, MaterialCard]], None],
    numbered: Sequence[tuple[int, OfMesh]],
    monitor: Callable[[float], None] = lambda _: None,
) -> None:
    """Send the cards of meshes that converge, with their numbers."""
    start_warp()
    for number, (model, state, here, ahead) in numbered:
        with suppress(Diverged):
            send((number, find_card(model, state, here, monitor, ahead=ahead)[0]))


def _mean(base: Any, cards: Sequence[Any]) -> Any:
    """Mean of dataclasses of numbers and arrays; texts come from `base`, except texts of its path."""
    mean = {}
    for field in fields(base):
        values = [getattr(card, field.name) for card in cards]
        if is_dataclass(values[0]):
            mean[field.name] = _mean(values[0], values)
        elif not isinstance(values[0], str) and values[0] is not None:
            mean[field.name] = sum(values[1:], values[0]) / len(values)
    return replace(base, **mean, **{name: "" for name in OF_ONE if hasattr(base, name)})
