"""How fast presets deliver a message from hand-held video: python -m reports.films.rates.

Each setting and view is a series of `reports.films.delivery`, with its stored runs, so a restarted
command goes on where it stopped. The table shows every series whose results the folder holds, so
settings and views can be filmed one after the other. Goodput is the message's bits over the time
from the first camera frame to the delivery: finding the display and its clock are included. All
films are simulated.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import tyro

from data_gen.film.codec import CodecSettings
from data_gen.pairs import PAIRS
from export.send.hiding import Hiding, Onlooker
from link.cli import read_flags, run_cli
from link.errors import at_least, choose, each_once
from link.files.lock import locked
from link.outside import read_json
from link.presets import PRESETS
from reports.films.delivery import check_delivery, run_deliveries
from reports.films.messages import DeliveryConfig
from reports.render.tables import Table, percent, share_interval, write_blocks
from reports.score.intervals import wilson

FAST = DeliveryConfig(preset="fast", state_hz=30, fps=60, n_bytes=20_000)
"""The setting "fast", a camera of 60 frames a second before the preset `fast`."""
SLANTED = replace(FAST, preset="hidden")
"""The setting "slanted", the same on the larger blocks of the preset `hidden`."""
HIDDEN = DeliveryConfig(preset="hidden", kappa=1, state_hz=60, fps=120, n_bytes=20_000)
"""The setting "hidden", below the threshold of sight at the preset's distance."""
SETTINGS = {
    "paper": DeliveryConfig(n_bytes=100),
    "robust": DeliveryConfig(preset="robust", n_bytes=2_000),
    "slow camera": DeliveryConfig(preset="hidden", kappa=1, n_bytes=20_000),
    "faint": DeliveryConfig(preset="hidden", kappa=1, state_hz=30, fps=60, n_bytes=20_000),
    "hidden": HIDDEN,
    "hidden, 240 fps": replace(HIDDEN, fps=240),
    "slanted": SLANTED,
    "slanted, H.264": replace(SLANTED, codec=CodecSettings("h264", 20_000)),
    "slanted, 1080p": replace(SLANTED, size=(1920, 1080)),
    "fast": FAST,
    "fast, H.264": replace(FAST, codec=CodecSettings("h264", 20_000)),
    "fast, 1080p": replace(FAST, size=(1920, 1080)),
}
"""Settings of display, camera and message, by name. "slanted" is "fast" on the grid of "hidden",
whose larger blocks are for slanted and distant displays. H.264 has 20 Mbit/s."""


@dataclass(frozen=True)
class RatesConfig:
    """How fast presets deliver a message (simulated)."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in reports/films/rates.py."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    runs: int = 1
    """Number of runs for each setting, pair and view."""
    n_bytes: int | None = None
    """Length of the message, bytes, instead of the settings' own."""
    seed: int = 0
    """Seed of all draws."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    out: Path = Path("runs/rates")
    """Folder of the results."""
    page: Path = Path("docs/receiver.md")
    """Page whose block "rates" is written."""

    def series(self, name: str, view: float) -> DeliveryConfig:
        """Make the series of films of a setting, filmed at one angle."""
        setting = choose(SETTINGS, name, "name in --settings")
        return replace(
            setting,
            pairs=self.pairs,
            views=(view,),
            runs=self.runs,
            n_bytes=setting.n_bytes if self.n_bytes is None else self.n_bytes,
            seed=self.seed,
            jobs=self.jobs,
            out=series_folder(self.out, name) / f"{view:g}",
        )


def series_folder(out: Path, name: str) -> Path:
    """Folder of all series of a setting."""
    return out / name.replace(",", "").replace(" ", "_")


def contrast_of(preset: str, state_hz: float, kappa: int) -> float:
    """Contrast over threshold of one block, as `export.send` prints it for a preset."""
    chosen = PRESETS[preset]
    return Hiding(chosen.layout, state_hz, Onlooker(distance=chosen.distance_m)).seen(kappa)


def stored_series(out: Path) -> list[tuple[str, dict[str, Any]]]:
    """Read the results of all series that a folder holds.

    Returns:
        names of settings with the contents of a file, in the order of `SETTINGS`, then of the
        messages' lengths and of the views.
    """
    found = []
    for name in SETTINGS:
        files = series_folder(out, name).glob("*/*.json")
        contents = [read_json(file) for file in files]
        contents.sort(
            key=lambda content: (content["config"]["n_bytes"], content["config"]["views"])
        )
        found += [(name, content) for content in contents]
    return found


def rates_table(stored: Sequence[tuple[str, dict[str, Any]]]) -> Table:
    """Show the results of series, one row for each.

    Args:
        stored: names of settings with the contents of a series' file.
    """
    heads = (
        "setting", "grid", "κ", "states/s", "camera fps", "bytes", "view", "delivered",
        "95 % interval", "wrong messages", "goodput, kbit/s, median", "least", "seconds, median",
        "bound, s", "bits wrong %", "contrast over threshold",
    )  # fmt: skip
    rows = []
    for name, content in stored:
        config = content["config"]
        layout = PRESETS[config["preset"]].layout
        runs = pd.DataFrame(content["runs"])
        came = runs[runs["delivered"]]
        rate = 8e-3 * config["n_bytes"] / came["seconds"]
        rows.append(
            [
                name,
                f"{layout.rows} × {layout.cols}",
                str(config["kappa"]),
                f"{config['state_hz']:g}",
                f"{config['fps']:g}",
                f"{config['n_bytes']:,}",
                f"{config['views'][0]:g}°",
                f"{len(came)} of {len(runs)}",
                f"{share_interval(*wilson(len(came), len(runs)), 0)} %",
                str(int(runs["wrong"].sum())),
                _rate(rate.median()) if len(came) else "–",
                _rate(rate.min()) if len(came) else "–",
                f"{came['seconds'].median():.1f}" if len(came) else "–",
                f"{content['summary'][-1]['bound_seconds']:.1f}",
                percent(runs["bits_wrong"].sum() / max(1, runs["bits"].sum())),
                f"{contrast_of(config['preset'], config['state_hz'], config['kappa']):.3g}",
            ]
        )
    title = (
        "Simulated hand-held video at 1280 × 720, or 1920 × 1080 where the setting says so; "
        "picture, room, pose, clocks (±1 %) and start in the loop drawn anew in each run, which "
        "ends after three loops (`python -m reports.films.rates`):"
    )
    return Table(heads, rows, title)


def _rate(kbit_s: float) -> str:
    """Write a rate with two digits or more."""
    return f"{kbit_s:.0f}" if kbit_s >= 10 else f"{kbit_s:.1f}"


def main() -> None:
    """Film, receive, store, print, and write the table."""
    config = read_flags(lambda: tyro.cli(RatesConfig))
    at_least(1, runs=config.runs, jobs=config.jobs)
    each_once(settings=config.settings, pairs=config.pairs, views=config.views)
    series = [config.series(name, view) for name in config.settings for view in config.views]
    for chosen in series:
        check_delivery(chosen)
    for chosen in series:
        with locked(chosen.out):
            run_deliveries(chosen)
    table = rates_table(stored_series(config.out))
    print(table.markdown())
    if config.page.exists():
        write_blocks(config.page, {"rates": table.markdown()})


if __name__ == "__main__":
    run_cli(main)
