"""Mutated images, videos and models: one clear line, or the right message; no crash, no hang."""

import functools
import json
import random
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ROOT, Command
from fuzz import KINDS, TRAIN, Inputs, mutated_bytes
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import Stream, states_of

from export.runtime import Decoder
from link.captures import KNOWN, MANIFEST, read_manifest, save_captures
from link.cli import run_cli
from link.errors import InputError
from link.frames import Captured
from link.geometry import frame_corners
from link.images import write_image
from link.images.files import read_image
from link.layout import MAX_BLOCKS, MAX_PIXELS, Layout, make_layout
from link.outside import parse_json
from link.types import Image
from receiver.locate.find import locate
from receiver.receiver import Receiver

MODEL = ROOT / "models" / "pretrained" / "ratex" / "decoder.onnx"
LAYOUT = make_layout()
TEXT = b"right"


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".webp"])
def test_mutated_image_files_are_refused_or_read(tmp_path: Path, suffix: str) -> None:
    """All of a file, and its first bytes alone, where sizes stand."""
    rng = random.Random(5)
    path = tmp_path / f"image{suffix}"
    write_image(path, np.random.default_rng(5).integers(0, 255, (90, 120, 3)).astype(np.uint8))
    data = path.read_bytes()
    for head in [len(data)] * 60 + [64] * 40:
        path.write_bytes(mutated_bytes(data[:head], rng) + data[head:])
        try:
            image = read_image(path)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert (image.dtype, image.ndim) == (np.uint8, 3)


LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**70), 10**70),
    st.floats(),
    st.text(st.characters(codec=None), max_size=5),
    st.sampled_from(["../x.png", "/etc/passwd", "n" * 300, "\0", "\u2028", 10**400]),
)
VALUES = st.recursive(
    LEAVES, lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(), part, max_size=3)
)


@settings(max_examples=10, deadline=None)
@given(st.dictionaries(st.sampled_from([*KNOWN, "pair", "view_deg", "x"]), VALUES, max_size=3))
def test_manifests_of_any_values_are_refused_or_read(
    tmp_path_factory: pytest.TempPathFactory, changes: dict[str, object]
) -> None:
    folder = tmp_path_factory.mktemp("captures")
    frame, corners = np.zeros((60, 80, 3), np.uint8), frame_corners(64, 48) + 4
    small = make_layout(4, 4, 64, 48, ratex=2)
    save_captures(folder, iter([Captured(frame, frame, small, corners, corners)]))
    sound = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(sound | changes))
    try:
        (read,) = read_manifest(folder)
        read.load().rectified()
    except InputError as error:
        assert str(error)


@settings(max_examples=75, deadline=None)
@given(
    VALUES
    | st.dictionaries(st.sampled_from(["rows", "cols", "width", "height", "ratex"]), VALUES).map(
        lambda changes: LAYOUT.to_dict() | changes
    )
)
def test_layouts_of_any_values_are_refused_or_small(value: object) -> None:
    try:
        layout = Layout.from_dict(parse_json(json.dumps(value), "layout"))
    except InputError:
        return
    assert layout.n_bits <= MAX_BLOCKS
    assert layout.width * layout.height <= MAX_PIXELS


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=60) | st.text('[]{}",:0123456789.eE+-\\uNaInfity d', max_size=60))
def test_any_text_is_json_within_bounds_or_refused(text: bytes | str) -> None:
    try:
        value = parse_json(text, "here")
    except InputError as error:
        assert str(error).startswith("here")
    else:
        assert json.dumps(value, allow_nan=False)


# Any command on any input


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    inputs = Inputs(tmp_path_factory.mktemp("good"))
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr("train.export_and_evaluate", stop_before_export)
        patch.setattr("sys.argv", ["train", *TRAIN, "--out", str(inputs.good / "training")])
        run_cli(import_module("train").main)
    assert (inputs.good / "training" / "state.pt").is_file()
    return inputs


