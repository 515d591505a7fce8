"""Other systems on the same captures: python -m reports.studies.peers --out runs/peers.

Packages, without their dependencies: see `adapters.INSTALL`.
"""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tyro
from tqdm import tqdm

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Source
from link.embed import check_kappa
from link.errors import InputError, at_least, choose, run_cli
from link.images import write_bytes
from link.layout import make_layout
from models import DECODERS, PRETRAINED
from reports.engine.backends import Backend, run_tasks
from reports.engine.predict import digest_files, fingerprint, methods_for
from reports.score.metrics import provenance
from reports.studies.peers.adapters import PEERS, make_peers
from reports.studies.peers.page import plot, table, tally
from reports.studies.peers.study import Ours, Still, System, measure

DECISIVE = ("adapters", "study")
"""Files here that decide numbers."""
PACKAGES = ("invisible-watermark", "blind-watermark", "PyWavelets")
NOTE = """# Other systems on the same captures

Simulated captures of held-out pictures, seed {seed}: {pairs}; {frames} pictures, each filmed by
every pair at every view, with one draw of the channel for all systems. By `{command}`.

Entries are per cent of message bits that are right, ± half the 95 % interval, which knows that
errors cluster by capture; 50 is chance. Every system gets the true corners, and captures
rectified to the displayed size. The peers mark one still picture and are read from one captured
frame, and from the mean of two. Ours ({ours}) is read from two frames, the original and the
embedded one: the display must show both in turn and the camera must catch each, which the peers
do not need. PSNR and SSIM compare what carries the message with what does not: the marked with
the unmarked picture, for ours the embedded with the original frame. Both of these show the five
ratex patches, except for `blind`, which has none and whose pictures are equalised instead.
Flicker is in neither measure. *Bits*: message bits of a still picture, or of a pair of frames.
*Decode ms*: median processor time for one rectified capture, one thread.

Peers come from the packages invisible-watermark (rivaGAN, DWT-DCT, DWT-DCT-SVD) and
blind-watermark, and decide as those do. "Default" is the package's own strength. rivaGAN has no
strength: what it adds to the picture was multiplied here. The DWT methods mark the U channel by
default; Y was tried too. invisible-watermark 0.2.0 swaps horizontal and vertical details when it
puts the picture together again (`encode` in maxDct.py and dwtDctSvd.py), which costs PSNR
whatever the strength, most in Y. No peer was made for a filmed display, and none is calibrated to
its photometry.

![bit accuracy against PSNR](peers.png)

*Of a peer's two readings the better one.*

"""


@dataclass(frozen=True)
class PeersConfig:
    """Bit accuracy against visibility: other systems, and ours."""

    pairs: tuple[str, ...] = ("canon-lg", "nikon-samsung", "sony-imac")
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Degrees."""
    systems: tuple[str, ...] = tuple(PEERS)
    """Other systems."""
    ours: tuple[str, ...] = ("learned", "oorc", "blind")
    """Methods of this repository."""
    kappas: tuple[int, ...] = (1, 2, 3, 5, 10)
    """Strengths of ours."""
    frames: int = 6
    """Pictures."""
    bits: int = 32
    """Message bits of the other systems; rivaGAN has 32."""
    seed: int = 0
    out: Path = Path("runs/peers")
    """Folder for peers.md, peers.json, peers.png and predictions.jsonl."""
    jobs: int = os.cpu_count() or 1


def main() -> None:
    """Embed, film, read, print."""
    config = tyro.cli(PeersConfig)
    source = Source(make_layout(), "test", config.seed, parameters=(("corner_px", 0.0),))
    systems = check(config, source)
    found = measured(config, source, systems)
    lines = [line for part in found for line in part]
    text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
    write_bytes(config.out / "predictions.jsonl", text.encode())
    rows = tally(lines)
    meta = {**provenance(config.seed, simulated=True), **versions()}
    content = {"meta": meta, "rows": [asdict(row) for row in rows]}
    write_bytes(
        config.out / "peers.json", (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
    )
    plot(rows, config.out / "peers.png")
    note = NOTE.format(
        seed=config.seed,
        pairs=", ".join(config.pairs),
        frames=config.frames,
        command=meta["command"],
        ours=", ".join(f"`{name}`" for name in config.ours),
    )
    write_bytes(config.out / "peers.md", f"{note}{table(rows)}\n".encode())
    print(table(rows))
    print(f"\nwritten: {config.out}/peers.md, peers.json, peers.png, predictions.jsonl")


def measured(
    config: PeersConfig, source: Source, systems: Sequence[System]
) -> list[list[dict[str, Any]]]:
    """Predictions of each system; a run that was cut off goes on where it stopped.

    Raises:
        InputError: one failed; those that finished are kept.
    """
    key = repr((source, config.pairs, config.views, config.frames, config.bits, versions()))
    key += fingerprint(source, config.frames, methods_for(config.ours, PRETRAINED))
    key += digest_files([Path(__file__).with_name(f"{name}.py") for name in DECISIVE])
    folder = config.out / "cells" / hashlib.sha256(key.encode()).hexdigest()[:16]
    files = [folder / f"{s.name}, {s.strength}.json".replace(" ", "_") for s in systems]
    todo = [number for number, file in enumerate(files) if not file.is_file()]
    task = partial(measure, source, config.pairs, config.views, config.frames)
    outcomes = run_tasks(task, [systems[number] for number in todo], Backend(config.jobs))
    done, failed = len(systems) - len(todo), []
    for outcome in tqdm(outcomes, total=len(systems), initial=done, unit="system"):
        number = todo[outcome.index]
        if outcome.failure is not None:
            failed.append(f"{files[number].stem}: {outcome.failure.reason}")
            continue
        write_bytes(files[number], json.dumps(outcome.result, allow_nan=False).encode())
    if failed:
        raise InputError(f"{len(failed)} of {len(systems)} systems failed: {'; '.join(failed)}")
    return [json.loads(file.read_text()) for file in files]


def check(config: PeersConfig, source: Source) -> list[System]:
    """The systems at their strengths; an `InputError` for a wrong flag or a missing package."""
    for pair in config.pairs:
        source.pair(pair)
    for view in config.views:
        check_view(view, "--views")
    for kappa in config.kappas:
        check_kappa(kappa)
    for name in config.ours:
        choose(DECODERS, name, "method")
    at_least(1, frames=config.frames, bits=config.bits, jobs=config.jobs)
    at_least(0, seed=config.seed)
    stills = [Still(peer) for name in config.systems for peer in make_peers(name, config.bits)]
    ours = [
        Ours(method, kappa)
        for method in methods_for(config.ours, PRETRAINED)
        for kappa in config.kappas
    ]
    if not stills and not ours:
        raise InputError("--systems, --ours: name at least one")
    return [*ours, *stills]


def versions() -> dict[str, str]:
    """Of the peers' packages that are installed."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


if __name__ == "__main__":
    run_cli(main)
