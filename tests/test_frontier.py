"""The study of what is read beside what is seen."""

from pathlib import Path

import numpy as np
import pytest

from reports.visibility import frontier
from reports.visibility.frontier import PAPER, PAPER_HZ, SETTINGS, FrontierSetting, information

PAGE = (
    "<!-- hidden_bits -->\n<!-- /hidden_bits -->\n<!-- hidden_rates -->\n<!-- /hidden_rates -->\n"
)


def test_information_of_a_symmetric_channel_is_its_capacity() -> None:
    wrong = 0.1
    sent = np.arange(1000) % 2
    place = np.arange(1000) % 20
    received = np.where((place == 3) | (place == 14), 1 - sent, sent)  # one in ten, of both bits
    scores = np.log((1 - wrong) / wrong) * (2 * received - 1)
    capacity = 1 + wrong * np.log2(wrong) + (1 - wrong) * np.log2(1 - wrong)
    assert (received != sent).mean() == wrong
    assert information(scores, sent) == pytest.approx(capacity, abs=1e-12)


def test_scores_that_tell_nothing_inform_of_nothing() -> None:
    assert information(np.zeros(8), np.arange(8) % 2) == 0
    assert information(np.full(8, 5.0), np.arange(8) % 2) < 0  # sure, and half of them wrong


def test_settings_have_names_of_their_own_and_fit_their_layouts() -> None:
    assert len({setting.name for setting in SETTINGS}) == len(SETTINGS)
    assert PAPER.layout.ratex
    assert not PAPER.layout.pilots
    assert all(bool(s.layout.pilots) != s.ratex for s in SETTINGS)


def test_finer_blocks_and_faster_states_are_seen_less() -> None:
    slow, fast = (FrontierSetting(8, 8, "antipodal", 3).seen(hz, 0) for hz in (15, 60))
    fine = FrontierSetting(48, 64, "antipodal", 3).seen(60, 0)
    assert PAPER.seen(PAPER_HZ, 0) > 1
    assert slow > fast > fine


@pytest.mark.slow
def test_the_page_gets_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "hidden.md"
    page.write_text(PAGE)
    monkeypatch.setattr(frontier, "SETTINGS", (PAPER, FrontierSetting(8, 8, "antipodal", 1)))
    monkeypatch.setattr(frontier, "PAIRS", ("canon-lg",))
    flags = ["--frames", "1", "--jobs", "1", "--observed", "0"]
    folders = ["--work", str(tmp_path / "work"), "--page", str(page)]
    monkeypatch.setattr("sys.argv", ["frontier", *flags, *folders])
    frontier.main()
    text = page.read_text()
    assert text.count("| 8 × 8 antipodal, pilots, κ 1 | 45° | learned |") == 1
    assert "| 8 × 8 on_off, ratex, κ 3 | 15 |" in text
    assert (tmp_path / "hidden_frontier.png").is_file()
