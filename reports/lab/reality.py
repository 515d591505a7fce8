"""The channel beside real measurements: python -m reports.lab.reality --data ../shared/data.

Writes docs/reality.md with curves and numbers, and, into a private folder, a page of real and
simulated pictures side by side: the real pictures may not be published.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import scipy.io
import tyro
from scipy.optimize import brentq

from data_gen.channel.transfer import cdtf
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.captures import load_capture, read_manifest
from link.errors import InputError, run_cli
from link.images import LUMA, as_rgb, read_image, write_bytes, write_image
from link.layout import make_layout
from reports.lab.noise import (
    LEVELS,
    Array,
    at_captured_scale,
    fit_cubic,
    noise_by_level,
    ripple,
)

matplotlib.use("Agg")
import matplotlib.pyplot as plt

RHO = np.arange(256.0)
WHITE = 245.0
"""Captured level of white, as the simulated cameras are exposed."""
DISPLAY_GAMMA = 2.2
PHOTOS = ("00005", "00012")
SHARES = (32, 128, 224)
DIFFERENCES = """## What differs

Written by hand on the numbers above. The phone is noisier than the simulated cameras, whose sensors
are larger and whose noise scale is fitted to little evidence. At 0° the simulated CDTFs lie in the
upper half of the measured band: the three cameras' JPEG curves are contrasty. Colour moiré is of
the size of the real photographs', but runs straight, for the channel has no lens distortion; the
phone's frames show none to speak of. Real cubic fits leave more where the photograph has haze and
uneven light."""
RED_LESS_GREEN = np.array([1.0, -1.0, 0.0])


@dataclass(frozen=True)
class RealityConfig:
    """Real curves, noise and pictures beside simulated ones."""

    data: Path
    """Folder with channel/crf, photo_pairs and real_message (README lists where they come from)."""
    out: Path = Path("docs/reality.md")
    private: Path = Path("runs/reality")
    """Folder for the page with real pictures."""
    frames: int = 4
    """Simulated frame pairs a pair and view."""
    seed: int = 0


def measured_cdtfs(file: Path) -> Array:
    """(N, 256) captured levels by the measured camera responses, of a display of gamma 2.2.

    Each curve B(I) is exposed so that white gives `WHITE`: 255 B(E (rho / 255)^2.2), B(E) fixed.
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


def photo_pair(folder: Path, name: str) -> tuple[Array, Array]:
    """Displayed and captured RGB (H, W, 3) in [0, 255] of an aligned photograph of a screen."""
    displayed, captured = (
        as_rgb(read_image(folder / f"{kind}_{name}.png")).astype(np.float64)
        for kind in ("tar", "src")
    )
    return displayed, captured


def cdtf_of_histogram(levels: Array) -> Array:
    """(256,) captured level of a displayed level, where the displayed histogram is uniform."""
    return np.asarray(np.quantile(levels, RHO / 255))


def simulated_fit(source: Source, name: str, view: float) -> tuple[Array, Array]:
    """Displayed and captured RGB (H, W, 3) in [0, 255] of one simulated frame, rectified."""
    cell = Cell(name, view, 5)
    shown = FramePair(source, cell, 3).displayed.original
    captured = FramePair(source, cell, 3).rectified.original
    return as_rgb(shown).astype(np.float64), captured.astype(np.float64)


def spread(curves: Array, at: int) -> str:
    """Least, median and largest of the curves at a displayed level."""
    values = np.asarray(curves)[:, at]
    values = values[np.isfinite(values)]
    return f"{values.min():.0f} – {np.median(values):.0f} – {values.max():.0f}"


def slopes(curves: Array) -> str:
    """The same of the slope at 128."""
    values = (np.asarray(curves)[:, 136] - np.asarray(curves)[:, 120]) / 16
    return f"{values.min():.2f} – {np.median(values):.2f} – {values.max():.2f}"


