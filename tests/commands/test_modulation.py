"""Antipodal blocks and pilots through the commands: what is written, decoded, left out, refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from conftest import Command, Refuses, cases

import data_gen.__main__ as data_gen_cli
import data_gen.video as video_cli
import evaluate
import export.runtime as runtime_cli
import export.to_onnx as to_onnx_cli
import receiver.__main__ as receive_cli
from data_gen.flags import LayoutFlags
from data_gen.frame_pair import Cell, Source
from export.parity import Parity
from export.runtime import Decoder
from link.captures import read_manifest
from link.embed import embed
from link.errors import InputError
from link.images import write_image
from link.layout import Layout, make_layout
from models import PRETRAINED, PRETRAINED_PILOTS
from models.phi.decoder import PhiDecoder
from reports.engine.backends import Backend
from reports.engine.digest import file_digest
from reports.engine.methods import Method
from reports.engine.predict import Condition, predict
from reports.engine.records import read_predictions
from reports.evaluation.settings import decisive_settings

FINE = ("--rows", 12, "--cols", 16, "--modulation", "antipodal", "--pilots", "auto")
FINE_LAYOUT = make_layout(12, 16, modulation="antipodal", pilots=32)
TINY = ["--pairs", "canon-lg", "--views", 0, "--kappas", 5, "--frames", 1, "--jobs", 1]


@pytest.fixture(scope="module")
def pilots_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped model, with metadata that claims pilots in place of its ratex patches."""
    proto = onnx.load(PRETRAINED / "decoder.onnx")
    layout = make_layout(modulation="antipodal", pilots=5)
    for entry in proto.metadata_props:
        if entry.key == "layout":
            entry.value = json.dumps(layout.to_dict())
    file = tmp_path_factory.mktemp("model") / "pilots.onnx"
    onnx.save(proto, file)
    return file


# Sender, simulator and film


WITH_LAYOUT = {
    "sender.__main__": "picture.png --message hi --preset paper",
    "data_gen.__main__": "",
    "data_gen.video": "--message hi",
    "evaluate": "",
}
"""Commands that take a layout, and their first words."""


@cases(
    ("--pilots many", "--pilots: need auto, or a share from 0 to below 1, got 'many'"),
    ("--pilots 0.01", "--pilots: 0.01 of 8x8 blocks is less than 2 pilots"),
    ("--pilots auto --ratex 5", "layout: has pilots beside ratex patches"),
    ("--modulation polar", "modulation"),
)
@pytest.mark.parametrize("module", WITH_LAYOUT)
def test_wrong_layouts_end_in_one_line(
    flags: str, says: str, module: str, tmp_path: Path, refuses: Refuses
) -> None:
    write_image(tmp_path / "picture.png", np.zeros((96, 128, 3), np.uint8))
    refuses(module, f"{WITH_LAYOUT[module]} {flags} --out out", says)


def test_simulated_captures_carry_the_layout(tmp_path: Path, command: Command) -> None:
    done = command(data_gen_cli.main, *FINE, "--frames", 1, "--out", tmp_path / "out")
    (entry,) = read_manifest(tmp_path / "out")
    assert entry.load().layout == FINE_LAYOUT
    done = command(evaluate.main, "--captures", tmp_path / "out", "--out", tmp_path / "run",
                   "--methods", "oorc", "two_step", "naive", "--no-html", "--jobs", 1)  # fmt: skip
    assert "two_step: left out of 1 of 1, it trains on ratex patches" in done.stdout
    assert "| oorc |" in done.stdout


