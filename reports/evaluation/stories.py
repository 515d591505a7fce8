"""Single frame pairs as strips of pictures: typical ones, and the worst failures with a reason.

Pictures are written when a run ends, so that a report can be built again without simulating.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from data_gen.frame_pair import Cell, FramePair, Source
from link.captures import Entry, KnownWindow, read_manifest
from link.frames import Captured, SoftBits
from link.images import as_rgb, write_image
from link.layout import Layout, block_mean
from link.types import Image
from reports.captured.evidence import PICTURES
from reports.captured.receive import pair_of_window
from reports.engine.records import FRAME
from reports.evaluation.reasons import explain, take_apart
from reports.render.figures import GAIN, bits_panel, difference_panel
from reports.run import Story

STRIP_WIDTH_PX = 384
"""Width of each picture of a story, pixels."""


@dataclass(frozen=True)
class Place:
    """One condition of a run, with all that is needed to film its frame pairs again."""

    source: Source
    """Pictures, messages and channel draws of the condition."""
    sweep: str
    """Name of the sweep that it belongs to; empty for the main comparison."""
    words: str
    """The condition in words."""


@dataclass(frozen=True)
class Chosen:
    """A frame pair to show, and the predictions of its methods."""

    place: Place
    """Condition in which the frame pair was filmed."""
    by_method: Mapping[str, Any]
    """Rows of the table of predictions, by method."""


def simulated_stories(
    records: pd.DataFrame,
    places: Mapping[str, Place],
    shown: Sequence[str],
    leaders: Sequence[str],
    hidden: Sequence[str],
    folder: Path,
    strips: int,
    failures: int,
) -> list[Story]:
    """Film typical and badly read frame pairs of a simulated run again, and write their pictures.

    Args:
        records: predictions of the main comparison and of all sweeps.
        places: by condition.
        shown: methods whose bits are drawn, the best one last.
        leaders: methods whose failures are told, the best one first.
        hidden: methods that decode equalised pictures without patches.
        folder: folder of the run.
        strips: largest number of typical frame pairs, one for each view and kappa.
        failures: largest number of frame pairs with most wrong bits.
    """
    stories = []
    for number, chosen in enumerate(typical_pairs(records, places, shown)[:strips]):
        stories.append(_filmed_again("strip", f"strip{number}", chosen, shown, hidden, folder))
    for rank, method in enumerate(leaders):
        count = failures // len(leaders) + (rank < failures % len(leaders))
        for number, chosen in enumerate(worst_pairs(records, places, method, count)):
            stem = f"failure_{rank}_{number}"
            stories.append(_filmed_again("failure", stem, chosen, [method], hidden, folder))
    return stories


def typical_pairs(
    records: pd.DataFrame, places: Mapping[str, Place], shown: Sequence[str]
) -> list[Chosen]:
    """For each view and kappa the frame pair with the median number of wrong bits of all methods.

    Only frame pairs of the main comparison that all methods of ``shown`` decoded are taken; the
    hardest views and kappas come first. Of several, one of the display and camera shown least.
    """
    main = _with_errors(records[records["condition"] == ""])
    frames = main.groupby(FRAME, sort=False, dropna=False).agg(
        errors=("errors", "sum"), methods=("method", set)
    )
    whole = frames[[set(shown) <= methods for methods in frames["methods"]]].reset_index()
    chosen: list[Any] = []
    cells = whole.groupby(["view_deg", "kappa"], sort=False)
    for _, cell in sorted(cells, key=lambda entry: (-entry[0][0], entry[0][1])):
        median = cell["errors"].sort_values().iloc[len(cell) // 2]
        equal = [row for _, row in cell[cell["errors"] == median].iterrows()]
        pairs = [row["pair"] for row in chosen]
        chosen.append(min(equal, key=lambda row: pairs.count(row["pair"])))
    return [_chosen(main, places, row) for row in chosen]


def worst_pairs(
    records: pd.DataFrame, places: Mapping[str, Place], method: str, count: int
) -> list[Chosen]:
    """The frame pairs that a method misreads most: two of the main comparison, one of each sweep.

    Returns:
        at most ``count`` of them, those of the main comparison first, the worst of each first.
    """
    mine = _with_errors(records[records["method"] == method])
    mine = mine[mine["errors"] > 0].sort_values("errors", ascending=False, kind="stable")
    mine["sweep"] = [places[condition].sweep for condition in mine["condition"]]
    order = dict.fromkeys(place.sweep for place in places.values())
    taken: list[Any] = []
    for sweep in order:
        seen = {tuple(row[FRAME]) for row in taken}
        candidates = mine[mine["sweep"] == sweep]
        fresh = [row for _, row in candidates.iterrows() if tuple(row[FRAME]) not in seen]
        taken += fresh[: 1 if sweep else 2]
    taken.sort(key=lambda row: (bool(row["sweep"]), -row["errors"]))
    return [Chosen(places[row["condition"]], {method: row}) for row in taken[:count]]


def captured_stories(
    captures: Path,
    records: pd.DataFrame,
    shown: Sequence[str],
    folder: Path,
    strips: int,
    failures: int,
) -> list[Story]:
    """Write pictures of the first captures of a folder, and of those with most wrong bits.

    Args:
        captures: folder with a manifest.
        records: predictions, by the number of the manifest's entry.
        shown: methods whose bits are drawn, the best one last.
        folder: folder of the run.
        strips: largest number of first captures.
        failures: largest number of captures with most wrong bits, dealt out to all methods.
    """
    entries = read_manifest(captures)
    by_index = {
        int(index): {row["method"]: row for _, row in group.iterrows()}
        for index, group in _with_errors(records).groupby("index")
    }
    stories = []
    for index in sorted(by_index)[:strips]:
        stem, rows = f"strip{index}", by_index[index]
        stories.append(_loaded("strip", stem, index, entries[index], rows, shown, folder))
    wrong = {
        (index, method): int(row["errors"])
        for index, rows in by_index.items()
        for method, row in rows.items()
        if row["errors"]
    }
    methods = sorted({method for _, method in wrong}, key=lambda name: (name != shown[-1], name))
    each = max(1, failures // max(1, len(methods)))
    for method in methods:
        mine = sorted((-count, index) for (index, name), count in wrong.items() if name == method)
        for _, index in mine[:each]:
            stem, rows = f"failure{len(stories)}", by_index[index]
            stories.append(_loaded("failure", stem, index, entries[index], rows, [method], folder))
    return stories


def _with_errors(records: pd.DataFrame) -> pd.DataFrame:
    """The table with a column ``errors``: known bits that are decided wrong."""
    return records.assign(errors=records["known"] - records["correct"])


def _chosen(records: pd.DataFrame, places: Mapping[str, Place], frame: Any) -> Chosen:
    """All predictions of one frame pair of the main comparison."""
    rows = records[(records[FRAME] == frame[FRAME]).all(axis=1)]
    return Chosen(places[""], {row["method"]: row for _, row in rows.iterrows()})


def _filmed_again(
    kind: Literal["strip", "failure"],
    stem: str,
    chosen: Chosen,
    shown: Sequence[str],
    hidden: Sequence[str],
    folder: Path,
) -> Story:
    """One simulated frame pair as a story; what it showed and what was captured is made again."""
    row, place = chosen.by_method[shown[-1]], chosen.place
    cell = Cell(row["pair"], float(row["view_deg"]), int(row["kappa"]))
    filmed = {
        equalised: FramePair(place.source, cell, int(row["index"]), equalised)
        for equalised in {name in hidden for name in shown}
    }
    main = filmed[shown[-1] in hidden]
    pictures = [
        ("displayed", as_rgb(main.displayed.original)),
        *_seen(main.captured),
        *(
            (_caption(mine), _bits(filmed[name in hidden].captured, mine))
            for name, mine in ((name, chosen.by_method[name]) for name in shown)
        ),
    ]
    reason = ""
    measured: dict[str, tuple[float, float]] = {}
    if kind == "failure":
        reason, measured = explain(take_apart(main), wrong_blocks(row, main.layout))
    where = (
        f"{cell.pair}, {cell.view_deg:g}°, κ {cell.kappa}, picture {row['picture']}, "
        f"frame pair {row['index']}; simulated"
    )
    title = f"{row['method']}: {place.words}"
    if kind == "strip":
        title = f"{cell.view_deg:g}°, κ {cell.kappa}"
    return Story(kind, title, where, _written(folder, stem, pictures), reason, measured)


def _loaded(
    kind: Literal["strip", "failure"],
    stem: str,
    index: int,
    entry: Entry,
    by_method: Mapping[str, Any],
    shown: Sequence[str],
    folder: Path,
) -> Story:
    """One frame pair of a folder of captures as a story."""
    loaded = entry.load()
    drawn = [by_method[name] for name in shown if name in by_method] or list(by_method.values())[:2]
    if isinstance(loaded, Captured):
        captured, title = loaded, " and ".join(file.name for file in entry.files)
    else:
        number = _worst_of_window(drawn[-1], loaded)
        captured = pair_of_window(loaded, number)
        drawn = [_of_window(row, loaded, number) for row in drawn]
        count = loaded.observation.mixture.count
        title = (
            f"{entry.files[0].name}: frame pair {number + 1} of {count}, put together from frames"
        )
    pictures = [*_seen(captured), *((_caption(row), _bits(captured, row)) for row in drawn)]
    where = ", ".join(
        f"{key} {captured.meta[key]}"
        for key in ("pair", "view_deg", "picture", "film", "time_s")
        if captured.meta.get(key)
    )
    reason = ""
    measured: dict[str, tuple[float, float]] = {}
    if kind == "failure":
        reason, measured = _what_the_capture_tells(captured, drawn[-1])
    return Story(kind, title, where, _written(folder, stem, pictures), reason, measured)


def _worst_of_window(row: Any, window: KnownWindow) -> int:
    """Number of the frame pair of a window with the most wrong bits that are known."""
    bits = window.bits
    wrong = (np.reshape(row["scores"], bits.shape) > 0) != bits
    return int((wrong & (bits >= 0)).sum(1).argmax())


def _of_window(row: Any, window: KnownWindow, number: int) -> dict[str, Any]:
    """Give of the prediction of a window that of one of its frame pairs."""
    scores, bits = (np.reshape(row[name], window.bits.shape)[number] for name in ("scores", "bits"))
    right = int(((scores > 0) == bits)[bits >= 0].sum())
    return {
        **row,
        "scores": scores,
        "bits": bits,
        "known": int((bits >= 0).sum()),
        "correct": right,
    }


def wrong_blocks(row: Any, layout: Layout) -> NDArray[np.bool_]:
    """Find the blocks whose known bit a prediction has wrong; ratex patches count as right.

    Args:
        row: a prediction, with ``scores`` and ``bits`` of the message blocks.
        layout: grid of blocks and ratex patches.

    Returns:
        (rows, cols), true where the bit is wrong.

    >>> from link.layout import make_layout
    >>> layout = make_layout(2, 2, 64, 48, ratex=0)
    >>> row = {"scores": np.array([2.0, -1.0, 3.0, -2.0]), "bits": np.array([1, 1, -1, 0])}
    >>> wrong_blocks(row, layout).tolist()
    [[False, True], [False, False]]
    """
    wrong = np.zeros((layout.rows, layout.cols), bool)
    wrong[layout.message_mask] = ((row["scores"] > 0) != row["bits"]) & (row["bits"] >= 0)
    return wrong


def _what_the_capture_tells(
    captured: Captured, row: Any
) -> tuple[str, dict[str, tuple[float, float]]]:
    """Level and texture of the blocks that were misread, which need no simulation."""
    pair, layout = captured.rectified(), captured.layout
    luma = cv2.cvtColor(as_rgb(pair.original), cv2.COLOR_RGB2GRAY).astype(np.float64)
    slope = np.hypot(*np.gradient(cv2.GaussianBlur(luma, (0, 0), 1.0)))
    wrong = wrong_blocks(row, layout)
    found = {}
    for name, image in (("captured level", luma), ("texture, levels a pixel", slope)):
        cells = block_mean(image, layout.rows, layout.cols)
        found[name] = (float(cells[wrong].mean()), float(cells[~wrong].mean()))
    level, other = found["captured level"]
    steep, usual = found["texture, levels a pixel"]
    reason = f"{int(wrong.sum())} wrong blocks: captured level {level:.0f} (others {other:.0f}), "
    reason += f"texture {steep:.1f} levels a pixel (others {usual:.1f})."
    return reason, found


def _seen(captured: Captured) -> list[tuple[str, Image]]:
    """The captured photograph with the display outlined, and the amplified difference."""
    photo = as_rgb(captured.original).copy()
    thick = max(2, photo.shape[1] // 300)
    cv2.polylines(photo, [captured.corners.round().astype(np.int32)], True, (40, 170, 70), thick)
    amplified, offset = difference_panel(captured.rectified())
    note = f"difference × {GAIN:g}"
    title = f"{note}, {offset:+.0f} taken off" if offset else note
    return [("captured", photo), (title, amplified)]


def _bits(captured: Captured, row: Any) -> Image:
    """The decided bits drawn over the rectified original."""
    return bits_panel(captured.rectified(), SoftBits(row["scores"]), row["bits"])


def _caption(row: Any) -> str:
    """The method, and how many of its known bits are wrong."""
    if not row["known"]:
        return str(row["method"])
    known = int(row["known"])  # a table that holds unknown numbers has no whole ones
    return f"{row['method']}: {known - int(row['correct'])} of {known} bits wrong"


def _written(
    folder: Path, stem: str, pictures: Sequence[tuple[str, Image]]
) -> list[tuple[str, str]]:
    """Write pictures of `STRIP_WIDTH_PX` as JPEG: file in the run's folder, and caption."""
    written = []
    for number, (caption, image) in enumerate(pictures):
        height = round(image.shape[0] * STRIP_WIDTH_PX / image.shape[1])
        size = STRIP_WIDTH_PX, height
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        name = f"{PICTURES}/{stem}_{number}.jpg"
        write_image(folder / name, np.asarray(small, np.uint8))
        written.append((name, caption))
    return written
