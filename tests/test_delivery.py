"""Messages that are delivered, or lost: the studies of receiver and code, and what they store."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command, slow
from tolerances import FLOAT64

from link.errors import InputError
from link.layout import make_layout
from reports.engine.checked import seal
from reports.engine.stored import all_results, each_result, resume
from reports.films import delivery
from reports.films.delivery import Delivery, DeliveryConfig, Take
from reports.readme import DOCS
from reports.studies import framing

ROOT = Path(__file__).parents[1]
STORED = sorted((ROOT / DOCS / "delivery").glob("*.json"))


# Results that are stored as they end


def double(number: int) -> int:
    if number < 0:
        raise ValueError("made to fail")
    return 2 * number


@pytest.mark.parametrize("jobs", [1, slow(2)])
def test_results_come_in_the_order_of_the_items(jobs: int) -> None:
    assert all_results(double, [3, 1, 2], jobs=jobs, title="double") == [6, 2, 4]


def test_what_is_stored_is_not_computed_again(tmp_path: Path) -> None:
    file = tmp_path / "made" / "double.jsonl"
    assert resume(double, {"one": 1}, file, 1, "double") == {"one": 2}
    file.write_text(seal({"name": "one", "result": 7}))
    found = resume(double, {"two": 2, "one": 1}, file, 1, "double")
    assert list(found.items()) == [("two", 4), ("one", 7)]


DAMAGED = ["", "{}", "[]", "null", "2", '{"name": "one"}', '{"name": "one", "result": 7}', "NaN"]
DAMAGED += ['{"name": "one", "result": NaN}', "[" * 10**5, "\xff", '{"name": 1, "result": 2}']


@pytest.mark.parametrize("line", DAMAGED, ids=lambda line: line[:20])
def test_a_damaged_line_is_made_again(tmp_path: Path, line: str) -> None:
    file = tmp_path / "double.jsonl"
    items = {"one": 1, "two": 2}
    resume(double, items, file, 1, "double")
    whole = file.read_bytes()
    first, second = whole.splitlines(keepends=True)
    file.write_bytes(line.encode("latin-1") + b"\n" + second)
    assert resume(double, items, file, 1, "double") == {"one": 2, "two": 4}
    assert file.read_bytes() == second + first
    file.write_bytes(first.replace(b'"result": 2', b'"result": 3') + second)
    assert resume(double, items, file, 1, "double") == {"one": 2, "two": 4}


def test_a_line_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    resume(double, {"one": 1, "two": 2}, file, 1, "double")
    file.write_text(file.read_text()[:-9])
    assert resume(double, {"one": 1, "two": 2}, file, 1, "double") == {"one": 2, "two": 4}
    assert len(file.read_text().splitlines()) == 2


def test_one_that_fails_is_named_after_the_others_were_stored(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    with pytest.raises(InputError, match=r"double: 1 of 3 failed: bad: ValueError: made to fail"):
        resume(double, {"one": 1, "bad": -1, "two": 2}, file, 1, "double")
    assert len(file.read_text().splitlines()) == 2
    with pytest.raises(InputError, match="1 of 1"):
        list(each_result(double, {"bad": -1}, 1, "double"))


# The delivery of messages


def config_of(stored: dict[str, Any]) -> DeliveryConfig:
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in stored["config"].items()}
    return DeliveryConfig(**values)


@pytest.mark.parametrize("file", STORED, ids=lambda file: file.stem)
def test_the_stored_summary_is_that_of_the_stored_runs(file: Path) -> None:
    stored = json.loads(file.read_text())
    config = config_of(stored)
    assert config.name == file.stem
    runs = [Delivery(**run) for run in stored["runs"]]
    found = delivery.summarise_deliveries(runs, config)
    for row, expected in zip(found, stored["summary"], strict=True):
        assert row.pop("view") == expected.pop("view")
        assert row == pytest.approx(expected, rel=FLOAT64)


def test_the_bound_is_the_channels_capacity() -> None:
    run = Delivery(**json.loads(STORED[0].read_text())["runs"][0])
    config = DeliveryConfig(n_bytes=59, state_hz=2.0)
    perfect = Delivery(**{**asdict(run), "bits_wrong": 0})
    n_bits = make_layout().n_bits
    assert delivery.bound_seconds(perfect, config) == pytest.approx(8 * 59 / n_bits, rel=1e-6)
    eleventh = Delivery(**{**asdict(run), "bits": 1000, "bits_wrong": 110})
    assert delivery.bound_seconds(eleventh, config) == pytest.approx(16 * 59 / n_bits, 1e-3)


def test_a_run_goes_on_with_the_takes_that_are_missing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []
    known = json.loads(STORED[0].read_text())["runs"][0]

    def deliver(take: Take) -> dict[str, Any]:
        taken.append((take.pair, take.view, take.run))
        return {**known, "pair": take.pair, "view_deg": take.view, "run": take.run}

    monkeypatch.setattr(delivery, "deliver", deliver)
    flags = ("--pairs", "canon-lg", "--views", 0, "--jobs", 1, "--out", tmp_path)
    for runs in (1, 2):
        done = command(delivery.main, *flags, "--runs", runs)
        assert done.status == 0, done.stderr
    assert taken == [("canon-lg", 0.0, 0), ("canon-lg", 0.0, 1)]
    assert command(delivery.main, *flags, "--runs", 1, "--loops", 2).status == 0
    assert len(taken) == 3  # another setting reads nothing of what was stored
    assert delivery.delivery_table(tmp_path).rows[0][4] == "1"


@pytest.mark.slow
def test_a_message_is_delivered_from_a_simulated_film(command: Command, tmp_path: Path) -> None:
    flags = ("--pairs", "canon-lg", "--views", 0, "--runs", 1, "--n-bytes", 20, "--jobs", 1)
    done = command(delivery.main, *flags, "--out", tmp_path)
    assert done.status == 0, done.stderr
    (file,) = tmp_path.glob("*.json")
    (run,) = json.loads(file.read_text())["runs"]
    assert run["delivered"] and not run["wrong"]
    assert run["bits_wrong"] < 0.05 * run["bits"]


# The codes


SMALL = ("--trials", 4, "--ber", 0.02, 0.2, "--jobs", 1)


def test_the_code_holds_at_few_and_fails_at_many_wrong_bits(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(framing, "RANDOM", 6)
    monkeypatch.setattr(framing, "NOISY", 4)
    monkeypatch.setattr(framing, "BATCH", 4)
    done = command(framing.main, *SMALL, "--wrong", "--out", tmp_path)
    assert done.status == 0, done.stderr
    content = json.loads((tmp_path / "framing.json").read_text())
    rows = [row for row in content["rows"] if row["code"].startswith("LDPC")]
    assert [(row["loops"], row["ber"]) for row in rows] == [
        (loops, ber) for loops in (1, 2, 3) for ber in (0.02, 0.2)
    ]
    assert [row["failed"] for row in rows if row["ber"] == 0.02] == [0, 0, 0]
    assert rows[1]["failed"] == 4
    assert [(row["decodes"], row["wrong"]) for row in content["wrong"]] == [(6, 0), (4, 0)]
    assert (tmp_path / "framing.png").is_file()
    (stored,) = tmp_path.glob("batches_*.jsonl")
    before = stored.read_bytes()
    assert command(framing.main, *SMALL, "--wrong", "--out", tmp_path).status == 0
    assert stored.read_bytes() == before


def test_a_batch_begins_where_the_one_before_ended() -> None:
    config = framing.FramingConfig(trials=3, ber=(0.05, 0.1))
    (code,) = [name for name in framing.CODES if name.startswith("LDPC")]
    batches = list(framing.curve_batches(config, [code]).values())
    rng = np.random.default_rng(config.seed)
    for batch in batches:
        again = np.random.default_rng()
        again.bit_generator.state = dict(batch.state)
        pairs = zip(framing.draw_trials(batch, rng), framing.draw_trials(batch, again), strict=True)
        for one, other in pairs:
            assert one.message == other.message
            assert np.array_equal(one.scores, other.scores)
