"""Messages that are delivered, or lost: the studies of receiver and code, and what they store."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Command, slow
from tolerances import FLOAT64

from data_gen.film.codec import CodecSettings
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from lab.docs import DOCS
from link.errors import InputError
from link.layout import make_layout
from models import PRETRAINED
from reports.engine.backends import Backend
from reports.engine.checked import seal
from reports.engine.stored import all_results, each_result, resume
from reports.films import codecs, delivery
from reports.films.codecs import VariantsTake
from reports.films.delivery import Delivery, DeliveryConfig, Take
from reports.score.reliability import confidence_bins

STORED = sorted((ROOT / DOCS / "delivery").glob("*.json"))


# Results that are stored as they end


def double(number: int) -> int:
    if number < 0:
        raise ValueError("made to fail")
    return 2 * number


@pytest.mark.parametrize("jobs", [1, slow(2)])
def test_results_come_in_the_order_of_the_items(jobs: int) -> None:
    assert all_results(double, [3, 1, 2], Backend(jobs), title="double") == [6, 2, 4]


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
    with pytest.raises(InputError, match="1 of 1"):
        list(each_result(double, {"bad": -1}, Backend(), "double"))


# The delivery of messages


def config_of(stored: dict[str, Any]) -> DeliveryConfig:
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in stored["config"].items()}
    parts = {"phone": PhoneSettings, "codec": CodecSettings}
    values |= {k: kind(**values[k]) for k, kind in parts.items() if k in values}
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
    assert command(delivery.main, *flags, "--runs", 1, "--codec.name", "h264").status == 0
    assert len(taken) == 4
    files = sorted(file.name for file in tmp_path.glob("*.json"))
    assert [name.partition("seed0")[2] for name in files] == [".json", "_h264_8000k.json"]
    assert len(delivery.delivery_table(tmp_path).rows) == 1  # of lossless films alone
    stored = json.loads((tmp_path / files[1]).read_text())
    assert stored["camera"] == "h264_8000k"
    assert config_of(stored).codec == CodecSettings("h264")


def test_a_film_is_named_after_all_that_phone_and_codec_do() -> None:
    assert DeliveryConfig().camera == ""
    config = DeliveryConfig(
        hand=6.0,
        drop=0.05,
        jitter_s=0.004,
        phone=PhoneSettings(noise_reduction=0.3, motion_blur=True),
        codec=CodecSettings("hevc", 4000, b_frames=2),
    )
    words = "hand6_drop0.05_jitter_s0.004_noise_reduction0.3_motion_blur1_hevc_4000k_b2"
    assert config.camera == words
    assert config.name == f"{DeliveryConfig().name}_{words}"
    settings = config.video(SceneSettings())
    assert (settings.hand, settings.drop, settings.jitter_s) == (6.0, 0.05, 0.004)
    assert settings.phone == config.phone


@pytest.mark.parametrize(
    "change",
    [
        {"hand": 2.0},
        {"drop": 0.1},
        {"jitter_s": 0.001},
        {"phone": PhoneSettings(sharpen=0.5)},
        {"codec": CodecSettings("h264")},
        {"codec": CodecSettings("h264", preset="fast")},
    ],
)
def test_stored_runs_are_those_of_one_camera(change: dict[str, Any], tmp_path: Path) -> None:
    model = tmp_path / "decoder.onnx"
    runs = [
        delivery.stored_runs(config, model)
        for config in (DeliveryConfig(out=tmp_path), DeliveryConfig(out=tmp_path, **change))
    ]
    assert runs[0].name != runs[1].name


@pytest.mark.slow
def test_a_message_is_delivered_from_a_simulated_film(command: Command, tmp_path: Path) -> None:
    flags = ("--pairs", "canon-lg", "--views", 0, "--runs", 1, "--n-bytes", 20, "--jobs", 1)
    done = command(delivery.main, *flags, "--out", tmp_path)
    assert done.status == 0, done.stderr
    (file,) = tmp_path.glob("*.json")
    (run,) = json.loads(file.read_text())["runs"]
    assert run["delivered"] and not run["wrong"]
    assert run["bits_wrong"] < 0.05 * run["bits"]


# Codecs and phones


LN4 = np.log(4.0)


def film_of(take: VariantsTake, delivered: bool) -> dict[str, Any]:
    known = json.loads(STORED[0].read_text())["runs"][0]
    run = {"view_deg": take.take.view, "pair": take.take.pair, "run": take.take.run}
    known |= run | {"delivered": delivered, "wrong": False, "bits": 200, "bits_wrong": 30}
    # all bits were decided with 4 : 1, and 85 % of them right
    known["bins"] = [
        asdict(one) for one in confidence_bins(np.full(200, LN4), np.arange(200) >= 30)
    ]
    return {name: known | {"kbits": 7900.0 if "h264" in name else None} for name in take.variants}


def test_films_through_codecs_are_pooled_and_kept(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []

    def read(take: VariantsTake) -> dict[str, Any]:
        taken.append((take.take.config.kappa, take.take.view, take.take.run))
        return film_of(take, delivered=take.take.run == 0)

    monkeypatch.setattr(codecs, "read_variants", read)
    page = tmp_path / "films.md"
    flags = ("--pairs", "canon-lg", "--variants", "lossless", "h264-8000", "--jobs", 1)
    flags += ("--out", tmp_path, "--page", page)
    for runs in (1, 2):
        done = command(codecs.main, *flags, "--runs", runs)
        assert done.status == 0, done.stderr
    cells = [(kappa, view) for kappa in (3, 5) for view in (0.0, 45.0)]
    assert taken == [(*cell, run) for run in (0, 1) for cell in cells]
    content = json.loads((tmp_path / "codecs.json").read_text())
    assert [(row["variant"], row["kappa"], row["view_deg"]) for row in content["rows"]] == [
        (variant, *cell) for variant in ("lossless", "h264-8000") for cell in cells
    ]
    for row in content["rows"]:
        assert (row["runs"], row["delivered"], row["wrong_messages"]) == (2, 1, 0)
        assert row["wrong_bits"] == pytest.approx(0.15)
        assert row["calibration_error"] == pytest.approx(0.05)
        assert row["ci_low"] < 0.5 < row["ci_high"]
        assert row["wrong_bits_low"] < 0.15 < row["wrong_bits_high"]
        assert row["kbits"] == (7900 if row["variant"] == "h264-8000" else None)
    shown = page.read_text()
    assert "| H.264, 8 Mbit/s | 3 | 0° | 1 of 2 |" in shown
    assert shown.splitlines()[1:-1] == done.stdout.splitlines()[:-1]
    assert command(codecs.main, *flags, "--runs", 1, "--n-bytes", 20).status == 0
    assert len(taken) == 12  # another setting reads nothing of what was stored
    fast = ("--preset", "fast", "--state-hz", 30, "--fps", 60, "--block", "phones_fast")
    done = command(codecs.main, *flags, *fast, "--runs", 1)
    assert "60 frames/s, of 30 states/s on 96 × 128 blocks" in done.stdout
    assert len(taken) == 16


def test_the_page_of_films_has_all_blocks() -> None:
    page = (ROOT / "docs" / "films.md").read_text()
    for name in codecs.BLOCKS:
        assert f"<!-- {name} -->" in page and f"<!-- /{name} -->" in page


def test_every_variant_can_be_encoded_and_is_another_one() -> None:
    assert len({repr((v.codec, v.phone)) for v in codecs.VARIANTS.values()}) == len(codecs.VARIANTS)
    for name, variant in codecs.VARIANTS.items():
        variant.codec.check()
        variant.phone.check()
        assert variant.codec.on or variant.phone.processes or name == "lossless"


@pytest.mark.slow
def test_one_film_is_read_through_codecs_and_phones() -> None:
    """A codec's lane sees what a film through the codec alone shows."""
    config = DeliveryConfig(kappa=5, n_bytes=20)
    take = Take(config, "canon-lg", 0.0, 0, PRETRAINED / "decoder.onnx")
    found = codecs.read_variants(VariantsTake(take, ("lossless", "h264-8000", "phone")))
    for name, run in found.items():
        kbits = run.pop("kbits")
        assert (kbits is None) == (name == "lossless")
        assert kbits is None or kbits == pytest.approx(8000, rel=0.3)
        assert run["delivered"] and not run["wrong"], name
        assert run["frames_with_display"] > 0.9 * run["frames"]
    alone = delivery.deliver(take)
    coded = delivery.deliver(replace(take, config=replace(config, codec=CodecSettings("h264"))))
    for name, other in (("lossless", alone), ("h264-8000", coded)):
        del found[name]["receiver_fps"], other["receiver_fps"]
        assert found[name] == other
