"""The measuring command of the search for the display."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from lab import __main__ as lab
from lab.films.locate import (
    STUDY,
    PhotoFound,
    Sighting,
    group_sightings,
    measure_photos,
    overlap,
    summarise_sightings,
)
from lab.study import read_results
from link.errors import InputError
from link.images import write_image

SQUARE = np.array([[10.0, 10.0], [110.0, 10.0], [110.0, 110.0], [10.0, 110.0]])


def test_overlap() -> None:
    assert overlap(SQUARE, SQUARE) == pytest.approx(1)
    assert overlap(SQUARE, np.roll(SQUARE, 1, axis=0)) == pytest.approx(1)
    assert overlap(SQUARE, SQUARE + np.array([50, 0])) == pytest.approx(1 / 3)
    assert overlap(SQUARE, SQUARE + np.array([200, 0])) == 0


def outcome(*errors: float, coverage: float = 0.1) -> Sighting:
    return Sighting("edges", "office", 0.0, coverage, bool(errors), list(errors), 0.05)


def test_summary_counts_found_missed_and_wrong() -> None:
    outcomes = [outcome(0.1, 0.2, 0.3, 0.4), outcome(1, 2, 3, 11), outcome()]
    row = summarise_sightings("all", outcomes, 1.0)
    assert (row["photographs"], row["found"], row["wrong"]) == (3, 1, 1)
    assert row["median_px"] == pytest.approx(0.25)
    assert row["found_low"] < 1 / 3 < row["found_high"]
    assert row["median_ms"] == pytest.approx(50)
    assert summarise_sightings("all", outcomes, 2.0)["found"] == 2
    nothing = summarise_sightings("all", [outcome()], 1.0)
    assert nothing["median_px"] is None
    json.dumps(nothing, allow_nan=False)


def test_groups_hold_each_photograph_once() -> None:
    outcomes = [outcome(coverage=share) for share in (0.05, 0.15, 0.39, 0.4, 0.9)]
    split = group_sightings(outcomes)
    covers = [o for name, some in split.items() if name.startswith("covers") for o in some]
    assert sorted(o.coverage for o in covers) == [0.05, 0.15, 0.39, 0.4, 0.9]


def test_photos(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no folder"):
        measure_photos(tmp_path / "missing")
    write_image(tmp_path / "a.png", np.full((120, 160, 3), 90, np.uint8))
    with pytest.raises(InputError, match="npy"):
        measure_photos(tmp_path)
    np.save(tmp_path / "a.npy", SQUARE.astype(np.int32))
    assert measure_photos(tmp_path) == [PhotoFound("a.png", 0.0, [])]
    image = np.full((120, 160, 3), 20, np.uint8)
    image[10:111, 10:111] = np.random.default_rng(0).integers(150, 220, (101, 101, 3))
    write_image(tmp_path / "a.png", image)
    (row,) = measure_photos(tmp_path)
    assert row.iou > 0.97
    assert max(row.errors_px) < 1.5


@pytest.mark.slow
def test_command(tmp_path: Path, command: Command) -> None:
    flags = ("locate", "--size", 480, 270, "--jobs", 1, "--out", tmp_path / "out")
    done = command(lab.main, *flags, "--frames", 1)
    written = read_results(STUDY, tmp_path / "out" / "locate.json")
    assert [sighting.kind for sighting in written.content.sightings] == ["patches", "edges"]
    assert written.meta["simulated"] is True
    assert written.content.photos == []
    assert len(written.content.empty) > 10
    assert "patches: all | 1 |" in done.stdout
    command(lab.main, *flags, "--frames", 0, status=2)
    command(lab.main, *flags, "--photos", tmp_path / "missing", status=2)
