"""The study of how often displays are found by their pilots, and its tables."""

import json
from pathlib import Path

import numpy as np
import pytest
from pilot_films import robust_film

from lab.films.pilot_search import (
    SearchOutcome,
    SearchTake,
    folder_outcome,
    search_film,
    search_table,
    stages_table,
    waited_for,
)
from link.geometry import homography_from_corners
from link.images import write_image
from link.presets import PRESETS

HIDDEN = PRESETS["hidden"].layout


def outcome(number: int, seen: str = "display", off: float | None = 0.2) -> SearchOutcome:
    found = None if off is None else 0.1 * (number + 1)
    stages = {} if found is None else {"proposed": found / 2, "found": found}
    return SearchOutcome(
        preset="fast",
        seen=seen,
        number=number,
        view_deg=30.0,
        coverage=0.3,
        error_px=off,
        right=seen == "display" and off is not None,
        stages=stages,
        evidence=0.0,
    )


@pytest.mark.slow
def test_a_display_is_found() -> None:
    found = search_film(SearchTake("robust", "display", 0, 1.5, "canon-lg", 0))
    assert found.right
    assert found.found_s is not None and found.found_s < 1.5
    assert 0.1 < found.coverage < 0.65


def test_the_table_counts_what_was_found_and_what_should_not_have_been() -> None:
    outcomes = [outcome(0), outcome(1), outcome(2, off=None), outcome(0, "still", None)]
    outcomes.append(outcome(1, "still", 5.0))
    display, still = (
        dict(zip(search_table(outcomes).heads, row, strict=True))
        for row in search_table(outcomes).rows
    )
    assert display["found"].startswith("2 (")
    assert display["found wrongly"].startswith("0 (")
    assert display["median s"] == "0.15"
    assert (still["found"], still["found wrongly"][:3]) == ("–", "1 (")


@pytest.mark.slow
def test_of_a_film_in_a_folder_it_is_told_where_the_time_went(tmp_path: Path) -> None:
    images, corners = robust_film(28)
    lines = []
    for number, (image, quad) in enumerate(zip(images, corners, strict=True)):
        write_image(tmp_path / f"{number:06d}.png", np.repeat(image[:, :, None], 3, axis=2))
        H = homography_from_corners(quad, HIDDEN.width, HIDDEN.height)
        lines.append(json.dumps({"time_s": number / 30, "H_captured_from_display": H.tolist()}))
    (tmp_path / "truth.jsonl").write_text("\n".join(lines))
    film = folder_outcome(str(tmp_path))
    assert film.right
    assert list(film.stages) == ["proposed", "weighed", "verified", "found", "read"]
    assert sorted(film.stages.values()) == list(film.stages.values())
    assert film.error_px is not None and film.error_px < 1
    (row,) = stages_table([film]).rows
    assert row[0] == tmp_path.name


def test_what_a_display_waited_for_is_what_it_never_got_or_got_late() -> None:
    assert waited_for(outcome(2, off=None)) == "a proposal within a block"
    assert waited_for(outcome(2)) == "a proposal within a block"
    late = outcome(2)
    late.stages.update(found=1.5)
    assert waited_for(late) == "frames that agree, or the clock"
