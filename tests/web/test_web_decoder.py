"""The page's onnxruntime gives the scores that Python's gives."""

import numpy as np
import pytest
from web_fixtures import run_node_tests, write_fixture

from export.runtime import Decoder
from export.web.tables import layout_table
from link.embed import embed
from link.presets import PRESETS
from models import PRETRAINED, PRETRAINED_PILOTS

MODELS = {
    "paper": PRETRAINED / "decoder.onnx",
    "robust": PRETRAINED_PILOTS / "24x32.onnx",
    "hidden": PRETRAINED_PILOTS / "48x64.onnx",
    "fast": PRETRAINED_PILOTS / "96x128.onnx",
}


@pytest.mark.slow
def test_scores_are_those_of_python(tmp_path):
    rng = np.random.default_rng(3)
    known = []
    for name, model in MODELS.items():
        layout = PRESETS[name].layout
        picture = np.tile(np.linspace(60, 190, layout.width), (layout.height, 1)).astype(np.uint8)
        shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, 2)
        pair = [
            (0.9 * frame + rng.normal(12, 2, frame.shape)).clip(0, 255).astype(np.uint8)
            for frame in (shown.original, shown.embedded)
        ]
        soft = Decoder(model, threads=1, time_limit_s=60).decode(*pair)
        known.append(
            {
                "model": str(model),
                "layout": layout_table(layout),
                "original": pair[0],
                "embedded": pair[1],
                "scores": soft.scores,
                "head": soft.head,
            }
        )
    write_fixture(tmp_path, "decoders", known)
    run_node_tests("decoder", tmp_path)
