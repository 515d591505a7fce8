import json
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from conftest import cases, refusal, run_process, slow
from numpy.typing import NDArray
from tolerances import ONNX_SCORE

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from export import to_onnx
from export.onnx_file import check_onnx_file
from export.parity import Parity, compare_with_torch
from export.runtime import FORMAT, Decoder
from export.watchdog import Watchdog
from link import __version__
from link.errors import InputError
from link.frames import Captured
from link.layout import Layout, make_layout
from link.observation import Observation
from link.types import Image
from models import PRETRAINED
from models.phi.checkpoint import load_checkpoint
from models.phi.config import FULL
from models.phi.decoder import PhiDecoder
from models.phi.methods import decode_with

UNSEEN_SEED = 7
SIZES = ((512, 384), (640, 480), (400, 331))
"""The exported size, a larger one, and one at which no block has a whole number of pixels."""


@pytest.fixture(scope="module")
def module(checkpoint: Path) -> PhiDecoder:
    return load_checkpoint(checkpoint).eval()


@pytest.fixture(scope="module")
def model(checkpoint: Path) -> bytes:
    return (checkpoint / "decoder.onnx").read_bytes()


@pytest.fixture(scope="module")
def shipped() -> Decoder:
    return Decoder(PRETRAINED / "decoder.onnx")


@pytest.fixture(scope="module")
def shipped_model() -> bytes:
    """The bytes of the shipped graph, for what is refused whatever the weights are."""
    return (PRETRAINED / "decoder.onnx").read_bytes()