def stop_before_export(*_: object) -> None:
    """End a command in place of the export of a sound decoder, which takes long."""
    raise InputError("the fuzz ends before an export")


def texts(said: str) -> set[str]:
    """Messages that a receiver printed."""
    lines = [line for line in said.splitlines() if line.startswith('{"event": "message"')]
    return {json.loads(line)["text"] for line in lines}


@pytest.mark.slow
@pytest.mark.parametrize("shown", ["film.avi", "states"])
def test_the_films_to_mutate_are_read(shown: str, inputs: Inputs, command: Command) -> None:
    done = command(import_module("receiver.__main__").main, inputs.good / shown)
    assert texts(done.stdout) == {TEXT.decode()}


OFTEN = {"run": 20}
"""Number of cases of a kind that are run outside CI, too; 1 for the others."""
CASES = [
    pytest.param(
        kind, seed, marks=pytest.mark.slow if seed < OFTEN.get(kind, 1) else pytest.mark.exhaustive
    )
    for kind in KINDS
    for seed in range(100)
]


@pytest.mark.timeout(200)
@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_a_command_on_a_mutated_input_is_refused_in_a_line_or_right(
    kind: str,
    seed: int,
    inputs: Inputs,
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It may neither crash nor hang, nor receive a message that nobody sent."""
    for module, function in (("train", "export_and_evaluate"), ("export.to_onnx", "to_onnx")):
        monkeypatch.setattr(f"{module}.{function}", stop_before_export)
    place = tmp_path / "case"
    place.mkdir()
    monkeypatch.chdir(place)  # a mutated --out is a name in this folder
    inputs.rng = random.Random(seed)
    module, words = getattr(inputs, kind)(place)
    start = time.process_time()
    done = command(import_module(module).main, *words, status=None)
    assert time.process_time() - start < 10, words
    assert done.status in (0, 1, 2), (words, done.stderr)
    assert "Traceback" not in done.stderr, (words, done.stderr)
    assert done.status == 0 or done.stderr.strip(), words
    assert texts(done.stdout) <= {TEXT.decode()}, words


# Any frames


def noise(rng: np.random.Generator, image: Image) -> Image:
    return rng.integers(0, 256, image.shape).astype(np.uint8)


def shuffled(rng: np.random.Generator, image: Image) -> Image:
    return np.ascontiguousarray(rng.permutation(image, axis=int(rng.integers(2))))


def cut(rng: np.random.Generator, image: Image) -> Image:
    height, width = (int(rng.integers(16, side)) for side in image.shape[:2])
    return image[:height, :width]


def flat(rng: np.random.Generator, image: Image) -> Image:
    return np.full_like(image, rng.integers(256))


def mirrored(rng: np.random.Generator, image: Image) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


@functools.cache
def decoder() -> Decoder:
    return Decoder(MODEL)


@functools.cache
def frames_of_a_film() -> list[Image]:
    rng = np.random.default_rng(0)
    film = Stream(size=(320, 240)).frames(states_of(TEXT, LAYOUT, rng), 0.5, rng)
    return [image for _, image, _ in film]


CHANGES: list[Callable[..., Image]] = [noise, shuffled, cut, flat, mirrored]


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_frames_of_any_content_and_size_in_any_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    receiver, images = Receiver(decoder()), frames_of_a_film()
    for number in rng.integers(0, len(images), 12):
        image = images[number]
        if rng.random() < 0.6:
            image = CHANGES[int(rng.integers(len(CHANGES)))](rng, image)
        step = receiver.push(image, float(rng.uniform(-1, 5)))
        assert step.message is None or step.message.data == TEXT
    step = receiver.finish()
    assert step.message is None or step.message.data == TEXT


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(16, 90), st.integers(16, 90))
def test_locate_takes_any_picture(seed: int, height: int, width: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    if seed % 3 == 0:
        image = cv2.GaussianBlur(image, (0, 0), 5)
    assert locate(image, LAYOUT) is None
