"""Try a network that weighs pixels: python -m reports.lab.pixel_network --out DIR.

A small convolutional network looks at every pixel of the registered frames and their surroundings.
It gives the pixel a weight in the mean of its block, and the change of intensity that it expects
there whatever the bit. Both enter the shipped decoder of layouts with pilots, and are trained
through its per-frame solver. The network starts as nothing: its weights are the decoder's own, and
it expects no change.

Three decoders read the same held-out frame pairs: the shipped one, the shipped one trained further
on the same batches, and the one with the network. Writes results.json and a block of
docs/hidden.md.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time
from typing import Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm, trange

from data_gen.channel.optics import check_view
from data_gen.episodes import EpisodePlan, augmented_features, simulate_episodes
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from export.parity import synthetic_pair
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from export.to_onnx import to_onnx
from link.cli import read_flags, run_cli
from link.embed import check_kappa
from link.errors import InputError, at_least, each_once
from link.images import as_batch, make_folder, write_bytes
from link.layout import Layout, make_layout
from models import PRETRAINED_PILOTS
from models.neural.checkpoint import load_checkpoint
from models.neural.config import DecoderConfig
from models.neural.decoder import PhiDecoder
from models.neural.methods import decode_with
from reports.engine.checked import write_json
from reports.engine.provenance import commit, provenance
from reports.render.tables import Table, write_blocks
from reports.score.paired import Paired, compare

GRIDS = ((24, 32), (48, 64))
"""Rows and columns of the antipodal layouts with pilots on which the decoders are trained."""
SETTINGS = ((24, 32, 1), (48, 64, 1), (48, 64, 3))
"""Rows, columns and kappa of what is read."""
KINDS = ("shipped", "further", "network")
"""Names of the decoders that are compared: the shipped one, the one trained further, and the one
with the network, which is trained on the same batches."""
ROUNDS = 60
"""Number of times that each graph is timed."""
WIDTH = 16
"""Number of channels of the network."""
DILATIONS = (1, 2, 4)
"""Distances, in pixels, between the 3 x 3 points that each hidden layer looks at."""
LARGEST = 4.0
"""Bound of the network's inputs, and of the logarithm of the factor that it gives a weight."""
EDGE_PX = 2.0
"""Distance to the edge of a block, in pixels, beyond which all pixels are alike."""


@dataclass(frozen=True)
class NetworkConfig:
    """Train a network that weighs pixels, and compare it with the shipped decoder."""

    out: Path = Path("runs/pixel_network")
    """Folder for results.json and the states of both trained decoders."""
    episodes: int = 198
    """Number of simulated frame pairs for each grid, of training pictures."""
    steps: int = 400
    """Number of steps of the optimiser for each of the two trained decoders."""
    batch: int = 4
    """Number of frame pairs in a step."""
    lr: float = 3e-3
    """Adam's learning rate of the network at the start; it falls to zero on a cosine."""
    lr_decoder: float = 1e-3
    """Adam's learning rate of the decoder's own parameters, with and without the network."""
    kappas: tuple[int, ...] = (1, 2, 3)
    """Values of κ, in gray levels, from which the episodes draw."""
    max_view: float = 60.0
    """Largest view of an episode, in degrees; views are uniform from 0 to this."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation of the held-out frame pairs, in degrees."""
    frames: int = 4
    """Number of held-out frame pairs for each camera-display pair, view and setting."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = 1
    """Number of processes that simulate the episodes."""
    page: Path | None = None
    """Page whose block ``pixel_network`` is written; none where absent."""


@dataclass(frozen=True)
class NetworkRow:
    """What the three decoders read of one setting at one view."""

    rows: int
    """Number of rows of blocks."""
    cols: int
    """Number of columns of blocks."""
    kappa: int
    """Number of gray levels by which blocks change."""
    view_deg: float
    """Angle of observation, in degrees from the display's normal."""
    wrong: dict[str, int]
    """Number of wrong bits by decoder: "shipped", "further" and "network"."""
    further: Paired
    """The decoder trained further against the shipped one."""
    network: Paired
    """The decoder with the network against the one trained further."""