@pytest.fixture(scope="module")
def unseen(layout: Layout) -> list[Observation]:
    """9 frame pairs of all nine pairs, a third at each size."""
    source = Source(layout, seed=UNSEEN_SEED)
    pairs = []
    for index in range(9):
        cell = Cell(list(PAIRS)[index], 5.0 * (index % 12), 1 + index % 6)
        width, height = SIZES[index // 3]
        captured = FramePair(source, cell, index).captured
        pairs.append(replace(captured, layout=replace(layout, width=width, height=height)))
    return [captured.rectified() for captured in pairs]


def batch(frames: list[Image]) -> Image:
    return np.ascontiguousarray(np.stack(frames).transpose(0, 3, 1, 2))


# Parity


@pytest.mark.parametrize("start", [0, slow(3), slow(6)])
def test_torch_and_onnxruntime_agree_on_a_batch(
    module: PhiDecoder, model: bytes, unseen: list[Observation], start: int
) -> None:
    pairs = unseen[start : start + 3]
    original, embedded = batch([p.original for p in pairs]), batch([p.embedded for p in pairs])
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    scores, head = session.run(["scores", "head"], {"original": original, "embedded": embedded})
    with torch.inference_mode():
        expected, expected_head = module(torch.from_numpy(original), torch.from_numpy(embedded))
    assert scores.shape == (3, module.layout.n_bits)
    assert head.shape == expected_head.shape
    np.testing.assert_allclose(scores, expected.numpy(), rtol=0, atol=ONNX_SCORE)
    assert np.array_equal(scores > 0, expected.numpy() > 0)
    alone = decode_with(module, pairs[2]).scores
    np.testing.assert_allclose(scores[2], alone, rtol=0, atol=ONNX_SCORE)


@pytest.mark.parametrize("level", [0, None], ids=["black", "picture"])
def test_torch_and_onnxruntime_agree_where_both_frames_are_the_same(
    module: PhiDecoder, onnx_decoder: Decoder, rectified: Observation, level: int | None
) -> None:
    frame = rectified.original if level is None else np.full((384, 512, 3), level, np.uint8)
    ours = decode_with(module, Observation.still(frame, frame, module.layout))
    theirs = onnx_decoder.decode(frame, frame)
    np.testing.assert_allclose(theirs.scores, ours.scores, rtol=0, atol=ONNX_SCORE)


def test_compare_reports_agreement(module: PhiDecoder, onnx_decoder: Decoder) -> None:
    parity = compare_with_torch(module, onnx_decoder, frames=6, seed=UNSEEN_SEED)
    assert parity.holds
    assert (parity.frames, parity.bits) == (6, 6 * module.layout.n_bits)
    assert parity.different_bits == 0
    assert 0 <= parity.max_difference <= ONNX_SCORE
    assert parity.median_score < 0.9 * parity.largest_score  # most scores are not at their bound


def test_compare_reports_another_checkpoint(layout: Layout, onnx_decoder: Decoder) -> None:
    parity = compare_with_torch(PhiDecoder(layout, FULL), onnx_decoder, frames=2, seed=UNSEEN_SEED)
    assert not parity.holds
    assert parity.max_difference > ONNX_SCORE


@cases(
    (Parity(1, 59, 0, 1e-5, 10.0, 5.0), True),
    (Parity(1, 59, 1, 1e-5, 10.0, 5.0), False),
    (Parity(1, 59, 0, 1e-2, 10.0, 5.0), False),
    (Parity(1, 59, 0, float("nan"), 10.0, 5.0), False),
)
def test_parity_needs_equal_bits_and_close_scores(parity: Parity, holds: bool) -> None:
    assert parity.holds is holds


def test_an_export_without_parity_leaves_no_file(
    layout: Layout, model: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(to_onnx, "PARITY_FRAMES", 1)
    monkeypatch.setattr(to_onnx, "to_onnx", lambda module, run_name, *_: model)
    untrained = PhiDecoder(layout, FULL)  # not what the model holds
    with pytest.raises(InputError, match="torch and onnxruntime disagree"):
        to_onnx.export(untrained, tmp_path / "decoder.onnx", "run")
    assert list(tmp_path.iterdir()) == []


def test_an_export_with_parity_leaves_the_model_alone(
    module: PhiDecoder, model: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(to_onnx, "PARITY_FRAMES", 1)
    monkeypatch.setattr(to_onnx, "to_onnx", lambda module, run_name, *_: model)
    parity = to_onnx.export(module, tmp_path / "decoder.onnx", "run")
    assert parity.holds
    assert [file.name for file in tmp_path.iterdir()] == ["decoder.onnx"]
    assert (tmp_path / "decoder.onnx").read_bytes() == model


# What the file carries


def test_the_metadata_configures_the_runtime(
    onnx_decoder: Decoder, module: PhiDecoder, layout: Layout, checkpoint: Path
) -> None:
    metadata = onnx_decoder.metadata
    assert onnx_decoder.layout == layout
    assert metadata["format"] == FORMAT
    if checkpoint != PRETRAINED:  # what ships says the version that exported it
        assert metadata["version"] == __version__
    assert metadata["run"] == checkpoint.name
    assert json.loads(metadata["layout"]) == layout.to_dict()
    assert json.loads(metadata["decoder"]) == asdict(FULL)
    assert json.loads(metadata["features"]) == module.phi.names


def test_no_local_path_leaks_into_the_model(model: bytes) -> None:
    for leak in (b"/work", b"/home", b"/tmp", b"site-packages", b".venv", b".py", b"Traceback"):
        assert leak not in model
    assert str(Path.cwd()).encode() not in model


def test_the_model_passes_the_checker_and_leaves_three_axes_free(model: bytes) -> None:
    proto = onnx.load_from_string(model)
    onnx.checker.check_model(proto, full_check=True)
    assert [value.name for value in proto.graph.input] == ["original", "embedded"]
    for value in proto.graph.input:
        assert value.type.tensor_type.elem_type == onnx.TensorProto.UINT8
        fixed = [dim.dim_value for dim in value.type.tensor_type.shape.dim]
        assert fixed == [0, 3, 0, 0]  # 0: free


# Damaged and foreign files

BARE = json.dumps(make_layout(ratex=0).to_dict())
"""A layout that the shipped graph does not have."""


def foreign_model(model: bytes) -> bytes:
    """A valid model that adds one to a number."""
    x, y = (
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1]) for name in ("x", "y")
    )
    one = onnx.helper.make_tensor("one", onnx.TensorProto.FLOAT, [1], [1.0])
    add = onnx.helper.make_node("Add", ["x", "one"], ["y"])
    graph = onnx.helper.make_graph([add], "increment", [x], [y], [one])
    proto = onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8
    )
    onnx.checker.check_model(proto)
    return bytes(proto.SerializeToString())


