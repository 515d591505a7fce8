"""Messages that are delivered, or lost: the studies of receiver and code, and what they store."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from conftest import Command, slow

from data_gen.film.codec import CodecSettings
from data_gen.film.message import FilmSettings, Take
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from lab import __main__ as lab
from lab.films import delivery
from lab.films.trial import Delivery
from lab.study import stored_results
from link.errors import InputError
from reports.engine.backends import Backend
from reports.engine.checked import seal
from reports.engine.stored import resume

RUN = Delivery("canon-lg", 0.0, 0, "a", True, False, 2.0, 100, 5)


# Results that are stored as they end


def double(number: int) -> int:
    if number < 0:
        raise ValueError("made to fail")
    return 2 * number


@pytest.mark.parametrize("jobs", [1, slow(2)])
def test_results_come_in_the_order_of_the_items(jobs: int, tmp_path: Path) -> None:
    items = {"three": 3, "one": 1, "two": 2}
    found = resume(double, items, tmp_path / "double.jsonl", Backend(jobs), "double")
    assert list(found.items()) == [("three", 6), ("one", 2), ("two", 4)]


def test_what_is_stored_is_not_computed_again(tmp_path: Path) -> None:
    file = tmp_path / "made" / "double.jsonl"
    assert resume(double, {"one": 1}, file, Backend(), "double") == {"one": 2}
    file.write_text(seal({"name": "one", "result": 7}))
    found = resume(double, {"two": 2, "one": 1}, file, Backend(), "double")
    assert list(found.items()) == [("two", 4), ("one", 7)]


DAMAGED = ["", "{}", "[]", "null", "2", '{"name": "one"}', '{"name": "one", "result": 7}', "NaN"]
DAMAGED += ['{"name": "one", "result": NaN}', "[" * 10**5, "\xff", '{"name": 1, "result": 2}']


@pytest.mark.parametrize("line", DAMAGED, ids=lambda line: line[:20])
def test_a_damaged_line_is_made_again(tmp_path: Path, line: str) -> None:
    file = tmp_path / "double.jsonl"
    items = {"one": 1, "two": 2}
    resume(double, items, file, Backend(), "double")
    whole = file.read_bytes()
    first, second = whole.splitlines(keepends=True)
    file.write_bytes(line.encode("latin-1") + b"\n" + second)
    assert resume(double, items, file, Backend(), "double") == {"one": 2, "two": 4}
    assert file.read_bytes() == second + first
    file.write_bytes(first.replace(b'"result": 2', b'"result": 3') + second)
    assert resume(double, items, file, Backend(), "double") == {"one": 2, "two": 4}


def test_a_line_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    resume(double, {"one": 1, "two": 2}, file, Backend(), "double")
    file.write_text(file.read_text()[:-9])
    assert resume(double, {"one": 1, "two": 2}, file, Backend(), "double") == {"one": 2, "two": 4}
    assert len(file.read_text().splitlines()) == 2


def test_one_that_fails_is_named_after_the_others_were_stored(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    with pytest.raises(InputError, match=r"double: 1 of 3 failed: bad: ValueError: made to fail"):
        resume(double, {"one": 1, "bad": -1, "two": 2}, file, Backend(), "double")
    assert len(file.read_text().splitlines()) == 2


# The delivery of messages


def test_a_run_goes_on_with_the_takes_that_are_missing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []

    def deliver(take: Take) -> dict[str, Any]:
        taken.append((take.pair, take.view, take.run))
        return asdict(replace(RUN, pair=take.pair, view_deg=take.view, run=take.run))

    monkeypatch.setattr(delivery, "deliver", deliver)
    flags = ("delivery", "--pairs", "canon-lg", "--views", 0, "--jobs", 1, "--out", tmp_path)
    for runs in (1, 2):
        command(lab.main, *flags, "--runs", runs)
    assert taken == [("canon-lg", 0.0, 0), ("canon-lg", 0.0, 1)]
    command(lab.main, *flags, "--runs", 1, "--loops", 2)
    assert len(taken) == 3  # another setting reads nothing of what was stored
    table = (tmp_path / "delivery.md").read_text().splitlines()
    assert [line.split("|")[8].strip() for line in table[4:]] == ["1 of 1"]
    for change in CAMERAS:
        command(lab.main, *flags, "--runs", 1, *change)
    assert len(taken) == 3 + len(CAMERAS)
    results = stored_results(delivery.STUDY, tmp_path)
    cameras = {stored.content.camera for stored in results.values()}
    assert {"", "h264_8000k", "hand2", "drop0.1"} < cameras


CAMERAS = (
    ["--hand", 2],
    ["--drop", 0.1],
    ["--jitter-s", 0.001],
    ["--sharpen", 0.5],
    ["--codec.name", "h264"],
    ["--codec.name", "h264", "--codec.preset", "fast"],
)
"""Flags of cameras that differ."""


def test_a_film_is_named_after_all_that_phone_and_codec_do() -> None:
    assert FilmSettings().camera == ""
    config = FilmSettings(
        hand=6.0,
        drop=0.05,
        jitter_s=0.004,
        phone=PhoneSettings(noise_reduction=0.3, motion_blur=True),
        codec=CodecSettings("hevc", 4000, b_frames=2),
    )
    words = "hand6_drop0.05_jitter_s0.004_noise_reduction0.3_motion_blur1_hevc_4000k_b2"
    assert config.camera == words
    assert config.name(0) == f"{FilmSettings().name(0)}_{words}"
    settings = config.video(SceneSettings())
    assert (settings.hand, settings.drop, settings.jitter_s) == (6.0, 0.05, 0.004)
    assert settings.phone == config.phone


@pytest.mark.slow
def test_a_message_is_delivered_from_a_simulated_film(command: Command, tmp_path: Path) -> None:
    flags = ("--pairs", "canon-lg", "--views", 0, "--runs", 1, "--n-bytes", 20, "--jobs", 1)
    command(lab.main, "delivery", *flags, "--out", tmp_path)
    (file,) = tmp_path.glob("*.json")
    (run,) = json.loads(file.read_text())["runs"]
    assert run["delivered"] and not run["wrong"]
    assert run["bits_wrong"] < 0.05 * run["bits"]
