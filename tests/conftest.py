"""What several tests need, made once a session."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from hypothesis import settings

import train
from data_gen.frame_pair import Cell, Source, simulate
from export.runtime import Decoder
from link.errors import run_cli
from link.frames import Captured, Rectified
from link.layout import Layout, make_layout
from models.neural.decoder import FULL

settings.register_profile("suite", deadline=None, derandomize=True)  # the same on every machine
settings.load_profile("suite")

LEARNED = FULL


torch.set_num_threads(
    1
)  # the suite's tensors are small, and threads on 2 cores wait for each other


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


TINY = ["--pair", "canon-lg", "--episodes", "6", "--rounds", "2", "--steps", "3", "--lr", "0.1"]
TINY += ["--frames", "1", "--jobs", "1"]


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What train.py leaves behind; every parameter has moved by up to half."""
    folder = tmp_path_factory.mktemp("runs") / "canon-lg"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["train.py", *TINY, "--out", str(folder)])
        train.main()
    return folder


@pytest.fixture(scope="session")
def onnx_decoder(run_folder: Path) -> Decoder:
    return Decoder(run_folder / "decoder.onnx")


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    status: int
    stdout: str
    stderr: str


Command = Callable[..., Finished]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run a script's ``main`` in this process, as its last two lines do."""

    def run(main: Callable[[], None], *arguments: object) -> Finished:
        monkeypatch.setattr(sys, "argv", ["program", *map(str, arguments)])
        capsys.readouterr()
        status = 0
        try:
            run_cli(main)
        except SystemExit as end:
            status = int(end.code or 0)
        return Finished(status, *capsys.readouterr())

    return run
