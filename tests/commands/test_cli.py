"""Commands as a user runs them: good input gives results, bad input gives one line."""

import json
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ROOT, Command, Finished, MakeOnce, slow

import data_gen.__main__ as data_gen_cli
import evaluate
import export.parity as parity_cli
import export.runtime as runtime_cli
import export.to_onnx as to_onnx_cli
import train
from data_gen.pairs import PAIRS
from export.runtime import Decoder
from link.captures import MANIFEST, load_capture, read_manifest
from link.frames import Captured
from link.images import write_image
from models import DECODERS, PRETRAINED


def shell(*arguments: object) -> Finished:
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return Finished(done.returncode, done.stdout, done.stderr)


def refused(finished: Finished, *parts: str) -> None:
    """Exactly one line, "error: ...", that holds the parts; status 2; nothing on stdout."""
    lines = finished.stderr.splitlines()
    assert finished.status == 2
    assert len(lines) == 1, finished.stderr
    assert lines[0].startswith("error: ")
    for part in parts:
        assert part in lines[0]
    assert finished.stdout == ""


def refused_late(finished: Finished, *parts: str) -> None:
    """As `refused`, but a progress bar may stand before the line."""
    refused(Finished(finished.status, "", finished.stderr.splitlines()[-1]), *parts)
    assert "Traceback" not in finished.stderr


