"""Other systems: the comparison by an exact toy, the adapters where the packages are installed."""

import json
import multiprocessing
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from numpy.typing import NDArray

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pictures.library import load_pictures
from lab import __main__ as lab
from lab.comparison.peers import adapters
from lab.comparison.peers.adapters import IMPORTED, Peer, make_peers
from lab.comparison.peers.page import count_readings, peers_figure, peers_table
from lab.comparison.peers.study import STUDY
from lab.comparison.peers.systems import (
    JPEG,
    NO_CHANNEL,
    MarkedPicture,
    PairSystem,
    PeerTask,
    Reading,
    StillSystem,
    System,
    read_messages,
    receptions,
)
from lab.study import read_results
from link.embed import with_head_room
from link.frames import Rectified
from link.images.quality import psnr
from link.layout import make_layout
from reports.engine.methods import Method

SOURCE = Source(make_layout())


@dataclass(frozen=True)
class Stripes:
    """A toy: six upright stripes, dark or bright; the first is dark and the last bright."""

    name: str = "stripes"
    strength: str = "exact"
    n_bits: int = 4

    def embed(self, picture: NDArray[np.uint8], bits: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Bits become stripes of gray 40 or 200."""
        marked = picture.copy()
        for stripe, bit in zip(np.array_split(marked, 6, axis=1), [0, *bits, 1], strict=True):
            stripe[:] = 200 if bit else 40
        return marked

    def extract(self, picture: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Mean level, over the middle of the first and the last."""
        levels = [stripe.mean() for stripe in np.array_split(picture, 6, axis=1)]
        return np.array(levels[1:-1]) - (levels[0] + levels[-1]) / 2


def readings_of(
    system: System, pairs: tuple[str, ...], views: tuple[float, ...], frames: int
) -> list[Reading]:
    found = read_messages(PeerTask(SOURCE, pairs, views, frames, system))
    return [Reading(**reading) for reading in found]


@pytest.fixture(scope="module")
def readings() -> list[Reading]:
    return readings_of(StillSystem(Stripes()), ("canon-lg", "sony-imac"), (0.0, 45.0), 2)


def test_the_toy_is_read_from_every_condition(readings: list[Reading]) -> None:
    rows = count_readings(readings)
    found = {(row.condition, row.frames_used): (row.captures, row.bits) for row in rows}
    assert found == {
        (NO_CHANNEL, 1): (2, 8),
        (JPEG, 1): (2, 8),
        ("0°", 1): (4, 16),
        ("0°", 2): (4, 16),
        ("45°", 1): (4, 16),
        ("45°", 2): (4, 16),
    }
    assert all(row.correct == row.bits and row.message_bits == 4 for row in rows)


def test_what_is_read_is_what_was_shown(readings: list[Reading]) -> None:
    for index in (0, 1):
        shown = StillSystem(Stripes()).show(SOURCE, index)
        picture = with_head_room(prepare_picture(index), 5)
        assert np.array_equal(shown.clean, picture)
        mine = [reading for reading in readings if reading.index == index]
        assert len(mine) == 2 + 2 * 4
        assert all(reading.bits == shown.displayed.bits.tolist() for reading in mine)
        expected = psnr(picture, Stripes().embed(picture, shown.displayed.bits))
        assert {reading.psnr for reading in mine} == {expected}
        exact = next(reading for reading in mine if reading.condition == NO_CHANNEL)
        levels = np.where(shown.displayed.bits == 1, 80.0, -80.0)
        assert exact.scores == levels.tolist()


def prepare_picture(index: int) -> NDArray[np.uint8]:
    name = FramePair(SOURCE, Cell("canon-lg", 0.0, 5), index).picture.name
    pictures = load_pictures("test", SOURCE.layout.width, SOURCE.layout.height)
    return next(picture.rgb for picture in pictures if picture.name == name)


def test_the_mean_of_two_frames_is_read_where_two_were_filmed() -> None:
    dark, bright = (np.zeros((384, 510, 3), np.uint8) for _ in range(2))
    dark[:, -85:], bright[:, -85:], bright[:, 85:-85] = 100, 100, 201
    pair = Rectified(dark, bright, SOURCE.layout)
    found = list(StillSystem(Stripes()).read(pair, filmed=True))
    assert [(used, scores.tolist()) for used, scores, _ in found] == [
        (1, [-50.0] * 4),
        (2, [50.0] * 4),  # 100.5 is rounded to even
    ]
    assert len(list(StillSystem(Stripes()).read(pair, filmed=False))) == 1


def test_every_system_gets_the_draws_of_the_channel_that_evaluate_has() -> None:
    cell = Cell("sony-imac", 45.0, 5)
    displayed = FramePair(SOURCE, cell, 1).displayed
    shown = MarkedPicture(displayed.original, displayed)
    task = PeerTask(SOURCE, ("sony-imac",), (45.0,), 2, StillSystem(Stripes()))
    *_, filmed = receptions(task, shown, 1)
    assert (filmed.condition, filmed.pair, filmed.view_deg) == ("45°", "sony-imac", 45.0)
    expected = FramePair(SOURCE, cell, 1).rectified
    assert np.array_equal(filmed.frames.original, expected.original)
    assert np.array_equal(filmed.frames.embedded, expected.embedded)


@pytest.mark.parametrize(("method", "n_bits"), [("oorc", 59), ("blind", 64)])
def test_ours_is_measured_alike(method: str, n_bits: int) -> None:
    rows = count_readings(readings_of(PairSystem(Method(method), 5), ("canon-lg",), (0.0,), 1))
    assert [(row.condition, row.frames_used) for row in rows] == [
        (NO_CHANNEL, 2),
        (JPEG, 2),
        ("0°", 2),
    ]
    assert rows[0].accuracy == 1.0
    assert {row.message_bits for row in rows} == {n_bits}
    assert 30 < rows[0].psnr < 45


def reading(strength: str, condition: str, scores: list[float], **changes: Any) -> Reading:
    known = {
        "method": "toy",
        "frames_used": 1,
        "pair": None,
        "view_deg": None,
        "index": 0,
        "psnr": 40.0,
        "ssim": 0.9,
        "decode_s": 0.002,
        "bits": [1, 0],
    }
    return Reading(
        **{**known, "strength": strength, "condition": condition, "scores": scores, **changes}
    )


def test_rows_count_bits_and_average_visibility() -> None:
    rows = count_readings(
        [
            reading("weak", "0°", [1.0, -1.0]),
            reading("weak", "0°", [1.0, 1.0], psnr=30.0, ssim=0.7, decode_s=0.004),
            reading("strong", "0°", [-1.0, 1.0]),
        ]
    )
    weak, strong = rows
    assert (weak.captures, weak.bits, weak.correct, weak.accuracy) == (2, 4, 3, 0.75)
    assert (weak.psnr, weak.decode_ms, round(weak.ssim, 6)) == (35.0, 3.0, 0.8)
    assert weak.ci_low < 0.75 < weak.ci_high
    assert (strong.correct, strong.accuracy, strong.ci_low) == (0, 0.0, 0.0)
    head, _, first, second = peers_table(rows).markdown().splitlines()
    assert head == "| system | strength | PSNR dB | SSIM | bits | 0°, 1 frame | decode ms |"
    assert first.startswith("| toy | weak | 35.0 | 0.8000 | 2 | 75.0 ±")
    assert second.startswith("| toy | strong | 40.0 | 0.9000 | 2 | 0.0 ±")


# The command


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    systems: dict[str, Callable[[int], list[Peer]]] = {"stripes": lambda n_bits: [Stripes()]}
    monkeypatch.setattr(adapters, "PEERS", systems)


SMALL = ("--pairs", "canon-lg", "--views", 0, "--frames", 1, "--kappas", 5, "--jobs", 1)


def no_constants(name: str) -> None:
    raise AssertionError(f"{name} is not JSON")


def stored_readings(folder: Path) -> list[Reading]:
    (stored,) = folder.glob("read_messages_*.jsonl")
    lines = [json.loads(line) for line in stored.read_text().splitlines()]
    return [Reading(**reading) for line in lines for reading in line["result"]]


@pytest.mark.slow
@pytest.mark.usefixtures("toy")
def test_the_command_writes_page_numbers_and_picture(tmp_path: Path, command: Command) -> None:
    flags = ("--systems", "stripes", "--ours", "naive", "--out", tmp_path)
    done = command(lab.main, "peers", *SMALL, *flags)
    assert done.status == 0, done.stderr
    content = json.loads((tmp_path / "peers.json").read_text(), parse_constant=no_constants)
    assert content["meta"]["simulated"] is True
    assert {row["method"] for row in content["rows"]} == {"naive", "stripes"}
    rows = read_results(STUDY, tmp_path / "peers.json").content.rows
    assert count_readings(stored_readings(tmp_path)) == rows
    assert len(peers_figure(rows).axes) == 3
    page = (tmp_path / "peers.md").read_text()
    assert "Simulated" in page
    assert "| stripes | exact |" in page
    assert (tmp_path / "peers.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.usefixtures("toy")
def test_a_run_goes_on_where_it_stopped(tmp_path: Path, command: Command) -> None:
    run = (*SMALL, "--systems", "stripes", "--ours", "naive", "--out", tmp_path)
    assert command(lab.main, "peers", *run).status == 0
    before = untimed(stored_readings(tmp_path))
    (stored,) = tmp_path.glob("read_messages_*.jsonl")
    kept, lost = stored.read_text().splitlines(keepends=True)
    assert [json.loads(line)["name"][:9] for line in (kept, lost)] == ["naive, κ ", "stripes, "]
    stored.write_text(kept + lost[: len(lost) // 2])  # as if killed while it was written
    assert command(lab.main, "peers", *run).status == 0
    again, made = stored.read_text().splitlines(keepends=True)
    assert again == kept
    assert json.loads(made)["name"] == json.loads(lost)["name"]
    assert untimed(stored_readings(tmp_path)) == before


def untimed(readings: list[Reading]) -> list[Reading]:
    return [replace(reading, decode_s=0) for reading in readings]


@pytest.mark.usefixtures("toy")
def test_a_system_that_fails_is_named(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def extract(self: Stripes, picture: NDArray[np.uint8]) -> NDArray[np.float64]:
        raise ZeroDivisionError("made to fail")

    monkeypatch.setattr(Stripes, "extract", extract)
    run = (*SMALL, "--systems", "stripes", "--ours", "naive", "--out", tmp_path)
    done = command(lab.main, "peers", *run)
    assert done.status == 2
    assert "read messages: 1 of 2 failed: stripes, exact" in done.stderr
    (stored,) = tmp_path.glob("read_messages_*.jsonl")
    (kept,) = stored.read_text().splitlines()
    assert json.loads(kept)["name"].startswith("naive, κ 5")


@pytest.mark.parametrize("name", list(IMPORTED))
def test_a_missing_package_is_one_line_with_the_remedy(
    name: str, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    adapters._package.cache_clear()
    monkeypatch.setitem(sys.modules, IMPORTED[name], None)
    done = command(lab.main, "peers", *SMALL, "--systems", name, "--out", tmp_path)
    assert done.status == 2
    assert done.stderr.startswith(f"error: {name}: the package {IMPORTED[name]} is missing; run ")
    assert "pip install --no-deps invisible-watermark==" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--systems", "stegastamp"), "unknown system 'stegastamp'; choose one of: stripes"),
        (("--systems", "stripes", "--ours", "best"), "unknown method 'best'"),
        (("--systems", "stripes", "--pairs", "mine"), "mine"),
        (("--systems", "stripes", "--frames", 0), "--frames: need at least 1"),
    ],
)
@pytest.mark.usefixtures("toy")
def test_wrong_flags(
    flags: tuple[object, ...], message: str, tmp_path: Path, command: Command
) -> None:
    done = command(lab.main, "peers", *SMALL, *flags, "--out", tmp_path)
    assert done.status == 2
    assert message in done.stderr


# The adapters, where the packages are


def needs(name: str) -> None:
    if find_spec(IMPORTED[name]) is None or find_spec("pywt") is None:
        pytest.skip(f"{name} is not installed: {adapters.INSTALL}")


@pytest.mark.parametrize(
    ("name", "strength", "least"),
    [
        ("rivaGAN", "default", 0.9),  # a network: some bits of some pictures are wrong
        ("DWT-DCT", "default", 0.8),
        ("DWT-DCT-SVD", "default", 1.0),
        ("blind-watermark", "default", 1.0),
    ],
)
def test_adapters_read_what_they_wrote(name: str, strength: str, least: float) -> None:
    needs(name)
    peer = next(peer for peer in make_peers(name, 32) if peer.strength == strength)
    picture = with_head_room(load_pictures("test", 256, 256)[0].rgb, 5)
    before = picture.copy()
    bits = np.random.default_rng(0).integers(0, 2, 32)
    marked = peer.embed(picture, bits)
    assert marked.shape == picture.shape
    assert marked.dtype == np.uint8
    assert np.array_equal(picture, before)
    assert 30 < psnr(picture, marked) < 50
    scores = peer.extract(marked)
    assert scores.shape == (32,)
    assert np.mean((scores > 0) == bits) >= least
    other = peer.extract(peer.embed(picture, 1 - bits))
    assert np.mean((other > 0) == bits) < 0.5


@pytest.mark.parametrize("name", list(IMPORTED))
def test_stronger_is_more_visible(name: str) -> None:
    needs(name)
    picture = with_head_room(load_pictures("test", 256, 256)[0].rgb, 5)
    bits = np.random.default_rng(0).integers(0, 2, 32)
    peers = [peer for peer in make_peers(name, 32) if peer.name == name]
    assert peers[0].strength != peers[-1].strength
    weak, strong = (psnr(picture, peer.embed(picture, bits)) for peer in (peers[0], peers[-1]))
    assert weak > strong + 3


def test_blind_watermark_leaves_the_start_method_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    needs("blind-watermark")
    for module in [name for name in sys.modules if name.partition(".")[0] == "blind_watermark"]:
        monkeypatch.delitem(sys.modules, module)
    before = multiprocessing.get_start_method(allow_none=True)
    adapters._package.cache_clear()
    make_peers("blind-watermark", 32)
    assert multiprocessing.get_start_method(allow_none=True) == before
