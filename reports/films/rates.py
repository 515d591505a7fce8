"""How fast presets deliver a message from hand-held video: python -m reports.films.rates.

Each setting is a series of `reports.films.delivery`, with its stored runs, so a restarted command
goes on where it stopped. Goodput is the message's bits over the time from the first camera frame to
the delivery: finding the display and its clock are included. All films are simulated.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import tyro

from data_gen.pairs import PAIRS
from export.send.hiding import Hiding, Onlooker
from link.errors import at_least, choose, each_once, read_flags, run_cli
from link.files.lock import locked
from link.outside import read_json
from link.presets import PRESETS
from reports.films.delivery import check_delivery, run_deliveries
from reports.films.messages import DeliveryConfig
from reports.render.tables import Table, percent, share_interval, write_blocks
from reports.score.intervals import wilson

SETTINGS = {
    "paper": DeliveryConfig(n_bytes=100),
    "robust": DeliveryConfig(preset="robust", n_bytes=2_000),
    "slow camera": DeliveryConfig(preset="hidden", kappa=1, n_bytes=20_000),
    "faint": DeliveryConfig(preset="hidden", kappa=1, state_hz=30, fps=60, n_bytes=20_000),
    "hidden": DeliveryConfig(preset="hidden", kappa=1, state_hz=60, fps=120, n_bytes=20_000),
    "slanted": DeliveryConfig(preset="hidden", kappa=3, state_hz=30, fps=60, n_bytes=20_000),
    "fast": DeliveryConfig(preset="fast", state_hz=30, fps=60, n_bytes=20_000),
}
"""Settings of display, camera and message, by name. "slanted" is "fast" on the grid of "hidden",
whose larger blocks are for slanted and distant displays."""


@dataclass(frozen=True)
class RatesConfig:
    """How fast presets deliver a message (simulated)."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in reports/films/rates.py."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
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

    def series(self, name: str) -> DeliveryConfig:
        """Make the series of films of a setting."""
        setting = choose(SETTINGS, name, "name in --settings")
        return replace(
            setting,
            pairs=self.pairs,
            runs=self.runs,
            n_bytes=setting.n_bytes if self.n_bytes is None else self.n_bytes,
            seed=self.seed,
            jobs=self.jobs,
            out=self.out / name.replace(" ", "_"),
        )


def contrast_of(config: DeliveryConfig) -> float:
    """Contrast over threshold of one block, as `export.send` prints it for the preset."""
    onlooker = Onlooker(distance=PRESETS[config.preset].distance_m)
    return Hiding(config.layout, config.state_hz, onlooker).seen(config.kappa)


def rates_table(stored: dict[str, dict[str, Any]], seen_of: dict[str, float]) -> Table:
    """Show the settings' results by view.

    Args:
        stored: contents of a series' file, by the setting's name.
        seen_of: contrast over threshold, by the setting's name.
    """
    heads = (
        "setting", "grid", "κ", "states/s", "camera fps", "bytes", "view", "delivered",
        "95 % interval", "wrong messages", "goodput, kbit/s, median", "least", "seconds, median",
        "bits wrong %", "contrast over threshold",
    )  # fmt: skip
    rows = []
    for name, content in stored.items():
        config = content["config"]
        layout = PRESETS[config["preset"]].layout
        runs = pd.DataFrame(content["runs"])
        for view, group in runs.groupby("view_deg"):
            came = group[group["delivered"]]
            rate = 8e-3 * config["n_bytes"] / came["seconds"]
            rows.append(
                [
                    name,
                    f"{layout.rows} × {layout.cols}",
                    str(config["kappa"]),
                    f"{config['state_hz']:g}",
                    f"{config['fps']:g}",
                    f"{config['n_bytes']:,}",
                    f"{view:g}°",
                    f"{len(came)} of {len(group)}",
                    f"{share_interval(*wilson(len(came), len(group)), 0)} %",
                    str(int(group["wrong"].sum())),
                    _rate(rate.median()) if len(came) else "–",
                    _rate(rate.min()) if len(came) else "–",
                    f"{came['seconds'].median():.1f}" if len(came) else "–",
                    percent(group["bits_wrong"].sum() / max(1, group["bits"].sum())),
                    f"{seen_of[name]:.3g}",
                ]
            )
    title = (
        "Simulated hand-held video at 1280 × 720; picture, room, pose, clocks (±1 %) and start in "
        "the loop drawn anew in each run, which ends after three loops "
        "(`python -m reports.films.rates`):"
    )
    return Table(heads, rows, title)


def _rate(kbit_s: float) -> str:
    """Write a rate with two digits or more."""
    return f"{kbit_s:.0f}" if kbit_s >= 10 else f"{kbit_s:.1f}"


def main() -> None:
    """Film, receive, store, print, and write the table."""
    config = read_flags(lambda: tyro.cli(RatesConfig))
    at_least(1, runs=config.runs, jobs=config.jobs)
    each_once(settings=config.settings, pairs=config.pairs)
    series = {name: config.series(name) for name in config.settings}
    for chosen in series.values():
        check_delivery(chosen)
    stored = {}
    for name, chosen in series.items():
        with locked(chosen.out):
            stored[name] = read_json(run_deliveries(chosen))
    table = rates_table(stored, {name: contrast_of(chosen) for name, chosen in series.items()})
    print(table.markdown())
    if config.page.exists():
        write_blocks(config.page, {"rates": table.markdown()})


if __name__ == "__main__":
    run_cli(main)
