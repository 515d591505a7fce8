"""Stored runs, photographs and settings from strangers: a right result or one line."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import cases, refusal
from runs import write_run

from data_gen.effects import parse_settings
from export.onnx_file import MAX_FIELDS, MAX_NODES
from export.runtime import MAX_MEMORY_BYTES, MAX_MODEL_BYTES, TIME_LIMIT_S
from export.watchdog import GRACE_S
from link import cli, images, layout, outside
from link.errors import InputError, ParameterError
from link.images import files, write_bytes
from link.images.files import read_image
from link.images.video import VideoReader
from link.layout import make_layout
from link.modules import ROOT
from link.outside import inside, parse_json, read_bounded, read_json
from models.phi.checkpoint import MAX_STATE_BYTES, MAX_WEIGHTS_BYTES
from receiver.locate.find import locate
from reports.captured.sent import read_settings
from reports.run import RunFolder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A small finished run with one picture."""
    write_run(tmp_path / "run")
    return tmp_path / "run"


def refused(folder: Path) -> str:
    said = refusal(RunFolder(folder).read)
    assert str(folder) in said
    return said


def test_a_whole_run_is_read(run: Path) -> None:
    read = RunFolder(run).read()
    assert len(read.records) == 15
    assert read.stories[0].pictures == [("stories/a.jpg", "caption")]


@cases(
    ("run.json", "[" * 10**5, "32 deep"),
    ("stories.json", "[NaN]", "finite"),
    ("predictions.jsonl", "{}\n", "line 1, method"),
    ("predictions.jsonl", "\xff", "not"),
)
def test_damage_is_told_with_its_file(file: str, text: str, message: str, run: Path) -> None:
    (run / file).write_bytes(text.encode("latin-1"))
    said = refused(run)
    assert file in said
    assert message in said


@pytest.mark.parametrize("key", ["seed", "command"])
@pytest.mark.parametrize("value", [None, "x\0"], ids=repr)
def test_a_run_that_does_not_say_how_it_was_made_is_refused(
    run: Path, key: str, value: object
) -> None:
    about = json.loads((run / "run.json").read_text())
    about["meta"][key] = value if key != "command" or value != "x\0" else 5
    (run / "run.json").write_text(json.dumps(about))
    assert f"run.json, meta, {key}" in refused(run)


@cases(
    {"scores": "12"},
    {"scores": [None, 1]},
    {"bits": [7, 0]},
    {"kappa": 0},
    {"index": -1},
    {"index": 1},
    {"view_deg": "steep"},
    {"pair": ["canon-lg"]},
    ids=str,
)
def test_a_prediction_out_of_range_is_refused(changes: dict[str, Any], run: Path) -> None:
    file = run / "predictions.jsonl"
    first, *others = file.read_text().splitlines()
    file.write_text("\n".join([json.dumps(json.loads(first) | changes), *others]) + "\n")
    says = (next(iter(changes)), "as many scores as bits", "frame pair 1 twice for naive")
    assert any(words in refused(run) for words in says)


@cases(
    ("[1, 2.5, -3e10]", [1, 2.5, -3e10]),
    (f"[{10**60}, 1e+100, 1e-400]", [10**60, 1e100, 0.0]),
    ('"\\ud83d\\ude00"', "\N{GRINNING FACE}"),
    ("[" * 32 + "]" * 32, None),
    (b'{"key": "\xc3\xa4"}', {"key": "ä"}),
)
def test_json_within_bounds_is_read_as_it_is(text: str | bytes, expected: Any) -> None:
    value = parse_json(text, "here")
    assert expected is None or value == expected


@pytest.mark.parametrize("text", ['{"a": 1, "a": 2}', '[{"b": {"c": 1, "a": 2, "a": 2}}]'])
def test_a_key_that_an_object_has_twice_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="here: an object has the key 'a' twice; keep one"):
        parse_json(text, "here")


@pytest.mark.parametrize("text", ['"' + "[" * 40, "[" * 40 + '"', '"\\' + '"[' * 20_000])
def test_strings_that_do_not_end_are_refused_at_once(text: str) -> None:
    with pytest.raises(InputError, match=r"here: (not JSON|lists or objects)"):
        parse_json(text, "here")


