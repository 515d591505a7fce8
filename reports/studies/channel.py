"""The channel in pictures and numbers: python -m reports.studies.channel (about six minutes).

Writes docs/channel.md and its pictures: CDTFs by display and by angle, histograms, one message
decoded in steps, a contact sheet of the nine pairs, the time by stage, and what each effect costs.
"""

import cProfile
import os
import platform
import pstats
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import cv2
import matplotlib
import numpy as np
import tyro
from numpy.typing import NDArray

from data_gen.channel.composition import capture, cdtf
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import CAMERAS, DISPLAYS, PAIRS
from link.errors import at_least, run_cli
from link.images import LUMA, intensity, write_bytes, write_image
from link.layout import make_layout
from models import PRETRAINED, make_decoder
from reports.engine.predict import Method, methods_for
from reports.engine.protocols import apply
from reports.studies.sensitivity import sensitivity_table

matplotlib.use("Agg")
import matplotlib.pyplot as plt

Image = NDArray[np.uint8]
STAGES = {
    "emitted_light": "display: EOTF, angle, backlight",
    "moire_gain": "moire",
    "image_of": "perspective and blur",
    "expose": "crosstalk, exposure, vignetting, banding",
    "_mosaic": "Bayer mosaic",
    "_demosaic": "demosaicing",
    "jpeg": "JPEG",
    "develop": "noise, colour matrix, response, sharpening",
}
"""Functions of the channel; `develop` contains the three before it."""
ASTRONAUT = "photo/astronaut/0"


@dataclass(frozen=True)
class ChannelConfig:
    """Figures, timing and sensitivity of the simulated channel."""

    frames: int = 15
    """Frame pairs a cell of the sensitivity table."""
    timed: int = 40
    """Frame pairs that are timed."""
    seed: int = 0
    jobs: int = os.cpu_count() or 1
    out: Path = Path("docs/channel.md")
    work: Path = Path("runs/sensitivity")


def plot_displays(path: Path) -> None:
    """CDTFs of three displays by one camera."""
    figure, panels = plt.subplots(1, 3, figsize=(11, 3.4), sharey=True)
    for panel, camera in zip(panels, CAMERAS, strict=True):
        for display in DISPLAYS:
            panel.plot(cdtf(PAIRS[f"{camera}-{display}"], 0.0) @ LUMA, label=display)
            oblique = cdtf(PAIRS[f"{camera}-{display}"], 45.0) @ LUMA
            panel.plot(oblique, "--", color=panel.lines[-1].get_color())
        panel.set_title(CAMERAS[camera].name)
        panel.set_xlabel("displayed gray level")
    panels[0].set_ylabel("captured gray level")
    panels[0].legend(title="– 0°, – – 45°")
    _save(figure, path)


def plot_angles(path: Path, source: Source) -> None:
    """CDTF and histogram of one pair at several angles."""
    angles = (0.0, 30.0, 45.0, 60.0)
    figure, panels = plt.subplots(2, len(angles), figsize=(12, 5), sharex="row", sharey="row")
    for column, view in zip(panels.T, angles, strict=True):
        column[0].plot(cdtf(PAIRS["nikon-samsung"], view) @ LUMA, color="C3")
        column[0].set_title(f"nikon-samsung, {view:g}°")
        column[0].set_ylim(0, 255)
        frame = FramePair(source, Cell("nikon-samsung", view, 5), _astronaut(source, view)).captured
        levels = 255 * intensity(frame.rectified().original)
        column[1].hist(levels.ravel(), bins=64, range=(0, 256), density=True, color="0.4")
        column[1].set_xlabel("captured gray level")
    panels[0, 0].set_ylabel("captured, of displayed 0–255")
    panels[1, 0].set_ylabel("share of pixels")
    _save(figure, path)


def _astronaut(source: Source, view: float) -> int:
    cell = Cell("nikon-samsung", view, 5)
    return next(i for i in range(20) if FramePair(source, cell, i).picture.name == ASTRONAUT)


def plot_decisions(path: Path, source: Source) -> None:
    """Difference of the frames, its threshold, and the bits: the paper's example figure."""
    cell = Cell("canon-samsung", 45.0, 5)
    captured = FramePair(source, cell, _astronaut(source, 45.0)).captured
    pair = captured.rectified()
    difference = 255 * (intensity(pair.embedded) - intensity(pair.original))
    layout = pair.layout
    naive = apply("paper", [Method("naive")])[0].build()
    panels: list[tuple[str, NDArray[np.generic]]] = [
        ("captured", pair.original),
        ("embedded − original, ±10 levels", np.clip(0.5 + difference / 20, 0, 1)),
        ("pixels above 2.5 levels", (difference > 2.5).astype(float)),
    ]
    truth = captured.bits
    for name, decoder in (("naive", naive), ("oorc", make_decoder("oorc"))):
        bits = decoder.decode(pair).bits
        grid = np.full((layout.rows, layout.cols), 0.5)
        grid[layout.message_mask] = bits
        wrong = int((bits != truth).sum())
        panels.append((f"{name}: {wrong} of {bits.size} bits wrong", grid))
    figure, axes = plt.subplots(1, len(panels), figsize=(15, 2.9))
    for axis, (title, image) in zip(axes, panels, strict=True):
        axis.imshow(
            image, cmap="gray", vmin=0, vmax=1 if image.dtype != np.uint8 else 255,
            extent=(0, layout.width, layout.height, 0), interpolation="nearest",
        )  # fmt: skip
        axis.set_title(title, fontsize=10)
        axis.axis("off")
    _save(figure, path)


