"""Commands as a user runs them: good input gives results. What is refused is in test_refusals."""

import json
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from conftest import Command, MakeOnce, Refuses, run_main, run_process

import data_gen.__main__ as data_gen_cli
import evaluate
import export.runtime as runtime_cli
from export.runtime import Decoder
from link.frames import Captured
from link.images import write_image
from models import OF_PAIRS, PRETRAINED

FILES = [PRETRAINED / "decoder.onnx", "o.png", "e.png"]
"""A decoder and a frame pair of the fixture `images`."""


@pytest.fixture(scope="module")
def images(captured: Captured, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A captured pair (o.png, e.png), and the same rectified (ro.png, re.png)."""
    folder = tmp_path_factory.mktemp("images")
    pair = captured.rectified()
    write_image(folder / "o.png", captured.original)
    write_image(folder / "e.png", captured.embedded)
    write_image(folder / "ro.png", pair.original)
    write_image(folder / "re.png", pair.embedded)
    return folder


@pytest.fixture
def in_images(images: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(images)


@pytest.fixture(scope="module")
def captures(make_once: MakeOnce) -> Path:
    """Two frame pairs that `python -m data_gen` wrote, sony-lg, 20 degrees."""

    def fill(folder: Path) -> None:
        flags = ("--frames", 2, "--pair", "sony-lg", "--view", 20, "--out", folder)
        with redirect_stdout(StringIO()) as printed:
            run_main(data_gen_cli.main, *flags)
        report = json.loads(printed.getvalue())
        assert report["frame_pairs"] == 2
        assert report["simulated"] is True
        assert 30 < report["psnr_db"] < 50
        assert 0.9 < report["ssim"] < 1

    return make_once("sony-lg", fill)


def points(corners: np.ndarray) -> list[str]:
    return [f"{x},{y}" for x, y in corners]


# python -m export.runtime


def test_runtime_prints_bits_and_scores_of_rectified_images(
    images: Path, captured: Captured, command: Command
) -> None:
    model = PRETRAINED / "decoder.onnx"
    done = command(runtime_cli.main, model, images / "ro.png", images / "re.png")
    assert done.stderr == ""
    result = json.loads(done.stdout)
    pair = captured.rectified()
    expected = Decoder(model).decode(pair.original, pair.embedded)
    assert result["bits"] == expected.bits.tolist()
    assert result["layout"] == captured.layout.to_dict()
    np.testing.assert_allclose(result["scores"], expected.scores, atol=1e-4)  # four decimals


def test_runtime_decodes_captured_images_with_corners(images: Path, captured: Captured) -> None:
    """In a process of its own."""
    line = [sys.executable, "-m", "export.runtime", FILES[0], images / "o.png", images / "e.png"]
    line += ["--corners", *points(captured.corners)]
    done = run_process(*line)
    assert done.stderr == ""
    assert np.mean(np.array(json.loads(done.stdout)["bits"]) == captured.bits) > 0.8


@pytest.mark.slow
def test_the_corners_of_the_embedded_image_count(
    in_images: None, captured: Captured, command: Command
) -> None:
    corners = points(captured.corners)
    moved = points(captured.corners + np.array([9.0, 5.0]))
    scores = [
        json.loads(command(runtime_cli.main, *FILES, "--corners", *corners, *more).stdout)["scores"]
        for more in ((), ("--corners-embedded", *corners), ("--corners-embedded", *moved))
    ]
    assert scores[0] == scores[1] != scores[2]


def test_corners_at_the_edge_of_the_image_can_be_given(in_images: None, command: Command) -> None:
    whole = ("-0.5,-0.5", "511.5,-0.5", "511.5,383.5", "-0.5,383.5")
    done = command(runtime_cli.main, FILES[0], "ro.png", "re.png", "--corners", *whole)
    assert done.stderr == ""


def test_corners_that_do_not_fit_are_refused(
    images: Path, captured: Captured, refuses: Refuses
) -> None:
    turned = points(np.roll(captured.corners, 2, axis=0))
    refuses("export.runtime", [*FILES, "--corners", *turned], "no ratex patches", folder=images)
    alone = ["--corners-embedded", *points(captured.corners)]
    refuses("export.runtime", [*FILES, *alone], "--corners", folder=images)


# python -m data_gen, then evaluate.py --captures


@pytest.mark.slow
def test_evaluate_decodes_captures_with_every_method(
    captures: Path, tmp_path: Path, command: Command
) -> None:
    out, shown = tmp_path / "out", tmp_path / "shown"
    run = ("--captures", captures, "--run", PRETRAINED, "--no-html", "--jobs", 1)
    done = command(evaluate.main, *run, "--out", out, "--show", shown)
    rows = json.loads((out / "metrics.json").read_text())["rows"]
    assert sorted(row["method"] for row in rows) == sorted(OF_PAIRS)
    for row in rows:
        assert (row["pair"], row["view_deg"], row["kappa"]) == ("sony-lg", 20.0, 5)
        assert (row["frames"], row["bits"]) == (2, 118)
    accuracy = {row["method"]: row["accuracy"] for row in rows}
    assert min(accuracy["oorc"], accuracy["phi"], accuracy["learned"]) > 0.85
    assert "learned" in done.stdout
    names = {f"{number:05d}_{method}.png" for number in (0, 1) for method in OF_PAIRS}
    assert {file.name for file in shown.iterdir()} == names


@pytest.mark.slow
def test_evaluate_says_which_methods_hidden_captures_leave_out(
    tmp_path: Path, command: Command
) -> None:
    folder, out = tmp_path / "captures", tmp_path / "out"
    command(data_gen_cli.main, "--out", folder, "--frames", 1, "--hidden")
    methods = ("--methods", "oorc", "hidden_ratex", "--jobs", 1)
    done = command(evaluate.main, "--captures", folder, "--out", out, *methods)
    assert "oorc: left out of 1 of 1, it trains on ratex patches" in done.stdout
    rows = json.loads((out / "metrics.json").read_text())["rows"]
    assert [row["method"] for row in rows] == ["hidden_ratex"]


def test_data_gen_does_not_write_into_other_captures(captures: Path, refuses: Refuses) -> None:
    words = ["--out", captures, "--frames", 1]
    refuses("data_gen.__main__", words, "--out", "already holds captures", folder=captures)


# Bad captures and folders


def test_a_refused_run_does_not_occupy_its_folder(
    captures: Path, tmp_path: Path, command: Command
) -> None:
    command(evaluate.main, "--captures", tmp_path / "typo", "--out", tmp_path / "out", status=2)
    flags = ("--methods", "naive", "--no-html", "--jobs", 1)
    command(evaluate.main, "--captures", captures, "--out", tmp_path / "out", *flags)
