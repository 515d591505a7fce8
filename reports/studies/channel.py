"""The channel in pictures and numbers: python -m reports.studies.channel (about six minutes).

Fills docs/channel.md: the pictures beside it, the time by stage, and what each effect costs each
method. `--only time` measures the time alone, in a minute, on a machine that does nothing else.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from data_gen.frame_pair import Source
from link.cli import read_flags, run_cli
from link.errors import InputError, at_least, each_once
from link.layout import make_layout
from models import PRETRAINED
from reports.engine.backends import Backend
from reports.engine.methods import Method, methods_for
from reports.engine.predict import predict_all
from reports.engine.protocols import apply_protocol
from reports.render.tables import replace_block
from reports.studies.channel_pictures import draw_channel
from reports.studies.channel_time import time_report
from reports.studies.sensitivity import effect_conditions, sensitivity_tables

Part = Literal["pictures", "time", "effects"]
BLOCKS = ("time", "effects")
"""Parts that fill the block of their name in the page."""


@dataclass(frozen=True)
class ChannelConfig:
    """Pictures, times and sensitivity of the simulated channel."""

    only: tuple[Part, ...] = ("time", "pictures", "effects")
    """Parts to make anew."""
    frames: int = 15
    """Number of frame pairs in each cell of the table of effects."""
    timed: int = 40
    """Frame pairs that are timed."""
    seed: int = 0
    """Seed of messages and channel draws."""
    jobs: int = os.cpu_count() or 1
    """Processes for the table of effects."""
    out: Path = Path("docs/channel.md")
    """The page, which has blocks named "time" and "effects"; pictures are written beside it."""
    work: Path = Path("runs/sensitivity")
    """Folder of the predictions, from which a run that was cut off goes on."""


def main() -> None:
    """Time, draw, decode, write."""
    config = read_flags(lambda: tyro.cli(ChannelConfig))
    each_once(only=config.only)
    at_least(1, frames=config.frames, timed=config.timed, jobs=config.jobs)
    at_least(0, seed=config.seed)
    check_page(config.out, [name for name in BLOCKS if name in config.only])
    source = Source(make_layout(), "test", config.seed)
    if "time" in config.only:
        fill_block(config.out, "time", time_report(source, config.timed))
    if "pictures" in config.only:
        draw_channel(source, config.out.parent)
    if "effects" in config.only:
        fill_block(config.out, "effects", effects_report(config, source))


def check_page(page: Path, blocks: Sequence[str]) -> None:
    """Raise an `InputError` unless the page has these blocks; called before any work."""
    text = page.read_text() if page.is_file() else ""
    for name in blocks:
        if f"<!-- {name} -->\n" not in text or f"<!-- /{name} -->" not in text:
            raise InputError(
                f"--out: {page} is not here, or has no block between <!-- {name} --> and "
                f"<!-- /{name} -->; run from the checkout"
            )


def effects_report(config: ChannelConfig, source: Source) -> str:
    """Decode with every effect switched off in turn, and return the tables as Markdown."""
    methods = apply_protocol(
        "paper", [Method(n) for n in ("naive", "two_step", "oorc", "hidden_ratex")]
    )
    methods += methods_for(["learned"], PRETRAINED)
    conditions = effect_conditions(source, config.frames)
    tables = sensitivity_tables(predict_all(conditions, methods, config.work, Backend(config.jobs)))
    return "\n\n".join([f"Seed {config.seed}.", *(table.markdown() for table in tables)])


def fill_block(page: Path, name: str, content: str) -> None:
    """Put a result into its block of the page, and print it."""
    replace_block(page, name, content)
    print(content, end="\n\n")


if __name__ == "__main__":
    run_cli(main)
