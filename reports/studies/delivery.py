"""Messages from simulated hand-held video: python -m reports.studies.delivery.

Each run draws a picture, a room, a pose, the hand's motion, both clocks and where in the loop the
camera joins; the receiver gets the frames alone. Runs are stored as they end, and a restarted
command goes on where it stopped.
"""

import json
import os
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import cv2
import numpy as np
import tyro
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.film.scenes import SceneSettings
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import PAIRS
from data_gen.film.stream import VideoSettings, film
from export.receive.receiver import Receiver
from export.runtime import Decoder
from export.to_onnx import to_onnx
from link.code.framing import encode
from link.embed import embed
from link.errors import at_least, run_cli
from link.images import write_bytes
from link.layout import Layout, make_layout
from models import PRETRAINED
from models.neural.checkpoint import load_checkpoint
from reports.score.metrics import provenance, wilson

RUNS = "runs.jsonl"


@dataclass(frozen=True)
class DeliveryConfig:
    """A message from at most three loops of a hand-held video (simulated)."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    views: tuple[float, ...] = (0.0, 45.0)
    kappa: int = 3
    grid: int = 8
    """Blocks along each side: 8 or 16."""
    state_hz: float = 15.0
    """States a second; two of them are a frame pair."""
    fps: float = 30.0
    n_bytes: int = 100
    runs: int = 6
    """Of each pair and view."""
    loops: float = 3.0
    """Given up after so many."""
    coverage: tuple[float, float] = (0.15, 0.6)
    """Share of the image that the display covers, drawn between these."""
    seed: int = 0
    jobs: int = os.cpu_count() or 1
    out: Path = Path("runs/delivery")


def simulate(
    config: DeliveryConfig, pair: str, view: float, run: int, model: bytes
) -> dict[str, Any]:
    """One run: film until the message comes or the loops are over."""
    cv2.setNumThreads(1)
    layout = make_layout(config.grid, config.grid)
    key = f"{pair} {view} {run} {config.kappa} {config.grid} {config.state_hz} {config.fps}"
    rng = np.random.default_rng([config.seed, zlib.crc32(key.encode())])
    source = Source(layout, "test", config.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[int(rng.integers(len(pictures)))]
    message = rng.bytes(config.n_bytes)
    bits = encode(message, layout.n_bits)
    shown = [embed(picture.rgb, frame, layout, config.kappa) for frame in bits]
    states = [frame for one in shown for frame in (one.original, one.embedded)]
    settings = VideoSettings(
        scene=SceneSettings(
            coverage=float(rng.uniform(*config.coverage)), pictures=pictures, free=0.03
        ),
        fps=config.fps,
        state_hz=config.state_hz,
        seconds=config.loops * 2 * len(bits) / config.state_hz,
    )
    decoder = Decoder(PRETRAINED / "decoder.onnx", threads=1) if not model else _decoder(model)
    receiver = Receiver(decoder, config.fps)
    wrong = decoded = frames = 0
    spent, got, time = 0.0, None, 0.0
    for frame in film(states, layout, source.pair(pair), view, settings, rng):
        frames, time = frames + 1, frame.time_s
        start = perf_counter()
        step = receiver.push(frame.rgb, frame.time_s)
        spent += perf_counter() - start
        for one in step.pairs:
            errors = _errors(one.soft.scores, bits)
            wrong, decoded = wrong + errors, decoded + layout.n_bits
        if step.message is not None:
            got = step.message.data
            break
    return {
        "pair": pair,
        "view_deg": view,
        "run": run,
        "picture": picture.name,
        "delivered": got == message,
        "wrong": got is not None and got != message,
        "loops": time * config.state_hz / 2 / len(bits),
        "seconds": time,
        "frames": frames,
        "frames_with_display": receiver.found,
        "bits": decoded,
        "bits_wrong": wrong,
        "loop_frames": len(bits),
        "receiver_fps": frames / spent,
    }


def _errors(scores: NDArray[np.float64], bits: NDArray[np.integer]) -> int:
    """Wrong bits of a pair, against the frame of the loop that it fits best."""
    return int(((scores > 0) != bits).sum(axis=1).min())


def _decoder(model: bytes) -> Decoder:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "decoder.onnx"
        write_bytes(path, model)
        return Decoder(path, threads=1)


def model_for(layout: Layout) -> bytes:
    """The shipped decoder for another layout; empty for its own."""
    if layout == make_layout():
        return b""
    return to_onnx(load_checkpoint(PRETRAINED, layout=layout), "pretrained")


def bound_seconds(row: dict[str, Any], config: DeliveryConfig) -> float:
    """Time in which no code could deliver faster at this run's share of wrong bits (hard bits)."""
    n_bits = make_layout(config.grid, config.grid).n_bits
    p = min(max(row["bits_wrong"] / max(row["bits"], 1), 1e-9), 0.5)
    entropy = -p * np.log2(p) - (1 - p) * np.log2(1 - p)
    per_pair = max(n_bits * (1 - entropy), 1e-9)
    return float(8 * config.n_bytes / per_pair * 2 / config.state_hz)


