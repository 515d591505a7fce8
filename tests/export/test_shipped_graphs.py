"""The graphs that ship are those of the presets, and decide as the checkpoints in torch do."""

from pathlib import Path

import numpy as np
import onnx
import pytest

from data_gen.frame_pair import Cell, FramePair, Source
from export.runtime import Decoder
from link.layout import Layout
from link.presets import PRESETS
from models import FILM_GRAPH, PRETRAINED, PRETRAINED_PILOTS, shipped_checkpoint, shipped_graphs
from models.phi.checkpoint import load_checkpoint
from models.phi.methods import decode_with

GRAPHS = list(shipped_graphs().values())


def test_there_is_a_graph_for_each_preset() -> None:
    assert GRAPHS[0] == PRETRAINED / "decoder.onnx"
    assert set(shipped_graphs()) == {preset.layout for preset in PRESETS.values()}
    assert len(set(GRAPHS)) == len(GRAPHS) == len({p.layout for p in PRESETS.values()})
    assert set(GRAPHS[1:]) == set(PRETRAINED_PILOTS.glob("*.onnx"))  # no other ships
    assert all(graph.is_file() for graph in GRAPHS)
    assert [graph.stem for graph in GRAPHS[1:]] == sorted(
        f"{preset.layout.rows}x{preset.layout.cols}"
        for preset in PRESETS.values()
        if preset.layout.pilots
    )


def test_scans_of_the_film_decoder_turn_no_tensors_around() -> None:
    nodes = list(onnx.load(FILM_GRAPH).graph.node)
    for node in nodes:  # grows by the nodes of subgraphs
        nodes += [inner for each in node.attribute for inner in each.g.node]
    assert not [node.name for node in nodes if "flip" in node.name]
    ways = [a.ints[0] for n in nodes for a in n.attribute if a.name == "scan_input_directions"]
    assert set(ways) == {0, 1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("layout", "graph"), shipped_graphs().items(), ids=[graph.stem for graph in GRAPHS]
)
def test_a_shipped_graph_reads_a_preset_as_torch_does(layout: Layout, graph: Path) -> None:
    decoder = Decoder(graph, time_limit_s=60.0)
    assert decoder.layout == layout
    assert decoder.layout.code == layout.code
    assert layout in [preset.layout for preset in PRESETS.values()]
    pair = FramePair(Source(layout), Cell("canon-lg", 0.0, 3), 0).captured.rectified()
    module = load_checkpoint(shipped_checkpoint(layout), layout).eval()
    expected, found = decode_with(module, pair), decoder.decode(pair.original, pair.embedded)
    np.testing.assert_allclose(found.scores, expected.scores, atol=2e-2)
    clear = np.abs(expected.scores) > 1e-2
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(found.bits[clear], expected.bits[clear])