def with_metadata(**changes: str | None) -> Callable[[bytes], bytes]:
    """Damage a model by other metadata; None takes an entry out."""

    def damage(model: bytes) -> bytes:
        proto = onnx.load_from_string(model)
        metadata = {entry.key: entry.value for entry in proto.metadata_props} | changes
        del proto.metadata_props[:]
        onnx.helper.set_model_props(proto, {k: v for k, v in metadata.items() if v is not None})
        return bytes(proto.SerializeToString())

    return damage


def without_metadata(model: bytes) -> bytes:
    proto = onnx.load_from_string(model)
    del proto.metadata_props[:]
    return bytes(proto.SerializeToString())


DAMAGED: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "one byte short": (lambda model: model[:-1], "not a readable ONNX model"),
    "empty": (lambda model: b"", "not a "),
    "foreign": (foreign_model, "not a decoder of this version"),
    "no metadata": (without_metadata, "not a decoder of this version"),
    "other format": (with_metadata(format="999"), "not a decoder of this version"),
    "no layout": (with_metadata(layout=None), "carries no layout"),
    "broken layout": (with_metadata(layout="{"), "carries no layout"),
    "other layout": (with_metadata(layout=BARE), "gives 59 scores where its metadata says 64"),
    "no features": (with_metadata(features=None), "features are no list of names"),
    "other features": (with_metadata(features="[]"), "gives 7 weights where its metadata"),
    "deep layout": (with_metadata(layout="[" * 100_000), "32 deep"),
    "long number": (with_metadata(layout="9" * 5_000), "64 digits"),
    "Latin-1": (lambda model: model.replace(b"P1(i_o)", b"P\xff(i_o)"), ""),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_file_that_is_no_decoder_is_refused(
    case: str, shipped_model: bytes, tmp_path: Path
) -> None:
    damage, message = DAMAGED[case]
    path = tmp_path / "damaged.onnx"
    path.write_bytes(damage(shipped_model))
    assert path.read_bytes() != shipped_model
    assert message in refusal(lambda: Decoder(path))


def test_a_missing_file_is_refused_with_the_way_to_get_one(tmp_path: Path) -> None:
    assert "no such model; export one with" in refusal(lambda: Decoder(tmp_path / "none.onnx"))


IDENTITIES = (
    onnx.helper.make_node("Identity", ["s"], ["scores"]),
    onnx.helper.make_node("Identity", ["h"], ["head"]),
)
FLOAT, BOOL = onnx.TensorProto.FLOAT, onnx.TensorProto.BOOL


def described(name: str, kind: int, *shape: int | str) -> onnx.ValueInfoProto:
    return onnx.helper.make_tensor_value_info(name, kind, shape)


def handmade(
    model: bytes,
    nodes: Sequence[onnx.NodeProto] = IDENTITIES,
    constants: Mapping[str, NDArray] | None = None,
    scores: onnx.ValueInfoProto | None = None,
    head: onnx.ValueInfoProto | None = None,
) -> onnx.ModelProto:
    """A model with the metadata and the inputs of a decoder, and any graph and outputs."""
    values = {"s": np.zeros((1, 59), np.float32), "h": np.zeros((1, 7), np.float32)}
    graph = onnx.helper.make_graph(
        list(nodes),
        "handmade",
        [
            described(name, onnx.TensorProto.UINT8, "batch", 3, "height", "width")
            for name in ("original", "embedded")
        ],
        [scores or described("scores", FLOAT, "b", 59), head or described("head", FLOAT, "b", 7)],
        [onnx.numpy_helper.from_array(v, k) for k, v in (values | dict(constants or {})).items()],
    )
    opset = onnx.helper.make_opsetid("", 18)
    proto = onnx.helper.make_model(graph, opset_imports=[opset], ir_version=9)
    metadata = onnx.load_from_string(model).metadata_props
    onnx.helper.set_model_props(proto, {entry.key: entry.value for entry in metadata})
    return proto


