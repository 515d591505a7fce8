"""The frame pairs that methods read worst, as strips of pictures.

Pictures are written when a run ends, so that a report can be built again without simulating.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from data_gen.frame_pair import Cell
from link.captures import KnownWindow
from link.frames import Captured, SoftBits
from link.images import as_rgb, write_image
from link.types import Image
from reports.captured.evidence import PICTURES
from reports.captured.receive import pair_of_window
from reports.engine.checked import write_json
from reports.engine.methods import Method
from reports.engine.predict import Condition
from reports.render.figures import GAIN, bits_panel, difference_panel
from reports.run import STORIES, RunFolder, Story

STRIP_WIDTH_PX = 384
"""Width of each picture of a story, pixels."""
MOST = 8
"""Number of captures of a run that are shown as pictures, dealt out to all methods, and to each at
least one."""
PLACES = {"pair": "{}", "view_deg": "{:g}°", "picture": "{}", "film": "{}", "time_s": "{:.2f} s"}
"""How the values of a capture's `meta` that tell a reader where it is from are written, by key."""


def worst_stories(
    records: pd.DataFrame, load: Callable[[Any], Captured | KnownWindow], folder: Path
) -> list[Story]:
    """Draw the captures with most wrong bits of each method; where no bit is known, the first ones.

    Args:
        records: predictions.
        load: gives what a row of the predictions decoded.
        folder: folder of the run, which gets the pictures.
    """
    records = records.assign(errors=records["known"] - records["correct"])
    shown = records[(records["errors"] > 0) | (records["known"] == 0)]
    groups = shown.sort_values("errors", ascending=False, kind="stable").groupby(
        "method", sort=False
    )
    chosen = groups.head(max(1, MOST // max(1, len(groups)))).sort_values("method", kind="stable")
    return [
        _story(row, load(row), folder, f"worst{number}")
        for number, (_, row) in enumerate(chosen.iterrows())
    ]


def simulated_pictures(
    folder: RunFolder, comparison: Condition, records: pd.DataFrame, methods: Sequence[Method]
) -> None:
    """Film the frame pairs that are read worst again, and write their pictures.

    Args:
        folder: folder of the run.
        comparison: the main comparison.
        records: its predictions.
        methods: all methods that were compared.
    """
    equalised = {method.label for method in methods if comparison.equalises(method)}

    def filmed_again(row: pd.Series) -> Any:
        cell = Cell(row["pair"], float(row["view_deg"]), int(row["kappa"]))
        return comparison.source.observe(cell, int(row["index"]), row["method"] in equalised)

    write_json(folder.path / STORIES, worst_stories(records, filmed_again, folder.path))


def _story(row: Any, loaded: Captured | KnownWindow, folder: Path, stem: str) -> Story:
    """One capture as pictures; of a window of film the frame pair with most wrong bits."""
    scores, bits = np.reshape(row["scores"], (-1, loaded.layout.n_bits)), np.atleast_2d(row["bits"])
    bits = bits.reshape(scores.shape)
    errors = (((scores > 0) != bits) & (bits >= 0)).sum(1)
    number = int(errors.argmax())
    captured = pair_of_window(loaded, number) if isinstance(loaded, KnownWindow) else loaded
    meta = {key: value for key, value in captured.meta.items() if value is not None}
    place = [words.format(meta[key]) for key, words in PLACES.items() if key in meta]
    place += [] if captured.kappa is None else [f"κ {captured.kappa}"]
    place += [f"window {row['index']}"] if len(scores) > 1 else []
    place += [f"frame pair {number if len(scores) > 1 else row['index']}"]
    known = int((bits[number] >= 0).sum())
    decided = f"{errors[number]} of {known} bits wrong" if known else "decided bits"
    drawn = bits_panel(captured.rectified(), SoftBits(scores[number]), bits[number])
    return Story(
        str(row["method"]),
        ", ".join(place),
        _written(folder, stem, [*_seen(captured), (decided, drawn)]),
    )


def _seen(captured: Captured) -> list[tuple[str, Image]]:
    """The captured photograph with the display outlined, and the amplified difference."""
    photo = as_rgb(captured.original).copy()
    thick = max(2, photo.shape[1] // 300)
    cv2.polylines(photo, [captured.corners.round().astype(np.int32)], True, (40, 170, 70), thick)
    amplified, offset = difference_panel(captured.rectified())
    note = f"difference × {GAIN:g}"
    title = f"{note}, {offset:+.0f} taken off" if offset else note
    return [("captured", photo), (title, amplified)]


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
