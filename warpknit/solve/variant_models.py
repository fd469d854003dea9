"""Meshes of [variants], built one after the other. Loops that do not fit are replaced by the next seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from ..base.errors import ModelError
from ..knit.lapping import KnitError
from ..scene import Scene
from .model import build_model
from .simulate import Record, Simulation

MOST_NODES = 500_000  # of all meshes side by side
TRIES = 4  # seeds to a mesh, before a scene has none


def side_by_side(models: Sequence[Any], loops: Sequence[int] | None = None) -> list[list[int]]:
    """Places of models that can run as worlds of one simulation: with equal nodes and load steps, and own loops.

    Results do not depend on which models run together. A group has at most MOST_NODES. loops: a number for each model, equal
    for equal loops, which need not be their own; default: all differ.
    """
    groups: dict[tuple[int, ...], list[int]] = {}
    for place, model in enumerate(models):
        alone = () if model.scene.model.of_kind.own_loops else (place if loops is None else loops[place],)
        groups.setdefault((model.node_count, len(model.scene.stages), *alone), []).append(place)
    found = []
    for (nodes, *_), places in groups.items():
        most = max(1, MOST_NODES // nodes)
        found += [places[first : first + most] for first in range(0, len(places), most)]
    return found


def last_records(models: Sequence[Any], monitor: Callable[[int], None] = lambda _steps: None) -> Iterator[tuple[int, Record]]:
    """Place and last record of each model that converges, side by side.

    monitor: called at every check with the time steps of all models so far, may raise to stop.
    """
    before = 0
    for places in side_by_side(models):
        simulation = Simulation(models[places[0]], worlds=[models[place] for place in places])
        simulation.monitor = partial(lambda ran, begun, _progress: monitor(begun + ran.steps), simulation, before)
        last = {record.world: record for record in simulation.run()}
        for world, place in enumerate(places):
            if world not in simulation.failures:
                yield place, last[world]
        before += simulation.steps


class VariantModels:
    """Models by number; the number is added to the seed."""

    def __init__(self, scene: Scene, device: str = "cpu") -> None:
        self.scene, self.device = scene, device
        self.next = 0  # number of the mesh that is tried next
        self.refused: dict[int, str] = {}  # why, by number
        self.taken: list[int] = []  # numbers of the meshes that fit
        self._models: dict[int, Any] = {}
        self._base: Any = None  # the mesh of even loops

    def model(self, number: int) -> Any:
        """The model of a mesh. Raises `ModelError`, `KnitError`."""
        if number not in self._models:
            model: Any = build_model(self.scene.variant(number), self.device)
            if model.scene.model.of_kind.own_loops:  # results do not depend on which meshes run side by side
                self._base = self._base or build_model(self.scene.of_even_loops, self.device)
                model = model.beside(self._base)
            self._models[number] = model
        return self._models[number]

    def of_place(self, place: int) -> Any:
        """The model of the mesh at a place among those that fit, from 0."""
        while place >= len(self.taken):
            self.take(place + 1 - len(self.taken))
        return self.model(self.taken[place])

    def take(self, count: int, fits: Callable[[list[Any], Any], bool] = lambda _models, _model: True) -> list[int]:
        """Numbers of the next meshes, up to `count`, where `fits` allows. Raises the last error where no mesh fits."""
        taken: list[int] = []
        end = self.next + TRIES * max(count, self.scene.variants.count)
        while len(taken) < count and self.next < end:
            try:
                model = self.model(self.next)
            except (KnitError, ModelError) as error:
                self.refused[self.next] = str(error)
                self.next += 1
                if self.next == end and not taken:
                    raise
                continue
            if taken and not fits([self.model(number) for number in taken], model):
                break
            taken.append(self.next)
            self.next += 1
        self.taken += taken
        return taken