@pytest.mark.slow
def test_each_capture_is_decoded_by_the_checkpoint_for_its_layout(
    tmp_path: Path, command: Command
) -> None:
    """Frame pairs with patches, frame pairs with pilots, and a set that joins both."""
    lines = []
    for name, flags in (("patches", ()), ("pilots", FINE)):
        folder = tmp_path / "both" / name
        done = command(data_gen_cli.main, *flags, "--frames", 1, "--kappa", 5, "--out", folder)
        entry = json.loads((folder / "manifest.jsonl").read_text())
        entry |= {key: f"{name}/{entry[key]}" for key in ("original", "embedded")}
        lines.append(json.dumps(entry))
    (tmp_path / "both" / "manifest.jsonl").write_text("\n".join(lines))
    for folder, pairs in (("both/patches", 1), ("both/pilots", 1), ("both", 2)):
        out = tmp_path / f"of {pairs} {folder.replace('/', ' ')}"
        done = command(evaluate.main, "--captures", tmp_path / folder, "--out", out,
                       "--methods", "learned", "oorc", "--no-html", "--jobs", 1)  # fmt: skip
        assert "left out" not in done.stdout
        records = read_predictions(out / "predictions.jsonl")
        assert (records["method"] == "learned").sum() == pairs
    digests = json.loads((out / "config.json").read_text())["checkpoints"]
    assert digests["learned"] == file_digest(
        [folder / name for folder in (PRETRAINED, PRETRAINED_PILOTS)
         for name in ("config.json", "decoder.pt")]
    )  # fmt: skip


@pytest.fixture
def exported(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Layout, Path, str]]:
    """Layout, file and name of the run of each export, none of which is carried out."""
    done: list[tuple[Layout, Path, str]] = []

    def record(module: PhiDecoder, path: Path, run_name: str, *_: object) -> Parity:
        done.append((module.layout, path, run_name))
        return Parity(1, 1, 0, 0.0, 1.0, 1.0)

    monkeypatch.setattr(to_onnx_cli, "export", record)
    return done


def test_the_layout_chooses_the_checkpoint_that_is_exported(
    exported: list[tuple[Layout, Path, str]], tmp_path: Path, command: Command, refuses: Refuses
) -> None:
    layouts = {"patches": make_layout(6, 6), "pilots": FINE_LAYOUT}
    for name, layout in layouts.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(layout.to_dict()))
    out = ("--out", tmp_path / "mine.onnx")
    for words in (("--layout", tmp_path / f"{name}.json") for name in layouts):
        command(to_onnx_cli.main, *words, *out)
    assert exported == [
        (layouts["patches"], out[1], "ratex"),
        (layouts["pilots"], out[1], "pilots"),
    ]
    words = [PRETRAINED, "--layout", tmp_path / "pilots.json", *out]
    says = f"not with pilots; take {PRETRAINED_PILOTS} or a run that was"
    refuses("export.to_onnx", words, says)


@pytest.mark.parametrize("run", [(), (PRETRAINED,), (PRETRAINED_PILOTS / ".." / "ratex",)])
def test_an_export_leaves_what_ships_as_it_is(
    run: tuple[Path, ...], exported: list[tuple[Layout, Path, str]], refuses: Refuses
) -> None:
    refuses("export.to_onnx", run, "error: --out: ", "name the new .onnx file")
    assert exported == []


def test_the_name_of_a_preset_stands_for_the_decoder_that_ships(
    tmp_path: Path, refuses: Refuses
) -> None:
    write_image(tmp_path / "gray.png", np.full((384, 512, 3), 99, np.uint8))
    for preset, known in (("paper", "ratex patches"), ("robust", "pilots")):
        refuses("export.runtime", f"{preset} gray.png gray.png", f"no {known} where the corners")


def test_captures_have_layouts_of_their_own(refuses: Refuses) -> None:
    said = "error: --captures: has layouts of its own"
    refuses("evaluate", "--captures . --rows 12 --out run", said)


@pytest.mark.slow
def test_a_film_with_pilots_is_made_and_the_receiver_says_what_it_saw(
    pilots_model: Path, tmp_path: Path, command: Command
) -> None:
    film = tmp_path / "film.mkv"
    flags = ("--message", "hi", "--seconds", 0.1, "--size", 320, 180)
    done = command(video_cli.main, *FINE, *flags, "--out", film)
    assert Layout.from_dict(json.loads(done.stdout)["layout"]) == FINE_LAYOUT
    done = command(receive_cli.main, film, "--model", pilots_model, status=2)
    assert json.loads(done.stdout)["frames_with_display"] == 0  # too few to find a display in
    assert done.stderr.count("\n") == 1


