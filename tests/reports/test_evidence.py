"""The captures that are read worst, which evaluate.py draws."""

from pathlib import Path
from typing import Any

import numpy as np

from data_gen.frame_pair import Cell, FramePair, Source
from link.layout import make_layout
from reports.engine.records import to_records
from reports.evaluation.stories import worst_stories


def test_the_worst_captures_are_drawn_and_unknown_bits_are_not_counted(tmp_path: Path) -> None:
    source, cell = Source(make_layout()), Cell("canon-lg", 45.0, 3)
    captured = [FramePair(source, cell, index).captured for index in range(3)]

    def line(method: str, index: int, wrong: int, known: bool = True) -> dict[str, Any]:
        truth = captured[index].bits
        scores = np.where((truth > 0) ^ (np.arange(truth.size) < wrong), 1.0, -1.0)
        bits = truth if known else np.full_like(truth, -1)
        place = {"pair": "canon-lg", "view_deg": 45.0, "kappa": 3, "picture": None}
        numbers = {"scores": scores.tolist(), "bits": bits.tolist()}
        return {"method": method, "index": index, **place, **numbers}

    wrong = {"naive": (1, 0, 5), "oorc": (0, 0, 0)}
    lines = [line(m, i, errors) for m, each in wrong.items() for i, errors in enumerate(each)]
    for made, shown, captions in (
        (lines, ["naive", "naive"], ["5 of 59 bits wrong", "1 of 59 bits wrong"]),
        ([line("oorc", 0, 0, known=False)], ["oorc"], ["decided bits"]),
    ):
        stories = worst_stories(to_records(made), lambda row: captured[row["index"]], tmp_path)
        assert [story.method for story in stories] == shown
        assert [story.pictures[-1][1] for story in stories] == captions
        assert all((tmp_path / file).is_file() for story in stories for file, _ in story.pictures)
