"""From photographs of a display to a manifest, and on to a report."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

import evaluate
from data_gen.channel.stills import capture
from data_gen.pairs import get_pair
from data_gen.pictures.library import load_pictures
from lab import recorded
from link.captures import read_manifest
from link.code.framing import encode
from link.embed import embed
from link.frames import Captured, Displayed
from link.images import read_image, write_image
from link.layout import Layout, make_layout
from sender import __main__ as send

MESSAGE = "hidden"


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Captured]]:
    """What sender wrote, and the simulated photographs of it, in two folders."""
    folder, layout = tmp_path_factory.mktemp("recorded"), make_layout()
    picture = load_pictures("test", layout.width, layout.height)[0].rgb
    write_image(folder / "picture.png", picture)
    with pytest.MonkeyPatch.context() as patch:
        arguments = [str(folder / "picture.png"), "--message", MESSAGE, "--preset", "paper"]
        patch.setattr("sys.argv", ["send", *arguments, "--out", str(folder / "sent")])
        send.main()
    states = sorted((folder / "sent").glob("state_*.png"))
    captures = []
    (folder / "photos").mkdir()
    for number in range(0, len(states), 2):
        shown = [read_image(state) for state in states[number : number + 2]]
        bits = np.zeros(layout.n_bits, np.intp)
        rng = np.random.default_rng(7)  # the camera stands still
        pair = get_pair("canon-lg")
        captures.append(capture(Displayed(*shown, bits, layout, 3), pair, 30.0, rng))
        for kind in ("original", "embedded"):
            name = f"{number + (kind == 'embedded'):04d}.png"
            write_image(folder / "photos" / name, getattr(captures[-1], kind))
    return folder, captures


@pytest.mark.slow
def test_the_manifest_holds_what_was_sent_and_where(
    filmed: tuple[Path, list[Captured]], command: Command, layout: Layout
) -> None:
    folder, captures = filmed
    photos, sent = folder / "photos", folder / "sent"
    command(recorded.main, photos, "--sent", sent, "--pair", "mine", "--view", 30)
    entries = read_manifest(photos)
    frames = encode(MESSAGE.encode(), layout.n_bits)
    assert len(entries) == len(frames) == len(captures)
    for entry, bits, captured in zip(entries, frames, captures, strict=True):
        assert entry["bits"] == list(bits)
        assert (entry["kappa"], entry["pair"], entry["view_deg"]) == (3, "mine", 30.0)
        error = np.linalg.norm(np.array(entry["corners"]) - captured.corners, axis=1)
        assert error.max() < 4.0  # pixels; the reported corners themselves are half a pixel off


@pytest.mark.slow
def test_the_recorded_set_gives_a_report(
    filmed: tuple[Path, list[Captured]], command: Command, tmp_path: Path
) -> None:
    folder, _ = filmed
    photos, sent = folder / "photos", folder / "sent"
    command(recorded.main, photos, "--sent", sent, "--handheld", "--unknown")
    assert all("bits" not in entry for entry in read_manifest(photos))
    assert all("corners_embedded" in entry for entry in read_manifest(photos))
    command(recorded.main, photos, "--sent", sent)
    command(evaluate.main, "--captures", photos, "--methods", "oorc", "--out", tmp_path / "out")
    (row,) = json.loads((tmp_path / "out" / "metrics.json").read_text())["rows"]
    assert row["accuracy"] > 0.9
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.parametrize("kappa", [1, 3, 10])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_bits_are_read_from_the_states(
    tmp_path: Path, layout: Layout, kappa: int, level: int
) -> None:
    rng = np.random.default_rng(kappa)
    picture = load_pictures("test", layout.width, layout.height)[1].rgb
    shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, kappa, level)
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    for path, state in zip(paths, (shown.original, shown.embedded), strict=True):
        write_image(path, state)
    assert np.array_equal(recorded.sent_bits(paths, layout, kappa), shown.bits)


@pytest.mark.slow
def test_what_does_not_fit_is_refused(
    filmed: tuple[Path, list[Captured]], command: Command, tmp_path: Path
) -> None:
    folder, captures = filmed
    photos, sent = folder / "photos", folder / "sent"
    cases = [
        ((tmp_path / "none", "--sent", sent), "no such folder of photographs"),
        ((sent, "--sent", photos), "sent.json is missing or damaged"),
    ]
    few = tmp_path / "few"
    few.mkdir()
    write_image(few / "1.png", captures[0].original)
    cases.append(((few, "--sent", sent), "1 photographs of"))
    dark = tmp_path / "dark"
    for number in range(2 * len(captures)):
        write_image(dark / f"{number:02d}.png", np.full((576, 768, 3), 20, np.uint8))
    cases.append(((dark, "--sent", sent), "no display found"))
    for arguments, words in cases:
        done = command(recorded.main, *arguments, status=2)
        assert words in done.stderr
        assert done.stderr.count("\n") == 1 or "locate" in done.stderr
