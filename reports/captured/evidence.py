"""Evidence about films in the report: where and when bits are wrong, and what the receiver saw."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from link.captures import Entry, KnownWindow, read_manifest
from link.frames import Captured
from link.images import as_gray, write_image
from link.layout import block_mean
from link.outside import is_file, read_json
from models.film.window import gray_frames
from reports.captured.door import FILMS
from reports.engine.checked import Count, Number, checked
from reports.score.reliability import told

BIN_S, MOST_BINS = 0.25, 16
"""Seconds of film over which wrong bits are counted together, and largest number of such stretches
of a film: longer films have stretches of twice the length, or four times, and so on, so that the
lines of all methods can be told apart."""
LEVELS = 16
"""Width of the bins of gray levels over which wrong bits are counted together."""
MAP_PX = 384
"""Width of the pictures that show which blocks are misread, pixels."""
WORST = 0.5
"""Share of wrong bits that such a picture shows brightest: as many as chance has."""
FEW, ALL = np.array([249, 221, 216]), np.array([165, 20, 10])
"""Colours, R, G and B, of blocks with few wrong bits, and with as many as chance."""
PICTURES = "stories"
"""Folder, in that of a run, of its pictures."""


@dataclass(frozen=True)
class Place:
    """Corners of the display at a time."""

    time_s: Number
    """Time, seconds of the film."""
    corners: list[tuple[Number, Number]]
    """Four corners, pixels of the camera's frame."""


@dataclass(frozen=True)
class FilmSeen:
    """Measurements of a receiver on one film."""

    film: str
    """Name of the film."""
    fps: Number = 0.0
    """Nominal number of frames a second."""
    size: tuple[Count, Count] = (0, 0)
    """Width and height of its frames, pixels."""
    frames: Count = 0
    """Number of frames."""
    found: Count = 0
    """Number of frames in which the display was found."""
    state_hz: Number | None = None
    """Number of states a second of the display by the clock that was found; None for none."""
    exposed: Number = 0.0
    """Length of an exposure, in states of the display."""
    level: Number | None = None
    """Mean gray level of the display in [0, 255]; None where nothing was measured."""
    clipped: Number = 0.0
    """Share of the display's pixels at the camera's limit."""
    cut: Count = 0
    """Number of frames with a part of the display outside the image."""
    places: list[Place] = field(default_factory=list)
    """Corners of the display, some times a second."""


@dataclass(frozen=True)
class WrongBits:
    """Wrong bits of a method in one bin, such as a stretch of time."""

    method: str
    """Label of the method."""
    value: Number
    """Middle of the bin: seconds of the film, or a captured gray level."""
    wrong: Count
    """Number of wrong bits."""
    known: Count
    """Number of bits whose truth is known, at least 1."""
    film: str = ""
    """Name of the film; empty where all films count together."""


@dataclass(frozen=True)
class FilmEvidence:
    """All that the report says of the films of a run."""

    seen: list[FilmSeen]
    """Measurements of the receiver on each film."""
    times: list[WrongBits]
    """Wrong bits over the time of each film."""
    levels: list[WrongBits]
    """Wrong bits by the captured gray level of the block."""
    maps: list[tuple[str, str]]
    """Method, and file of the picture of its misread blocks, in the run's folder."""
    blocks_s: Number
    """Number of message blocks a second that the displays showed, of frame pairs; 0 where no film
    tells the display's rate."""
    bits_s: dict[str, Number] = field(default_factory=dict)
    """Information in bits a second that the scores of the best method hold, by film; of films that
    tell the display's rate."""

    def over_time(self, most: int) -> dict[str, list[WrongBits]]:
        """Wrong bits of the first ``most`` films, by film; of those with several bins of time."""
        films: dict[str, list[WrongBits]] = {}
        for entry in self.times:
            films.setdefault(entry.film, []).append(entry)
        return {
            name: mine
            for name, mine in list(films.items())[:most]
            if len({entry.value for entry in mine}) > 1
        }


