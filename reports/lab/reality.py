"""Hold the channel beside real measurements: python -m reports.lab.reality --data ../shared/data.

Writes the numbers into the marked blocks of docs/reality.md, whose other text is written by hand,
and two pictures of curves beside it. Real pictures may not be published: those go, above simulated
ones, into a private folder.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import scipy.io
import tyro
from matplotlib.figure import Figure
from scipy.optimize import brentq

from data_gen.channel.transfer import cdtf
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.captures import load_capture, read_manifest
from link.cli import read_flags, run_cli
from link.errors import InputError, at_least
from link.frames import Captured
from link.images import LUMA, as_rgb, read_image, write_image
from link.layout import make_layout
from reports.lab.noise import (
    LEVELS,
    Array,
    at_captured_scale,
    fit_cubic,
    noise_by_level,
    ripple,
)
from reports.render.charts import INK, MUTED, RULE, in_style, new_panels, save_png
from reports.render.tables import Table, write_blocks

RHO = np.arange(256.0)
"""Displayed gray levels at which curves are compared."""
WHITE = 245.0
"""Captured level of white, as the simulated cameras are exposed."""
DISPLAY_GAMMA = 2.2
"""Exponent of the display through which measured camera responses are seen."""
PHOTOS = ("00005", "00012")
"""Names of the aligned photographs of a screen."""
STATED_LEVELS = (32, 128, 224)
"""Displayed levels at which the table of curves states the captured ones."""
RED_LESS_GREEN = np.array([1.0, -1.0, 0.0])
"""Weights of red, green and blue in the colour by which moiré is told."""
BAND_CURVES = 20
"""Number of curves above which a panel shows their band in place of each."""


@dataclass(frozen=True)
class RealityConfig:
    """Real curves, noise and pictures beside simulated ones."""

    data: Path
    """Folder with channel/crf, photo_pairs and real_message."""
    out: Path = Path("docs/reality.md")
    """Page whose marked blocks are replaced; the pictures of curves are written beside it."""
    private: Path = Path("runs/reality")
    """Folder for real pictures beside simulated ones."""
    frames: int = 4
    """Number of simulated frame pairs for each pair and view."""
    seed: int = 0
    """Seed of the simulated frame pairs."""


def measured_cdtfs(file: Path) -> Array:
    """Show a display of gamma 2.2 to the measured camera responses.

    Each response B(I) is exposed so that white gives `WHITE`: 255 B(E (rho / 255)^2.2), where E
    solves 255 B(E) = `WHITE`.

    Args:
        file: the responses of Columbia's DoRF, with "I" and "B", as a .mat file.

    Returns:
        (N, 256) captured levels of the displayed levels `RHO`.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with file.open("rb") as stream:
            table = scipy.io.loadmat(stream)
        curves = list(zip(table["I"], table["B"], strict=True))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"cannot read camera responses from {file}: {error}") from None
    rows = []
    for irradiance, brightness in curves:
        high = np.maximum.accumulate(brightness)

        def excess(E: float, x: Array = irradiance, y: Array = high) -> float:
            return float(255 * np.interp(E, x, y) - WHITE)

        E = float(brentq(excess, 0.0, 1.0))
        rows.append(255 * np.interp(E * (RHO / 255) ** DISPLAY_GAMMA, irradiance, high))
    return np.array(rows)


def cdtf_of_histogram(levels: Array) -> Array:
    """Find the CDTF behind captured levels whose displayed histogram is uniform: their quantiles.

    Args:
        levels: captured levels of any shape.

    Returns:
        (256,) captured levels of the displayed levels `RHO`.
    """
    return np.asarray(np.quantile(levels, RHO / 255))


@dataclass(frozen=True)
class AlignedFrame:
    """A frame as it was displayed, and the capture of it, aligned."""

    title: str
    """What tables call the frame."""
    displayed: Array
    """(H, W, 3) RGB in [0, 255], encoded."""
    captured: Array
    """(H, W, 3) RGB in [0, 255], encoded."""


def photographed_frame(folder: Path, name: str) -> AlignedFrame:
    """Read an aligned photograph of a screen."""
    displayed, captured = (
        as_rgb(read_image(folder / f"{kind}_{name}.png")).astype(np.float64)
        for kind in ("tar", "src")
    )
    return AlignedFrame(f"real photograph {name}", displayed, captured)


