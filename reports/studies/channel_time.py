"""How long the simulated channel takes, stage by stage.

Stages are functions of the channel, told apart by their code and not by their names. Every moment
belongs to the innermost stage that runs, so the stages' times are never negative, do not overlap,
and add up to the whole.
"""

import inspect
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import perf_counter
from types import FrameType
from typing import Any

import cv2
import numpy as np

from data_gen.channel.camera import collect, demosaic, develop, jpeg, mosaic
from data_gen.channel.composition import Shot, Viewpoint
from data_gen.channel.moire import moire_gain
from data_gen.channel.optics import image_of
from data_gen.channel.stills import draw_shots
from data_gen.frame_pair import Cell, FramePair, Source
from reports.engine.backends import one_thread
from reports.engine.provenance import machine
from reports.render.tables import Table

TIMED_CELL = Cell("nikon-lg", 45.0, 5)
"""Cell whose frame pairs are timed."""
CHANNEL_STAGES: dict[str, Sequence[Callable[..., Any]]] = {
    "draws of a frame pair: pose, motion, room light": (draw_shots,),
    "display: EOTF, angle, backlight": (Viewpoint.emitted,),
    "perspective and blur": (image_of,),
    "moire": (moire_gain,),
    "crosstalk, exposure, vignetting, banding": (Shot.expose_lights, collect),
    "noise, colour matrix, response, sharpening": (develop,),
    "Bayer mosaic": (mosaic,),
    "demosaicing": (demosaic,),
    "JPEG": (jpeg,),
}
"""Stages of the channel by title, and the functions that each consists of, less the stages that
these call."""
REST = "rest"
"""Title of the time outside all stages."""


def time_stages(
    call: Callable[[], object],
    stages: Mapping[str, Sequence[Callable[..., Any]]],
    clock: Callable[[], float] = perf_counter,
) -> dict[str, float]:
    """Run a function, and divide the time that it takes among stages.

    Args:
        call: what to run, in this thread.
        stages: functions written in Python, by the title of their stage.
        clock: returns a time in seconds that never runs backwards.

    Returns:
        the seconds of each stage, and of `REST`, in which no stage ran. A stage that calls another
        does not count the other's time, so the values add up to the time of the whole call.
    """
    stage_of = {
        inspect.unwrap(function).__code__: title
        for title, functions in stages.items()
        for function in functions
    }
    seconds = dict.fromkeys([*stages, REST], 0.0)
    running = [REST]
    since = clock()

    def at_switch(frame: FrameType, event: str, _: object) -> None:
        """Credit the time since the last switch to the stage that ran until now."""
        nonlocal since
        title = stage_of.get(frame.f_code)
        if title is None or event not in ("call", "return"):
            return
        now = clock()
        seconds[running[-1]] += now - since
        since = now
        if event == "call":
            running.append(title)
        else:  # also where the function raises
            running.pop()

    sys.setprofile(at_switch)
    try:
        call()
    finally:
        sys.setprofile(None)
    seconds[REST] += clock() - since
    return seconds


def time_frame_pairs(source: Source, count: int) -> dict[str, list[float]]:
    """Time the channel of frame pairs of `TIMED_CELL` on one core, after one that warms up.

    Args:
        source: pictures and seed.
        count: number of frame pairs.

    Returns:
        milliseconds of each stage and of `REST`, one value a frame pair.
    """
    one_thread()
    found: dict[str, list[float]] = {title: [] for title in [*CHANNEL_STAGES, REST]}
    for index in (0, *range(count)):
        pair = FramePair(source, TIMED_CELL, index)
        _ = pair.displayed  # made before the clock starts
        film = partial(getattr, pair, "captured")
        for title, seconds in time_stages(film, CHANNEL_STAGES).items():
            found[title].append(1e3 * seconds)
    return {title: values[1:] for title, values in found.items()}


def stage_table(times: Mapping[str, Sequence[float]]) -> Table:
    """Return the mean, quartiles and share of each stage, and of the whole.

    >>> print(stage_table({"blur": [1.0, 3.0], "rest": [2.0, 2.0]}).markdown())
    | stage | ms a frame pair, mean | quartiles | share |
    |---|---:|---:|---:|
    | blur | 2.0 | 1.5 – 2.5 | 50 % |
    | rest | 2.0 | 2.0 – 2.0 | 50 % |
    | whole | 4.0 | 3.5 – 4.5 | 100 % |

    Args:
        times: milliseconds of each stage, one value a frame pair.
    """
    whole = np.sum(list(times.values()), axis=0)
    rows = []
    for title, values in [*times.items(), ("whole", whole)]:
        mean = np.mean(values)
        low, high = np.percentile(values, (25, 75))
        share = f"{100 * mean / whole.mean():.0f} %"
        rows.append([title, f"{mean:.1f}", f"{low:.1f} – {high:.1f}", share])
    return Table(["stage", "ms a frame pair, mean", "quartiles", "share"], rows)


def time_report(source: Source, count: int) -> str:
    """Time frame pairs, and return the table with the number of pairs a second, as Markdown.

    Args:
        source: pictures and seed.
        count: number of frame pairs.
    """
    times = time_frame_pairs(source, count)
    low, median, high = np.percentile(np.sum(list(times.values()), axis=0), (25, 50, 75))
    host = machine()
    return (
        f"{stage_table(times).markdown()}\n\n"
        f"Median {median:.0f} ms a frame pair (quartiles {low:.0f} to {high:.0f}, n = {count}), "
        f"{1e3 / median:.0f} pairs a second on one core of {host.processor}, "
        f"{os.cpu_count()} cores, numpy {np.__version__}, OpenCV {cv2.__version__}."
    )
