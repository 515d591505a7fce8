"""Other systems on the same captures: python -m reports.studies.peers --out runs/peers.

Packages, without their dependencies: `adapters.INSTALL` is the command that installs them.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tyro

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Source
from link.cli import read_flags, run_cli
from link.embed import check_kappa
from link.errors import InputError, ParameterError, at_least, choose, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import make_layout
from models import DECODERS, PRETRAINED
from reports.engine.backends import Backend
from reports.engine.digest import code_digest, package_versions, short_digest
from reports.engine.methods import methods_for
from reports.engine.predict import fingerprint
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.render.charts import save_png
from reports.render.tables import write_blocks
from reports.studies.peers.adapters import PEERS, make_peers
from reports.studies.peers.page import (
    PACKAGES,
    count_readings,
    peers_block,
    peers_figure,
    write_peers,
)
from reports.studies.peers.study import (
    PairSystem,
    PeerTask,
    Reading,
    StillSystem,
    System,
    read_messages,
)

MAX_BITS = 1024
"""Largest number of message bits; the pictures have three times as many blocks of 8 x 8."""


@dataclass(frozen=True)
class PeersConfig:
    """Bit accuracy against visibility: other systems, and ours."""

    pairs: tuple[str, ...] = ("canon-lg", "nikon-samsung", "sony-imac")
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    systems: tuple[str, ...] = tuple(PEERS)
    """Other systems."""
    ours: tuple[str, ...] = ("learned", "oorc", "blind")
    """Methods of this repository."""
    kappas: tuple[int, ...] = (1, 2, 3, 5, 10)
    """Strengths of ours: gray levels added to a block that carries a 1."""
    frames: int = 6
    """Number of pictures."""
    bits: int = 32
    """Number of message bits of the other systems; rivaGAN has 32."""
    seed: int = 0
    """Seed of messages and of the channel."""
    out: Path = Path("runs/peers")
    """Folder for peers.md, peers.json, peers.png, predictions.jsonl and the stored readings."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""


def main() -> None:
    """Embed, film, read, print."""
    config = read_flags(lambda: tyro.cli(PeersConfig))
    source = Source(make_layout(), "test", config.seed, parameters=(("corner_px", 0.0),))
    systems = check_systems(config, source)
    with locked(config.out):
        _run(config, source, systems)


def _run(config: PeersConfig, source: Source, systems: Sequence[System]) -> None:
    """Embed, film, read, print, while no other process writes the folder."""
    readings = read_all(config, source, systems)
    lines = [json.dumps(reading, allow_nan=False) + "\n" for reading in readings]
    write_bytes(config.out / "predictions.jsonl", "".join(lines).encode())
    rows = count_readings([Reading(**reading) for reading in readings])
    stored = config.out / "peers.json"
    write_peers(stored, rows, provenance(config.seed, simulated=True) | peer_versions())
    save_png(peers_figure(rows, columns=2), config.out / "peers.png")
    block = peers_block(stored)
    write_blocks(config.out / "peers.md", {"peers": block})
    print(block)
    print(f"\nwritten: {config.out}/peers.md, peers.json, peers.png, predictions.jsonl")


def read_all(
    config: PeersConfig, source: Source, systems: Sequence[System]
) -> list[dict[str, Any]]:
    """Let each system embed and read; a run that was cut off goes on where it stopped.

    Returns:
        the fields of a `Reading` for each message, ordered as ``systems``.

    Raises:
        InputError: one failed; those that finished are kept.
    """
    settings = (source, config.pairs, config.views, config.frames, config.bits, peer_versions())
    parts = (repr(settings), code_digest("reports.studies.peers.study"), *package_versions())
    mark = short_digest(*parts)
    tasks = {}
    for system in systems:
        name = f"{system.name}, {system.strength}"
        if isinstance(system, PairSystem):
            name += f", {fingerprint(source, config.frames, system.method)[:8]}"
        tasks[name] = PeerTask(source, config.pairs, config.views, config.frames, system)
    file = config.out / f"readings_{mark}.jsonl"
    found = resume(read_messages, tasks, file, Backend(config.jobs), "systems")
    return [reading for readings in found.values() for reading in readings]


def check_systems(config: PeersConfig, source: Source) -> list[System]:
    """Make the systems at their strengths.

    Raises:
        InputError: a flag is wrong, or a package is missing.
    """
    for pair in config.pairs:
        source.pair(pair)
    for view in config.views:
        check_view(view, "views")
    for kappa in config.kappas:
        check_kappa(kappa, "kappas")
    for name in config.ours:
        choose(DECODERS, name, "method")
    at_least(1, frames=config.frames, bits=config.bits, jobs=config.jobs)
    at_least(0, seed=config.seed)
    each_once(pairs=config.pairs, views=config.views, kappas=config.kappas)
    if config.bits > MAX_BITS:
        raise ParameterError("bits", f"need at most {MAX_BITS}, got {config.bits}")
    stills: list[System] = [
        StillSystem(peer) for name in config.systems for peer in make_peers(name, config.bits)
    ]
    ours: list[System] = [
        PairSystem(method, kappa)
        for method in methods_for(config.ours, PRETRAINED)
        for kappa in config.kappas
    ]
    if not stills and not ours:
        raise InputError("--systems, --ours: name at least one")
    return [*ours, *stills]


def peer_versions() -> dict[str, str]:
    """Versions of those packages of the other systems that are installed."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


if __name__ == "__main__":
    run_cli(main)
