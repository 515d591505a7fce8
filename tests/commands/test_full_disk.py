"""A disk that takes no more: one line names the file and the reason, and nothing half is left."""

import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Refuses, cases

import export.to_onnx as to_onnx_cli
from link.images import write_image
from models import PRETRAINED

LIMIT_BYTES = 20_000
"""Size at which a file cannot grow any more; everything that the commands write is larger."""


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "picture.png"
    write_image(path, np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8))
    return path


@pytest.fixture
def no_space() -> Iterator[None]:
    """Files of this process cannot grow over `LIMIT_BYTES`: writing fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT_BYTES, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


SEND = "PICTURE --message hi --preset paper --rows 5 --cols 6 --ratex 2 --width 120 --height 80"
FILM = "--message hi --seconds 0.2 --size 320 240"


@cases(
    ("sender.__main__", f"{SEND} --out OUT/x.html", "x.html"),
    ("sender.__main__", f"{SEND} --out OUT/x.mkv", "x.mkv"),
    ("sender.__main__", f"{SEND} --out OUT/x.avi", "x.avi"),
    ("sender.__main__", f"{SEND} --out OUT/x", "x/state_00000.png"),
    ("data_gen.video", f"{FILM} --out OUT/film.mkv", "film.mkv"),
    ("data_gen.video", f"{FILM} --out OUT/film.mp4 --codec.kbits 9000", "film.mp4"),
    ("data_gen.video", f"{FILM} --out OUT/film", "film/000000.png"),
    ("data_gen.__main__", "--frames 2 --out OUT/gen", "gen/00000_original.png"),
    ("receiver.locate.__main__", "PICTURE --show OUT/seen", "seen/picture.png"),
)
def test_a_full_disk_is_named_and_nothing_half_is_left(
    module: str, words: str, named: str, picture: Path, no_space: None, refuses: Refuses
) -> None:
    out = picture.parent / "out"
    out.mkdir()
    given = words.replace("PICTURE", str(picture)).replace("OUT", str(out))
    said = refuses(module, given, began=True, folder=out)
    assert said == f"error: {out / named}: cannot be written (File too large)"


def test_a_model_that_cannot_be_written_leaves_nothing(
    tmp_path: Path, refuses: Refuses, no_space: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(to_onnx_cli, "to_onnx", lambda *_: bytes(2 * LIMIT_BYTES))
    words = [PRETRAINED, "--out", tmp_path / "decoder.onnx"]
    refuses("export.to_onnx", words, "cannot be written (File too large)", folder=tmp_path)


def test_an_out_that_is_a_folder_is_refused_before_the_export(
    tmp_path: Path, refuses: Refuses
) -> None:
    said = f"--out: {tmp_path} is a folder or a device; name a file"
    refuses("export.to_onnx", [PRETRAINED, "--out", tmp_path], said, folder=tmp_path)
