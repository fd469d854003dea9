"""The material card of a tile of unequal loops: the mean of the cards of the meshes of `[variants]`, and their spread."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from ..errors import Diverged
from ..results.row import Row
from ..runner.history import row_of
from ..runner.variants import Spread, first_meshes, spread_of
from ..scene import Scene, Stage
from ..solve.variant_models import VariantModels, last_records
from .card import MaterialCard, find_card
from .card_files import card_values
from .fine_states import DIFFERENCE_TOLERANCE, exact
from .load_path import PathState, part_of, under_strain, under_tension

AHEAD = 1.01  # of the load of a card: the way on, along which a mesh with friction or yield is loaded
FEWEST = 2  # cards, of a mean
OF_ONE = ("jumps", "branch")  # texts on the path of one mesh


@dataclass(frozen=True)
class MeanCard:
    """A mean card, and the cards at the ends of its range of stiffness."""

    card: MaterialCard
    meshes: int  # how many cards it is the mean of
    spread: Mapping[str, Spread]  # of each value of a card, by name
    softest: MaterialCard  # of the least C11 + C22
    stiffest: MaterialCard


def loads_of_card(scene: Scene, row: Row, tension: float | None) -> tuple[Stage, Stage]:
    """The strains of a state, and a little more of its load: of a `tension` [N/m] both ways, or else of the strains."""
    strains = np.array([[row.strain_weft, row.shear], [0.0, row.strain_warp]])
    here, ahead = (under_strain(scene, np.eye(2) + factor * strains) for factor in (1.0, AHEAD))
    return here, ahead if tension is None else under_tension(scene, AHEAD * tension)


def find_mean(
    scene: Scene, load: Stage, tension: float | None, base: MaterialCard, monitor: Callable[[float], None] = lambda _: None
) -> MeanCard | None:
    """The mean over the cards of the meshes under a load; None where fewer than FEWEST of them converge.

    base: card of the mesh of even loops, whose texts the mean has. `monitor` is called with the share that is done.
    """
    fine = exact(scene, DIFFERENCE_TOLERANCE)
    meshes, cards = list(_loaded(fine, load)), []
    for number, (model, state, row) in enumerate(meshes):
        with suppress(Diverged):
            here, ahead = loads_of_card(fine, row, tension)
            cards.append(find_card(model, state, here, part_of(monitor, number, len(meshes)), ahead=ahead)[0])
    if len(cards) < FEWEST:
        return None
    values = [{name: value for name, value, _unit, _meaning in card_values(card)} for card in cards]
    common = [name for name in values[0] if all(name in each for each in values)]
    spread = {name: spread_of([each[name] for each in values]) for name in common}
    ordered = sorted(cards, key=lambda card: float(np.trace(card.stiffness[:2, :2])))
    return MeanCard(_mean(base, cards), len(cards), spread, ordered[0], ordered[-1])


def _loaded(scene: Scene, load: Stage) -> Iterator[tuple[Any, PathState, Row]]:
    """Model, state and row of each mesh that converges under a load."""
    variants = VariantModels(replace(scene, stages=(load,), sweep=None))
    models = [variants.model(number) for number in variants.take(first_meshes(scene.variants))]
    for place, record, drive in last_records(models):
        yield models[place], PathState((load,), drive.snapshot()), row_of(record)


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
