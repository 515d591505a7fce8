"""Messages from simulated hand-held video: python -m reports.films.delivery.

Each run draws a picture, a room, a pose, the motion of the hand, both clocks, and the moment of the
loop at which the camera joins. What a phone does to the frames is chosen: its processing, a codec
(``--codec.name h264 --codec.kbits 8000``), lost frames. The same draws are filmed whatever is
chosen. The receiver gets the frames and their times alone. Runs are stored as they end, and a
restarted command goes on where it stopped.
"""

import json
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro

from data_gen.channel.optics import check_view
from data_gen.film.codec import through_codec
from data_gen.film.scenes import SceneSettings
from data_gen.pairs import PAIRS
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from export.to_onnx import to_onnx
from link.cli import read_flags, run_cli
from link.code.framing import frames_needed
from link.embed import check_kappa
from link.errors import ParameterError, at_least, choose, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.outside import read_json
from link.presets import PRESETS
from models import shipped_checkpoint, shipped_graphs
from models.neural.checkpoint import load_checkpoint
from reports.engine.backends import Backend, one_thread
from reports.engine.checked import write_json
from reports.engine.digest import code_digest, file_digest, package_versions, short_digest
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.films.messages import Delivery, DeliveryConfig, FilmReading, Take, film_message
from reports.render.tables import Table, percent, share_interval
from reports.score.intervals import wilson

STORED_VERSION = 2
"""Raise it when `deliver` or `reports.films.messages` changes what it does, so that older runs are
not read again."""
DECIDING = (
    "data_gen.film.stream", "data_gen.film.codec", "data_gen.frame_pair", "export.receive.receiver",
)  # fmt: skip
"""Modules that decide, with all that they import, what a run gives."""
GRIDS = (8, 16)
"""Numbers of blocks along each side that a message may be filmed with."""
MAX_LOOPS = 100.0
"""Largest number of loops of the message after which a run may be given up."""


def deliver(take: Take) -> dict[str, Any]:
    """Film until the message comes or the loops are over.

    Returns:
        the fields of a `Delivery`.
    """
    one_thread()
    filmed = film_message(take)
    reading = FilmReading(filmed, Decoder(take.model, 1, OWN_TIME_LIMIT_S))
    for frame in through_codec(filmed.frames, take.config.codec, take.config.fps):
        reading.push(frame)
        if reading.ended:
            break
    return asdict(reading.delivery())


def receiver_model(config: DeliveryConfig) -> Path:
    """Path of the shipped decoder for the layout of a setting, exported where none ships."""
    layout = config.layout
    shipped = shipped_graphs().get(layout)
    if shipped is not None:
        return shipped
    path = config.out / config.name / "decoder.onnx"
    folder = shipped_checkpoint(layout)
    write_bytes(path, to_onnx(load_checkpoint(folder, layout=layout), folder.name))
    return path


def deciding_parts(config: DeliveryConfig, model: Path) -> list[str]:
    """List all that decides a run apart from pair, view and number: settings, code, packages."""
    settings = (config.kappa, config.layout, config.state_hz, config.fps, config.n_bytes)
    camera = (config.hand, config.drop, config.jitter_s, config.phone, config.codec)
    return [
        repr(
            (
                STORED_VERSION,
                *settings,
                config.redundancy,
                config.loops,
                config.outside,
                config.coverage,
                config.size,
                config.pan_px,
                *camera,
                config.seed,
            )
        ),
        code_digest(*DECIDING),
        file_digest([model]),
        *package_versions(),
        version("av") if config.codec.on else "",
    ]


def stored_runs(config: DeliveryConfig, model: Path) -> Path:
    """File of the runs, named after all that decides them apart from pair, view and number."""
    mark = short_digest(*deciding_parts(config, model))
    return config.out / config.name / f"runs_{mark}.jsonl"


def bound_seconds(delivery: Delivery, config: DeliveryConfig) -> float:
    """Shortest time in which a code for hard bits could deliver at this run's share of wrong bits.

    It is the capacity of a binary symmetric channel, for a receiver that knows from the start the
    clock of the display and the place in the loop.
    """
    n_bits = config.layout.n_bits
    p = min(max(delivery.bits_wrong / max(delivery.bits, 1), 1e-9), 0.5)
    entropy = -p * np.log2(p) - (1 - p) * np.log2(1 - p)
    per_pair = max(n_bits * (1 - entropy), 1e-9)
    return float(8 * config.n_bytes / per_pair * 2 / config.state_hz)


def summarise_deliveries(
    deliveries: list[Delivery], config: DeliveryConfig
) -> list[dict[str, Any]]:
    """Pool the runs of each view, and all of them.

    Returns:
        for each view, and then for "all": numbers of runs and of messages ``delivered``, with
        Wilson's 95 % interval of their share; ``wrong_messages``; median and 95 % quantile of the
        seconds (None where no message came), median of the loops, and median of `bound_seconds`;
        share of ``bits_wrong``; and bits of delivered messages in a second of film.
    """
    runs = pd.DataFrame([asdict(delivery) for delivery in deliveries])
    runs["bound"] = [bound_seconds(delivery, config) for delivery in deliveries]
    groups = {f"{view:g}°": runs[runs["view_deg"] == view] for view in config.views} | {"all": runs}
    rows = []
    for name, group in groups.items():
        came, filmed = group[group["delivered"]], float(group["seconds"].sum())
        low, high = wilson(len(came), len(group))
        rows.append(
            {
                "view": name,
                "runs": len(group),
                "delivered": len(came),
                "ci_low": low,
                "ci_high": high,
                "wrong_messages": int(group["wrong"].sum()),
                "seconds_median": float(came["seconds"].median()) if len(came) else None,
                "seconds_95": float(came["seconds"].quantile(0.95)) if len(came) else None,
                "loops_median": float(came["loops"].median()) if len(came) else 0.0,
                "bound_seconds": float(group["bound"].median()),
                "bits_wrong": int(group["bits_wrong"].sum()) / max(1, int(group["bits"].sum())),
                "goodput_bit_s": 8 * config.n_bytes * len(came) / max(filmed, 1 / config.fps),
            }
        )
    return rows


