"""The sound of a film goes beside the states that are written of it, as it is."""

import heapq
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from link.errors import InputError
from link.images import replaced

try:
    import av
except ModuleNotFoundError:
    av = None  # type: ignore[assignment]

SILENT = "note: {}: is written without its sound; {}"
"""Note that is printed where sound is left out."""


def add_sound(video: Path, film: Path, film_s: float) -> None:
    """Add a film's sound to a video, over and over until the video ends; nothing is encoded anew.

    Where that cannot be done, the video stays as it is, and stderr says why.

    Args:
        video: a .mkv file; others hold no sound of every kind.
        film: video file; it may be silent.
        film_s: seconds after which the video shows the film from its beginning.
    """
    if video.suffix.lower() != ".mkv":
        print(SILENT.format(film, "a .mkv holds it"), file=sys.stderr)
        return
    if av is None:
        print(SILENT.format(film, "pip install 'av>=18' writes it, too"), file=sys.stderr)
        return
    try:
        with av.open(film) as source:
            if source.streams.audio:
                _write_both(video, source, film_s)
    except (av.FFmpegError, InputError) as error:
        print(SILENT.format(film, error), file=sys.stderr)


def _write_both(video: Path, source: Any, film_s: float) -> None:
    """Write a video and the first sound of an open film in place of the video."""
    heard = source.streams.audio[0]
    sound = [packet for packet in source.demux(heard) if packet.pts is not None]
    with av.open(video) as silent, replaced(video, ".mkv") as whole, av.open(whole, "w") as out:
        seen = silent.streams.video[0]
        shown, played = out.add_stream_from_template(seen), out.add_stream_from_template(heard)
        ends = float(silent.duration or 0) / av.time_base

        def states() -> Iterator[tuple[float, Any]]:
            for packet in silent.demux(seen):
                if packet.pts is not None:
                    packet.stream = shown
                    yield float(packet.pts * packet.time_base), packet

        def sounds() -> Iterator[tuple[float, Any]]:
            start = 0.0
            while sound and start < ends:
                for packet in sound:
                    again = av.Packet(bytes(packet))
                    again.time_base, again.duration = packet.time_base, packet.duration
                    again.pts = again.dts = packet.pts + round(start / packet.time_base)
                    again.stream = played
                    time = float(again.pts * packet.time_base)
                    if time < min(ends, start + film_s):
                        yield time, again
                start += film_s

        for _, packet in heapq.merge(states(), sounds(), key=lambda timed: timed[0]):
            out.mux(packet)
