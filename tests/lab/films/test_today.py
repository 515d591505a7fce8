"""The table of cameras and displays of today."""

import pytest

from lab.films.today import (
    EFFECTS,
    NOTHING,
    SETTINGS,
    TodayContent,
    TodayFlags,
    TodaySeries,
    check_today,
    label_of_today,
    today_blocks,
)
from lab.films.trial import Delivery
from lab.study import Results
from link.errors import InputError


def run(pair: str, view: float, delivered: bool, seconds: float) -> Delivery:
    return Delivery(pair, view, 0, "a", delivered, False, 1.0, seconds, 9, 100, 5)


def rows(text: str) -> list[dict[str, str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    heads, _, *cells = ([cell.strip() for cell in line.split("|")] for line in lines)
    return [dict(zip(heads, row, strict=True)) for row in cells]


def test_each_pair_is_a_row_and_effects_are_summed_over_pairs() -> None:
    plain = [
        run("phone-tv", 0.0, True, 1.0),
        run("phone-tv", 45.0, True, 3.0),
        run("phone-oled", 0.0, False, 5.0),
    ]
    better = [*plain[:2], run("phone-oled", 0.0, True, 2.0)]
    series = [
        TodaySeries("robust, 30 fps", NOTHING, plain),
        TodaySeries("robust, 30 fps", "distortion", better),
        TodaySeries("fast, 60 fps", NOTHING, plain),
    ]
    blocks = today_blocks({"one": Results({}, TodayContent(series))})
    cells = rows(blocks["today"])
    assert [(row["setting"], row["pair"], row["delivered"]) for row in cells] == [
        (setting, pair, came)
        for setting in ("robust, 30 fps", "fast, 60 fps")
        for pair, came in (("phone-tv", "2 of 2"), ("phone-oled", "0 of 1"))
    ]
    assert (cells[0]["longest"], cells[1]["longest"]) == ("3.00", "–")
    assert cells[1]["bits wrong %"] == "5.00"
    assert "Wrong messages: 0" in blocks["today"]
    effects = rows(blocks["today_effects"])
    assert [(row["switched off"], row["delivered"]) for row in effects] == [
        (NOTHING, "2 of 3"),
        ("distortion", "3 of 3"),
    ]


def test_films_of_several_results_count_once_and_effects_beside_their_own() -> None:
    plain = [run("phone-tv", 0.0, True, 1.0), run("phone-oled", 0.0, False, 5.0)]
    usual = TodayContent([TodaySeries("robust, 30 fps", NOTHING, plain)])
    switched = TodayContent(
        [
            TodaySeries("robust, 30 fps", NOTHING, plain[:1]),
            TodaySeries("robust, 30 fps", "scan", plain[:1]),
        ]
    )
    blocks = today_blocks({"usual": Results({}, usual), "switched": Results({}, switched)})
    assert [row["delivered"] for row in rows(blocks["today"])] == ["1 of 1", "0 of 1"]
    effects = [(row["switched off"], row["delivered"]) for row in rows(blocks["today_effects"])]
    assert effects == [(NOTHING, "1 of 1"), ("scan", "1 of 1")]


def test_webcams_film_what_they_are_fast_enough_for() -> None:
    flags = TodayFlags()
    for name, (_, fps) in SETTINGS.items():
        assert any(pair.startswith("webcam") for pair in flags.filmed(name)) == (fps <= 30)
    assert flags.film("hidden, 60 fps", "distortion").without == ("distortion",)


def test_wrong_words_are_refused() -> None:
    check_today(TodayFlags(without=(NOTHING, *EFFECTS)))
    for flags, word in (
        (TodayFlags(without=("fog",)), "fog"),
        (TodayFlags(settings=("quick",)), "quick"),
        (TodayFlags(pairs=("canon-dell",)), "canon-dell"),
    ):
        with pytest.raises(InputError, match=word):
            check_today(flags)
    effects = TodayFlags(settings=("robust, 30 fps",), without=(NOTHING, "distortion"))
    assert label_of_today(effects) == "robust_30fps_effects"
