"""One receiver reads every preset: it finds what is shown, says which, and delivers the message."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Command, Refuses, cases
from pilot_films import CORNERS, TEXT, BlockMeans, filmed, robust_film, texture
from streams import events_of, write_film

import receiver.__main__ as receive_cli
import receiver.decoders as decoders_module
from link.embed import embed
from link.errors import InputError
from link.frames import SoftBits
from link.images import write_image
from link.layout import Layout, block_mean, make_layout
from link.presets import PRESETS, Preset, preset_name
from link.types import Image
from models import PRETRAINED, PRETRAINED_PILOTS, shipped_graphs
from receiver.decoders import ShippedDecoder
from receiver.pilots.search import proposals
from receiver.reading.occlusion import Occlusion
from receiver.reading.reader import DecodedPair
from receiver.reading.shown import States
from receiver.reading.states import DisplayState
from receiver.receiver import Receiver, make_trackers
from receiver.stream import MAX_PRINTED_BITS, pair_event
from receiver.tracking.patches import Tracker
from receiver.tracking.pilots import PilotTracker
from receiver.tracking.two_images import decode_in_both, find_in_both

PAPER, ROBUST = PRESETS["paper"].layout, PRESETS["robust"].layout
BARE = make_layout(ratex=0)


def receiver_of(*layouts: Layout, fps: float = 30.0) -> Receiver:
    return Receiver([BlockMeans(layout) for layout in layouts], fps)


def read(receiver: Receiver, images: list[Image]) -> bytes | None:
    for number, image in enumerate(images):
        step = receiver.push(image, number / 30)
        if step.message is not None:
            return step.message.data
    step = receiver.finish()
    return None if step.message is None else step.message.data


@pytest.mark.slow
def test_a_film_of_a_preset_with_pilots_delivers_its_message() -> None:
    receiver = receiver_of(PAPER, ROBUST)
    assert receiver.layout == PAPER
    images, _ = robust_film(60)
    assert read(receiver, images) == TEXT
    assert receiver.layout == ROBUST
    assert receiver.progress > 0.9
    for number in range(receiver.frames, len(images)):
        receiver.push(images[number], number / 30)
    assert receiver.state_hz == pytest.approx(15.0, rel=0.02)  # of a second of film
    assert receiver.decoded >= 2
    assert receiver.observations.found == receiver.found > 20


def test_decoders_are_one_for_each_layout() -> None:
    with pytest.raises(InputError, match="decoders: need at least one"):
        receiver_of()
    with pytest.raises(InputError, match="two of them read the same layout"):
        receiver_of(PAPER, ROBUST, PAPER)
    with pytest.raises(InputError, match="no ratex patches"):
        receiver_of(BARE)
    with pytest.raises(InputError, match="no ratex patches"):
        receiver_of(ROBUST, BARE)


def test_pilots_share_a_tracker_and_patches_have_one_each() -> None:
    layouts = [preset.layout for preset in PRESETS.values()]
    kinds = [type(tracker) for tracker in make_trackers(layouts, 30.0)]
    assert kinds == [Tracker, PilotTracker]
    other = make_layout(6, 6)
    assert [type(tracker) for tracker in make_trackers([PAPER, other], 30.0)] == [Tracker] * 2


@pytest.mark.slow
def test_a_display_without_edges_is_found_in_two_images_by_what_toggles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(proposals, "display_candidates", lambda *_: [])
    first, second = filmed(ROBUST, 2, seed=1, hold=1, kappa=3.0)[0]
    found = find_in_both(first, second, [ROBUST])
    assert found is not None
    assert max(np.abs(corners - CORNERS).max() for corners in found.corners) < 3


def test_two_images_must_show_both_states() -> None:
    first, *_ = filmed(ROBUST, 2, seed=1, hold=1)[0]
    with pytest.raises(InputError, match="the two images show the same state"):
        decode_in_both(BlockMeans(ROBUST), first, first, (CORNERS, CORNERS))
    with pytest.raises(InputError, match="no ratex patches and no pilots"):
        decode_in_both(BlockMeans(BARE), first, first, (CORNERS, CORNERS))


# the command


def test_by_default_all_shipped_graphs_are_read(
    monkeypatch: pytest.MonkeyPatch, command: Command, refuses: Refuses, tmp_path: Path
) -> None:
    loaded: list[Path] = []
    checked: dict[Layout, Path] = {}

    def load(path: Path, threads: int) -> BlockMeans:
        loaded.append(path)
        return BlockMeans(PAPER if path == PRETRAINED / "decoder.onnx" else ROBUST)

    def check(path: Path, layout: Layout, threads: int) -> BlockMeans:
        checked[layout] = path
        return BlockMeans(layout)

    monkeypatch.setattr(decoders_module, "Decoder", load)
    monkeypatch.setattr(decoders_module, "ShippedDecoder", check)
    write_image(tmp_path / "in" / "a.png", np.full((60, 80, 3), 90, np.uint8))
    command(receive_cli.main, tmp_path / "in", status=2)
    assert checked == shipped_graphs()
    assert len(checked) > 2
    assert loaded == []  # a film without a display needs none of them
    chosen = [PRETRAINED / "decoder.onnx", PRETRAINED_PILOTS / "24x32.onnx"]
    words = (tmp_path / "in", "--model", chosen[1], "--model")
    done = command(receive_cli.main, *words, chosen[0], status=2)
    assert loaded == chosen[::-1]
    assert len(done.stderr.splitlines()) == 1
    assert [line["event"] for line in events_of(done.stdout)] == ["end"]
    said = "decoders: two of them read the same layout"
    refuses("receiver.__main__", [*words, chosen[1]], said)


def test_a_shipped_graph_is_loaded_when_it_decodes(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[Path] = []

    def load(path: Path, threads: int, time_limit_s: float) -> BlockMeans:
        loaded.append(path)
        return BlockMeans(PAPER)

    monkeypatch.setattr(decoders_module, "Decoder", load)
    graph = PRETRAINED / "decoder.onnx"
    right, wrong = ShippedDecoder(graph, PAPER), ShippedDecoder(graph, ROBUST)
    assert loaded == []
    frame = np.full((PAPER.height, PAPER.width), 90, np.uint8)
    assert not right.decode(frame, frame).scores.any()
    assert right.decode(frame, frame + 3).scores.all()
    assert loaded == [graph]
    with pytest.raises(InputError, match=r"decoder\.onnx: is for another layout than"):
        wrong.decode(frame, frame)


def test_a_shipped_graph_is_loaded_once_beside_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on, loaded = threading.Event(), threading.Event(), []

    def load(path: Path, threads: int, time_limit_s: float) -> BlockMeans:
        begun.set()
        assert go_on.wait(10)
        loaded.append(path)
        return BlockMeans(PAPER)

    monkeypatch.setattr(decoders_module, "Decoder", load)
    decoder = ShippedDecoder(PRETRAINED / "decoder.onnx", PAPER)
    decoder.prepare()
    decoder.prepare()
    assert begun.wait(10)
    assert loaded == []  # the camera's frames go on
    go_on.set()
    frame = np.full((PAPER.height, PAPER.width), 90, np.uint8)
    assert not decoder.decode(frame, frame).scores.any()
    assert len(loaded) == 1


@cases(
    (lambda data: b"version https://git-lfs", "not a readable ONNX model; export it again (it"),
    (None, "no such model"),
    ids=["another file", "missing"],
)
def test_a_damaged_shipped_graph_is_refused_at_once(
    damage: Callable[[bytes], bytes] | None,
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    refuses: Refuses,
    tmp_path: Path,
) -> None:
    broken = tmp_path / "24x32.onnx"
    if damage is not None:
        broken.write_bytes(damage((PRETRAINED_PILOTS / "24x32.onnx").read_bytes()))
    monkeypatch.setattr(decoders_module, "shipped_graphs", lambda: {ROBUST: broken})
    refuses("receiver.__main__", ["no film"], f"{broken}: {says}")


def test_two_images_of_pilots_give_one_line(
    monkeypatch: pytest.MonkeyPatch, refuses: Refuses, tmp_path: Path
) -> None:
    monkeypatch.setattr(decoders_module, "Decoder", lambda *_: BlockMeans(ROBUST))
    write_image(tmp_path / "a.png", np.full((60, 80, 3), 90, np.uint8))
    says = ("no display is in both whose blocks change", "(robust looked for)")
    refuses("receiver.__main__", "a.png a.png --model pilots.onnx", *says)


@pytest.mark.slow
def test_the_command_says_which_preset_is_shown(tmp_path: Path, command: Command) -> None:
    film = write_film(tmp_path / "film.avi", robust_film(32)[0], codec="FFV1")
    graph = PRETRAINED_PILOTS / "24x32.onnx"
    done = command(receive_cli.main, film, "--model", graph, "--scores")
    lines = events_of(done.stdout)
    display = next(line for line in lines if line["event"] == "display")
    assert display["preset"] == "robust"
    assert np.shape(display["corners"]) == (4, 2)
    pairs = [line for line in lines if line["event"] == "pair"]
    assert all(len(line["bits"]) == len(line["scores"]) == ROBUST.n_bits for line in pairs)
    assert pairs
    said = [line for line in lines if line["event"] == "message"]
    assert [line["text"] for line in said] == [TEXT.decode()]


@pytest.mark.slow
def test_a_mirrored_film_is_read_and_said(tmp_path: Path, command: Command) -> None:
    for number, image in enumerate(robust_film(32)[0]):
        write_image(tmp_path / f"{number:03d}.png", image[:, ::-1])
    done = command(receive_cli.main, tmp_path)
    assert done.stderr.startswith("note: the film is mirrored")
    lines = events_of(done.stdout)
    assert TEXT.decode() in [each.get("text") for each in lines]
    assert not [line for line in lines if "bits" in line or "scores" in line]  # without --scores


def test_presets_are_named_by_their_layouts() -> None:
    assert {name: preset_name(preset.layout) for name, preset in PRESETS.items()} == {
        name: name for name in PRESETS
    }
    assert preset_name(make_layout(5, 5)) is None


@pytest.mark.parametrize("count", [MAX_PRINTED_BITS, MAX_PRINTED_BITS + 1])
def test_few_bits_are_printed_and_many_where_scores_are(count: int) -> None:
    scores = np.resize([2.0, -2.0, 0.0], count)
    state = DisplayState(np.zeros((8, 8), np.uint8), np.ones((2, 2)), 3)
    shown = States(state, state, np.ones((2, 2), bool))
    pair = DecodedPair(7, 1.25, SoftBits(scores), shown, 0.5)
    plain, whole = pair_event(pair, scores=False), pair_event(pair, scores=True)
    assert ("bits" in plain) == (count <= MAX_PRINTED_BITS)
    assert "scores" not in plain
    assert whole["bits"] == "".join("1" if score > 0 else "0" for score in scores)
    assert whole["scores"] == scores.tolist()
    assert (plain["pair"], plain["frames"], plain["erased"]) == (7, [3, 3], count // 3)


@pytest.mark.parametrize("preset", PRESETS.values(), ids=list(PRESETS))
def test_what_covers_blocks_is_seen_at_every_grid_and_toggling_is_not(preset: Preset) -> None:
    layout = preset.layout
    rng = np.random.default_rng(4)
    picture = np.asarray(125 + 22 * texture((layout.height, layout.width), 3), np.float32)
    occlusion = Occlusion(layout)
    for number in range(8):
        bits = rng.integers(0, 2, layout.n_bits)
        shown = embed(np.clip(picture, 10, 245).astype(np.uint8), bits, layout, preset.kappa)
        gray = np.asarray(shown.original + rng.normal(0, 1.5, picture.shape), np.float32)
        image = np.clip(gray, 0, 255).astype(np.uint8)
        if number < 7:
            assert not occlusion.covered(image).any()
    hand = np.zeros(image.shape, bool)
    hand[layout.height // 2 :, layout.width // 2 :] = True
    covered = occlusion.covered(np.where(hand, 30, image).astype(np.uint8))
    behind = block_mean(hand.astype(np.float32), layout.rows, layout.cols)[layout.message_mask]
    assert covered[behind == 1].mean() > 0.9  # a picture may be as dark as the hand in places
    assert not covered[behind == 0].any()