def film_evidence(
    captures: Path, records: pd.DataFrame, folder: Path, pictures: bool
) -> FilmEvidence:
    """Count wrong bits over time, display and gray level.

    Args:
        captures: folder with a manifest.
        records: predictions of its entries.
        folder: folder of the run, which gets the pictures.
        pictures: whether pictures are made.
    """
    seen, entries = read_seen(captures), read_manifest(captures)
    rows: list[pd.DataFrame] = []
    grids: dict[str, dict[tuple[int, int], NDArray[np.float64]]] = {}
    by_index = dict(list(records.groupby("index")))
    last_s = max(float(e.meta.get("end_s", e.meta.get("time_s", 0.0))) for e in entries)
    bin_s = BIN_S * 2 ** int(np.ceil(np.log2(max(1.0, last_s / (MOST_BINS * BIN_S)))))
    for index, entry in enumerate(entries):
        captured = entry.load()
        pairs = captured.observation.mixture.count if isinstance(captured, KnownWindow) else 1
        level = np.clip(np.tile(block_levels(captured), pairs), 0, 255)
        begin = float(entry.meta.get("time_s", 0.0))
        end = float(entry.meta.get("end_s", begin))
        middles = begin + (end - begin) * (np.arange(pairs) + 0.5) / pairs
        time = np.repeat(middles, captured.layout.n_bits)
        for row in by_index[index].itertuples() if index in by_index else ():
            known = row.bits >= 0
            wrong = ((row.scores > 0) != row.bits) & known
            place = pd.DataFrame({"time": time // bin_s, "level": level // LEVELS})
            place["known"], place["wrong"] = known, wrong
            counted = place.groupby(["time", "level"]).sum().reset_index()
            rows.append(counted.assign(method=row.method, film=str(entry.meta.get("film", ""))))
            layout = captured.layout
            grid = grids.setdefault(str(row.method), {})
            size = layout.rows, layout.cols
            counts = grid.setdefault(size, np.zeros((2, *size)))
            for number, mine in enumerate((wrong, known)):
                counts[number][layout.message_mask] += mine.reshape(pairs, -1).sum(0)
    table, blocks = pd.concat(rows), _blocks_a_second(seen, entries)
    return FilmEvidence(
        seen,
        _wrong_bits(table, "time", bin_s, ["film"]),
        _wrong_bits(table, "level", LEVELS, []),
        _maps(grids, folder) if pictures else [],
        float(np.mean(blocks)),
        _bits_a_second(blocks, entries, records),
    )


def read_seen(captures: Path) -> list[FilmSeen]:
    """Read what the receiver saw, where the folder says it; nothing elsewhere."""
    file = captures / FILMS
    if not is_file(file):
        return []
    content: Any = read_json(file)
    films = content.get("films") if isinstance(content, dict) else None
    return checked(list[FilmSeen], films, str(file))


def block_levels(captured: KnownWindow | Captured) -> NDArray[np.float64]:
    """Measure the captured gray level, 0 to 255, of each message block: (n_bits,)."""
    layout = captured.layout
    if isinstance(captured, KnownWindow):
        gray = gray_frames(captured.observation).mean(0)
    else:
        gray = as_gray(captured.rectified().original)
    mean = block_mean(gray.astype(np.float64), layout.rows, layout.cols)
    return np.asarray(mean[layout.message_mask], np.float64)


def _wrong_bits(table: pd.DataFrame, by: str, width: float, more: Sequence[str]) -> list[WrongBits]:
    """Sum counts by method and one column, whose bins are given at their middle."""
    sums = table.groupby(["method", *more, by], sort=False)[["wrong", "known"]].sum().reset_index()
    sums = sums[sums["known"] > 0].sort_values(by, kind="stable")
    return [
        WrongBits(
            str(row["method"]),
            round((float(row[by]) + 0.5) * width, 3),
            int(row["wrong"]),
            int(row["known"]),
            str(row["film"]) if more else "",
        )
        for _, row in sums.iterrows()
    ]


def _maps(
    grids: dict[str, dict[tuple[int, int], NDArray[np.float64]]], folder: Path
) -> list[tuple[str, str]]:
    """Draw the blocks that each method misreads, of the grid that was recorded most."""
    found = []
    for number, (method, by_grid) in enumerate(grids.items()):
        wrong, known = max(by_grid.values(), key=lambda counts: counts[1].sum())
        share = np.where(known > 0, wrong / np.maximum(known, 1), 0)
        scaled = np.clip(share / WORST, 0, 1) ** 0.5
        tint = FEW + (ALL - FEW) * scaled[..., None]
        shown = np.where((scaled > 0)[..., None], tint, 245).astype(np.uint8)
        shown[known == 0] = 205
        height = round(MAP_PX * 3 / 4)
        large = cv2.resize(shown, (MAP_PX, height), interpolation=cv2.INTER_NEAREST)
        name = f"{PICTURES}/map_{number}.jpg"
        write_image(folder / name, np.asarray(large, np.uint8))
        found.append((method, name))
    return found


def _bits_a_second(
    blocks: Sequence[float], entries: Sequence[Entry], records: pd.DataFrame
) -> dict[str, float]:
    """Find how many bits of information a second the best method has of each film.

    Args:
        blocks: number of blocks a second of each entry; 0 where it is not known.
        entries: parts of the films.
        records: predictions of the entries.
    """
    parts: dict[str, list[int]] = {}
    for number, entry in enumerate(entries):
        if blocks[number]:
            parts.setdefault(str(entry.meta["film"]), []).append(number)
    found = {}
    for film, numbers in parts.items():
        mine = records[records["index"].isin(numbers) & (records["known"] > 0)]
        if len(mine):
            most = max(told(part)[1] for _, part in mine.groupby("method"))
            found[film] = most * blocks[numbers[0]]
    return found


def _blocks_a_second(seen: Sequence[FilmSeen], entries: Sequence[Entry]) -> list[float]:
    """Tell how many blocks the display showed in a second, by entry; 0 where it is not known."""
    rates = {film.film: film.state_hz for film in seen}
    return [
        (rates.get(str(entry.meta.get("film"))) or 0) / 2 * entry.layout.n_bits for entry in entries
    ]
