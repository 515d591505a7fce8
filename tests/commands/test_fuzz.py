"""Mutated images, videos and models: one clear line, or the right message; no crash, no hang."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from conftest import ROOT, slow
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from streams import Stream, states_of

from export.locate.find import locate
from export.receive.receiver import Receiver
from export.runtime import Decoder
from link.captures import KNOWN, MANIFEST, load_capture, read_manifest, save_captures
from link.errors import InputError
from link.frames import Captured
from link.geometry import frame_corners
from link.images import read_image, write_image
from link.layout import MAX_BLOCKS, MAX_PIXELS, Layout, make_layout
from link.outside import parse_json

MODEL = ROOT / "models" / "neural" / "pretrained" / "decoder.onnx"
LAYOUT = make_layout()
TEXT = b"right"

FEED = """
import json, sys
from pathlib import Path
from export.receive.receiver import Receiver
from export.runtime import Decoder
from export.receive.sources import open_source
from link.errors import InputError
results = []
for model, source in json.loads(sys.argv[1]):
    try:
        receiver = Receiver(Decoder(Path(model)))
        got = None
        for frame in open_source(source).frames:
            got = receiver.push(frame.image, frame.time).message or got
        got = receiver.finish().message or got
        results.append(got.data.hex() if got else None)
    except InputError as error:
        results.append("refused: " + str(error))
print(json.dumps(results))
"""


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, a piece cut out, moved, or the end lost."""
    array = bytearray(data)
    kind = rng.integers(4)
    if kind == 0:
        for at in rng.integers(0, len(array), int(rng.integers(1, 40))):
            array[at] = int(rng.integers(256))
    elif kind == 1:
        del array[int(rng.integers(len(array))) :]
    elif kind == 2:
        start = int(rng.integers(len(array)))
        del array[start : start + int(rng.integers(1, 2000))]
    else:
        start = int(rng.integers(len(array)))
        piece = array[start : start + 500]
        at = int(rng.integers(len(array)))
        array[at:at] = piece
    return bytes(array)


def feed(cases: list[tuple[str, str]]) -> list[str | None]:
    """Decode each (model, source) in one process of its own, which must end by itself."""
    done = subprocess.run(
        [sys.executable, "-c", FEED, json.dumps(cases)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    results: list[str | None] = json.loads(done.stdout.splitlines()[-1])
    return results


def is_right_or_refused(result: str | None) -> bool:
    return result is None or result == TEXT.hex() or result.startswith("refused: ")


@pytest.fixture(scope="module")
def states() -> list[NDArray[np.uint8]]:
    return states_of(TEXT, LAYOUT, np.random.default_rng(0))


@pytest.mark.slow
def test_mutated_videos(tmp_path: Path, states: list[NDArray[np.uint8]]) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (320, 240))
    for _, image, _ in Stream(size=(320, 240)).frames(states, 2, np.random.default_rng(2)):
        writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    writer.release()
    rng = np.random.default_rng(3)
    cases = [(str(MODEL), str(path))]
    for number in range(10):
        bad = tmp_path / f"bad{number}.avi"
        bad.write_bytes(mutated(path.read_bytes(), rng))
        cases.append((str(MODEL), str(bad)))
    results = feed(cases)
    assert results[0] == TEXT.hex()
    assert all(is_right_or_refused(result) for result in results)


@pytest.mark.slow
def test_mutated_models(tmp_path: Path, states: list[NDArray[np.uint8]]) -> None:
    for number, state in enumerate(states):
        write_image(tmp_path / "in" / f"{number:03d}.png", state)
    rng = np.random.default_rng(4)
    cases = [(str(MODEL), str(tmp_path / "in"))]
    for number in range(25):
        bad = tmp_path / f"bad{number}.onnx"
        bad.write_bytes(mutated(MODEL.read_bytes(), rng))
        cases.append((str(bad), str(tmp_path / "in")))
    results = feed(cases)
    assert results[0] == TEXT.hex()
    assert all(is_right_or_refused(result) for result in results)
    assert sum(str(result).startswith("refused: ") for result in results) > 5


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff"])
def test_mutated_image_files(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(5)
    path = tmp_path / f"image{suffix}"
    write_image(path, rng.integers(0, 255, (90, 120, 3)).astype(np.uint8))
    data = path.read_bytes()
    for _ in range(60):
        path.write_bytes(mutated(data, rng))
        try:
            image = read_image(path)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert image.dtype == np.uint8
            assert image.ndim == 3


def test_mutated_headers_of_images_are_refused_or_read(tmp_path: Path) -> None:
    """Sizes stand in the first bytes of a file."""
    rng = np.random.default_rng(6)
    picture = rng.integers(0, 255, (90, 120, 3)).astype(np.uint8)
    for suffix in (".png", ".jpg", ".tiff", ".bmp", ".webp"):
        path = tmp_path / f"image{suffix}"
        write_image(path, picture)
        data = path.read_bytes()
        for _ in range(40):
            path.write_bytes(mutated(data[:64], rng) + data[64:])
            try:
                assert read_image(path).ndim == 3
            except InputError as error:
                assert "\n" not in str(error)


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


@settings(max_examples=50, deadline=None)
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
        load_capture(folder, read).rectified()
    except InputError as error:
        assert str(error)


@settings(max_examples=150, deadline=None)
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


@pytest.mark.parametrize("seed", range(8))
def test_mutated_metadata_of_a_model_is_refused_or_harmless(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = onnx.load(MODEL)
    entry = next(e for e in model.metadata_props if e.key == ("layout", "features")[seed % 2])
    entry.value = mutated(entry.value.encode(), rng).decode(errors="replace")
    path = tmp_path / "model.onnx"
    path.write_bytes(model.SerializeToString())
    try:
        assert Decoder(path, threads=1).layout.n_bits <= MAX_BLOCKS
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.slow
def test_the_fuzz_command_finds_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--cases", "35", "--seed", "1"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert len(json.loads(done.stdout.splitlines()[-1])["kinds"]) == 10


@pytest.mark.parametrize("name", [slow("data_gen"), slow("send_folder"), slow("film_mkv")])
def test_a_killed_command_ends_in_the_same_bytes(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.kills", "--kills", "2", "--commands", name],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["kills"] >= 2 and found["files_compared"] > 0 and not found["failures"]


def noise(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return rng.integers(0, 256, image.shape).astype(np.uint8)


def shuffled(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(rng.permutation(image, axis=int(rng.integers(2))))


def cut(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = (int(rng.integers(16, side)) for side in image.shape[:2])
    return image[:height, :width]


def flat(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.full_like(image, rng.integers(256))


def mirrored(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(image[:, ::-1])


CHANGES: list[Callable[..., NDArray[np.uint8]]] = [noise, shuffled, cut, flat, mirrored]


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_frames_of_any_content_and_size_in_any_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = states_of(TEXT, LAYOUT, np.random.default_rng(0))
    receiver = Receiver(DECODER)
    images = [image for _, image, _ in Stream(size=(320, 240)).frames(states, 0.5, rng)]
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


DECODER = Decoder(MODEL)