def contact_sheet(source: Source) -> Image:
    """Captured frames of the nine pairs, 0 degrees above 45, cameras across."""
    rows = []
    for view in (0.0, 45.0):
        for display in DISPLAYS:
            tiles = []
            for camera in CAMERAS:
                cell = Cell(f"{camera}-{display}", view, 5)
                index = _photograph(source, cell)
                frame = FramePair(source, cell, index).captured.original
                tile = cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
                label = f"{camera}-{display} {view:g} deg"
                cv2.putText(
                    tile, label, (8, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1,
                    cv2.LINE_AA,
                )  # fmt: skip
                tiles.append(tile)
            rows.append(np.hstack(tiles))
    return np.asarray(np.vstack(rows), np.uint8)


def _photograph(source: Source, cell: Cell) -> int:
    """Index of the astronaut, whose licence lets a picture of it be published here."""
    return next(i for i in range(20) if FramePair(source, cell, i).picture.name == ASTRONAUT)


def stage_table(source: Source, count: int) -> str:
    """Milliseconds of one frame pair by stage, on one core: median and spread of the total."""
    cv2.setNumThreads(1)
    cell = Cell("nikon-lg", 45.0, 5)
    takes = [FramePair(source, cell, index) for index in range(count)]
    pair = source.pair(cell.pair)
    capture(takes[0].displayed, pair, cell.view_deg, np.random.default_rng(0))
    totals = []
    for take in takes:
        start = perf_counter()
        capture(take.displayed, pair, cell.view_deg, take.channel_rng())
        totals.append(1e3 * (perf_counter() - start))
    profile = cProfile.Profile()
    for take in takes:
        profile.runcall(capture, take.displayed, pair, cell.view_deg, take.channel_rng())
    seconds: dict[str, float] = {}
    for (_, _, name), (_, _, _, cumulative, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        seconds[name] = max(seconds.get(name, 0.0), cumulative)
    stage = {name: 1e3 * seconds[name] / count for name in STAGES}
    stage["develop"] -= stage["_mosaic"] + stage["_demosaic"] + stage["jpeg"]
    rest = 1e3 * seconds["capture"] / count - sum(stage.values())
    low, median, high = np.percentile(totals, (25, 50, 75))
    lines = ["| stage | ms a frame pair | share |", "|---|---:|---:|"]
    whole = sum(stage.values()) + rest
    for name, title in STAGES.items():
        lines.append(f"| {title} | {stage[name]:.1f} | {100 * stage[name] / whole:.0f} % |")
    lines.append(f"| pose, room light, rest | {rest:.1f} | {100 * rest / whole:.0f} % |")
    lines.append("")
    lines.append(
        f"Median {median:.0f} ms a frame pair (quartiles {low:.0f} to {high:.0f}, n = {count}), "
        f"{1e3 / median:.0f} pairs a second on one core of {platform.machine()}, "
        f"{os.cpu_count()} cores, numpy {np.__version__}, OpenCV {cv2.__version__}."
    )
    return "\n".join(lines)


def _save(figure: "plt.Figure", path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main() -> None:
    """Draw, time, decode, write."""
    config = tyro.cli(ChannelConfig)
    at_least(1, frames=config.frames, timed=config.timed, jobs=config.jobs)
    at_least(0, seed=config.seed)
    source, docs = Source(make_layout(), "test", config.seed), config.out.parent
    docs.mkdir(parents=True, exist_ok=True)
    stages = stage_table(source, config.timed)
    plot_displays(docs / "channel_displays.png")
    plot_angles(docs / "channel_angles.png", source)
    plot_decisions(docs / "channel_decisions.png", source)
    write_image(docs / "channel_sheet.jpg", contact_sheet(source))
    methods = apply("paper", [Method(n) for n in ("naive", "two_step", "oorc", "hidden_ratex")])
    methods += methods_for(["learned"], PRETRAINED)
    table = sensitivity_table(methods, config.frames, config.seed, config.work, config.jobs)
    parts = [
        "# The simulated channel",
        "Generated by `python -m reports.studies.channel`; everything here is simulated. "
        "Parameters and their sources: `data_gen/pairs.py`; the fitted ones: "
        "[prediction.md](prediction.md).",
        "## Three displays, three cameras\n\n![CDTFs](channel_displays.png)",
        "## Angle: CDTF and histogram\n\nThe camera keeps its exposure, as in the paper.\n\n"
        "![CDTFs and histograms](channel_angles.png)",
        "## One message\n\n![difference, threshold, bits](channel_decisions.png)",
        "## The nine pairs at 0° and 45°\n\n![contact sheet](channel_sheet.jpg)",
        f"## Time\n\n{stages}",
        "## What carries the result\n\nEach row switches one effect off, on the same draws: the "
        "change in accuracy, points, ± half the 95 % interval over frame pairs. Protocol `paper`; "
        f"`learned` is the shipped decoder. Seed {config.seed}.\n\n{table}",
    ]
    write_bytes(config.out, ("\n\n".join(parts) + "\n").encode())
    print(stages, table, sep="\n\n")


if __name__ == "__main__":
    run_cli(main)
