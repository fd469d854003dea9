"""The material card of a tile of unequal loops: the mean of the cards of the meshes of `[variants]`, and their spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..measure import Observables
from ..measure.table import Record
from ..runner.history import row_of
from ..runner.variants import Spread, mesh_values_of, spread_of
from ..scene import Scene, Stage
from .card import MaterialCard, find_cards
from .card_files import card_values
from .load_path import DIFFERENCE_TOLERANCE, Meshes, Monitor, PathState, under_strain, under_tension

AHEAD = 1.01  # of the load of a card: the way on, along which a mesh with friction or yield is loaded
ROUGH_TOLERANCE = 1e-4  # residual, for a mesh that does not converge to the finer one
BEYOND = 13.0 / 12.0  # of the load of the card: last point of its loading curves


@dataclass(frozen=True)
class MeanCard:
    """A mean card, and the cards at the ends of its range of stiffness."""

    card: MaterialCard
    meshes: int  # how many cards it is the mean of
    spread: Mapping[str, Spread]  # of each value of a card, by name
    frictions: Mapping[str, Mapping[str, float]]  # of each value its means with other frictions
    softest: MaterialCard  # of the least C11 + C22
    stiffest: MaterialCard
    tensioned: Observables  # the median mesh


def loads_of_card(scene: Scene, gradient: np.ndarray, tension: float | None) -> tuple[Stage, Stage, Stage]:
    """Loads at a state, a little ahead of it, and BEYOND it.

    They are of a `tension` [N/m] both ways, or else of strains. gradient: (2, 2) deformation gradient of the state.
    """
    strains = gradient - np.eye(2)
    here, *more = (under_strain(scene, np.eye(2) + factor * strains) for factor in (1.0, AHEAD, BEYOND))
    ahead, beyond = more if tension is None else (under_tension(scene, factor * tension) for factor in (AHEAD, BEYOND))
    return here, ahead, beyond


def find_mean(
    meshes: Meshes, states: Mapping[int, PathState], tension: float | None, monitor: Monitor = lambda _: None
) -> MeanCard:
    """The mean over the cards of the meshes in the states of a path; the next larger tolerance where half of them have none.

    tension [N/m]: of the states, both ways; default: at their strains. `monitor` is called with the completed share. Raises
    `Diverged` where too few for a mean converge.
    """
    scene = meshes.scene
    loads = {place: loads_of_card(scene, state.gradient, tension) for place, state in states.items()}
    load, ahead = ({place: of_mesh[k] for place, of_mesh in loads.items()} for k in (0, 1))
    error, cards, own = Diverged("no mesh"), dict[int, tuple[MaterialCard, Record]](), list[int]()
    for tolerance in (DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE, scene.solver.residual_tolerance):
        try:
            cards = find_cards(meshes.with_tolerance(tolerance), states, load, ahead, monitor)
        except Diverged as failed:
            error, cards = failed, {}
        own = [place for place in meshes.own if place in cards]
        if len(own) >= max(meshes.fewest, 0.5 * len(meshes.own)):
            break
    if len(own) < meshes.fewest:
        raise error
    values = {place: {name: value for name, value, *_ in card_values(card)} for place, (card, _) in cards.items()}
    common = [name for name in values[own[0]] if all(name in of_mesh for of_mesh in values.values())]
    ordered = sorted((cards[place][0] for place in own), key=lambda card: float(np.trace(card.stiffness[:2, :2])))
    median = own[mesh_values_of(scene, [row_of(cards[place][1]) for place in own]).median]
    return MeanCard(
        _mean(cards[own[0]][0], [cards[place][0] for place in own]),
        len(own),
        {name: spread_of([values[place][name] for place in own]) for name in common},
        {name: meshes.means(values, name) for name in common},
        ordered[0],
        ordered[-1],
        cards[median][1].observables,
    )


def _mean(base: Any, cards: Sequence[Any]) -> Any:
    """Mean of dataclasses of numbers and arrays, with the texts of `base`."""
    mean = {}
    for field in fields(base):
        values = [getattr(card, field.name) for card in cards]
        if is_dataclass(values[0]):
            mean[field.name] = _mean(values[0], values)
        elif not isinstance(values[0], str) and values[0] is not None:
            mean[field.name] = sum(values[1:], values[0]) / len(values)
    return replace(base, **mean)
