"""Cost of writing USD: speed beside `numpy.tofile`, and slow-down of the steps.

Write speed: frames of a gripped panel go through `StageWriter`, and the same number of bytes through `numpy.tofile` with
fsync, in turns. Slowdown: stretches of steps with a frame handed over to the writing thread before each, in turns with
stretches without; what the writer has not finished by the end of a stretch is waited for, and not counted. On a machine
that others use too, `slowdown_by_processor_time` is the steadier number: what handing over and writing a frame take of
the processors, over what the steps take.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from warpknit import measure
from warpknit.export.frame_files import FrameFiles
from warpknit.export.usd.writer import StageWriter
from warpknit.planar.model import Model
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.planar.step import Stepper
from warpknit.results.frame import Frame
from warpknit.scene import load_scene
from warpknit.solve.model import build_model

PANEL = Path(__file__).parents[2] / "scenes/panel_million.toml"


def panel(nodes: int) -> Model:
    """A gripped panel of about `nodes` nodes, square in repeats."""
    side = 16
    one = build_model(load_scene(PANEL, [f"knit.repeats=[{side}, {side}]"]), "cpu").panel.node_count / side**2
    side = max(2, round(math.sqrt(nodes / one)))
    return build_model(load_scene(PANEL, [f"knit.repeats=[{side}, {side}]"]), "cpu")


def stage_writer(model: Model, place: Path) -> StageWriter:
    scene = model.scene
    return StageWriter(
        place, model.layout(), scene_name=scene.name, scene_hash=scene.hash, version="bench",
        colour_stress_max=scene.wire.yield_stress, points_per_tile=scene.output.usd_points_per_tile,
    )  # fmt: skip


def frame_of(model: Model, state: Any, index: int) -> Frame:
    """The frame of the state, made uneven: equal tiles would be written once, and stresses of zero cost nothing."""
    frame = measure.frame(read(model, state), index=index, stage="bench", load_factor=0.5, temperature=293.15)
    nodes, random = model.panel.node_count, np.random.default_rng(1)
    stress = 1e8 * (1.0 + np.sin(0.01 * np.arange(nodes)) + 0.1 * random.random(nodes))
    position = frame.node_position
    position += 1e-7 * random.random(position.shape)
    return dataclasses.replace(frame, node_position=position, node_stress=stress)


@contextmanager
def folder(on: Path | None) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=on) as name:
        yield Path(name)


def write_speed(model: Model, *, frames: int, rounds: int, on: Path | None) -> dict[str, Any]:
    """Seconds a frame through USD and through tofile, the median of the rounds."""
    frame = frame_of(model, initial_state(model), 0)
    usd, floor, sizes, processor = [], [], [0], []
    for _ in range(rounds):
        with folder(on) as place:
            writer = stage_writer(model, place)
            writer.add_frame(frame)
            begin, used = time.perf_counter(), time.process_time()
            for index in range(1, frames + 1):
                writer.add_frame(dataclasses.replace(frame, index=index))
            usd.append((time.perf_counter() - begin) / frames)
            processor.append((time.process_time() - used) / frames)
            sizes = [path.stat().st_size for path in sorted((place / "frames").iterdir())[1:]]
        with folder(on) as place:
            bytes_ = np.random.default_rng(2).integers(0, 256, sizes[0], dtype=np.uint8)
            begin = time.perf_counter()
            for index in range(frames):
                with open(place / str(index), "wb") as file:
                    bytes_.tofile(file)
                    file.flush()
                    os.fsync(file.fileno())
            floor.append((time.perf_counter() - begin) / frames)
    return {
        "case": "usd write", "nodes": model.panel.node_count, "frames": frames, "bytes_a_frame": sizes[0],
        "usd_s_a_frame": statistics.median(usd), "usd_processor_s_a_frame": statistics.median(processor),
        "tofile_s_a_frame": statistics.median(floor), "ratio": statistics.median(u / f for u, f in zip(usd, floor, strict=True)),
    }  # fmt: skip


def slowdown(model: Model, *, frames: int, steps: int, threads: int, on: Path | None) -> dict[str, Any]:
    """Seconds of `steps` steps with a frame and without."""
    state = initial_state(model)
    state.steering.set(travel_limit=np.inf)
    stepper = Stepper(model, state, threads=threads)
    frame = frame_of(model, state, 0)
    stepper.step(50)
    with folder(on) as place, FrameFiles(place, model.layout(), stage_writer(model, place)) as writer:
        writer.add_frame(frame)
        writer.flush()
        plain, handed, late = [], [], []
        stepping = writing = 0.0  # [s] of processor time
        for index in range(1, frames + 1):
            begin, used = time.perf_counter(), time.process_time()
            stepper.step(steps)
            plain.append(time.perf_counter() - begin)
            alone = time.process_time() - used
            begin, used = time.perf_counter(), time.process_time()
            writer.add_frame(dataclasses.replace(frame, index=index))
            stepper.step(steps)
            handed.append(time.perf_counter() - begin)
            begin = time.perf_counter()
            writer.flush()
            late.append(time.perf_counter() - begin)
            stepping += alone
            writing += time.process_time() - used - alone
        writer.close(complete=True)
        shutil.rmtree(place / "frames")
    return {
        "case": "usd slowdown", "nodes": model.panel.node_count, "frames": frames, "steps_a_frame": steps, "threads": threads,
        "steps_s": statistics.median(plain), "steps_and_frame_s": statistics.median(handed),
        "waited_for_s": statistics.median(late),
        "slowdown": statistics.median(h / p for h, p in zip(handed, plain, strict=True)) - 1.0,
        "writer_processor_s_a_frame": writing / frames,
        "slowdown_by_processor_time": writing / stepping,
    }  # fmt: skip


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Of each size the write speed, and the slowdown by number of threads."""
    for nodes in options.nodes:
        model = panel(int(nodes))
        yield write_speed(model, frames=options.frames, rounds=options.rounds, on=options.folder)
        for threads in options.threads:
            yield slowdown(model, frames=options.frames, steps=options.steps, threads=threads, on=options.folder)