def test_files_that_never_end_are_none(tmp_path: Path) -> None:
    for read in (read_image, read_json, VideoReader):
        for path in (Path("/dev/zero"), tmp_path, tmp_path / ("n" * 300)):
            with pytest.raises(InputError, match=r"no such|a folder or a device"):
                read(path)
    (tmp_path / "long").write_bytes(bytes(11))
    with pytest.raises(InputError, match="larger than 10 bytes"):
        read_bounded(tmp_path / "long", 10)


def test_what_is_no_file_is_not_replaced_by_one(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/null")
    (tmp_path / "loop").symlink_to("loop")
    for name in ("pipe", "device", "loop", "."):
        with pytest.raises(InputError, match="name a file"):
            write_bytes(tmp_path / name, b"message")
    assert sorted(os.listdir(tmp_path)) == ["device", "loop", "pipe"]
    (tmp_path / "link").symlink_to("file")
    write_bytes(tmp_path / "link", b"old")
    write_bytes(tmp_path / "link", b"message")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"message"


def test_a_link_that_leads_to_itself_is_no_way_out(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    assert inside(tmp_path, "loop", "here") == tmp_path / "loop"
    with pytest.raises(InputError, match="no such image"):
        read_image(tmp_path / "loop")


@cases(
    "drift",
    "drift=NaN",
    "drift=" + "[" * 10**5,
    "a=" + "9" * 5000,
)
def test_settings_beyond_bounds_name_their_flag(text: str) -> None:
    with pytest.raises(ParameterError, match=r"^--set: need name=value") as error:
        parse_settings([text])
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("size", [(17, 70_000), (70_000, 17), (16, 16)])
def test_the_narrowest_photographs_are_searched(size: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    assert locate(image, make_layout()) is None


SENT_LAYOUT = json.dumps(make_layout().to_dict())
DEEP = "[" * 10**5


@cases(
        "", "{}", DEEP, f'{{"layout": {SENT_LAYOUT}}}', '{"kappa": 3}',
        f'{{"layout": {SENT_LAYOUT}, "kappa": NaN}}', f'{{"layout": {SENT_LAYOUT}, "kappa": true}}',
        f'{{"layout": {SENT_LAYOUT}, "kappa": 65}}', '{"layout": 5, "kappa": 3}',
        f'{{"layout": {SENT_LAYOUT}, "kappa": {"9" * 5000}}}',
)  # fmt: skip
def test_what_was_sent_is_read_through_the_door(content: str, tmp_path: Path) -> None:
    file = tmp_path / "sent.json"
    file.write_text(f'{{"layout": {SENT_LAYOUT}, "kappa": 3, "frames": 4}}')
    assert read_settings(tmp_path) == (make_layout(), 3)
    file.write_text(content)
    with pytest.raises(InputError, match=r"^--sent: \S*sent.json is missing or damaged \(.*\); "):
        read_settings(tmp_path)


def test_the_page_on_security_states_the_limits_of_the_code() -> None:
    page = " ".join((ROOT / "docs" / "security.md").read_text().split())
    mib = 2**20
    for words in (
        f"one line of a file of JSON lines | {outside.MAX_JSON_BYTES / mib:g} MiB |",
        f"| a file of JSON lines | {outside.MAX_LINES_BYTES / mib:g} MiB |",
        f"inside each other | {outside.MAX_DEPTH} |",
        f"characters of a whole number | {outside.MAX_DIGITS} |",
        f"frame of a video | {images.MAX_MEGAPIXELS:g} megapixels; `--max-megapixels` or "
        f"`{images.MEGAPIXELS_VARIABLE}`",
        f"and its pixels | {layout.MAX_SIDE_PX}, and {layout.MAX_PIXELS / 1e6:g} million |",
        f"scans of a JPEG | {files.MAX_SCANS} |",
        f"blocks of a layout | {layout.MAX_BLOCKS:,} |",
        f"its nodes and its fields | {MAX_MODEL_BYTES / mib:g} MiB, {MAX_NODES:,} and "
        f"{MAX_FIELDS:,} |",
        f"models of a process | {MAX_MEMORY_BYTES / mib:g} MiB |",
        f"or to run it | {TIME_LIMIT_S:g} s, and 1 s more",
        f"does not stop within {GRACE_S:g} s",
        f"weights of a checkpoint | {MAX_WEIGHTS_BYTES / mib:g} MiB |",
        f"state of a training | {MAX_STATE_BYTES / mib:g} MiB |",
        f"command line | {cli.MAX_NUMBER:,}, where",
        f"processes and threads {cli.MAX_OF_FLAG['jobs']} |",
    ):
        assert words in page