def endless(model: bytes, body: Sequence[onnx.NodeProto], condition: str) -> onnx.ModelProto:
    """A model with a loop that never ends."""
    loop = onnx.helper.make_graph(
        list(body),
        "body",
        [
            described("i", onnx.TensorProto.INT64),
            described("go", BOOL),
            described("x", FLOAT, 1, 59),
        ],
        [described(condition, BOOL), described("x", FLOAT, 1, 59)],
    )
    node = onnx.helper.make_node("Loop", ["", "true", "s"], ["scores"], body=loop)
    return handmade(model, [node, IDENTITIES[1]], {"true": np.array(True)})


def decode_black(proto: onnx.ModelProto, path: Path) -> None:
    path.write_bytes(proto.SerializeToString())
    frame = np.zeros((384, 512, 3), np.uint8)
    Decoder(path, threads=1, time_limit_s=1.0).decode(frame, frame)


def test_a_handmade_model_decodes(shipped_model: bytes, tmp_path: Path) -> None:
    decode_black(handmade(shipped_model), tmp_path / "zeros.onnx")


@pytest.mark.parametrize("place", ["initializer", "subgraph", "address"])
def test_a_model_that_reads_another_file_is_refused(
    shipped_model: bytes, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(236))
    monkeypatch.chdir(tmp_path)  # where onnxruntime looks for files of a model without a path
    tensor = onnx.numpy_helper.from_array(np.zeros((1, 59), np.float32), "s")
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    location = "*/_ORT_MEM_ADDR_/*" if place == "address" else "secret.bin"
    for key, value in (("location", location), ("offset", "0"), ("length", "236")):
        tensor.external_data.add(key=key, value=value)
    constant = onnx.helper.make_node("Constant", [], ["s"], value=tensor)
    proto = handmade(shipped_model)
    del proto.graph.initializer[0]
    if place == "subgraph":
        inner = onnx.helper.make_graph([constant], "inner", [], [described("s", FLOAT, 1, 59)])
        branch = onnx.helper.make_node("If", ["true"], ["s"], then_branch=inner, else_branch=inner)
        proto.graph.node.insert(0, branch)
        proto.graph.initializer.append(onnx.numpy_helper.from_array(np.array(True), "true"))
    else:
        proto.graph.initializer.append(tensor)
    with pytest.raises(InputError, match="takes values from another file"):
        decode_black(proto, tmp_path / "thief.onnx")


SCALAR, NAN, INF = np.float32(1), np.full((1, 7), np.nan), np.full((1, 59), np.inf)
OUTPUTS: dict[str, tuple[dict[str, Any], dict[str, onnx.ValueInfoProto], str]] = {
    "scalar": ({"s": SCALAR}, {"scores": described("scores", FLOAT)}, "no valid scores"),
    "empty": ({"h": np.zeros((0, 7), np.float32)}, {}, "no valid scores"),
    "narrow": ({"h": np.zeros((1, 6), np.float32)}, {}, "gives 6 weights where its"),
    "nan": ({"h": NAN.astype(np.float32)}, {}, "no valid scores"),
    "inf": ({"s": INF.astype(np.float32)}, {}, "no valid scores"),
    "float64": ({"s": INF}, {"scores": described("scores", 11, 1, 59)}, "no valid scores"),
    "sequence": (
        {},
        {"scores": onnx.helper.make_tensor_sequence_value_info("scores", FLOAT, None)},
        "no valid scores",
    ),
}
"""Constants and outputs of a handmade model that no decoder has, and what is said of it."""


@pytest.mark.parametrize("case", OUTPUTS)
def test_outputs_of_another_kind_are_refused(
    case: str, shipped_model: bytes, tmp_path: Path
) -> None:
    constants, outputs, message = OUTPUTS[case]
    constants = {name: np.asarray(value) for name, value in constants.items()}
    nodes = list(IDENTITIES)
    if case == "sequence":
        nodes[0] = onnx.helper.make_node("SequenceConstruct", ["s"], ["scores"])
    proto = handmade(shipped_model, nodes, constants, **outputs)
    assert message in refusal(lambda: decode_black(proto, tmp_path / "odd.onnx"))