def simulated_frame(source: Source, name: str, view: float) -> AlignedFrame:
    """Simulate one frame, and rectify it."""
    pair = FramePair(source, Cell(name, view, 5), 3)
    note = ", no moire" if "moire" in source.without else ""
    return AlignedFrame(
        f"{name}, {view:g}°{note}",
        as_rgb(pair.displayed.original).astype(np.float64),
        pair.rectified.original.astype(np.float64),
    )


def curve_groups(
    config: RealityConfig, photos: list[AlignedFrame], messages: list[Captured]
) -> dict[str, Array]:
    """Gather measured, simulated and photographed CDTFs, each (N, 256), by what they are."""
    fits = [fit_cubic(photo.displayed @ LUMA, photo.captured @ LUMA) for photo in photos]
    values = [m.rectified().original.max(axis=2).astype(np.float64) for m in messages]
    responses = config.data / "channel" / "crf" / "201_CRF_data.mat"
    photographed = [fit(RHO) for fit in fits] + [cdtf_of_histogram(value) for value in values]
    return {
        "201 measured responses, gamma 2.2": measured_cdtfs(responses),
        "channel, 0°": np.array([cdtf(pair, 0.0) @ LUMA for pair in PAIRS.values()]),
        "channel, 45°": np.array([cdtf(pair, 45.0) @ LUMA for pair in PAIRS.values()]),
        "real photographs": np.array(photographed),
    }


def curve_table(groups: dict[str, Array]) -> Table:
    """Show the least, median and largest captured level and slope of groups of CDTFs."""
    heads = [f"captured at {STATED_LEVELS[0]}", *(f"at {level}" for level in STATED_LEVELS[1:])]
    rows = []
    for title, curves in groups.items():
        stated = [_three_values(curves[:, level], 0) for level in STATED_LEVELS]
        slopes = (curves[:, 136] - curves[:, 120]) / 16
        rows.append([title, str(len(curves)), *stated, _three_values(slopes, 2)])
    return Table(["group", "curves", *heads, "slope at 128"], rows)


def _three_values(values: Array, digits: int) -> str:
    """Least, median and largest of the numbers that are finite."""
    known = values[np.isfinite(values)]
    three = (known.min(), np.median(known), known.max())
    return " – ".join(f"{value:.{digits}f}" for value in three)


def cubic_table(frames: list[AlignedFrame]) -> Table:
    """Show what a cubic CDTF leaves of captured frames, and the ripple in their flat parts."""
    rows = []
    for frame in frames:
        fit = fit_cubic(frame.displayed @ LUMA, frame.captured @ LUMA)
        flat, tint = (
            ripple(frame.displayed @ LUMA, frame.captured @ weights)
            for weights in (LUMA, RED_LESS_GREEN)
        )
        rows.append(
            [frame.title, f"{fit.r2:.3f}", f"{fit.residual:.1f}", f"{flat:.1f}", f"{tint:.1f}"]
        )
    heads = ["frame", "R²", "residual, levels", "ripple of luma", "ripple of R − G"]
    return Table(heads, rows)


def simulated_noise(source: Source, frames: int) -> dict[str, dict[int, float]]:
    """Estimate noise by captured level for each pair and view: the median over frame pairs."""
    found = {}
    for name in PAIRS:
        for view in (0.0, 45.0):
            pairs = [FramePair(source, Cell(name, view, 5), index) for index in range(frames)]
            seen = [noise_by_level(*at_captured_scale(pair.captured)) for pair in pairs]
            found[f"{name}, {view:g}°"] = {
                level: float(np.median([noise[level] for noise in seen if level in noise]))
                for level in LEVELS
                if any(level in noise for noise in seen)
            }
    return found


def noise_table(real: list[dict[int, float]], simulated: dict[str, dict[int, float]]) -> Table:
    """Show noise by captured level, a row for each real frame pair and each simulated pair."""
    named = {f"real phone, pair {i + 1}": noise for i, noise in enumerate(real)} | simulated
    rows = [
        [label, *(f"{noise[level]:.1f}" if level in noise else "–" for level in LEVELS)]
        for label, noise in named.items()
    ]
    return Table(["frames", *map(str, LEVELS)], rows)


