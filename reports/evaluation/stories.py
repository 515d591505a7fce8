"""Single frame pairs as strips of pictures: typical ones, and the worst failures with a reason.

Pictures are written when a run ends, so that a report can be built again without simulating.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.frame_pair import Cell, FramePair
from link.captures import load_capture, read_manifest
from link.frames import Captured, SoftBits
from link.images import as_rgb, write_bytes, write_image
from link.layout import block_mean
from reports.evaluation.reasons import explain, take_apart
from reports.render.figures import GAIN, bits_panel
from reports.studies.sweeps import Place

Image = NDArray[np.uint8]
WIDTH_PX = 384
"""Of a picture in a strip."""
STORIES_JSON = "stories.json"
FOLDER = "stories"


@dataclass(frozen=True)
class Story:
    """One frame pair as the report shows it."""

    kind: str
    """"strip" or "failure"."""
    title: str
    where: str
    """Pair, view, kappa, picture, number."""
    pictures: tuple[tuple[str, str], ...]
    """(file in the run's folder, caption)."""
    reason: str = ""
    measured: dict[str, tuple[float, float]] = field(default_factory=dict)
    """As `reasons.explain`."""


def errors_of(line: dict[str, Any]) -> int:
    """Known bits that a prediction has wrong."""
    bits = np.array(line["bits"])
    return int(((np.array(line["scores"]) > 0) != bits)[bits >= 0].sum())


def frame_of(line: dict[str, Any]) -> tuple[Any, ...]:
    """What names a frame pair within a place."""
    return line["pair"], line["view_deg"], line["kappa"], line["index"]


def grouped(lines: Iterable[dict[str, Any]]) -> dict[tuple[Any, ...], dict[str, dict[str, Any]]]:
    """Predictions by frame pair, then by method."""
    found: dict[tuple[Any, ...], dict[str, dict[str, Any]]] = {}
    for line in lines:
        found.setdefault(frame_of(line), {})[line["method"]] = line
    return found


def tell(
    places: Sequence[Place], shown: Sequence[str], told: Sequence[str], hidden: Sequence[str],
    folder: Path, strips: int, failures: int,
) -> list[Story]:  # fmt: skip
    """Write pictures and stories.json of a simulated run.

    Args:
        places: the main comparison first.
        shown: methods whose bits are drawn, the best one last.
        told: those of them whose failures are told, the best one first.
        hidden: those of them that decode equalised pictures without patches.
        folder: of the run.
        strips: typical frame pairs, one a view and kappa, at most so many.
        failures: frame pairs with most wrong bits, at most so many.
    """
    stories = []
    for number, (place, lines) in enumerate(typical(places[0], shown)[:strips]):
        stories.append(_simulated("strip", f"strip{number}", place, lines, shown, hidden, folder))
    for rank, method in enumerate(told):
        count = failures // len(told) + (rank < failures % len(told))
        for number, (place, lines) in enumerate(worst(places, method, count)):
            stem = f"failure_{rank}_{number}"
            stories.append(_simulated("failure", stem, place, lines, [method], hidden, folder))
    save(folder, stories)
    return stories


def typical(place: Place, shown: Sequence[str]) -> list[tuple[Place, dict[str, dict[str, Any]]]]:
    """Of each view and kappa the frame pair with the median number of wrong bits of all methods."""
    by_condition: dict[tuple[Any, ...], list[dict[str, dict[str, Any]]]] = {}
    for (_, view, kappa, _), lines in grouped(place.predictions).items():
        if set(shown) <= set(lines):
            by_condition.setdefault((view, kappa), []).append(lines)
    order = sorted(by_condition, key=lambda key: (-key[0], key[1]))  # the hardest first
    chosen = []
    for key in order:
        ranked = sorted(by_condition[key], key=lambda lines: sum(map(errors_of, lines.values())))
        chosen.append((place, ranked[len(ranked) // 2]))
    return chosen


def worst(
    places: Sequence[Place], method: str, count: int
) -> list[tuple[Place, dict[str, dict[str, Any]]]]:
    """Frame pairs that ``method`` misreads most: two of the main comparison, one a sweep."""
    ranked: dict[str, list[tuple[int, Place, dict[str, Any]]]] = {}
    for place in places:
        for line in place.predictions:
            if line["method"] == method and (errors := errors_of(line)):
                ranked.setdefault(place.sweep, []).append((errors, place, line))
    chosen: list[tuple[int, Place, dict[str, Any]]] = []
    for sweep, candidates in ranked.items():
        candidates.sort(key=lambda candidate: -candidate[0])
        seen = {frame_of(line) for _, _, line in chosen}
        fresh = [c for c in candidates if frame_of(c[2]) not in seen]
        chosen += fresh[: 1 if sweep else 2]
    chosen.sort(key=lambda candidate: (bool(candidate[1].sweep), -candidate[0]))
    return [(place, {method: line}) for _, place, line in chosen[:count]]


def tell_captures(
    captures: Path, predictions: Sequence[dict[str, Any]], shown: Sequence[str], folder: Path,
    strips: int, failures: int,
) -> list[Story]:  # fmt: skip
    """The same of a folder of captures: the first ones, and those with most wrong bits."""
    entries = read_manifest(captures)
    by_index: dict[int, dict[str, dict[str, Any]]] = {}
    for line in predictions:
        by_index.setdefault(line["index"], {})[line["method"]] = line
    stories = []
    for index in sorted(by_index)[:strips]:
        stories.append(_real("strip", index, captures, entries, by_index[index], shown, folder))
    best = shown[-1]
    wrong = [(errors_of(lines[best]), i) for i, lines in by_index.items() if best in lines]
    for _, index in sorted((pair for pair in wrong if pair[0]), key=lambda p: (-p[0], p[1]))[
        :failures
    ]:
        stories.append(
            _real("failure", index, captures, entries, by_index[index], shown[-1:], folder)
        )
    save(folder, stories)
    return stories


def save(folder: Path, stories: Sequence[Story]) -> None:
    """Write stories.json."""
    content = json.dumps([asdict(story) for story in stories], indent=1)
    write_bytes(folder / STORIES_JSON, f"{content}\n".encode())


def read_stories(folder: Path) -> list[Story]:
    """What `save` wrote; none where there is no such file."""
    file = folder / STORIES_JSON
    return [Story(**entry) for entry in json.loads(file.read_text())] if file.is_file() else []


def _simulated(
    kind: str, stem: str, place: Place, lines: dict[str, dict[str, Any]],
    shown: Sequence[str], hidden: Sequence[str], folder: Path,
) -> Story:  # fmt: skip
    line = lines[shown[-1]]
    cell = Cell(line["pair"], line["view_deg"], line["kappa"])
    filmed = {
        plain: FramePair(place.source, cell, line["index"], plain)
        for plain in {name in hidden for name in shown}
    }
    main = shown[-1] in hidden
    pictures = [
        ("displayed", as_rgb(filmed[main].displayed.original)),
        *_seen(filmed[main].captured),
        *((_caption(lines[n]), _bits(filmed[n in hidden].captured, lines[n])) for n in shown),
    ]
    reason = ""
    measured: dict[str, tuple[float, float]] = {}
    if kind == "failure":
        layout = filmed[main].layout
        wrong = np.zeros((layout.rows, layout.cols), bool)
        bits = np.array(line["bits"])
        wrong[layout.message_mask] = ((np.array(line["scores"]) > 0) != bits) & (bits >= 0)
        reason, measured = explain(take_apart(filmed[main]), wrong)
    where = (
        f"{cell.pair}, {cell.view_deg:g}°, κ {cell.kappa}, picture {line['picture']}, "
        f"frame pair {line['index']}; simulated"
    )
    title = f"{line['method']}: {place.name}"
    if kind == "strip":
        title = f"{cell.view_deg:g}°, κ {cell.kappa}"
    return Story(kind, title, where, _written(folder, stem, pictures), reason, measured)


def _real(
    kind: str, index: int, captures: Path, entries: Sequence[dict[str, Any]],
    lines: dict[str, dict[str, Any]], shown: Sequence[str], folder: Path,
) -> Story:  # fmt: skip
    entry = entries[index]
    captured = load_capture(captures, entry)
    drawn = [lines[name] for name in shown if name in lines] or list(lines.values())[:2]
    pictures = [*_seen(captured), *((_caption(one), _bits(captured, one)) for one in drawn)]
    where = ", ".join(
        f"{key} {captured.meta[key]}"
        for key in ("pair", "view_deg", "picture")
        if captured.meta.get(key)
    )
    reason = ""
    measured: dict[str, tuple[float, float]] = {}
    if kind == "failure":
        reason, measured = _seen_reason(captured, drawn[-1])
    title = f"{entry['original']} and {entry['embedded']}"
    return Story(kind, title, where, _written(folder, f"{kind}{index}", pictures), reason, measured)


def _seen_reason(
    captured: Captured, line: dict[str, Any]
) -> tuple[str, dict[str, tuple[float, float]]]:
    """What the capture alone tells: level and texture of the blocks that were misread."""
    pair, layout = captured.rectified(), captured.layout
    luma = cv2.cvtColor(as_rgb(pair.original), cv2.COLOR_RGB2GRAY).astype(np.float64)
    slope = np.hypot(*np.gradient(cv2.GaussianBlur(luma, (0, 0), 1.0)))
    bits = np.array(line["bits"])
    wrong = np.zeros((layout.rows, layout.cols), bool)
    wrong[layout.message_mask] = ((np.array(line["scores"]) > 0) != bits) & (bits >= 0)
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
    pair = captured.rectified()
    photo = as_rgb(captured.original).copy()
    thick = max(2, photo.shape[1] // 300)
    cv2.polylines(photo, [captured.corners.round().astype(np.int32)], True, (40, 170, 70), thick)
    change = as_rgb(pair.embedded).astype(np.float64) - as_rgb(pair.original)
    offset = float(np.median(change))
    amplified = np.clip(128 + GAIN * (change - offset), 0, 255).astype(np.uint8)
    note = f"difference × {GAIN:g}"
    title = f"{note}, {offset:+.0f} taken off" if offset else note
    return [("captured", photo), (title, amplified)]


def _bits(captured: Captured, line: dict[str, Any]) -> Image:
    soft = SoftBits(np.array(line["scores"]))
    return bits_panel(captured.rectified(), soft, np.array(line["bits"]))


def _caption(line: dict[str, Any]) -> str:
    known = sum(bit >= 0 for bit in line["bits"])
    return f"{line['method']}: {errors_of(line)} of {known} bits wrong" if known else line["method"]


def _written(
    folder: Path, stem: str, pictures: Sequence[tuple[str, Image]]
) -> tuple[tuple[str, str], ...]:
    """Reduce to `WIDTH_PX` and write as JPEG: (file, caption)."""
    written = []
    for number, (caption, image) in enumerate(pictures):
        height = round(image.shape[0] * WIDTH_PX / image.shape[1])
        small = cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        name = f"{FOLDER}/{stem}_{number}.jpg"
        write_image(folder / name, np.asarray(small, np.uint8))
        written.append((name, caption))
    return tuple(written)
