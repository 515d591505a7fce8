"""The study of what is read beside what is seen."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Command

from lab import __main__ as lab
from lab.study import Results, read_results, write_results
from lab.visibility import frontier
from lab.visibility.frontier import (
    SETTINGS,
    STUDY,
    condition_of,
    displayed_psnr,
    shown_rate,
)
from lab.visibility.frontier_charts import frontier_figure
from lab.visibility.frontier_reading import information
from lab.visibility.frontier_results import (
    CHART_HZ,
    PAPER_HZ,
    PAPER_SETTING,
    FrontierResults,
    FrontierSetting,
    Lead,
    ReadRow,
    SettingResult,
    ShownRate,
)
from lab.visibility.frontier_tables import bits_table, rate_table
from link.errors import InputError
from reports.score.reliability import decided_information

META = {"simulated": True, "seed": 0, "command": "python -m lab.visibility.frontier"}
FINE = FrontierSetting(96, 128, "antipodal", 3)


def read_row(method: str, correct: int, lead: Lead | None, view: float = 0.0) -> ReadRow:
    share = correct / 100
    return ReadRow(view, method, 4, 100, correct, share, share - 0.05, share, 2 * share - 1, lead)


def setting_result(setting: FrontierSetting, correct: int, low: float) -> SettingResult:
    shown = [ShownRate(PAPER_HZ, 8.0), ShownRate(CHART_HZ, 2.0)]
    read = [
        read_row("oorc", 90, Lead(correct - 90.0, low, 3.0)),
        read_row("learned", correct, None),
    ]
    return SettingResult(setting, 50, 44.0, shown, read)


@pytest.fixture
def results() -> FrontierResults:
    """The paper's setting, in which learned is ahead, and one in which it is not clearly so."""
    settings = [setting_result(PAPER_SETTING, 98, 1.0), setting_result(FINE, 91, -0.5)]
    return FrontierResults(settings)


def test_information_of_a_symmetric_channel_is_its_capacity() -> None:
    wrong = 0.1
    sent = np.arange(1000) % 2
    place = np.arange(1000) % 20
    received = np.where((place == 3) | (place == 14), 1 - sent, sent)  # one in ten, of both bits
    scores = np.log((1 - wrong) / wrong) * (2 * received - 1)
    capacity = 1 + wrong * np.log2(wrong) + (1 - wrong) * np.log2(1 - wrong)
    assert (received != sent).mean() == wrong
    assert information(scores, sent) == pytest.approx(capacity, abs=1e-12)
    assert decided_information(1 - wrong) == pytest.approx(capacity, abs=1e-12)


def test_scores_that_tell_nothing_inform_of_nothing() -> None:
    assert information(np.zeros(8), np.arange(8) % 2) == 0
    assert information(np.full(8, 5.0), np.arange(8) % 2) < 0  # sure, and half of them wrong


def test_settings_have_names_of_their_own_and_fit_their_layouts() -> None:
    assert len({setting.name for setting in SETTINGS}) == len(SETTINGS)
    assert PAPER_SETTING.layout.ratex
    assert not PAPER_SETTING.layout.pilots
    assert all(bool(s.layout.pilots) != s.ratex for s in SETTINGS)


def test_finer_blocks_and_faster_states_are_seen_less() -> None:
    antipodal = FrontierSetting(8, 8, "antipodal", 3)
    slow, fast = (shown_rate(antipodal, hz, 0).seen for hz in (15, 60))
    fine = shown_rate(FrontierSetting(48, 64, "antipodal", 3), 60, 0)
    assert shown_rate(PAPER_SETTING, PAPER_HZ, 0).seen > 1
    assert slow > fast > fine.seen


def test_psnr_is_that_of_the_change_against_the_picture() -> None:
    def expected(squared_error: float) -> float:
        return float(10 * np.log10(255**2 / squared_error))

    on_off = FrontierSetting(8, 8, "on_off", 4)  # half of the blocks change by 4
    assert displayed_psnr(condition_of(on_off, 1, 0)) == pytest.approx(expected(8), abs=0.3)
    antipodal = FrontierSetting(8, 8, "antipodal", 4)  # every block lies 2 beside the picture
    assert displayed_psnr(condition_of(antipodal, 1, 0)) == pytest.approx(expected(4), abs=1e-9)


