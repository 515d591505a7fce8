"""How fast presets deliver: what is filmed, and the table."""

from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Command

from data_gen.film.message import FilmSettings, Take
from lab import __main__ as lab
from lab.films import rates
from lab.films.rates import (
    SETTINGS,
    Delivery,
    FilmSeries,
    RatesContent,
    RatesFlags,
    deliver,
    label_of_rates,
    rates_blocks,
)
from lab.study import Results
from link.errors import InputError
from link.presets import PRESETS

RUN = Delivery("canon-lg", 0.0, 0, "a", True, False, 2.0, 100, 5)


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_suit_their_presets(name: str) -> None:
    config = RatesFlags().film(name)
    assert config.layout == PRESETS[config.preset].layout
    assert config.fps >= config.state_hz / 3
    assert "/" not in label_of_rates(RatesFlags(settings=(name,)))  # a file is named after it
    usual = 100 if config.carriers == "moving" else 20_000
    assert config.n_bytes == {"paper": 100, "robust": 2000}.get(name, usual)


def test_rates_are_those_of_the_runs() -> None:
    def run(seconds: float, delivered: bool) -> Delivery:
        return replace(RUN, seconds=seconds, delivered=delivered)

    later, sooner = (
        Results({}, RatesContent([FilmSeries("fast", 20_000, view, runs)]))
        for view, runs in ((45.0, [run(9.0, False)]), (0.0, [run(2.0, True), run(4.0, True)]))
    )
    table = rates_blocks({"one": later, "other": sooner})["rates"].splitlines()
    heads, _, *rows = ([cell.strip() for cell in line.split("|")] for line in table[2:])
    cells, lost = (dict(zip(heads, row, strict=True)) for row in rows)
    assert cells["delivered"] == "2 of 2"
    assert cells["goodput, kbit/s (least)"] == "60 (40)"  # of 80 and 40
    assert cells["bits wrong %"] == "5.00"
    assert lost["view"] == "45°"
    assert lost["delivered"] == "0 of 1"
    assert (lost["goodput, kbit/s (least)"], lost["seconds, median"]) == ("–", "–")


def test_results_are_named_after_what_was_filmed() -> None:
    flags = RatesFlags(settings=("hidden, 30 fps",), views=(0.0, 45.0))
    assert label_of_rates(flags) == "hidden_30_fps_0_45"
    assert label_of_rates(replace(flags, n_bytes=9, seed=3)) == "hidden_30_fps_0_45_9B_seed3"


def test_an_unknown_setting_lists_the_others() -> None:
    with pytest.raises(InputError, match="hidden, 30 fps"):
        RatesFlags().film("quick")


def test_a_run_goes_on_with_the_takes_that_are_missing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []

    def film(take: Take) -> Delivery:
        taken.append((take.pair, take.view, take.run))
        return replace(RUN, pair=take.pair, view_deg=take.view, run=take.run)

    monkeypatch.setattr(rates, "deliver", film)
    flags = ("rates", "--settings", "paper", "--pairs", "canon-lg", "--views", 0, "--jobs", 1)
    for runs in (1, 2):
        command(lab.main, *flags, "--out", tmp_path, "--runs", runs)
    assert taken == [("canon-lg", 0.0, 0), ("canon-lg", 0.0, 1)]
    command(lab.main, *flags, "--out", tmp_path, "--n-bytes", 90)
    assert len(taken) == 3  # another message reads nothing of what was stored
    table = (tmp_path / "rates.md").read_text().splitlines()
    assert [line.split("|")[6].strip() for line in table[4:]] == ["1 of 1", "2 of 2"]


@pytest.mark.slow
def test_a_message_is_delivered_from_a_simulated_film() -> None:
    run = deliver(Take(FilmSettings(n_bytes=20), "canon-lg", 0.0, 0, 0))
    assert run.delivered and not run.wrong
    assert run.bits_wrong < 0.05 * run.bits
