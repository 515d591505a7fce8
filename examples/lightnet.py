"""A plain convolutional network on two frames, after DeepLight's LightNet, with its training.

It knows nothing of the channel, and calibrates on no patches or pilots: it sees both frames of a
pair, scaled to `CELL` pixels a block, and gives each block a score. So it shows what the decoders
of this project are worth, and how a decoder of one's own enters the benchmark:

    python -m examples.lightnet
    python evaluate.py --benchmark --methods examples.lightnet:LightNet oorc learned
"""

import json
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import torch
import tyro
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import trange

from data_gen.episodes import EpisodePlan, EpisodeSet, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.cli import run_cli
from link.errors import InputError
from link.frames import SoftBits
from link.images import intensity, write_bytes
from link.layout import Layout
from link.observation import Observation
from link.presets import PRESETS
from link.types import Image
from models import Card

CELL = 8
"""Width and height of a block as the network sees it, pixels."""
FOLDER = Path("runs/lightnet")
"""Folder of the trained weights, decoder.pt, and of the settings of the training, config.json."""
SHOWN = ("paper", "hidden")
"""Presets on whose grids the network is trained."""


def make_network() -> nn.Sequential:
    """Build the network: (N, 3, CELL rows, CELL cols) to (N, 1, rows, cols) scores."""
    layers: list[nn.Module] = []
    for inside, outside, stride in ((3, 24, 2), (24, 32, 2), (32, 48, 2), (48, 48, 1)):
        layers += [nn.Conv2d(inside, outside, 3, stride, 1), nn.BatchNorm2d(outside), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(48, 1, 1))


def network_input(original: Image, embedded: Image, layout: Layout) -> Tensor:
    """Scale both frames: (3, CELL rows, CELL cols) of their mean, their change, and the modulation.

    Args:
        original: an `Image`, the rectified original frame.
        embedded: an `Image` of the shape of ``original``.
        layout: grid that the frames show.
    """
    size = CELL * layout.cols, CELL * layout.rows
    first, second = (
        cv2.resize(np.asarray(intensity(frame), np.float32), size, interpolation=cv2.INTER_AREA)
        for frame in (original, embedded)
    )
    kind = np.full_like(first, float(layout.modulation == "antipodal"))
    return torch.from_numpy(np.stack([(first + second) - 1, 32 * (second - first), kind]))


@lru_cache(maxsize=2)
def load_network(folder: Path) -> nn.Sequential:
    """Load the trained network.

    Raises:
        InputError: it was not trained yet.
    """
    if not (folder / "decoder.pt").is_file():
        raise InputError(f"{folder} holds no network; first python -m examples.lightnet")
    network = make_network()
    network.load_state_dict(torch.load(folder / "decoder.pt", weights_only=True))
    return network.eval()


@dataclass(frozen=True)
class LightNet:
    """The trained network as a decoder of frame pairs; films reach it pair by pair."""

    checkpoint: Path = FOLDER
    """Folder of the trained weights."""
    card = Card("examples.lightnet:LightNet", "#55606e", "P", llr=True, checkpoint=lambda _: FOLDER)
    """Entry of the decoder in reports: inputs, colour and marker."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block by its log-odds."""
        seen = network_input(pair.original, pair.embedded, pair.layout)
        with torch.no_grad():
            scores = load_network(self.checkpoint)(seen[None])[0, 0].double().numpy()
        return SoftBits(scores[pair.layout.message_mask])


@dataclass(frozen=True)
class Training:
    """Train the network on simulated frame pairs of training pictures."""

    episodes: int = 90
    """Number of frame pairs of each grid."""
    steps: int = 600
    """Number of the optimiser's steps, on the grids by turns."""
    batch: int = 16
    """Number of frame pairs in a step, of fewer where the grid is fine."""
    jobs: int = 2
    """Number of processes that simulate."""


def train(settings: Training) -> None:
    """Simulate, train, and write the weights to `FOLDER`."""
    torch.manual_seed(0)
    sets = []
    for name in SHOWN:
        layout = PRESETS[name].layout
        plan = EpisodePlan(settings.episodes, (1, 2, 3, 5), 60.0)
        episodes = simulate_episodes(Source(layout, "train"), tuple(PAIRS), plan, settings.jobs)
        sets.append((layout, *as_inputs(episodes, layout)))
    network = make_network()
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.steps)
    for step in (bar := trange(settings.steps, desc="train", unit="step")):
        layout, inputs, sent = sets[step % len(sets)]
        size = max(2, min(settings.batch, settings.batch * 1000 // (layout.rows * layout.cols)))
        chosen = torch.randint(len(inputs), (size,))
        scores = network(inputs[chosen])[:, 0, layout.message_mask]
        loss = binary_cross_entropy_with_logits(scores, sent[chosen])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
        bar.set_postfix(loss=f"{loss.item():.3f}")
    FOLDER.mkdir(parents=True, exist_ok=True)
    torch.save(network.state_dict(), FOLDER / "decoder.pt.part")
    (FOLDER / "decoder.pt.part").replace(FOLDER / "decoder.pt")
    write_bytes(FOLDER / "config.json", json.dumps(asdict(settings)).encode())


def as_inputs(episodes: EpisodeSet, layout: Layout) -> tuple[Tensor, Tensor]:
    """Give the network's inputs for all frame pairs, and their bits as float."""
    frames = (each.permute(0, 2, 3, 1).numpy() for each in (episodes.original, episodes.embedded))
    inputs = [network_input(first, second, layout) for first, second in zip(*frames, strict=True)]
    return torch.stack(inputs), episodes.bits.float()


if __name__ == "__main__":
    run_cli(lambda: train(tyro.cli(Training)))