def summary(rows: list[dict[str, Any]], config: DeliveryConfig) -> list[dict[str, Any]]:
    """One row a view, and one for all."""
    groups: list[tuple[str, list[dict[str, Any]]]] = [
        (f"{view:g}°", [row for row in rows if row["view_deg"] == view]) for view in config.views
    ]
    table = []
    for name, group in [*groups, ("all", rows)]:
        delivered = [row for row in group if row["delivered"]]
        low, high = wilson(len(delivered), len(group))
        seconds = [row["seconds"] for row in delivered] or [float("nan")]
        table.append(
            {
                "view": name,
                "runs": len(group),
                "delivered": len(delivered),
                "ci_low": low,
                "ci_high": high,
                "wrong_messages": sum(row["wrong"] for row in group),
                "seconds_median": float(np.median(seconds)),
                "seconds_95": float(np.quantile(seconds, 0.95)),
                "loops_median": float(np.median([row["loops"] for row in delivered] or [0.0])),
                "bound_seconds": float(np.median([bound_seconds(row, config) for row in group])),
                "bits_wrong": sum(row["bits_wrong"] for row in group)
                / max(1, sum(row["bits"] for row in group)),
                "goodput_bit_s": 8
                * config.n_bytes
                * len(delivered)
                / sum(row["seconds"] for row in group),
            }
        )
    return table


def readme_block(folder: Path) -> str:
    """What README says of the stored results: one row a delivery.json in ``folder``."""
    lines = [
        "Simulated hand-held video at 1280 × 720, 0° and 45°, κ = 3, a 100-byte message; "
        "picture, room, pose, clocks (±1 %) and start in the loop drawn anew in each run "
        "(`python -m reports.studies.delivery`):\n",
        "| grid | states/s | camera fps | pairs | runs | delivered in 3 loops | 95 % interval | "
        "wrong messages | bits wrong % | seconds, median (95 %) | loops | bound, s | "
        "goodput, bit/s |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for path in sorted(folder.glob("*.json")):
        stored = json.loads(path.read_text())
        row, setup = stored["summary"][-1], stored["config"]
        lines.append(
            f"| {setup['grid']} × {setup['grid']} | {setup['state_hz']:g} | {setup['fps']:g} | "
            f"{len(setup['pairs'])} | {row['runs']} | {row['delivered']} | "
            f"{100 * row['ci_low']:.1f} – {100 * row['ci_high']:.1f} % | {row['wrong_messages']} | "
            f"{100 * row['bits_wrong']:.2f} | {row['seconds_median']:.1f} "
            f"({row['seconds_95']:.1f}) | {row['loops_median']:.2f} | "
            f"{row['bound_seconds']:.1f} | {row['goodput_bit_s']:.0f} |"
        )
    lines.append(
        "\n*bound*: the time that a perfect code for hard bits would need at the same share of "
        "wrong bits, with a clock and a place in the loop for nothing."
    )
    return "\n".join(lines)


def main() -> None:
    """Film, receive, print a table."""
    config = tyro.cli(DeliveryConfig)
    at_least(1, runs=config.runs, jobs=config.jobs, n_bytes=config.n_bytes)
    name = f"grid{config.grid}_{config.state_hz:g}hz_{config.fps:g}fps_kappa{config.kappa}"
    folder = config.out / f"{name}_{config.n_bytes}B_seed{config.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    rows = list(_stored(folder / RUNS))
    done = {(row["pair"], row["view_deg"], row["run"]) for row in rows}
    wanted = [
        (pair, view, run)
        for run in range(config.runs)
        for view in config.views
        for pair in config.pairs
    ]
    model = model_for(make_layout(config.grid, config.grid))
    work = Parallel(n_jobs=config.jobs, return_as="generator_unordered")(
        delayed(simulate)(config, *key, model) for key in wanted if key not in done
    )
    with (folder / RUNS).open("a") as file:
        for row in tqdm(work, total=len(wanted), initial=len(done), unit="run"):
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()
    rows = [row for row in rows if (row["pair"], row["view_deg"], row["run"]) in set(wanted)]
    table = summary(rows, config)
    for line in table:
        print(json.dumps(line))
    meta = provenance(config.seed, simulated=True)
    setup = {key: value for key, value in asdict(config).items() if key not in ("out", "jobs")}
    result = {"meta": meta, "config": setup, "summary": table, "runs": sorted(rows, key=_order)}
    write_bytes(config.out / f"{folder.name}.json", (json.dumps(result, indent=1) + "\n").encode())


def _order(row: dict[str, Any]) -> tuple[str, float, int]:
    return row["pair"], row["view_deg"], row["run"]


def _stored(path: Path) -> Iterator[dict[str, Any]]:
    if path.is_file():
        for line in path.read_text().splitlines():
            try:
                yield json.loads(line)
            except json.JSONDecodeError:
                continue  # cut off where a run was killed


if __name__ == "__main__":
    run_cli(main)
