"""The page's onnxruntime gives the scores that Python's gives."""

import numpy as np
import pytest
from port import PortError, same
from tolerances import ONNX_SCORE

from export.runtime import Decoder
from link.embed import embed
from link.presets import PRESETS
from models import PRETRAINED_PILOTS

MODELS = {
    "robust": PRETRAINED_PILOTS / "24x32.onnx",
    "hidden": PRETRAINED_PILOTS / "48x64.onnx",
    "fast": PRETRAINED_PILOTS / "96x128.onnx",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_scores_are_those_of_python(name, port):
    rng, layout, model = np.random.default_rng(3), PRESETS[name].layout, MODELS[name]
    picture = np.tile(np.linspace(60, 190, layout.width), (layout.height, 1)).astype(np.uint8)
    shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, 2)
    pair = [
        (0.9 * frame + rng.normal(12, 2, frame.shape)).clip(0, 255).astype(np.uint8)
        for frame in (shown.original, shown.embedded)
    ]
    soft = Decoder(model, threads=1, time_limit_s=60).decode(*pair)
    found = port("export/decoder.js").Decoder(layout, model.read_bytes()).decode(*pair)
    same(found.scores, soft.scores, ONNX_SCORE)
    same(found.scores > 0, soft.scores > 0)
    same(found.head, soft.head, ONNX_SCORE)


@pytest.mark.slow
def test_a_graph_of_another_layout_is_refused_and_may_be_given_again(port):
    graphs = [MODELS[name].read_bytes() for name in ("robust", "hidden")]
    decoder = port("export/decoder.js").Decoder(PRESETS["robust"].layout, graphs[1])
    with pytest.raises(PortError, match="gives 2765 scores"):
        decoder.load()
    decoder.model = graphs[0]
    decoder.load()


def test_the_frames_of_a_pair_have_one_size(port):
    decoder = port("export/decoder.js").Decoder(PRESETS["robust"].layout, b"")
    with pytest.raises(PortError, match="one size"):
        decoder.decode(np.zeros((96, 128), np.uint8), np.zeros((48, 128), np.uint8))