def delivery_table(folder: Path) -> Table:
    """Show the stored results of a plain camera's settings, one row for each file of a folder."""
    heads = (
        "grid", "states/s", "camera fps", "pairs", "runs", "delivered in 3 loops", "95 % interval",
        "wrong messages", "bits wrong %", "seconds, median (95 %)", "loops", "bound, s",
        "goodput, bit/s",
    )  # fmt: skip
    rows = []
    for path in sorted(folder.glob("*.json")):
        stored = read_json(path)
        if stored.get("camera") or stored["config"].get("preset", "paper") != "paper":
            continue  # reports.films.codecs compares what phones do
        row, setup = stored["summary"][-1], stored["config"]
        rows.append(
            [
                f"{setup['grid'] or 8} × {setup['grid'] or 8}",
                f"{setup['state_hz']:g}",
                f"{setup['fps']:g}",
                str(len(setup["pairs"])),
                str(row["runs"]),
                str(row["delivered"]),
                f"{share_interval(row['ci_low'], row['ci_high'], 1)} %",
                str(row["wrong_messages"]),
                percent(row["bits_wrong"]),
                "–"
                if row["seconds_median"] is None
                else f"{row['seconds_median']:.1f} ({row['seconds_95']:.1f})",
                f"{row['loops_median']:.2f}",
                f"{row['bound_seconds']:.1f}",
                f"{row['goodput_bit_s']:.0f}",
            ]
        )
    title = (
        "Simulated hand-held video at 1280 × 720, 0° and 45°, κ = 3, a 100-byte message; picture, "
        "room, pose, clocks (±1 %) and start in the loop drawn anew in each run "
        "(`python -m reports.films.delivery`):"
    )
    return Table(heads, rows, title)


def delivery_block(folder: Path) -> str:
    """Show the stored results of all settings, and say what the bound is."""
    bound = (
        "*bound*: the time that a perfect code for hard bits would need at the same share of wrong "
        "bits, if the receiver knew the clock and the place in the loop from the start."
    )
    return f"{delivery_table(folder).markdown()}\n\n{bound}"


def check_delivery(config: DeliveryConfig) -> None:
    """Raise an `InputError` that names the first flag with a wrong value, before any work."""
    at_least(1, runs=config.runs, jobs=config.jobs, n_bytes=config.n_bytes)
    at_least(0, seed=config.seed)
    each_once(pairs=config.pairs, views=config.views)
    for pair in config.pairs:
        choose(PAIRS, pair, "name in --pairs")
    for view in config.views:
        check_view(view, "views")
    check_kappa(config.kappa)
    choose(PRESETS, config.preset, "preset")
    if config.grid is not None and (config.preset != "paper" or config.grid not in GRIDS):
        raise ParameterError("grid", f"need 8 or 16, and the preset paper, got {config.grid}")
    frames_needed(config.n_bytes, config.layout.n_bits, "n_bytes")
    if not 0 < config.loops <= MAX_LOOPS:
        raise ParameterError(
            "loops", f"need more than 0 and at most {MAX_LOOPS:g}, got {config.loops:g}"
        )
    least, most = config.coverage
    for share in config.coverage:
        scene = SceneSettings(config.size, share)
        config.video(scene).check()
        replace(scene, outside=config.outside).check()
    config.codec.check()
    if not least <= most:
        raise ParameterError("coverage", f"the largest share, {most:g}, is below the least")


def main() -> None:
    """Film, receive, store, print."""
    config = read_flags(lambda: tyro.cli(DeliveryConfig))
    check_delivery(config)
    with locked(config.out):
        print(run_deliveries(config))


def run_deliveries(config: DeliveryConfig) -> Path:
    """Film, receive, store, print, while no other process writes the folder.

    Returns:
        the file of the results.
    """
    model = receiver_model(config)
    takes = {
        f"{pair} {view:g} {run}": Take(config, pair, view, run, model)
        for run, view, pair in product(range(config.runs), config.views, config.pairs)
    }
    stored = resume(deliver, takes, stored_runs(config, model), Backend(config.jobs), "runs")
    deliveries = [Delivery(**run) for run in stored.values()]
    summary = summarise_deliveries(deliveries, config)
    for row in summary:
        print(json.dumps(row))
    setup = {key: value for key, value in asdict(config).items() if key not in ("out", "jobs")}
    content = {
        "meta": provenance(config.seed, simulated=True),
        "camera": config.camera,
        "config": setup,
        "summary": summary,
        "runs": sorted(stored.values(), key=lambda run: (run["pair"], run["view_deg"], run["run"])),
    }
    file = config.out / f"{config.name}.json"
    write_json(file, content)
    return file


if __name__ == "__main__":
    run_cli(main)