def test_a_model_that_asks_for_12_gigabytes_is_refused(
    shipped_model: bytes, tmp_path: Path
) -> None:
    nodes = [
        onnx.helper.make_node("ConstantOfShape", ["n"], ["many"]),
        onnx.helper.make_node("ReduceSum", ["many"], ["sum"], keepdims=0),
        onnx.helper.make_node("Add", ["s", "sum"], ["scores"]),
        IDENTITIES[1],
    ]
    with pytest.raises(InputError, match="failed to run"):
        decode_black(
            handmade(shipped_model, nodes, {"n": np.array([3 * 10**9])}), tmp_path / "big.onnx"
        )


@pytest.mark.slow
def test_a_file_of_a_million_empty_graphs_is_refused_at_once() -> None:
    with pytest.raises(InputError, match="more than 500000 fields"):
        check_onnx_file(b"\x3a\x00" * 10**6)


@pytest.mark.parametrize("kind", ["sparse", "domain", "text"])
def test_what_no_decoder_needs_is_refused(shipped_model: bytes, kind: str, tmp_path: Path) -> None:
    proto = handmade(shipped_model)
    if kind == "sparse":
        values = onnx.numpy_helper.from_array(np.ones(1, np.float32), "s")
        indices = onnx.numpy_helper.from_array(np.zeros(1, np.int64), "")
        proto.graph.sparse_initializer.append(
            onnx.helper.make_sparse_tensor(values, indices, [10**6, 10**6])
        )
    elif kind == "domain":
        proto.graph.node[0].domain = "ai.onnx.ml"
    else:
        proto.graph.node[0].op_type = "StringConcat"
    with pytest.raises(InputError, match=r"sparse tensors|operators from|has the operator"):
        decode_black(proto, tmp_path / "odd.onnx")


@pytest.mark.slow
def test_a_loop_without_end_is_stopped(shipped_model: bytes, tmp_path: Path) -> None:
    body = [onnx.helper.make_node("Identity", ["go"], ["on"])]
    with pytest.raises(InputError, match=r"the model took more than 1.2 s; it is stopped"):
        decode_black(endless(shipped_model, body, "on"), tmp_path / "endless.onnx")


