"""The table of how fast presets deliver."""

from dataclasses import replace

import pytest

from data_gen.film.message import check_settings
from lab.films.delivery import contrast_of
from lab.films.rates import (
    SETTINGS,
    FilmSeries,
    RatesContent,
    RatesFlags,
    label_of_rates,
    rates_blocks,
)
from lab.films.trial import Delivery
from lab.study import Results
from link.errors import InputError
from link.presets import PRESETS


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_can_be_run(name: str) -> None:
    config = RatesFlags().film(name)
    check_settings(config)
    assert config.layout == PRESETS[config.preset].layout
    assert config.fps >= config.state_hz / 3
    assert "/" not in label_of_rates(RatesFlags(settings=(name,)))  # a file is named after it
    assert config.n_bytes == {"paper": 100, "robust": 2000}.get(name, 20_000)


def test_hidden_is_below_the_threshold_and_paper_is_not() -> None:
    hidden, paper = (
        contrast_of(config.preset, config.state_hz, config.kappa)
        for config in (SETTINGS["hidden"], SETTINGS["paper"])
    )
    assert hidden <= 1.0 < paper


def test_rates_are_those_of_the_runs() -> None:
    def run(seconds: float, delivered: bool) -> Delivery:
        return Delivery("canon-lg", 0.0, 0, "a", delivered, False, seconds, 100, 5)

    later, sooner = (
        Results({}, RatesContent([FilmSeries("fast", 20_000, view, runs)]))
        for view, runs in ((45.0, [run(9.0, False)]), (0.0, [run(2.0, True), run(4.0, True)]))
    )
    table = rates_blocks({"one": later, "other": sooner})["rates"].splitlines()
    heads, _, *rows = ([cell.strip() for cell in line.split("|")] for line in table[2:])
    cells, lost = (dict(zip(heads, row, strict=True)) for row in rows)
    assert cells["delivered"] == "2 of 2"
    assert cells["goodput, kbit/s, median"] == "60"  # of 80 and 40
    assert cells["least"] == "40"
    assert cells["bits wrong %"] == "5.00"
    assert lost["view"] == "45°"
    assert (lost["delivered"], lost["least"], lost["seconds, median"]) == ("0 of 1", "–", "–")


def test_results_are_named_after_what_was_filmed() -> None:
    flags = RatesFlags(settings=("hidden, 30 fps",), views=(0.0, 45.0))
    assert label_of_rates(flags) == "hidden_30_fps_0_45"
    assert label_of_rates(replace(flags, n_bytes=9, seed=3)) == "hidden_30_fps_0_45_9B_seed3"


def test_an_unknown_setting_lists_the_others() -> None:
    with pytest.raises(InputError, match="slow camera"):
        RatesFlags().film("quick")