@in_style
def curve_figure(groups: dict[str, Array]) -> Figure:
    """Draw groups of CDTFs, a panel each; many curves are shown as their band of 5 to 95 %."""
    figure, panels = new_panels(len(groups), columns=2, legend=0.1, title=True)
    for panel, (title, curves) in zip(panels, groups.items(), strict=True):
        if len(curves) > BAND_CURVES:
            low, middle, high = np.percentile(curves, (5, 50, 95), axis=0)
            panel.fill_between(RHO, low, high, color=RULE)
            panel.plot(RHO, middle, color=MUTED)
        else:
            panel.plot(RHO, curves.T, linewidth=1)
        panel.set_title(title)
        panel.set(xlabel="displayed level", ylabel="captured level", ylim=(0, 255))
    return figure


@in_style
def noise_figure(real: list[dict[int, float]], simulated: dict[str, dict[int, float]]) -> Figure:
    """Draw noise against captured level; what was seen at 45 degrees is dashed."""
    figure, (panel,) = new_panels(legend=2.0, size=(8.0, 5.2))
    for number, (label, noise) in enumerate(simulated.items()):
        style = "--" if label.endswith("45°") else "-"
        colour = f"C{number // 2}"
        panel.plot(list(noise), list(noise.values()), style, color=colour, linewidth=1, label=label)
    for number, noise in enumerate(real):
        name = "real phone frames" if number == 0 else None
        panel.plot(list(noise), list(noise.values()), "o-", color=INK, linewidth=2, label=name)
    panel.set(xlabel="captured level", ylabel="noise of one frame, levels")
    panel.set_ylim(0)
    panel.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def write_private_picture(config: RealityConfig, source: Source) -> None:
    """Write crops of real above crops of simulated pictures, at full resolution."""
    real = [read_image(config.data / "photo_pairs" / f"src_{name}.png") for name in PHOTOS]
    real.append(read_image(config.data / "real_message" / "single_0.png"))
    simulated = [
        FramePair(source, Cell(name, view, 5), 3).captured.original
        for name, view in (("nikon-lg", 0.0), ("sony-samsung", 0.0), ("canon-imac", 45.0))
    ]
    rows = []
    for label, images in (("real", real), ("simulated", simulated)):
        crops = []
        for image in images:
            y, x = (image.shape[0] - 360) // 2, (image.shape[1] - 480) // 2
            crop = np.ascontiguousarray(as_rgb(image)[y : y + 360, x : x + 480])
            cv2.putText(crop, label, (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 0), 2)
            crops.append(crop)
        rows.append(np.hstack(crops))
    write_image(config.private / "real_and_simulated.png", np.vstack(rows))


def main() -> None:
    """Measure, draw, write."""
    config = read_flags(lambda: tyro.cli(RealityConfig))
    at_least(1, frames=config.frames)
    if not config.data.is_dir():
        raise InputError(f"--data: {config.data} is not a folder")
    source = Source(make_layout(), "test", config.seed)
    plain = Source(make_layout(), "test", config.seed, without=("moire",))
    photos = [photographed_frame(config.data / "photo_pairs", name) for name in PHOTOS]
    entries = read_manifest(config.data / "real_message")
    messages = [load_capture(config.data / "real_message", entry) for entry in entries]
    groups = curve_groups(config, photos, messages)
    simulated = [
        simulated_frame(channel, name, view)
        for name, view in (("canon-samsung", 0.0), ("nikon-lg", 0.0), ("sony-imac", 45.0))
        for channel in (source, plain)
    ]
    real_noise = [noise_by_level(*at_captured_scale(message)) for message in messages]
    made_noise = simulated_noise(source, config.frames)
    blocks = {
        "reality_cdtf": curve_table(groups).markdown(),
        "reality_cubic": cubic_table([*photos, *simulated]).markdown(),
        "reality_noise": (
            f"Simulated: median of {config.frames} frame pairs.\n\n"
            f"{noise_table(real_noise, made_noise).markdown()}"
        ),
    }
    write_blocks(config.out, blocks)
    save_png(curve_figure(groups), config.out.with_name("reality_cdtf.png"))
    save_png(noise_figure(real_noise, made_noise), config.out.with_name("reality_noise.png"))
    write_private_picture(config, source)
    print(*blocks.values(), sep="\n\n")


if __name__ == "__main__":
    run_cli(main)
