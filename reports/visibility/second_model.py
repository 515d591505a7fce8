"""Ask a second model, ColorVideoVDP: python -m reports.visibility.second_model --python PYTHON.

ColorVideoVDP (Mantiuk, Hanji, Ashraf, Asano and Chapiro, SIGGRAPH 2024,
https://doi.org/10.1145/3658144) rates a video against a reference in JOD: 10 is identical, and one
JOD less means that three of four viewers prefer the reference. It knows spatial frequency and
masking. It needs torchvision, whose wheel on PyPI does not load beside the CPU build of torch, so
it runs in an environment of its own (6 GB):

    python3 -m venv ~/cvvdp && ~/cvvdp/bin/pip install cvvdp
    python -m reports.visibility.second_model --python ~/cvvdp/bin/python

What it is shown: a window in the middle of a photograph that fills its display "standard_fhd", with
a random message, and as reference the mean over time of the same frames.
"""

import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from data_gen.pictures.library import load_pictures
from export.visibility.line_code import LINE_CODES
from link.cli import read_flags, run_cli
from link.embed import with_head_room
from link.errors import InputError, at_least
from link.presets import PRESETS, Preset
from reports.render.tables import Table, write_blocks
from reports.visibility.presets import seen_of, setting, setting_name, viewing_of

DISPLAY = "standard_fhd"
"""Name of ColorVideoVDP's display, which is also that of `export.visibility.viewing.Viewing`."""
SIZE = (1920, 1080)
"""Width and height of this display, in pixels."""
WORKER = Path(__file__).with_name("cvvdp_worker.py")
"""Script that runs in the other environment."""
RATED = (
    PRESETS["paper"],
    setting((8, 8), "on_off", 3, 60),
    setting((8, 8), "toggle", 1, 60),
    setting((48, 64), "toggle", 3, 60),
    PRESETS["hidden"],
    setting((48, 64), "soft2", 3, 60),
    setting((8, 8), "on_off", 3, 15, "chroma"),
)
"""Settings that are rated, which takes up to two minutes each."""
WORKER_S = 600.0
"""Longest time that the other environment may take for one setting, in seconds."""


@dataclass(frozen=True)
class SecondModelConfig:
    """Rate the presets by ColorVideoVDP, beside elaTCSF."""

    python: Path
    """Python of an environment in which cvvdp is installed."""
    page: Path = Path("docs/visibility.md")
    """Page whose block is written."""
    window: tuple[int, int] = (480, 272)
    """Width and height of the window in the middle of the display that is rated, in pixels."""
    seconds: float = 0.4
    """Length of the clips, in seconds."""
    seed: int = 0
    """Seed of the random messages."""


def draw_clip(
    preset: Preset, window: tuple[int, int], seconds: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw what a window in the middle of the display shows of a random message.

    Args:
        preset: grid, line code, kappa, colour and rates.
        window: width and height, pixels of the display.
        seconds: length of the clip.
        rng: draws the bits.

    Returns:
        (frames, height, width, 3) encoded, in [0, 1], whole gray levels.
    """
    width, height = window
    left, top = (SIZE[0] - width) // 2, (SIZE[1] - height) // 2
    full = with_head_room(load_pictures("test", *SIZE)[0].rgb, 2 * preset.kappa)
    picture = full[top : top + height, left : left + width].astype(np.float64)
    rows, cols = preset.layout.rows, preset.layout.cols
    code, view = LINE_CODES[preset.line_code], viewing_of(preset)
    count = round(seconds * view.refresh_hz)
    bits = rng.integers(0, 2, (rows * cols, count // (2 * code.toggles * view.refreshes) + 1))
    shown = np.array([code.amplitudes(row, view.refreshes)[:count] for row in bits])
    row = (np.arange(top, top + height) * rows // SIZE[1])[:, None]
    col = np.arange(left, left + width) * cols // SIZE[0]
    blocks = shown.reshape(rows, cols, count)[row, col]
    frames = [
        np.floor(
            picture + preset.kappa * blocks[:, :, i, None] * np.array(preset.layout.direction) + 0.5
        )
        for i in range(count)
    ]
    return np.asarray(np.stack(frames).clip(0, 255) / 255, np.float32)


def rate_clips(python: Path, clips: Sequence[NDArray[np.float32]], fps: float) -> list[float]:
    """Rate clips against their mean over time, in another environment.

    Args:
        python: Python of an environment with cvvdp.
        clips: each (frames, H, W, 3) encoded, in [0, 1].
        fps: frames a second.

    Returns:
        the quality of each in JOD.

    Raises:
        InputError: the other environment fails, or takes too long.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "clips.npz"
        pairs = {}
        for number, clip in enumerate(clips):
            pairs[f"test{number}"] = clip
            pairs[f"reference{number}"] = np.broadcast_to(clip.mean(axis=0), clip.shape)
        np.savez(file, allow_pickle=False, **pairs)
        command = [str(python), str(WORKER), str(file), DISPLAY, str(fps)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, timeout=WORKER_S * len(clips)
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{python}: does not run cvvdp ({error})") from None
    found = [float(value) for value in re.findall(r"^JOD (\S+)$", done.stdout, re.MULTILINE)]
    if done.returncode != 0 or len(found) != len(clips):
        last = (done.stderr.strip().splitlines() or ["no output"])[-1]
        raise InputError(f"{python}: cvvdp failed: {last:.200}; install it there by pip")
    return found


def both_models(config: SecondModelConfig, presets: Sequence[Preset]) -> Table:
    """Tabulate the two models' verdicts on presets."""
    rows = []
    for preset in presets:
        rng = np.random.default_rng(config.seed)
        clip = draw_clip(preset, config.window, config.seconds, rng)
        refresh_hz = viewing_of(preset).refresh_hz
        (jod,) = rate_clips(config.python, [clip], refresh_hz)
        seen = seen_of(preset, config.seed, 40.0).mean
        rates = f"{preset.state_hz:g} of {refresh_hz:g}"
        rows.append([setting_name(preset), rates, f"{seen:.2f}", f"{jod:.2f}"])
        print(*rows[-1], sep=", ", flush=True)
    heads = ["setting", "states/s of refreshes/s", "contrast over threshold", "JOD"]
    return Table(heads, rows, left=2)


def main() -> None:
    """Rate the presets, print, and write the block."""
    config = read_flags(lambda: tyro.cli(SecondModelConfig))
    at_least(0, seed=config.seed)
    if not 0.1 <= config.seconds <= 5:
        raise InputError(f"--seconds: need 0.1 to 5 s, got {config.seconds}")
    if not all(16 <= side <= full for side, full in zip(config.window, SIZE, strict=True)):
        raise InputError(f"--window: need 16 pixels up to {SIZE[0]} {SIZE[1]}")
    write_blocks(config.page, {"visibility_jod": both_models(config, RATED).markdown()})
    print(f"written: {config.page}")


if __name__ == "__main__":
    run_cli(main)
