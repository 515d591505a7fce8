"""Export a checkpoint as decoder.onnx with its layout inside: python -m export.to_onnx RUN."""

import json
import logging
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import onnx
import torch
import tyro
from onnxscript.values import Opset
from torch.onnx._internal.exporter import _ir_passes

from export.film_graph import FILM_FORMAT, FilmGraph
from export.parity import Parity, compare_films, compare_regions, compare_with_torch
from export.region_graph import REGION_FORMAT, RegionGraph
from export.runtime import FORMAT, Decoder
from link import __version__
from link.cli import check_flags, run_cli
from link.errors import InputError, ParameterError
from link.files.lock import locked
from link.images import replaced
from link.layout import MAX_SIDE_PX, MIN_BLOCK_PX, make_layout, read_layout
from link.observation import SLOTS
from link.outside import is_no_file
from link.presets import PRESETS
from models import PRETRAINED, PRETRAINED_PILOTS, shipped_checkpoint
from models.film.decoder import FilmDecoder
from models.film.window import LEAST_SIDE, SHRINK
from models.phi.checkpoint import load_checkpoint, read_config
from models.phi.decoder import PhiDecoder
from models.region import LEAST_PX
from models.region.region import DisplayRegion

INVERSE = onnx.defs.OpSchema(
    "Inverse",
    "com.microsoft",
    1,
    inputs=[onnx.defs.OpSchema.FormalParameter("X", "T")],
    outputs=[onnx.defs.OpSchema.FormalParameter("Y", "T")],
    type_constraints=[("T", ["tensor(double)"], "")],
)
"""Operator that inverts matrices; onnxruntime has it. ONNX itself has no solver, and elimination
written in ONNX took 6 ms."""


OPSET = 18
"""Version of ONNX's operators: the one that torch writes without converting, in which loops within
loops are right, and which older versions of onnxruntime have, too."""
PARITY_FRAMES = 30
"""Number of synthetic frame pairs on which torch and onnxruntime must agree after an export."""
BODIES = "pkg.torch.__subgraph__"
"""Domain of the bodies of loops, which torch writes as functions."""
_note_own_version = _ir_passes._maybe_set_opset_version


def _note_version(versions: dict[str, int], domain: str, version: int | None) -> None:
    """Note the version of a domain's operators; that of loops' bodies is 1 throughout.

    torch gives those of loops within loops another one than the model, and then cannot put them in
    their places.
    """
    _note_own_version(versions, domain, 1 if domain == BODIES else version)


def _inverse(A: Any) -> Any:
    return Opset(INVERSE.domain, 1).Inverse(A)


def _sum_pixels(frame: Any, weights: Any, stride: int) -> Any:
    opset = Opset("", OPSET)
    total = opset.ConvInteger(frame, weights, strides=[stride, stride])
    return opset.Cast(total, to=onnx.TensorProto.FLOAT)


def _stride(tensor: Any, axis: int) -> Any:
    """Tell the stride of a tensor along an axis; torch asks only for those of whole tensors."""
    opset = Opset("", OPSET)
    return opset.ReduceProd(opset.Shape(tensor, start=axis + 1), keepdims=0)


def to_onnx(module: PhiDecoder, run_name: str, training: Mapping[str, Any] | None = None) -> bytes:
    """Turn the decoder into an ONNX model that fits the head itself.

    Batch, height and width are free. The metadata holds the layout.

    Args:
        module: the decoder in torch, of any layout.
        run_name: name of the training run, kept in the metadata.
        training: settings of the training run, in JSON's types, kept in the metadata.

    Returns:
        the bytes of the .onnx file.
    """
    layout = module.layout
    example = torch.zeros((2, 3, layout.height, layout.width), dtype=torch.uint8)
    free = {
        0: torch.export.Dim("batch", min=1, max=1024),
        2: torch.export.Dim("height", min=layout.rows * MIN_BLOCK_PX, max=MAX_SIDE_PX),
        3: torch.export.Dim("width", min=layout.cols * MIN_BLOCK_PX, max=MAX_SIDE_PX),
    }
    frames = {"original": example, "embedded": example.clone()}
    model = _translate(module, frames, (free, free), ["scores", "head"])
    metadata = {
        "format": FORMAT,
        "layout": json.dumps(layout.to_dict()),
        "decoder": json.dumps(asdict(module.config)),
        "features": json.dumps(module.phi.names),
        "run": run_name,
        "training": json.dumps(dict(training or {})),
        "version": __version__,
    }
    return _finished(model, metadata)


