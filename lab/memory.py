"""Measure the memory of Python's receiver over an hour of messages.

Run: python -m lab.memory --minutes 60
"""

import gc
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import tyro

from data_gen.pairs import PAIRS
from export.receive.decoders import open_decoders
from export.receive.receiver import Receiver
from lab.films.page import SETTINGS
from lab.films.trial import Take, film_message
from link.images import as_gray
from reports.engine.backends import one_thread

EACH_MINUTES, FILM_S = 5, 6
"""Minutes of each message, and seconds of its film, which plays over and over."""
PAGE_BYTES = 4096
"""Size of a page of memory on Linux, bytes."""


@dataclass(frozen=True)
class Config:
    """Measure the memory of the receiver."""

    preset: str = "hidden"
    """Preset that is filmed at 30 frames a second."""
    minutes: int = 60
    """Length of all films, minutes."""


def held_mib() -> float:
    """Memory that the process holds, MiB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 2**20


def main() -> None:
    """Let one receiver read one message after the other, and print what it holds."""
    config = tyro.cli(Config)
    one_thread()
    settings = SETTINGS[config.preset]
    decoders, film = open_decoders(None, 1)
    receiver = Receiver(decoders, settings.fps, film=film)
    length = round(FILM_S * settings.fps)
    time, messages = 0.0, 0
    for number in range(config.minutes // EACH_MINUTES):
        pair = list(PAIRS)[number % len(PAIRS)]
        filmed = film_message(Take(settings, pair, 0.0, number, 0))
        frames = [as_gray(frame.rgb) for frame in islice(filmed.frames, length)]
        for _ in range(round(EACH_MINUTES * 60 / FILM_S)):
            for frame in frames:
                messages += receiver.push(frame, time).message is not None
                time += 1 / settings.fps
        del filmed, frames, frame
        gc.collect()
        print(f"{time / 60:.0f} min, {messages} messages, {held_mib():.0f} MiB", flush=True)


if __name__ == "__main__":
    main()