def plot_cdtfs(path: Path, groups: dict[str, Array]) -> None:
    """One panel a group; the measured responses as a band."""
    figure, panels = plt.subplots(1, len(groups), figsize=(4 * len(groups), 3.6), sharey=True)
    for panel, (title, curves) in zip(panels, groups.items(), strict=True):
        if len(curves) > 20:
            low, middle, high = np.percentile(curves, (5, 50, 95), axis=0)
            panel.fill_between(RHO, low, high, color="0.85")
            panel.plot(RHO, middle, color="0.3")
        else:
            panel.plot(RHO, curves.T, linewidth=1)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("displayed level")
        panel.set_ylim(0, 255)
    panels[0].set_ylabel("captured level")
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def plot_noise(
    path: Path, real: list[dict[int, float]], simulated: dict[str, dict[int, float]]
) -> None:
    """Noise against captured level."""
    figure, panel = plt.subplots(figsize=(8, 4))
    for label, noise in simulated.items():
        style = "--" if label.endswith("45°") else "-"
        panel.plot(list(noise), list(noise.values()), style, linewidth=1, label=label)
    for noise in real:
        panel.plot(list(noise), list(noise.values()), "ko-", linewidth=2)
    panel.plot([], [], "ko-", label="real phone frames")
    panel.set_xlabel("captured level")
    panel.set_ylabel("noise of one frame, levels")
    panel.set_ylim(0)
    panel.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def noise_table(real: list[dict[int, float]], simulated: dict[str, dict[int, float]]) -> str:
    """Rows real (each frame pair) and simulated, columns levels."""
    lines = [f"| frames | {' | '.join(map(str, LEVELS))} |", f"|---|{'---:|' * len(LEVELS)}"]
    named = {f"real phone, pair {i + 1}": noise for i, noise in enumerate(real)} | simulated
    for label, noise in named.items():
        parts = [f"{noise[level]:.1f}" if level in noise else "–" for level in LEVELS]
        lines.append(f"| {label} | {' | '.join(parts)} |")
    return "\n".join(lines)


def private_page(config: RealityConfig, source: Source) -> None:
    """Real above simulated crops, at full resolution."""
    real = [read_image(config.data / "photo_pairs" / f"src_{name}.png") for name in PHOTOS]
    real.append(read_image(config.data / "real_message" / "single_0.png"))
    made = [
        FramePair(source, Cell(name, view, 5), 3).captured.original
        for name, view in (("nikon-lg", 0.0), ("sony-samsung", 0.0), ("canon-imac", 45.0))
    ]
    rows = []
    for label, images in (("real", real), ("simulated", made)):
        crops = []
        for image in images:
            y, x = (image.shape[0] - 360) // 2, (image.shape[1] - 480) // 2
            crop = np.ascontiguousarray(as_rgb(image)[y : y + 360, x : x + 480])
            cv2.putText(crop, label, (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 0), 2)
            crops.append(crop)
        rows.append(np.hstack(crops))
    write_image(config.private / "real_and_simulated.png", np.vstack(rows))