@pytest.mark.slow
def test_a_loop_that_cannot_be_stopped_ends_the_process_with_one_line(
    shipped_model: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "endless.onnx"
    without_end = endless(shipped_model, [], "go")  # no node asks whether to stop
    path.write_bytes(without_end.SerializeToString())
    script = (
        "import sys, numpy as np\nfrom export.runtime import Decoder\n"
        "frame = np.zeros((384, 512, 3), np.uint8)\n"
        "Decoder(sys.argv[1], 1, time_limit_s=0.5).decode(frame, frame)"
    )
    done = run_process(sys.executable, "-c", script, path, status=2, limit_s=30)
    assert done.stderr == (
        "error: the model takes too long and cannot be stopped; the process ends\n"
    )


def test_work_that_ends_in_time_is_left_alone_and_late_work_is_asked_to_stop() -> None:
    watchdog, asked = Watchdog(), threading.Event()
    with watchdog.limit(30.0, asked.set, "quick work"):
        pass
    with watchdog.limit(0.1, asked.set, "slow work"):  # sooner than the timer that runs already
        assert asked.wait(5)
    asked.clear()
    for _ in range(3):
        with watchdog.limit(0.2, asked.set, "quick work"):
            pass
    assert not asked.wait(0.5)


def flipped(model: bytes, seed: int) -> bytes:
    """One to four bits flipped anywhere in the file."""
    rng = np.random.default_rng(seed)
    damaged = bytearray(model)
    for place in rng.integers(0, len(model), rng.integers(1, 5)):
        damaged[place] ^= 1 << int(rng.integers(0, 8))
    return bytes(damaged)


@pytest.mark.parametrize("seed", range(15))
def test_flipped_bits_leave_a_working_decoder_or_an_input_error(
    seed: int, shipped_model: bytes, rectified: Observation, tmp_path: Path
) -> None:
    path = tmp_path / "flipped.onnx"
    path.write_bytes(flipped(shipped_model, seed))
    try:
        soft = Decoder(path, threads=1).decode(rectified.original, rectified.embedded)
    except InputError as error:
        assert str(error)
    else:
        assert np.isfinite(soft.scores).all()


# decode


def test_gray_frames_decode_as_their_rgb_twins(shipped: Decoder, rectified: Observation) -> None:
    gray = [
        cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        for frame in (rectified.original, rectified.embedded)
    ]
    rgb = [np.repeat(frame[:, :, None], 3, axis=2) for frame in gray]
    plain, repeated = shipped.decode(*gray), shipped.decode(*rgb)
    assert np.array_equal(plain.scores, repeated.scores)
    assert plain.head is not None
    assert np.array_equal(plain.head, repeated.head)


def test_decode_does_not_depend_on_the_memory_layout(
    shipped: Decoder, rectified: Observation
) -> None:
    strided = [np.asfortranarray(frame) for frame in (rectified.original, rectified.embedded)]
    expected = shipped.decode(rectified.original, rectified.embedded)
    assert np.array_equal(shipped.decode(*strided).scores, expected.scores)


def test_decode_with_corners_is_rectifying_first(onnx_decoder: Decoder, captured: Captured) -> None:
    pair = captured.rectified()
    with_corners = onnx_decoder.decode(captured.original, captured.embedded, captured.corners)
    assert np.array_equal(
        with_corners.scores, onnx_decoder.decode(pair.original, pair.embedded).scores
    )
    assert np.mean(with_corners.bits == captured.bits) > 0.8


def test_the_embedded_frame_may_have_its_own_corners(
    onnx_decoder: Decoder, captured: Captured
) -> None:
    moved = replace(
        captured,
        embedded=np.roll(captured.embedded, 7, axis=1),
        corners_embedded=captured.corners + np.array([7.0, 0.0]),
    )
    expected = moved.rectified()
    soft = onnx_decoder.decode(
        moved.original, moved.embedded, moved.corners, moved.corners_embedded
    )
    again = onnx_decoder.decode(expected.original, expected.embedded)
    assert np.array_equal(soft.scores, again.scores)
    wrong = onnx_decoder.decode(moved.original, moved.embedded, moved.corners)
    assert not np.array_equal(soft.scores, wrong.scores)


FRAME = np.zeros((384, 512, 3), np.uint8)


@cases(
    (FRAME.astype(np.float32), FRAME, "must be uint8"),
    (FRAME, FRAME.astype(np.int16), "must be uint8"),
    (FRAME[None], FRAME[None], "must be uint8"),
    (np.zeros((384, 512, 4), np.uint8), np.zeros((384, 512, 4), np.uint8), "must be uint8"),
    (FRAME, FRAME[:, :-1], "512x384 and embedded is 511x384"),
    (FRAME, FRAME[..., 0], "original is"),
    (FRAME[:31], FRAME[:31], "512x31 frame is too small for 8x8 blocks"),
)
def test_frames_of_wrong_type_shape_or_size_are_refused(
    original: NDArray, embedded: NDArray, message: str, shipped: Decoder
) -> None:
    assert message in refusal(lambda: shipped.decode(original, embedded))


def test_the_smallest_frame_that_fits_is_decoded(
    onnx_decoder: Decoder, module: PhiDecoder, captured: Captured
) -> None:
    pair = replace(captured, layout=replace(module.layout, width=32, height=32)).rectified()
    soft = onnx_decoder.decode(pair.original, pair.embedded)
    np.testing.assert_allclose(
        soft.scores, decode_with(module, pair).scores, rtol=0, atol=ONNX_SCORE
    )


def test_captured_frames_of_two_sizes_are_refused(shipped: Decoder, captured: Captured) -> None:
    with pytest.raises(InputError, match="one camera at one size"):
        shipped.decode(captured.original, captured.embedded[:-1], captured.corners)
