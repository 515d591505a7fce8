"""Settings of a comparison: flags of evaluate.py, their checks, and those that decide its result.

Settings are compared with the usual ones, which are the defaults of the command's flags.
"""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from data_gen.flags import LayoutFlags, SourceFlags
from data_gen.pairs import PAIRS
from link.captures import BELOW
from link.errors import InputError, ParameterError, at_least, choose, each_once
from link.layout import Layout
from models import OF_PAIRS
from reports.engine.methods import PROTOCOLS, Method
from reports.engine.predict import checkpoint_digest

UNDECISIVE = ("out", "jobs", "backend", "scheduler", "show", "html", "report", "compare")
"""Flags that decide no number, and so are no part of a run's settings."""
OF_CELLS = ("pairs", "views", "kappas", "pictures", "without", "set", "frames")
"""Flags that say which frame pairs are simulated."""
OF_SIMULATION = (*OF_CELLS, "ratex")
"""Settings that say what is simulated. They say nothing of captures from a folder."""
OF_BENCHMARK = (*OF_CELLS, "films", "captures", "ablation", "protocol")
"""Flags that have no effect with --benchmark, which fixes its conditions, and so are refused."""
OF_RECORDINGS = ("photos", "camera", "view", "fps")
"""Flags that say more of own recordings."""


@dataclass(frozen=True)
class EvaluateConfig(SourceFlags):
    """The paper's protocol on simulated captures, or your own recordings with --captures."""

    out: Path = Path("runs/evaluation")
    """Folder for predictions.jsonl, metrics.json, tables.md and report.html. If it holds an
    unfinished run of the same settings, that run goes on. A folder that holds another run, or that
    another process is writing, is refused."""
    methods: tuple[str, ...] = OF_PAIRS
    """Decoders to compare, or "package.module:Class" for your own (docs/extend.md); by default all
    that read frame pairs, or all decoders where films are decoded. Options follow the name, as in
    oorc:C=0.1."""
    ablation: bool = False
    """Compare the parts of the learned decoder instead of --methods: parts are added to plain OORC,
    and removed from the full decoder (reports/ablation/switches.py)."""
    captures: Path | None = None
    """Decode recordings instead of the simulation: a folder of captures with a manifest.jsonl or,
    with --sent, a film (a video, or a folder of its frames), a folder of several films, or
    photographs."""
    sent: Path | None = None
    """With --captures: what the display showed, which is the player's .html or the folder of states
    that python -m sender wrote. For several films it can be a folder of these, named as the
    films."""
    photos: bool = False
    """With --sent: --captures holds photographs, one of each state in order, once or several
    times."""
    camera: str | None = None
    """With --sent: name of camera and display, by which tables group; by default the name of the
    film."""
    view: Annotated[float | None, tyro.conf.arg(name="view")] = None
    """With --sent: angle between the camera and the display's normal, degrees; by default the
    number before "deg" in the film's name."""
    fps: float | None = None
    """With --sent: frames a second of the films, if their own times are wrong, as in slow
    motion."""
    show: Path | None = None
    """With --captures: folder for annotated pictures, one for each frame pair and method."""
    films: tuple[str, ...] = ()
    """Decode simulated films instead of frame pairs, each named PRESET or PRESET:FPS, such as
    hidden:30. Each cell has --frames films, and one window of each is decoded. Layout and kappa are
    the preset's."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs, or "today" for all of data_gen/today.json."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation, degrees."""
    kappas: tuple[int, ...] = (5, 3)
    """Gray levels added for a bit 1."""
    frames: int = 15
    """Number of frame pairs in each cell; the paper has 25 (text) to 75 (15 pictures with 5
    messages each)."""
    protocol: str = "fair"
    """Rule for thresholds: "fair" sets them anew in each frame pair, "paper" fixes them as the
    paper does."""
    benchmark: bool = False
    """Compare under the fixed conditions of reports/benchmark.py instead of others, and write
    benchmark.json, by which results of different authors can be compared (docs/benchmark.md)."""
    run: Path | None = None
    """Checkpoint of the method "learned": by default the shipped one for the layout of each frame
    pair, trained on all pairs."""
    report: Path | None = None
    """Build the report of this finished run again, without decoding; all other flags are
    ignored."""
    compare: tuple[Path, Path] | None = None
    """Compare two finished runs on the same captures, the second against the first."""
    html: bool = True
    """Write report.html and the pictures in it; with --no-html, --report can do so later."""
    jobs: int = os.cpu_count() or 1
    """Number of processes that decode."""
    backend: Literal["loky", "dask"] = "loky"
    """Where cells are decoded: processes of this machine, or the workers of a Dask cluster."""
    scheduler: str | None = None
    """With --backend dask: the scheduler's address, such as tcp://host:8786."""


def check_settings(config: EvaluateConfig) -> None:
    """Raise an `InputError` that names the first flag with a wrong value, or that clashes."""
    at_least(1, frames=config.frames, jobs=config.jobs)
    each_once(methods=config.methods)
    if config.run is not None and "learned" not in [m.partition(":")[0] for m in config.methods]:
        raise ParameterError("run", "is a checkpoint of learned, which is not among the methods")
    choose(PROTOCOLS, config.protocol, "protocol")
    needed = (config.captures, config.sent)
    if config.captures is None and config.sent is not None:
        raise InputError("--sent: is about own recordings, and needs --captures")
    if flag := first_set(config, OF_RECORDINGS if None in needed else ()):
        raise InputError(f"--{flag}: is about own recordings, and needs --captures and --sent")
    if config.view is not None and not abs(config.view) < BELOW["view_deg"]:
        raise ParameterError("view", f"need an angle below 90 degrees, got {config.view:g}")
    if config.show is not None and config.captures is None:
        raise InputError("--show: draws captures, so it needs --captures")
    if config.captures is not None and config.layout() != EvaluateConfig().layout():
        raise InputError("--captures: has layouts of its own; leave out the flags of the layout")
    for kind, why, flags in (
        ("benchmark", "has conditions of its own", OF_BENCHMARK),
        ("ablation", "compares parts of one decoder", ("methods",)),
        ("films", "are simulated", ("captures",)),
    ):
        if getattr(config, kind) and (flag := first_set(config, flags)):
            raise InputError(f"--{kind}: {why}; leave out --{flag}")


def first_set(config: EvaluateConfig, flags: Sequence[str]) -> str:
    """Name the first of some flags that is not as it usually is; "" where all are.

    >>> first_set(EvaluateConfig(frames=3), ("pairs", "frames"))
    'frames'
    """
    usual = EvaluateConfig()
    return next((flag for flag in flags if getattr(config, flag) != getattr(usual, flag)), "")


def decisive_settings(
    config: EvaluateConfig, methods: Sequence[Method], layouts: Sequence[Layout]
) -> dict[str, Any]:
    """Name all that decides the result: flags, and digests of the checkpoints.

    Args:
        config: settings of evaluate.py.
        methods: methods that are compared.
        layouts: layouts of the frame pairs on which they are compared.
    """
    layout = config.layout()
    flags = {field.name for field in fields(LayoutFlags)}
    settings = {k: v for k, v in asdict(config).items() if k not in (*UNDECISIVE, *flags)}
    settings |= {flag: getattr(layout, flag) for flag in sorted(flags)}
    settings["ratex"] = len(layout.ratex)
    return {**settings, "checkpoints": {m.name: checkpoint_digest(m, *layouts) for m in methods}}