def main() -> None:
    """Measure, plot, write."""
    config = tyro.cli(RealityConfig)
    if not config.data.is_dir():
        raise InputError(f"--data: {config.data} is not a folder")
    source, docs = Source(make_layout(), "test", config.seed), config.out.parent
    docs.mkdir(parents=True, exist_ok=True)
    photos = [photo_pair(config.data / "photo_pairs", name) for name in PHOTOS]
    fits = [fit_cubic(displayed @ LUMA, captured @ LUMA) for displayed, captured in photos]
    entries = read_manifest(config.data / "real_message")
    messages = [load_capture(config.data / "real_message", entry) for entry in entries]
    values = [m.rectified().original.max(axis=2).astype(np.float64) for m in messages]
    groups = {
        "201 measured responses, gamma 2.2": measured_cdtfs(
            config.data / "channel" / "crf" / "201_CRF_data.mat"
        ),
        "channel, 0°": np.array([cdtf(pair, 0.0) @ LUMA for pair in PAIRS.values()]),
        "channel, 45°": np.array([cdtf(pair, 45.0) @ LUMA for pair in PAIRS.values()]),
        "real photographs": np.array(
            [fit(RHO) for fit in fits] + [cdtf_of_histogram(v) for v in values]
        ),
    }
    plot_cdtfs(docs / "reality_cdtf.png", groups)
    lines = [
        "| group | curves | captured at 32 | at 128 | at 224 | slope at 128 |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for title, curves in groups.items():
        at = " | ".join(spread(curves, level) for level in SHARES)
        lines.append(f"| {title} | {len(curves)} | {at} | {slopes(curves)} |")

    fit_lines = [
        "| frame | R² | residual, levels | ripple of luma | ripple of R − G |",
        "|---|---:|---:|---:|---:|",
    ]
    plain = Source(make_layout(), "test", config.seed, without=("moire",))
    named = [(f"real photograph {n}", p) for n, p in zip(PHOTOS, photos, strict=True)]
    for name, view in (("canon-samsung", 0.0), ("nikon-lg", 0.0), ("sony-imac", 45.0)):
        named.append((f"{name}, {view:g}°", simulated_fit(source, name, view)))
        named.append((f"{name}, {view:g}°, no moire", simulated_fit(plain, name, view)))
    for title, (displayed, captured) in named:
        fit = fit_cubic(displayed @ LUMA, captured @ LUMA)
        flat, tint = (ripple(displayed @ LUMA, captured @ w) for w in (LUMA, RED_LESS_GREEN))
        fit_lines.append(
            f"| {title} | {fit.r2:.3f} | {fit.residual:.1f} | {flat:.1f} | {tint:.1f} |"
        )

    real_noise = [noise_by_level(*at_captured_scale(message)) for message in messages]
    simulated_noise = {}
    for name in PAIRS:
        for view in (0.0, 45.0):
            found = [
                noise_by_level(
                    *at_captured_scale(FramePair(source, Cell(name, view, 5), index).captured)
                )
                for index in range(config.frames)
            ]
            simulated_noise[f"{name}, {view:g}°"] = {
                level: float(np.median([noise[level] for noise in found if level in noise]))
                for level in LEVELS
                if any(level in noise for noise in found)
            }
    plot_noise(docs / "reality_noise.png", real_noise, simulated_noise)
    private_page(config, source)
    parts = [
        "# The channel beside reality",
        "Generated by `python -m reports.lab.reality --data DIR`. Real material: the 201 camera "
        "responses of Columbia's DoRF (as distributed with CBDNet); two photographs of a screen "
        "aligned with what it showed (a demoiréing test set in the style of FHDMi); four frame "
        "pairs of a hidden message filmed by a phone, from a 2015 Android implementation by the "
        "paper's group (four frames in all, so the pairs are not independent). Pictures may not "
        "be published: the command writes them, real above simulated, to `runs/reality/`.",
        "## CDTF\n\nEach measured response is exposed so that white gives 245, through a display "
        "of gamma 2.2; the band holds 5 to 95 %. Real photographs: cubic fits to the two aligned "
        "pairs, and quantiles of the message frames, whose displayed V channel was equalised. "
        "Least – median – largest:\n\n![CDTFs](reality_cdtf.png)",
        "\n".join(lines),
        "## What a cubic leaves\n\nBoth sides blurred by 3 px, so that the residual is colour, "
        "shading and haze rather than misaligned texture. Ripple: what the camera adds to the "
        "flattest tenth of the lit 64 × 64 tiles, in levels: moiré (mostly colour), banding, "
        "noise.",
        "\n".join(fit_lines),
        "## Noise from frame to frame\n\nOne estimator for all: the frames' difference at captured "
        "scale, high-passed by a Gaussian of 2 px, median absolute deviation over flat pixels, "
        f"divided by √2. Simulated: median of {config.frames} frame pairs. By captured level:\n\n"
        "![noise](reality_noise.png)",
        noise_table(real_noise, simulated_noise),
        DIFFERENCES,
    ]
    write_bytes(config.out, ("\n\n".join(parts) + "\n").encode())
    print(*parts[3:], sep="\n\n")


if __name__ == "__main__":
    run_cli(main)
