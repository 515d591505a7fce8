"""The study of how often displays are found by their pilots: what films show, and its table."""

import json
from math import lcm
from pathlib import Path

import numpy as np
import pytest
from pilot_films import robust_film

from lab.films.pilot_search import (
    PAN_PX,
    PATTERNS,
    SCENE,
    SearchOutcome,
    displayed_states,
    folder_outcome,
    search_table,
    searched_layouts,
    stages_table,
    waited_for,
)
from link.geometry import homography_from_corners
from link.images import write_image
from link.layout import make_layout
from link.presets import PRESETS

HIDDEN = PRESETS["hidden"].layout


def pictures(count: int) -> list[np.ndarray]:
    shape = (HIDDEN.height, HIDDEN.width, 3)
    return [np.random.default_rng(n).integers(30, 220, shape, np.uint8) for n in range(count)]


def test_a_film_has_scenes_that_move_and_no_message() -> None:
    shown = pictures(2)
    states, _ = displayed_states("film", shown, "hidden", np.random.default_rng(0))
    assert len(states) == 2 * PATTERNS
    for start in range(0, len(states), SCENE):
        np.testing.assert_array_equal(states[start], shown[start // SCENE % 2])
        steps = [
            (down, right)
            for down in range(-PAN_PX, PAN_PX + 1)
            for right in range(-PAN_PX, PAN_PX + 1)
            if (np.roll(states[start], (down, right), axis=(0, 1)) == states[start + 1]).all()
        ]
        assert len(steps) == 1  # the next state is the one before, moved


@pytest.mark.slow
def test_displays_show_the_preset_or_another_layout_or_stand_still() -> None:
    shown, rng = pictures(1), np.random.default_rng(1)
    states, layout = displayed_states("display", shown, "hidden", rng)
    assert (len(states), layout) == (2 * lcm(PATTERNS, 63), HIDDEN)
    pair = states[2 * np.flatnonzero(HIDDEN.code.signs < 0)[0] :][:2]
    change = pair[0].astype(int) - pair[1]  # the embedded frame comes first
    top, bottom, left, right = HIDDEN.cell_box(*divmod(int(HIDDEN.pilot_blocks[0]), HIDDEN.cols))
    assert np.sign(change[top:bottom, left:right].mean()) == 2 * HIDDEN.pilot_bits[0] - 1
    states, layout = displayed_states("other", shown, "hidden", rng)
    assert layout == make_layout()
    assert layout not in searched_layouts()
    states, _ = displayed_states("still", shown, "hidden", rng)
    assert len(states) == 1


def outcome(number: int, seen: str = "display", off: float | None = 0.2) -> SearchOutcome:
    found = None if off is None else 0.1 * (number + 1)
    right = seen == "display" and off is not None
    stages = {} if found is None else {"proposed": found / 2, "found": found}
    return SearchOutcome("fast", seen, number, 30.0, 0.3, found, off, right, stages, 0.0)


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


def test_of_a_film_in_a_folder_it_is_told_where_the_time_went(tmp_path: Path) -> None:
    images, corners = robust_film(40)
    lines = []
    for number, (image, quad) in enumerate(zip(images, corners, strict=True)):
        write_image(tmp_path / f"{number:06d}.png", np.repeat(image[:, :, None], 3, axis=2))
        H = homography_from_corners(quad, HIDDEN.width, HIDDEN.height)
        lines.append(json.dumps({"time_s": number / 30, "H_captured_from_display": H.tolist()}))
    (tmp_path / "truth.jsonl").write_text("\n".join(lines))
    film = SearchOutcome(**folder_outcome(str(tmp_path)))
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