class PixelNetwork(nn.Module):
    """A network that gives each pixel a weight and an expected change; 6,676 parameters.

    It is convolutional, so any grid and any size of the frames will do.
    """

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for dilation in DILATIONS:
            before = WIDTH if layers else 10
            conv = nn.Conv2d(before, WIDTH, 3, padding=dilation, dilation=dilation)
            layers += [conv, nn.ReLU()]
        self.hidden = nn.Sequential(*layers)
        self.last = nn.Conv2d(WIDTH, 4, 3, padding=1)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(
        self, maps: Tensor, weights: Tensor, rows: int, cols: int, slope: float
    ) -> tuple[Tensor, Tensor]:
        """Weigh pixels and take the expected change away.

        Args:
            maps: (B, F, H, W) features of `PhiDecoder.pixel_maps` on a layout with pilots.
            weights: (B, 1, H, W) weights of the decoder itself.
            rows: number of rows of blocks.
            cols: number of columns of blocks.
            slope: gradient, in intensity per pixel, that counts as 1.

        Returns:
            features without the expected change, and the weights that the network gives.
        """
        change, gray = maps[:, :1], maps[:, 4:5]
        dx, dy, curvature = ((maps[:, -4 + i :][:, :1] / slope) for i in range(3))
        scale = (weights * change * change).mean((1, 2, 3), keepdim=True).sqrt() + 1e-6
        relative = (change / scale).clamp(-LARGEST, LARGEST)
        edges = self.edges(maps, rows, cols)
        inputs = [gray, relative, dx, dy, curvature, weights]
        inputs += [relative * dx * weights, relative * dy * weights, edges]
        stacked = torch.cat(inputs, dim=1).clamp(-LARGEST, LARGEST)
        out = self.last(self.hidden(stacked))
        expected = out[:, 1:2] + out[:, 2:3] * dx + out[:, 3:4] * dy
        factor = out[:, :1].clamp(-LARGEST, LARGEST).exp()
        return torch.cat([change - scale * expected, maps[:, 1:]], dim=1), weights * factor

    @staticmethod
    def edges(maps: Tensor, rows: int, cols: int) -> Tensor:
        """Measure how near each pixel is to the edges of its block.

        Returns:
            (B, 2, H, W): distances to the next edge along y and along x, divided by `EDGE_PX` and
            at most 1.
        """
        B, _, height, width = maps.shape
        y = (torch.arange(height) + 0.5) * (rows / height)
        x = (torch.arange(width) + 0.5) * (cols / width)
        y, x = ((place - place.round()).abs() for place in (y, x))
        y, x = y * (height / rows / EDGE_PX), x * (width / cols / EDGE_PX)
        both = [y.unsqueeze(1).expand(height, width), x.expand(height, width)]
        return torch.stack(both).clamp(max=1.0).expand(B, -1, -1, -1)