def test_results_come_back_as_they_were_written(tmp_path: Path, results: FrontierResults) -> None:
    write_results(tmp_path / "frontier.json", Results(META, results))
    assert read_results(STUDY, tmp_path / "frontier.json") == Results(META, results)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("settings", 0, "shown", 0, "seen"), 0.0),  # has no place on a logarithmic axis
        (("settings", 0, "read", 0, "accuracy"), 1.5),
        (("settings", 0, "setting", "kappa"), 0),
        (("settings", 0, "setting", "kappa"), 5),  # the paper's setting is missing
        (("settings", 1, "read", 1, "method"), "phi"),  # learned is missing
        (("settings", 1, "read", 1, "view_deg"), 45.0),  # of 0 degrees, oorc is left alone
        (("settings", 1, "read", 0, "method"), "learned"),
        (("settings", 1, "shown", 1, "states_hz"), 30),
        (("settings", 1, "read", 0, "bits"), 0),
        (("settings",), []),
        (("meta", "seed"), "0"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, results: FrontierResults, place: tuple[str | int, ...], value: object
) -> None:
    file = tmp_path / "frontier.json"
    write_results(file, Results(META, results))
    content = json.loads(file.read_text())
    inner = content
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"frontier\.json"):
        read_results(STUDY, file)


def test_a_lead_is_good_where_its_interval_lies_above_0(results: FrontierResults) -> None:
    assert [row[-1].tint for row in bits_table(results).cells] == ["good", "", "bad", ""]


def test_rates_are_those_of_learned_against_the_paper(results: FrontierResults) -> None:
    first, second, *_ = rate_table(results).rows
    assert first == [PAPER_SETTING.name, "15", "8.00", "44.0", "360", "1.00", "1.0"]
    assert second == [PAPER_SETTING.name, "60", "2.00", "44.0", "1,440", "0.25", "4.0"]


def test_charts_place_every_method_by_visibility(results: FrontierResults) -> None:
    panels = frontier_figure(results).axes
    assert [panel.get_title() for panel in panels] == [
        "Right bits over visibility, 0°",
        "Bits a second over visibility",
    ]
    for panel in panels:
        legend = panel.get_legend()
        assert legend is not None
        names = [text.get_text() for text in legend.get_texts()]
        assert {"learned", "8 × 8", "96 × 128"} <= set(names)
        assert ("oorc" in names) == (panel is panels[0])
        drawn = {x for line in panel.lines for x in np.atleast_1d(line.get_xdata())}
        assert {2.0} <= drawn


def test_the_stored_results_can_be_shown() -> None:
    stored = read_results(STUDY, ROOT / "docs/frontier.json").content
    assert {result.setting for result in stored.settings} == set(SETTINGS)
    assert len(frontier_figure(stored).axes) == 3


@pytest.mark.slow
def test_the_command_decodes_every_setting(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = (PAPER_SETTING, FrontierSetting(8, 8, "antipodal", 1))
    monkeypatch.setattr(frontier, "SETTINGS", settings)
    monkeypatch.setattr(frontier, "PAIRS", ("canon-lg",))
    flags = ["--frames", "1", "--jobs", "1", "--observed", "0", "--out", tmp_path]
    done = command(lab.main, "frontier", *flags)
    assert done.status == 0, done.stderr
    assert done.stdout.count("| 8 × 8 antipodal, pilots, κ 1 | 45° | learned |") == 1
    assert "| 8 × 8 on_off, ratex, κ 3 | 15 |" in done.stdout
    assert (tmp_path / "hidden_frontier.png").is_file()
    stored = read_results(STUDY, tmp_path / "frontier.json").content
    assert tuple(result.setting for result in stored.settings) == settings
    counts = {(row.method, row.frames) for result in stored.settings for row in result.read}
    assert counts == {("naive", 1), ("oorc", 1), ("learned", 1)}
    for result in stored.settings:
        for row in result.read:
            assert (row.lead is None) == (row.method == "learned")
