"""Compare decoders: python evaluate.py --pairs canon-lg --views 0 45 --kappas 5 3 --out DIR.

Decode once to predictions.jsonl, score to metrics.json, print tables beside the paper's numbers.
"""

import json
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import tyro

from data_gen.dataset import Source
from data_gen.effects import parse_settings
from data_gen.optics import check_view
from data_gen.pairs import PAIRS
from link.captures import load_capture, read_manifest
from link.embed import check_kappa
from link.errors import InputError, UnsuitedError, at_least, choose, run_cli
from link.images import make_folder, write_bytes, write_image
from link.layout import make_layout
from models import DECODERS, PRETRAINED
from reports.backends import make_backend
from reports.compare import (
    METHODS,
    Method,
    decode_captures,
    decode_each,
    methods_for,
    paper_cells,
)
from reports.figures import annotate
from reports.metrics import provenance, score, write_metrics
from reports.protocols import PROTOCOLS, apply
from reports.tables import paper_tables, summary_table

CONFIG = "config.json"
UNDECISIVE = ("out", "jobs", "backend", "scheduler", "show")
"""Flags that decide no number."""


@dataclass(frozen=True)
class EvaluateConfig:
    """The paper's protocol on simulated captures, or your own captures with --captures."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation, degrees."""
    kappas: tuple[int, ...] = (5, 3)
    """Gray levels added for a bit 1."""
    methods: tuple[str, ...] = tuple(DECODERS)
    """Decoders to compare; "ideal" is the floor under them, slow and for the simulation alone."""
    frames: int = 15
    """Frame pairs a cell; the paper has 25 (text) to 75 (15 pictures, 5 messages each)."""
    seed: int = 0
    protocol: str = "fair"
    """How thresholds are set: "fair" (in each frame pair), "paper", or another of
    reports/protocols.py."""
    without: tuple[str, ...] = ()
    """Effects of the channel to switch off, such as drift or moire (data_gen/effects.py)."""
    set: tuple[str, ...] = ()
    """Parameters of the channel, such as drift=0.1 jpeg_quality=70 (data_gen/parameters.py)."""
    out: Path = Path("runs/evaluation")
    """Folder for predictions.jsonl, metrics.json and tables.md."""
    captures: Path | None = None
    """Folder of captures, own or simulated, with a manifest.jsonl; replaces the simulation."""
    pictures: Path | None = None
    """Your own pictures, in place of the built-in test pictures."""
    run: Path | None = None
    """Checkpoint of the method "learned": by default the shipped one, trained on all pairs."""
    ratex: int = 5
    """Ratex patches: 1, 2, 3 or 5."""
    show: Path | None = None
    """With --captures: folder for annotated pictures, one a frame pair and method."""
    jobs: int = os.cpu_count() or 1
    """Processes."""
    backend: Literal["loky", "dask"] = "loky"
    """Where cells are decoded: processes of this machine, or the workers of a Dask cluster."""
    scheduler: str | None = None
    """With --backend dask: the scheduler's address, such as tcp://host:8786."""


def main() -> None:
    """Decode, score, print."""
    config = tyro.cli(EvaluateConfig)
    check(config)
    methods = apply(config.protocol, methods_for(config.methods, config.run or PRETRAINED))
    settings = describe(config, methods)
    refuse_other_run(config.out, settings)
    failed: list[str] = []
    if config.captures is not None:
        predictions, notes = decode_captures(config.captures, methods, config.out)
        for note in notes:
            print(note)
        entries = read_manifest(config.captures)
        simulated = all(bool(entry.get("simulated")) for entry in entries)
    else:
        cells = paper_cells(config.pairs, config.views, config.kappas)
        backend = make_backend(config.backend, config.jobs, config.scheduler)
        predictions, failed = decode_each(
            source_of(config), cells, config.frames, methods, config.out, backend
        )
        simulated = True
    write_bytes(config.out / CONFIG, settings)
    rows = score(predictions)
    meta = provenance(config.seed, simulated)
    write_metrics(config.out / "metrics.json", rows, {**meta, "failed_cells": failed})
    kind = "simulated captures" if simulated else "real captures"
    if config.captures is None:
        kind += ", held-out pictures" if config.pictures is None else ", your own pictures"
    tables = summary_table(rows, f"All cells ({kind})")
    if config.captures is None:
        tables = f"{paper_tables(rows)}\n\n{tables}"
    write_bytes(config.out / "tables.md", f"{tables}\n".encode())
    print(tables)
    print(f"\nwritten: {config.out}/predictions.jsonl, metrics.json, tables.md")
    if config.captures is not None and config.show is not None:
        show(config.captures, methods, config.show)
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    if failed:
        raise InputError(
            f"{len(failed)} of {len(cells)} cells failed, as listed above; the others are in "
            f"{config.out}, and the same command tries the failed ones again"
        )


def check(config: EvaluateConfig) -> None:
    """Refuse wrong flags before any work."""
    for pair in config.pairs:
        source_of(config).pair(pair)
    for kappa in config.kappas:
        check_kappa(kappa)
    for name in config.methods:
        choose(METHODS, name, "method")
    for view in config.views:
        check_view(view, "--views")
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    make_backend(config.backend, config.jobs, config.scheduler)
    if config.show is not None and config.captures is None:
        raise InputError("--show: draws captures, so it needs --captures")
    for flag, values in (
        ("pairs", config.pairs),
        ("views", config.views),
        ("kappas", config.kappas),
        ("methods", config.methods),
    ):
        if not values or len(set(values)) != len(values):
            raise InputError(f"--{flag}: name at least one, and none twice")


def source_of(config: EvaluateConfig) -> Source:
    """Test pictures, and the channel as the flags set it."""
    return Source(
        make_layout(ratex=config.ratex),
        "test",
        config.seed,
        pictures=config.pictures,
        ratex_kappa=choose(PROTOCOLS, config.protocol, "protocol").ratex_kappa,
        without=config.without,
        parameters=parse_settings(config.set),
    )


def describe(config: EvaluateConfig, methods: list[Method]) -> bytes:
    """What decides the result, as the text of config.json."""
    settings = {k: v for k, v in asdict(config).items() if k not in UNDECISIVE}
    settings["checkpoints"] = {method.name: method.digest() for method in methods}
    return (json.dumps(settings, indent=2, default=str) + "\n").encode()


def refuse_other_run(out: Path, settings: bytes) -> None:
    """Refuse a folder that holds the results of other settings."""
    make_folder(out)
    file = out / CONFIG
    if file.is_file() and file.read_bytes() != settings:
        raise InputError(f"--out: {out} holds a run with other settings; choose another folder")


def show(captures: Path, methods: list[Method], folder: Path) -> None:
    """Write one annotated picture a frame pair and method."""
    for number, entry in enumerate(read_manifest(captures)):
        captured = load_capture(captures, entry)
        pair = captured.rectified()
        for method in methods:
            try:
                soft = method.build().decode(pair)
            except UnsuitedError:
                continue
            picture = annotate(pair, soft, captured.bits)
            write_image(folder / f"{number:05d}_{method.name}.png", picture)
    print(f"annotated pictures: {folder}")


if __name__ == "__main__":
    run_cli(main)
