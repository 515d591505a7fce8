"""A disk that takes no more: one line names the file and the reason, and nothing half is left."""

import errno
import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

import data_gen.__main__ as data_gen_cli
import data_gen.video as film_cli
import export.locate.__main__ as locate_cli
import export.send.__main__ as send_cli
import export.to_onnx as to_onnx_cli
from link.errors import InputError
from link.images import write_bytes, write_image
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


FILM = ("--message", "hi", "--seconds", 0.2, "--size", 320, 240)


@pytest.mark.parametrize(
    ("main", "words", "named"),
    [
        (send_cli.main, ("PICTURE", "--message", "hi", "--out", "OUT/x.html"), "x.html"),
        (send_cli.main, ("PICTURE", "--message", "hi", "--out", "OUT/x.mkv"), "x.mkv"),
        (send_cli.main, ("PICTURE", "--message", "hi", "--out", "OUT/x.avi"), "x.avi"),
        (send_cli.main, ("PICTURE", "--message", "hi", "--out", "OUT/x"), "x/state_00000.png"),
        (film_cli.main, (*FILM, "--out", "OUT/film.mkv"), "film.mkv"),
        (film_cli.main, (*FILM, "--out", "OUT/film.mp4", "--codec.kbits", 9000), "film.mp4"),
        (film_cli.main, (*FILM, "--out", "OUT/film"), "film/000000.png"),
        (data_gen_cli.main, ("--frames", 2, "--out", "OUT/gen"), "gen/00000_original.png"),
        (locate_cli.main, ("PICTURE", "--show", "OUT/seen"), "seen/picture.png"),
    ],
    ids=["player", "mkv", "avi", "states", "film.mkv", "film.mp4", "film", "captures", "outlines"],
)
def test_a_full_disk_is_named_and_nothing_half_is_left(
    main: object,
    words: tuple[object, ...],
    named: str,
    picture: Path,
    tmp_path: Path,
    no_space: None,
    command: Command,
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    places = {"PICTURE": str(picture)}
    said = [places.get(str(word), str(word).replace("OUT", str(out))) for word in words]
    done = command(main, *said)
    assert done.status == 2
    last = done.stderr.splitlines()[-1]
    assert last == f"error: {out / named}: cannot be written (File too large)"
    assert [path for path in out.rglob("*") if path.is_file()] == []


def test_a_model_that_cannot_be_written_leaves_nothing(
    tmp_path: Path, command: Command, no_space: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(to_onnx_cli, "to_onnx", lambda *_: bytes(2 * LIMIT_BYTES))
    done = command(to_onnx_cli.main, PRETRAINED, "--out", tmp_path / "decoder.onnx")
    assert done.status == 2
    assert "cannot be written (File too large)" in done.stderr and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_out_that_is_a_folder_is_refused_before_the_export(
    tmp_path: Path, command: Command
) -> None:
    done = command(to_onnx_cli.main, PRETRAINED, "--out", tmp_path)
    assert done.stderr == f"error: --out: {tmp_path} is a folder or a device; name a file\n"


def test_no_space_left_is_what_the_message_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, data: bytes) -> int:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match=r"file: cannot be written \(No space left on device\)"):
        write_bytes(tmp_path / "file", b"data")
    assert list(tmp_path.iterdir()) == []
