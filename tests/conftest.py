"""What several tests need, made once a session."""

from pathlib import Path

import pytest
import torch

from data_gen.dataset import Cell, Source, simulate
from export.runtime import Decoder
from export.to_onnx import to_onnx
from link.frames import Captured, Rectified
from link.layout import Layout, make_layout
from models.neural.checkpoint import save_checkpoint
from models.neural.decoder import DecoderConfig, PhiDecoder

LEARNED = DecoderConfig(drift_degree=4, channels="rgb", register=True)


@pytest.fixture(scope="session")
def layout() -> Layout:
    return make_layout()


@pytest.fixture(scope="session")
def captured(layout: Layout) -> Captured:
    """One simulated frame pair, canon-lg, 45 degrees, kappa 5."""
    return simulate(Source(layout), Cell("canon-lg", 45.0, 5), 0)


@pytest.fixture(scope="session")
def rectified(captured: Captured) -> Rectified:
    return captured.rectified()


@pytest.fixture(scope="session")
def run_folder(layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run: checkpoint with perturbed parameters, and its decoder.onnx."""
    folder = tmp_path_factory.mktemp("runs") / "canon-lg"
    module = PhiDecoder(layout, LEARNED)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=generator)
    save_checkpoint(folder, module, {})
    (folder / "decoder.onnx").write_bytes(to_onnx(module, folder.name))
    return folder


@pytest.fixture(scope="session")
def onnx_decoder(run_folder: Path) -> Decoder:
    return Decoder(run_folder / "decoder.onnx")