def film_to_onnx(module: FilmDecoder) -> bytes:
    """Turn the film decoder into an ONNX model; frames, pairs and the grid are free.

    Args:
        module: the decoder in torch.

    Returns:
        the bytes of the .onnx file.
    """
    layout = PRESETS["robust"].layout
    size = layout.height // SHRINK, layout.width // SHRINK
    dims = torch.export.Dim
    frames, pairs = dims("frames", min=4, max=256), dims("pairs", min=2, max=256)
    slots = dims("slots", min=2, max=SLOTS)
    rows, cols = (dims(name, min=LEAST_SIDE, max=1024) for name in ("rows", "cols"))
    height, width = (dims(name, min=32, max=MAX_SIDE_PX) for name in ("height", "width"))
    example = {
        "frames": torch.zeros(12, 1, *size),
        "seen": torch.ones(12, layout.rows, layout.cols),
        "known": torch.zeros(layout.rows, layout.cols),
        "shares": torch.zeros(12, SLOTS, layout.rows, layout.cols),
        "pair": torch.zeros(12, SLOTS, dtype=torch.int64),
        "pairs": torch.arange(5),
    }
    free: tuple[dict[int, Any], ...] = (
        {0: frames, 2: height, 3: width},
        {0: frames, 1: rows, 2: cols},
        {0: rows, 1: cols},
        {0: frames, 1: slots, 2: rows, 3: cols},
        {0: frames, 1: slots},
        {0: pairs},
    )
    model = _translate(module, example, free, ["scores"])
    _scan_backwards(model.graph)
    return _finished(model, {"format": FILM_FORMAT, "version": __version__})


def region_to_onnx(module: DisplayRegion) -> bytes:
    """Turn the map of displays into an ONNX model; the frames' number and size are free.

    The weights of its convolutions are kept as float16, to which training has rounded them.

    Args:
        module: the map in torch.

    Returns:
        the bytes of the .onnx file.
    """
    dims = torch.export.Dim
    frames = dims("frames", min=3, max=256)
    height, width = (dims(name, min=LEAST_PX, max=MAX_SIDE_PX) for name in ("height", "width"))
    example = {"frames": torch.zeros(13, 1, 360, 640)}
    model = _translate(module, example, ({0: frames, 2: height, 3: width},), ["log_odds"])
    _halve_weights(model.graph)
    return _finished(model, {"format": REGION_FORMAT, "version": __version__})