class NetworkDecoder(PhiDecoder):
    """The shipped decoder of layouts with pilots, whose pixels a network weighs."""

    def __init__(self, layout: Layout, config: DecoderConfig) -> None:
        super().__init__(layout, config)
        self.network = PixelNetwork()

    def average(self, maps: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Average over blocks what the network has left, with its weights."""
        layout, slope = self.layout, self.config.coarsen * self.config.texture
        return super().average(*self.network(maps, weights, layout.rows, layout.cols, slope))


@dataclass(frozen=True)
class Pixels:
    """Feature maps of the episodes of one layout, and their messages."""

    maps: Tensor
    """(N, F, H, W) float32 features of `PhiDecoder.pixel_maps`."""
    weights: Tensor
    """(N, 1, H, W) float32 weights of the pixels."""
    bits: Tensor
    """(N, n_bits) message bits, 0 or 1."""


def hidden_layout(rows: int, cols: int) -> Layout:
    """Make the antipodal layout with pilots of a grid."""
    return make_layout(rows, cols, modulation="antipodal", pilots="auto")


def simulate_pixels(decoder: PhiDecoder, pairs: Sequence[str], config: NetworkConfig) -> Pixels:
    """Simulate and augment training episodes, and compute their feature maps."""
    plan = EpisodePlan(config.episodes, config.kappas, config.max_view)
    source = Source(decoder.layout, "train", config.seed)
    episodes = simulate_episodes(source, pairs, plan, config.jobs)
    generator = torch.Generator().manual_seed(config.seed)
    maps, weights = augmented_features(episodes, decoder.pixel_maps, "cpu", generator)
    return Pixels(maps, weights, episodes.bits.float())


def train_further(
    decoders: Sequence[PhiDecoder], pixels: Sequence[Pixels], config: NetworkConfig
) -> list[float]:
    """Train decoders that share their parameters, one for each layout, in turn.

    Args:
        decoders: one decoder for each layout, with the same parameters; they are changed.
        pixels: the episodes of each layout.
        config: budget of the training.

    Returns:
        the loss of each step, in nats a bit.

    Raises:
        InputError: the loss is not finite.
    """
    generator = torch.Generator().manual_seed(config.seed)
    named = list(decoders[0].named_parameters())
    groups: list[dict[str, Any]] = [
        {"params": [p for name, p in named if name.startswith("network.")], "lr": config.lr},
        {"params": [p for name, p in named if name.startswith("refiner.")]},
    ]
    groups = [group for group in groups if group["params"]]
    optimiser = torch.optim.Adam(groups, config.lr_decoder)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    losses = []
    for step in trange(config.steps, desc="train", unit="step", mininterval=10):
        decoder, given = decoders[step % len(decoders)], pixels[step % len(decoders)]
        chosen = torch.randint(len(given.bits), (config.batch,), generator=generator)
        known, blocks = decoder.average(given.maps[chosen], given.weights[chosen])
        assert decoder.refiner is not None
        scores = decoder.refiner(decoder.statistics(known), decoder.statistics(blocks))
        loss = binary_cross_entropy_with_logits(scores.float(), given.bits[chosen])
        if not torch.isfinite(loss):
            raise InputError("the loss is not finite; lower --lr")
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_([p for _, p in named], 1.0)
        optimiser.step()
        schedule.step()
        losses.append(loss.item())
    return losses


def trained(
    kind: str, shipped: PhiDecoder, pixels: Sequence[Pixels], config: NetworkConfig
) -> PhiDecoder:
    """Train a decoder.

    Args:
        kind: "further" trains the shipped decoder itself, "network" the one with a network.
        shipped: the decoder from whose parameters both start; it is not changed.
        pixels: the episodes of each of `GRIDS`.
        config: budget of the training, and the folder that keeps the losses and the state.
    """
    with torch.random.fork_rng():
        torch.manual_seed(config.seed)
        decoder = (NetworkDecoder if kind == "network" else PhiDecoder)(
            shipped.layout, shipped.config
        )
    decoder.load_state_dict(shipped.state_dict(), strict=False)
    decoders = [decoder.for_layout(hidden_layout(*grid)) for grid in GRIDS]
    losses = train_further(decoders, pixels, config)
    write_bytes(config.out / f"{kind}.json", json.dumps(losses).encode())
    torch.save(decoder.state_dict(), config.out / f"{kind}.pt")
    return decoder.eval()


def read_setting(
    decoders: Mapping[str, PhiDecoder],
    setting: tuple[int, int, int],
    view: float,
    config: NetworkConfig,
) -> NetworkRow:
    """Let the decoders read the same held-out frame pairs of all camera-display pairs.

    Args:
        decoders: the decoders by the names that `NetworkRow` has, of any layout.
        setting: rows, columns and kappa.
        view: angle of observation, in degrees.
        config: number of frame pairs, and the seed.
    """
    rows, cols, kappa = setting
    layout = hidden_layout(rows, cols)
    modules = {name: module.for_layout(layout).eval() for name, module in decoders.items()}
    source = Source(layout, "test", config.seed)
    wrong: dict[str, list[NDArray[np.bool_]]] = {name: [] for name in modules}
    for name in tqdm(PAIRS, desc=f"{rows} x {cols}, {view:g} deg", unit="pair"):
        for index in range(config.frames):
            pair = FramePair(source, Cell(name, view, kappa), index)
            for kind, module in modules.items():
                soft = decode_with(module, pair.rectified)
                wrong[kind].append(soft.bits != pair.displayed.bits)

    def against(method: str, reference: str) -> Paired:
        both = zip(wrong[method], wrong[reference], strict=True)
        counts = [(a.size, a.sum(), b.sum(), (a & b).sum()) for a, b in both]
        return compare(np.array(counts, np.int64), np.random.default_rng(config.seed))

    total = {kind: int(sum(each.sum() for each in found)) for kind, found in wrong.items()}
    gains = against("further", "shipped"), against("network", "further")
    return NetworkRow(rows, cols, kappa, view, total, *gains)


def time_ratios(decoders: Mapping[str, PhiDecoder], layout: Layout, rounds: int) -> list[float]:
    """Time the exported graphs in turn, on one thread.

    Args:
        decoders: the decoders by name; the first is what the others are compared with.
        layout: the layout that both read.
        rounds: number of times that each graph runs.

    Returns:
        for each decoder the median of its CPU time over that of the first, taken in each round.
    """
    pair = synthetic_pair(layout, np.random.default_rng(0))
    frames = as_batch(pair.original), as_batch(pair.embedded)
    with TemporaryDirectory() as folder:
        graphs = []
        for name, decoder in decoders.items():
            file = Path(folder) / f"{name}.onnx"
            write_bytes(file, to_onnx(decoder.for_layout(layout), name))
            graphs.append(Decoder(file, threads=1, time_limit_s=OWN_TIME_LIMIT_S))
    times = []
    for _ in range(rounds):
        for graph in graphs:
            start = thread_time()
            graph.run(*frames)
            times.append(thread_time() - start)
    spent = np.array(times).reshape(rounds, -1)
    return [float(ratio) for ratio in np.median(spent / spent[:, :1], axis=0)]


def network_block(rows: Sequence[NetworkRow], cost: float) -> str:
    """Tabulate wrong bits of the three decoders, what each step gains, and the cost in time."""
    table = []
    for row in rows:
        shares = (100 * row.wrong[kind] / row.network.bits for kind in KINDS)
        gains = (
            f"{g.difference:+.2f} ({g.low:+.2f} to {g.high:+.2f})"
            for g in (row.further, row.network)
        )
        setting = f"{row.rows} × {row.cols}, κ {row.kappa}"
        table.append([setting, f"{row.view_deg:g}°", *(f"{share:.2f}" for share in shares), *gains])
    heads = ["setting", "view", "shipped, wrong %", "trained further", "with the network"]
    heads += ["gained by training, points", "by the network, points"]
    frames = sorted({row.network.frames for row in rows})
    title = (
        f"{', '.join(map(str, frames))} held-out frame pairs a row, simulated; 95 % intervals of a "
        "paired bootstrap over frame pairs."
    )
    return (
        f"{Table(heads, table, title, left=2).markdown()}\n\n"
        f"On {GRIDS[-1][0]} × {GRIDS[-1][1]} blocks, fit and decision through onnxruntime take "
        f"{cost:.2f} times as long with the network (CPU time of one thread)."
    )


def main() -> None:
    """Train, read, tabulate."""
    config = read_flags(lambda: tyro.cli(NetworkConfig))
    at_least(1, episodes=config.episodes, steps=config.steps, batch=config.batch)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    each_once(kappas=config.kappas, views=config.views)
    for kappa in config.kappas:
        check_kappa(kappa, "kappas")
    check_view(config.max_view, "max_view")
    for view in config.views:
        check_view(view, "views")
    make_folder(config.out)
    shipped = load_checkpoint(PRETRAINED_PILOTS)
    on_grids = [shipped.for_layout(hidden_layout(*grid)) for grid in GRIDS]
    pixels = [simulate_pixels(each, tuple(PAIRS), config) for each in on_grids]
    decoders = {"shipped": shipped}
    decoders |= {kind: trained(kind, shipped, pixels, config) for kind in KINDS[1:]}
    rows = [
        read_setting(decoders, setting, view, config)
        for setting in SETTINGS
        for view in config.views
    ]
    compared = {kind: decoders[kind] for kind in ("shipped", "network")}
    cost = time_ratios(compared, hidden_layout(*GRIDS[-1]), ROUNDS)[1]
    meta = provenance(config.seed, simulated=True) | {"commit": commit()}
    results = {"meta": meta, "rows": [asdict(row) for row in rows], "cost": cost}
    write_json(config.out / "results.json", results)
    block = network_block(rows, cost)
    print(block)
    if config.page:
        write_blocks(config.page, {"pixel_network": block})


if __name__ == "__main__":
    run_cli(main)
