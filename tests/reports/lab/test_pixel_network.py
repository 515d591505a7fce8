"""The trial of a network that weighs pixels, in small."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import reports.lab.pixel_network as pixel_network
from link.layout import Layout, make_layout
from models import PRETRAINED_PILOTS
from models.neural.checkpoint import load_checkpoint
from reports.lab.pixel_network import (
    NetworkConfig,
    NetworkDecoder,
    NetworkRow,
    Pixels,
    network_block,
    train_further,
)
from reports.score.paired import compare

LAYOUT = make_layout(8, 8, 128, 96, modulation="antipodal", pilots="auto")


def network_decoder(layout: Layout = LAYOUT) -> NetworkDecoder:
    shipped = load_checkpoint(PRETRAINED_PILOTS, layout)
    decoder = NetworkDecoder(layout, shipped.config)
    decoder.load_state_dict(shipped.state_dict(), strict=False)
    return decoder


def frames(count: int = 1) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    first = torch.randint(40, 200, (count, 3, 96, 128), generator=generator, dtype=torch.uint8)
    return first, first + torch.randint(0, 3, first.shape, generator=generator, dtype=torch.uint8)


def test_the_network_starts_as_the_shipped_decoder() -> None:
    shipped = load_checkpoint(PRETRAINED_PILOTS, LAYOUT)
    with torch.no_grad():
        expected, found = shipped(*frames())[0], network_decoder()(*frames())[0]
    torch.testing.assert_close(found, expected, rtol=0, atol=0)


def test_decoders_of_several_grids_share_the_network() -> None:
    decoder = network_decoder()
    other = decoder.for_layout(make_layout(16, 16, modulation="antipodal", pilots="auto"))
    assert isinstance(other, NetworkDecoder)
    assert other.network.last.weight is decoder.network.last.weight
    assert sum(p.numel() for p in decoder.network.parameters()) <= 50_000


def test_edges_are_nearest_at_the_borders_of_blocks() -> None:
    near = pixel_network.PixelNetwork.edges(torch.zeros(2, 1, 16, 32), rows=2, cols=2)
    assert near.shape == (2, 2, 16, 32)
    np.testing.assert_allclose(near[0, 0, :9, 0], [0.25, 0.75, 1, 1, 1, 1, 0.75, 0.25, 0.25])
    np.testing.assert_allclose(near[0, 1, 0, 14:18], [0.75, 0.25, 0.25, 0.75])


@pytest.mark.slow
def test_training_moves_the_network_and_the_refiner() -> None:
    decoder = network_decoder()
    with torch.no_grad():
        maps, weights = decoder.pixel_maps(*frames(3))
    bits = torch.randint(0, 2, (3, LAYOUT.n_bits), generator=torch.Generator().manual_seed(1))
    before = {name: value.clone() for name, value in decoder.state_dict().items()}
    config = NetworkConfig(steps=2, batch=2)
    losses = train_further([decoder], [Pixels(maps, weights, bits.float())], config)
    assert len(losses) == 2
    assert np.isfinite(losses).all()
    moved = {n for n, value in decoder.state_dict().items() if not torch.equal(value, before[n])}
    assert {"network.last.weight", "network.hidden.0.weight", "refiner.jitter"} <= moved
    assert "log_C" not in moved


def test_the_table_says_who_gains_what() -> None:
    counts = np.tile(np.array([[100, 4, 6, 3]]), (8, 1))
    gain = compare(counts, np.random.default_rng(0))
    wrong = {"shipped": 48, "further": 48, "network": 32}
    row = NetworkRow(24, 32, 1, 45.0, wrong, replace(gain, difference=0.0), gain)
    block = network_block([row], 2.345)
    assert "8 held-out frame pairs a row" in block
    line = block.splitlines()[4]
    assert line.startswith("| 24 × 32, κ 1 | 45° | 6.00 | 6.00 | 4.00 | +0.00 ")
    assert "+2.00 (" in line
    assert "2.35 times" in block or "2.34 times" in block
