"""Recorded captures with known bits as sets to train on, and to test on, split by recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_gen.episodes import EpisodeSet
from link.captures import Entry, KnownWindow, read_manifest
from link.errors import InputError
from link.frames import Captured
from link.images import as_rgb

HELD_OUT = 1 / 3
"""Share of the recordings on which the result is measured; at least one."""
LEAST = 8
"""Smallest number of frame pairs, or of windows of film, to train on."""
MOST_UNKNOWN = 0.1
"""Largest share of unknown bits in a frame pair that is trained on."""


@dataclass(frozen=True)
class OwnSet:
    """Captures of one kind, split by recording."""

    train: list[Captured | KnownWindow]
    """Captures that are trained on."""
    test: list[Captured | KnownWindow]
    """Captures of other recordings, on which the result is measured."""
    held_out: list[int]
    """Numbers of the entries of ``test`` in the manifest."""

    def episodes(self) -> EpisodeSet:
        """Stack the frame pairs that are trained on."""
        pairs = ((e.rectified(), e.bits) for e in self.train if isinstance(e, Captured))
        return EpisodeSet.stacked(
            (as_rgb(seen.original), as_rgb(seen.embedded), np.asarray(bits, np.int64))
            for seen, bits in pairs
        )


def own_set(captures: Path, *, films: bool, seed: int) -> OwnSet:
    """Load a folder of captures with known bits, and split it by recording.

    A recording is a film; where none is named, a picture, or else a camera-display pair and angle.

    Args:
        captures: folder with a manifest, such as the one that evaluate.py makes of own films.
        films: whether windows of film are taken; else frame pairs are.
        seed: seed by which recordings are held out.

    Raises:
        InputError: the folder is no good, holds the other kind alone, or is too small.
    """
    entries = read_manifest(captures)
    chosen = [at for at, entry in enumerate(entries) if entry.is_window == films]
    if not chosen:
        other = "windows of film; add --films" if not films else "frame pairs; leave out --films"
        raise InputError(f"--captures: {captures} holds {other}")
    layouts = [entries[at].layout for at in chosen]
    usual = max(layouts, key=layouts.count)
    chosen = [at for at, layout in zip(chosen, layouts, strict=True) if layout == usual]
    recordings = {at: _recording(entries[at]) for at in chosen}
    names = sorted(set(recordings.values()))
    if len(names) < 2:
        raise InputError(
            f"--captures: {captures} holds one recording, {names[0]}; to measure what training "
            "brings takes another: film again, from another place or with another picture"
        )
    rng = np.random.default_rng(seed)
    held = set(rng.permutation(names)[: max(1, round(HELD_OUT * len(names)))].tolist())
    loaded = {at: entries[at].load() for at in chosen}
    train = [each for at, each in loaded.items() if recordings[at] not in held and _is_known(each)]
    held_out = [at for at in chosen if recordings[at] in held and loaded[at].bits is not None]
    if len(train) < LEAST or not held_out:
        kind = "windows of film" if films else "frame pairs"
        raise InputError(
            f"--captures: {captures} has {len(train)} {kind} with known bits to train on beside "
            f"{len(held_out)} of the recordings held out ({', '.join(sorted(held))}); need {LEAST} "
            "and 1, better some dozens: record longer, or more"
        )
    return OwnSet(train, [loaded[at] for at in held_out], held_out)


def _recording(entry: Entry) -> str:
    for keys in (("film",), ("picture",), ("pair", "view_deg")):
        if any(entry.content.get(key) is not None for key in keys):
            return " ".join(str(entry.content.get(key)) for key in keys)
    return "all"


def _is_known(capture: Captured | KnownWindow) -> bool:
    """Tell whether the bits of a capture are known well enough to train on."""
    if capture.bits is None:
        return False
    inner = capture.bits
    if isinstance(capture, KnownWindow) and len(inner) > 3:
        return bool((inner[1:-1] >= 0).all())
    return float((inner < 0).mean()) <= (0 if isinstance(capture, KnownWindow) else MOST_UNKNOWN)


def windows_of(captures: Sequence[Captured | KnownWindow]) -> list[KnownWindow]:
    """Give the windows of film among captures."""
    return [each for each in captures if isinstance(each, KnownWindow)]