def _translate(
    module: torch.nn.Module,
    example: Mapping[str, torch.Tensor],
    free: tuple[dict[int, Any], ...],
    outputs: list[str],
) -> onnx.ModelProto:
    """Translate a module into ONNX, by example inputs and the sizes of theirs that are free."""
    if not onnx.defs.has("Inverse", domain=INVERSE.domain):
        onnx.defs.register_schema(INVERSE)
    for name in ("torch.onnx", "torch.export"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    # torch's cache of tensor shapes is slower than the shapes themselves where sizes are free
    uncached = torch._dynamo.config.patch(fake_tensor_cache_enabled=False)
    agreed = patch.object(_ir_passes, "_maybe_set_opset_version", _note_version)
    with warnings.catch_warnings(), uncached, agreed:
        warnings.simplefilter("ignore")  # of torch's own deprecations
        captured = torch.export.export(
            module.eval(),
            tuple(example.values()),
            dynamic_shapes=free,
            prefer_deferred_runtime_asserts_over_guards=True,
        )
        program = torch.onnx.export(
            captured,
            dynamic_shapes=free,  # for the names of the free sizes
            input_names=list(example),
            output_names=outputs,
            dynamo=True,
            custom_translation_table={
                torch.ops.camera_display.inverse.default: _inverse,
                torch.ops.camera_display.sum_pixels.default: _sum_pixels,
                torch.ops.aten.sym_stride.int: _stride,
            },
            opset_version=OPSET,
            verbose=False,
        )
    assert program is not None
    return program.model_proto


def _scan_backwards(graph: onnx.GraphProto) -> None:
    """Let scans that begin with the last slice do so themselves, subgraphs included.

    torch turns their inputs around before and their outputs after them, each time in a new tensor.
    """
    turns = [node for node in graph.node if node.name.startswith("node_flip")]
    before = {turn.output[0]: turn.input[0] for turn in turns}
    after = {turn.input[0]: turn.output[0] for turn in turns}
    needless: set[str] = set()
    for node in graph.node:
        attributes = {attribute.name: attribute for attribute in node.attribute}
        if "body" in attributes:
            _scan_backwards(attributes["body"].g)
        if node.op_type != "Scan":
            continue
        ways = [attributes[f"scan_{side}_directions"].ints for side in ("input", "output")]
        slices, stacked = (-len(way) for way in ways)
        if all(name in before for name in node.input[slices:]):
            needless.update(node.input[slices:])
            node.input[slices:] = [before[name] for name in node.input[slices:]]
            node.output[stacked:] = [after[name] for name in node.output[stacked:]]
            needless.update(node.output[stacked:])
            for way in ways:
                way[:] = [1] * len(way)
    for turn in turns:
        if turn.output[0] in needless:
            graph.node.remove(turn)


def _halve_weights(graph: onnx.GraphProto) -> None:
    """Keep the weights of convolutions in float16, which halves the file.

    onnxruntime makes them float32 when it loads the graph, so that all is computed as before.
    """
    for weights in graph.initializer:
        if len(weights.dims) == 4:
            name, values = weights.name, onnx.numpy_helper.to_array(weights)
            kept = onnx.numpy_helper.from_array(values.astype(np.float16), f"{name}.float16")
            weights.CopyFrom(kept)
            cast = onnx.helper.make_node("Cast", [kept.name], [name], to=onnx.TensorProto.FLOAT)
            graph.node.insert(0, cast)


def _finished(model: onnx.ModelProto, metadata: dict[str, str]) -> bytes:
    """Strip a model of torch's traces, give it its metadata, and check it."""
    _strip_traces(model.graph)
    onnx.helper.set_model_props(model, metadata)
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def _strip_traces(graph: onnx.GraphProto) -> None:
    """Drop the source lines that torch attaches to every node and value, subgraphs included."""
    for value in (*graph.value_info, *graph.input, *graph.output, *graph.initializer, graph):
        del value.metadata_props[:]
    for node in graph.node:
        del node.metadata_props[:]
        for attribute in node.attribute:
            if attribute.type == onnx.AttributeProto.GRAPH:
                _strip_traces(attribute.g)


def export(
    module: PhiDecoder,
    path: Path,
    run_name: str,
    training: Mapping[str, Any] | None = None,
) -> Parity:
    """Write an .onnx file once its parity with torch is shown.

    Args:
        module: the decoder in torch.
        path: the .onnx file.
        run_name: name of the training run, kept in the metadata.
        training: settings of the training run, in JSON's types, kept in the metadata.

    Returns:
        what the comparison found.

    Raises:
        InputError: torch and onnxruntime disagree; nothing is left under that name.
    """
    data = to_onnx(module, run_name, training)
    return _write_checked(
        path, data, lambda file: compare_with_torch(module, Decoder(file), PARITY_FRAMES, seed=1)
    )


def export_film(module: FilmDecoder, path: Path) -> Parity:
    """Write the .onnx file of the film decoder once its parity with torch is shown.

    Args:
        module: the decoder in torch.
        path: the .onnx file.

    Raises:
        InputError: torch and onnxruntime disagree; nothing is left under that name.
    """
    data = film_to_onnx(module)
    return _write_checked(path, data, lambda file: compare_films(module, FilmGraph(file)))


def export_region(module: DisplayRegion, path: Path) -> Parity:
    """Write the .onnx file of the map of displays once its parity with torch is shown.

    Args:
        module: the map in torch.
        path: the .onnx file.

    Raises:
        InputError: torch and onnxruntime disagree; nothing is left under that name.
    """
    data = region_to_onnx(module)
    return _write_checked(path, data, lambda file: compare_regions(module, RegionGraph(file)))


def _write_checked(path: Path, data: bytes, compare: Callable[[Path], Parity]) -> Parity:
    """Write a model under a temporary name, and rename it if it agrees with torch."""
    with replaced(path) as candidate:
        candidate.write_bytes(data)
        parity = compare(candidate)
        if not parity.holds:
            raise InputError(f"{path}: torch and onnxruntime disagree ({asdict(parity)})")
    return parity


@dataclass(frozen=True)
class ExportConfig:
    """Export a run's checkpoint."""

    run: tyro.conf.Positional[Path | None] = None
    """Folder with decoder.pt and config.json, such as runs/canon-lg; where absent, the checkpoint
    that ships for the layout."""
    layout: Path | None = None
    """JSON file with a layout (docs/formats.md); the run's own layout where absent."""
    out: Path | None = None
    """The .onnx file; RUN/decoder.onnx where absent, but for a checkpoint that ships."""


def main() -> None:
    """Export, check parity, and say so."""
    config = check_flags(tyro.cli(ExportConfig, prog="python -m export.to_onnx"))
    layout = read_layout(config.layout) if config.layout else None
    run = config.run or shipped_checkpoint(layout or make_layout())
    if config.out is None and run.resolve() in (PRETRAINED.resolve(), PRETRAINED_PILOTS.resolve()):
        raise ParameterError("out", f"{run} ships as it is; name the new .onnx file")
    path = config.out or run / "decoder.onnx"
    if is_no_file(path):
        raise ParameterError("out", f"{path} is a folder or a device; name a file")
    module, training = load_checkpoint(run, layout), read_config(run).get("train")
    with locked(path.parent, path.name):
        parity = export(module, path, run.name, training)
    print(json.dumps({"model": str(path), **asdict(parity)}))


if __name__ == "__main__":
    run_cli(main)