def test_the_runtime_says_where_no_pilots_are_seen(
    pilots_model: Path, tmp_path: Path, command: Command, refuses: Refuses
) -> None:
    layout = Decoder(pilots_model).layout
    noise = np.random.default_rng(0).integers(0, 256, (384, 512, 3), np.uint8)
    shown = embed(np.full_like(noise, 99), np.arange(layout.n_bits) % 2, layout, kappa=5)
    for name, image in (("noise", noise), ("a", shown.original), ("b", shown.embedded)):
        write_image(tmp_path / f"{name}.png", image)
    says = "no pilots where the corners and the model's layout put them"
    refuses("export.runtime", [pilots_model, "noise.png", "noise.png"], says)
    done = command(runtime_cli.main, pilots_model, tmp_path / "a.png", tmp_path / "b.png")
    assert done.stderr == ""
    assert len(json.loads(done.stdout)["bits"]) == layout.n_bits


# The comparison


@pytest.mark.slow
def test_the_comparison_leaves_out_what_does_not_suit(tmp_path: Path, command: Command) -> None:
    out = tmp_path / "run"
    done = command(
        evaluate.main, *TINY, *FINE, "--methods", "two_step", "oorc", "hidden_ratex", "--out", out
    )
    assert (
        "two_step: left out of 1 of 1, it trains on ratex patches and the layout has none"
        in done.stdout
    )
    lines = [json.loads(line) for line in (out / "predictions.jsonl").read_text().splitlines()]
    assert {line["method"]: len(line["bits"]) for line in lines} == {
        "oorc": 12 * 16 - 32,
        "hidden_ratex": 12 * 16 - 32,
    }
    settings = json.loads((out / "config.json").read_text())
    chosen = {key: settings.get(key) for key in ("rows", "cols", "modulation", "pilots", "ratex")}
    expected = {"rows": 12, "cols": 16, "modulation": "antipodal", "pilots": 32, "ratex": 0}
    assert chosen == expected
    page = (out / "report.html").read_text()
    assert "two_step: left out" in page
    assert "modulation: antipodal" in page
    command(evaluate.main, "--report", out)


def test_settings_say_the_layout_and_not_how_it_was_asked_for() -> None:
    assert decisive_settings(evaluate.EvaluateConfig(ratex=3), [], [])["ratex"] == 3
    same = [decisive_settings(evaluate.EvaluateConfig(pilots=p), [], []) for p in ("auto", "0.25")]
    assert same[0] == same[1]
    assert (same[0]["pilots"], same[0]["ratex"]) == (16, 0)


@pytest.mark.slow
def test_methods_that_train_on_what_the_layout_lacks_are_left_out(tmp_path: Path) -> None:
    cells, file = (Cell("canon-lg", 0.0, 5),), tmp_path / "predictions.jsonl"
    bare = Condition("bare", Source(replace(FINE_LAYOUT, pilots=0)), cells, 1)
    methods = [Method(name) for name in ("naive", "two_step", "oorc", "phi", "learned", "blind")]
    predicted = predict([bare], methods, file, Backend())
    assert predicted.records["method"].tolist() == ["blind"]
    reason = "left out of 1 of 1, it trains on ratex patches"
    assert len(predicted.left_out) == 5
    for method, line in zip(methods[:5], predicted.left_out, strict=True):
        assert line.startswith(f"bare: {method.label}: {reason}")
    with pytest.raises(InputError, match="no method suits what is decoded; bare: naive: left out"):
        predict([bare], methods[:1], tmp_path / "none.jsonl", Backend())


def test_flags_make_every_layout_of_the_contract() -> None:
    flags = LayoutFlags(rows=96, cols=128, modulation="antipodal", pilots="0.05")
    assert flags.layout() == make_layout(96, 128, modulation="antipodal", pilots=614)
    assert LayoutFlags().layout() == make_layout()
    wide = LayoutFlags(rows=27, cols=48, width=960, height=540, pilots="auto")
    assert wide.layout().n_bits == 27 * 48 - 65