@pytest.fixture(scope="module")
def images(captured: Captured, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A captured pair (o.png, e.png), the same rectified (ro.png, re.png), and bad files."""
    folder = tmp_path_factory.mktemp("images")
    pair = captured.rectified()
    write_image(folder / "o.png", captured.original)
    write_image(folder / "e.png", captured.embedded)
    write_image(folder / "ro.png", pair.original)
    write_image(folder / "re.png", pair.embedded)
    write_image(folder / "one.png", np.zeros((1, 1, 3), np.uint8))
    write_image(folder / "narrow.png", captured.embedded[:, :-100])
    (folder / "text.png").write_text("this is not an image\n")
    (folder / "empty.png").write_bytes(b"")
    return folder


@pytest.fixture(scope="module")
def captures(make_once: MakeOnce) -> Path:
    """Two frame pairs that `python -m data_gen` wrote, sony-lg, 20 degrees."""

    def fill(folder: Path) -> None:
        flags = ["--frames", "2", "--pair", "sony-lg", "--view", "20", "--out", str(folder)]
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
            patch.setattr("sys.argv", ["data_gen", *flags])
            data_gen_cli.main()
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
    assert (done.status, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    pair = captured.rectified()
    expected = Decoder(model).decode(pair.original, pair.embedded)
    assert result["bits"] == expected.bits.tolist()
    assert result["layout"] == captured.layout.to_dict()
    np.testing.assert_allclose(result["scores"], expected.scores, atol=1e-4)  # four decimals


def test_runtime_decodes_captured_images_with_corners(images: Path, captured: Captured) -> None:
    files = PRETRAINED / "decoder.onnx", images / "o.png", images / "e.png"
    done = shell("-m", "export.runtime", *files, "--corners", *points(captured.corners))
    assert (done.status, done.stderr) == (0, "")
    assert captured.bits is not None
    assert np.mean(np.array(json.loads(done.stdout)["bits"]) == captured.bits) > 0.8


def test_the_corners_of_the_embedded_image_count(
    images: Path, captured: Captured, command: Command
) -> None:
    files = PRETRAINED / "decoder.onnx", images / "o.png", images / "e.png"
    corners = points(captured.corners)
    moved = points(captured.corners + np.array([9.0, 5.0]))
    scores = [
        json.loads(command(runtime_cli.main, *files, "--corners", *corners, *more).stdout)["scores"]
        for more in ((), ("--corners-embedded", *corners), ("--corners-embedded", *moved))
    ]
    assert scores[0] == scores[1] != scores[2]


def test_corners_at_the_edge_of_the_image_can_be_given(images: Path, command: Command) -> None:
    files = PRETRAINED / "decoder.onnx", images / "ro.png", images / "re.png"
    whole = ("-0.5,-0.5", "511.5,-0.5", "511.5,383.5", "-0.5,383.5")
    done = command(runtime_cli.main, *files, "--corners", *whole)
    assert (done.status, done.stderr) == (0, "")


def test_corners_that_show_no_ratex_are_refused(
    images: Path, command: Command, captured: Captured
) -> None:
    files = PRETRAINED / "decoder.onnx", images / "o.png", images / "e.png"
    refused(command(runtime_cli.main, *files), "no ratex patches")
    turned = points(np.roll(captured.corners, 2, axis=0))
    refused(command(runtime_cli.main, *files, "--corners", *turned), "no ratex patches")


def test_corners_of_the_embedded_image_alone_are_refused(
    images: Path, captured: Captured, command: Command
) -> None:
    files = PRETRAINED / "decoder.onnx", images / "o.png", images / "e.png"
    corners = points(captured.corners)
    refused(command(runtime_cli.main, *files, "--corners-embedded", *corners), "--corners")


@pytest.mark.parametrize(
    ("original", "embedded", "parts"),
    [
        ("none.png", "e.png", ["none.png: no such image file"]),
        ("o.png", "none.png", ["none.png: no such image file"]),
        ("text.png", "e.png", ["text.png: not a readable image"]),
        ("o.png", "empty.png", ["empty.png: not a readable image"]),
        ("one.png", "one.png", ["one.png: image is 1x1"]),
        ("o.png", "narrow.png", ["original is 768x576 and embedded is 668x576"]),
    ],
)
def test_runtime_refuses_bad_images(
    original: str,
    embedded: str,
    parts: list[str],
    images: Path,
    command: Command,
) -> None:
    files = PRETRAINED / "decoder.onnx", images / original, images / embedded
    refused(command(runtime_cli.main, *files), *parts)


@pytest.mark.parametrize(
    ("corners", "part"),
    [
        ("10,10 900,10 700,500 10,500", "(900, 10) lies outside the 768x576 image"),
        ("10,10 700,10 700,500 10,5e9", "lies outside the 768x576 image"),
        ("10,10 700,10 700,500 10", "--corners: need four points x,y"),
        ("10,10 700,10 700,500 10,a", "--corners: need four points x,y"),
        ("10,10 700,10 700,500 10,20,30", "--corners: need four points x,y"),
        ("10,10 700,10 700,500 10,nan", "four finite points"),
        ("10,10 10,500 700,500 700,10", "not a convex quadrilateral"),
    ],
)
def test_runtime_refuses_bad_corners(
    corners: str, part: str, images: Path, command: Command
) -> None:
    files = PRETRAINED / "decoder.onnx", images / "o.png", images / "e.png"
    refused(command(runtime_cli.main, *files, "--corners", *corners.split()), part)


def test_runtime_refuses_a_truncated_model(images: Path, tmp_path: Path, command: Command) -> None:
    whole = (PRETRAINED / "decoder.onnx").read_bytes()
    (tmp_path / "cut.onnx").write_bytes(whole[: len(whole) // 3])
    files = tmp_path / "cut.onnx", images / "o.png", images / "e.png"
    refused(command(runtime_cli.main, *files), "cut.onnx: not a readable ONNX model")


# python -m data_gen, then evaluate.py --captures


@pytest.mark.slow
def test_data_gen_writes_captures_with_a_manifest(captures: Path) -> None:
    entries = read_manifest(captures)
    assert len(entries) == 2
    for number, entry in enumerate(entries):
        assert entry["original"] == f"{number:05d}_original.png"
        assert (entry["pair"], entry["view_deg"], entry["kappa"]) == ("sony-lg", 20.0, 5)
        assert entry["simulated"] is True
        loaded = load_capture(captures, entry)  # checks the sha256
        assert loaded.bits is not None
        assert loaded.bits.shape == (loaded.layout.n_bits,)
    assert len(list(captures.iterdir())) == 5  # nothing left over


@pytest.mark.slow
def test_evaluate_decodes_captures_with_every_method(
    captures: Path, tmp_path: Path, command: Command
) -> None:
    out, shown = tmp_path / "out", tmp_path / "shown"
    done = command(
        evaluate.main, "--captures", captures, "--run", PRETRAINED, "--out", out, "--show", shown
    )
    assert done.status == 0, done.stderr
    rows = json.loads((out / "metrics.json").read_text())["rows"]
    assert [row["method"] for row in rows] == list(DECODERS)
    for row in rows:
        assert (row["pair"], row["view_deg"], row["kappa"]) == ("sony-lg", 20.0, 5)
        assert (row["frames"], row["bits"]) == (2, 118)
    accuracy = {row["method"]: row["accuracy"] for row in rows}
    assert min(accuracy["oorc"], accuracy["phi"], accuracy["learned"]) > 0.85
    assert "learned" in done.stdout
    names = {f"{number:05d}_{method}.png" for number in (0, 1) for method in DECODERS}
    assert {file.name for file in shown.iterdir()} == names


@pytest.mark.slow
def test_evaluate_says_which_methods_hidden_captures_leave_out(
    tmp_path: Path, command: Command
) -> None:
    folder, out = tmp_path / "captures", tmp_path / "out"
    assert command(data_gen_cli.main, "--out", folder, "--frames", 1, "--hidden").status == 0
    methods = ("--methods", "oorc", "hidden_ratex")
    done = command(evaluate.main, "--captures", folder, "--out", out, *methods)
    assert done.status == 0, done.stderr
    assert "oorc: left out of 1 of 1, it trains on ratex patches" in done.stdout
    rows = json.loads((out / "metrics.json").read_text())["rows"]
    assert [row["method"] for row in rows] == ["hidden_ratex"]
    alone = ("--captures", folder, "--out", tmp_path / "none", "--methods", "oorc")
    refused_late(command(evaluate.main, *alone), f"{folder}: no method fits")


def test_data_gen_does_not_write_into_other_captures(captures: Path, command: Command) -> None:
    before = (captures / MANIFEST).read_bytes()
    done = command(data_gen_cli.main, "--out", captures, "--frames", 1)
    refused(done, "--out", "already holds captures")
    assert (captures / MANIFEST).read_bytes() == before


# Bad flags


@pytest.mark.parametrize("script", [train, data_gen_cli], ids=["train", "data_gen"])
def test_a_wrong_pair_is_refused_with_the_valid_names(
    script: object, tmp_path: Path, command: Command
) -> None:
    done = command(script.main, "--pair", "canon-dell", "--out", tmp_path)  # type: ignore[attr-defined]
    refused(done, "'canon-dell'", *PAIRS)


def test_evaluate_refuses_a_wrong_pair_with_the_valid_names(
    tmp_path: Path, command: Command
) -> None:
    refused(command(evaluate.main, "--pairs", "canon-dell", "--out", tmp_path), *PAIRS)


@pytest.mark.parametrize(
    "arguments",
    [
        slow(("train.py", "--pair", "canon-dell")),
        ("-m", "data_gen", "--out", "/nowhere/at/all", "--frames", "0"),
    ],
)
def test_a_refusal_in_a_process_of_its_own(arguments: tuple[str, ...]) -> None:
    refused(shell(*arguments))


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("--kappa 0", "--kappa: need 1 to 64"),
        ("--kappa 65", "--kappa: need 1 to 64"),
        ("--frames 0", "--frames: need at least 1"),
        ("--view 89", "--view: need an angle within ±75 degrees"),
        ("--view -89", "--view: need an angle within ±75 degrees"),
        ("--ratex 4", "--ratex: choose"),
        ("--rows 0", "--rows: need at least 1, got 0"),
        ("--without rain", "effect 'rain'; choose one of: perspective"),
        ("--set jpeg_quality=200", "jpeg_quality must lie in [0, 100]"),
        ("--set blur_px=true", "blur_px: need a number, such as"),
        ("--set bayer=2", "bayer: need true or false, such as"),
        ("--set gamma=[true,2,2]", "gamma must be 3 numbers"),
        ("--width 20", "need a frame of at least"),
    ],
)
def test_data_gen_refuses_bad_flags(
    arguments: str, part: str, tmp_path: Path, command: Command
) -> None:
    done = command(data_gen_cli.main, "--out", tmp_path / "out", *arguments.split())
    refused(done, part)
    assert not (tmp_path / "out" / MANIFEST).exists()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("--split dev", "train, test"),
        ("--pyramid-level 9", "--pyramid-level"),
        ("--pictures nowhere", "nowhere: no such folder"),
        ("--seed -1", "--seed"),
    ],
)
def test_data_gen_refuses_what_it_finds_on_the_way(
    arguments: str, part: str, tmp_path: Path, command: Command
) -> None:
    done = command(data_gen_cli.main, "--out", tmp_path / "out", *arguments.split())
    refused_late(done, part)
    assert not (tmp_path / "out" / MANIFEST).exists()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("--methods oorc magic", "naive, two_step, oorc, hidden_ratex, blind, phi, learned, cnn"),
        ("--kappas 5 0", "--kappas: need 1 to 64"),
        ("--frames 0", "--frames: need at least 1"),
        ("--jobs 0", "--jobs: need at least 1"),
        ("--views 0 89", "--view"),
        ("--views 45 45", "--views: name at least one, and none twice"),
        ("--ratex 4", "--ratex"),
        ("--captures nowhere", "manifest.jsonl"),
        ("--protocol papr", "protocol 'papr'; choose one of: fair, paper"),
        ("--without rain", "effect 'rain'; choose one of: perspective"),
        ("--set drift", "--set: need name=value"),
        ("--set wind=1", "unknown parameter 'wind'"),
        ("--set drift=2", "drift must lie in [0, 0.5]"),
    ],
)
def test_evaluate_refuses_bad_flags(
    arguments: str, part: str, tmp_path: Path, command: Command
) -> None:
    small = ("--pairs", "canon-lg") if "--captures" not in arguments else ()
    jobs = ("--jobs", 1) if "--jobs" not in arguments else ()
    frames = ("--frames", 1) if "--frames" not in arguments else ()
    done = command(evaluate.main, "--out", tmp_path, *small, *jobs, *frames, *arguments.split())
    refused(done, part)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("--run nowhere", "nowhere"),
        ("--pictures nowhere", "nowhere: no such folder"),
        ("--seed -1", "--seed"),
    ],
)
def test_evaluate_refuses_what_it_finds_on_the_way(
    arguments: str, part: str, tmp_path: Path, command: Command
) -> None:
    small = ("--pairs", "canon-lg", "--frames", 1, "--jobs", 1)
    done = command(evaluate.main, "--out", tmp_path, *small, *arguments.split())
    refused_late(done, part)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("--frames 0", "--frames"),
        ("--episodes 0", "--episodes"),
        ("--kappas 0 65", "--kappa"),
        ("--max-view 400", "--max-view"),
        ("--seed -1", "--seed"),
    ],
)
def test_train_refuses_bad_flags(
    arguments: str, part: str, tmp_path: Path, command: Command
) -> None:
    small = ("--episodes", 6, "--rounds", 1, "--steps", 1, "--jobs", 1)
    done = command(train.main, "--out", tmp_path, *small, *arguments.split())
    refused_late(done, part)


@pytest.mark.parametrize("script", [to_onnx_cli, parity_cli], ids=["to_onnx", "parity"])
def test_export_refuses_a_folder_without_a_checkpoint(
    script: object, tmp_path: Path, command: Command
) -> None:
    done = command(script.main, tmp_path)  # type: ignore[attr-defined]
    refused(done, "config.json: not found; train first")


# Bad captures and folders


def test_evaluate_refuses_a_folder_without_a_manifest(tmp_path: Path, command: Command) -> None:
    done = command(evaluate.main, "--captures", tmp_path, "--out", tmp_path / "out")
    refused(done, "manifest.jsonl: not found")


@pytest.mark.parametrize("line", ["5", "null", "[[1]]", '"text"', "{}", "{", ""])
def test_evaluate_refuses_a_manifest_that_lists_no_frame_pair(
    line: str, tmp_path: Path, command: Command
) -> None:
    (tmp_path / MANIFEST).write_text(line + "\n")
    done = command(
        evaluate.main, "--captures", tmp_path, "--out", tmp_path / "out", "--methods", "naive"
    )
    refused(done, MANIFEST)


def changed(captures: Path, folder: Path, **changes: object) -> Path:
    """A copy of the captures whose first entry has other fields."""
    for file in captures.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    entries = [{**entry, **changes} for entry in read_manifest(captures)]
    (folder / MANIFEST).write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    return folder


LAYOUT = {"rows": 8, "cols": 8, "width": 512, "height": 384}


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"original": "none.png"}, "none.png: no such image file"),
        ({"original": "00000_embedded.png"}, "differs from the manifest's sha256"),
        ({"corners": [[0, 0], [1, 1]]}, "corners: need four"),
        ({"corners": "here"}, "corners: need four"),
        ({"bits": [2] * 59}, "bits: need a list of 0, 1 or null"),
        ({"bits": [1] * 58}, "the layout carries 59, the manifest lists 58"),
        ({"kappa": 0}, "kappa must be a whole number from 1 to 64"),
        ({"layout": {"rows": 8}}, "layout: need the keys"),
        ({"layout": {**LAYOUT, "ratex": [[float("inf"), 0]]}}, "line 1, layout.ratex"),
    ],
)
def test_evaluate_refuses_captures_with_a_wrong_field(
    changes: dict[str, object], part: str, captures: Path, tmp_path: Path, command: Command
) -> None:
    folder = changed(captures, tmp_path, **changes)
    done = command(
        evaluate.main, "--captures", folder, "--out", tmp_path / "out", "--methods", "naive"
    )
    refused_late(done, part)


def test_evaluate_refuses_a_folder_with_another_run(tmp_path: Path, command: Command) -> None:
    small = ("--pairs", "canon-lg", "--views", 0, "--kappas", 5, "--methods", "naive", "--jobs", 1)
    small += ("--no-html",)
    assert command(evaluate.main, "--out", tmp_path, *small, "--frames", 1).status == 0
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    done = command(evaluate.main, "--out", tmp_path, *small, "--frames", 2)
    refused(done, "--out", "holds a run with other settings")
    after = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    assert before == after


def test_a_refused_run_does_not_occupy_its_folder(
    captures: Path, tmp_path: Path, command: Command
) -> None:
    wrong = command(evaluate.main, "--captures", tmp_path / "typo", "--out", tmp_path / "out")
    assert wrong.status == 2
    flags = ("--methods", "naive", "--no-html")
    done = command(evaluate.main, "--captures", captures, "--out", tmp_path / "out", *flags)
    assert done.status == 0, done.stderr


def test_an_out_that_is_a_file_is_refused(tmp_path: Path, command: Command) -> None:
    (tmp_path / "file").write_text("mine")
    refused_late(command(data_gen_cli.main, "--out", tmp_path / "file", "--frames", 1), "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_gray_png_is_read_as_rgb(images: Path, tmp_path: Path, command: Command) -> None:
    for name in ("ro.png", "re.png"):
        gray = cv2.imread(str(images / name), cv2.IMREAD_GRAYSCALE)
        assert cv2.imwrite(str(tmp_path / name), gray)
    files = PRETRAINED / "decoder.onnx", tmp_path / "ro.png", tmp_path / "re.png"
    done = command(runtime_cli.main, *files)
    assert (done.status, done.stderr) == (0, "")
