"""Map where a display toggles in frames that are held still: the network `DisplayRegion`.

A display that sends by pilots changes its blocks from state to state, whatever it shows. Noise of
the sensor has as much power in single pixels as in their means over blocks, once the number of
pixels is allowed for; blocks that toggle have more of it in the means. Edges that are not held
quite still have it, too, and dark parts of a picture hardly toggle, so no threshold separates a
display from its room. A small convolutional network (a U-Net, Ronneberger et al. 2015) learns from
simulated rooms which parts of the image belong to one.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, max_pool2d, pad, pixel_unshuffle

from models.region import CELL_PX

SQUARE_PX = 4
"""Side, in pixels of the frames, of the squares over which they are averaged: about a block of the
finest grids, in frames whose longer side has 640 pixels."""
SQUARES = CELL_PX // SQUARE_PX
"""Side, in such squares, of a cell of the map that the network returns."""
FEATURES = 6
"""Number of values that the network sees of each square (`DisplayRegion.features`)."""
WIDTH, DEEP = 16, 24
"""Number of channels of the network at the resolution of its map, and at lower resolutions."""
LEAST = (0.05, 0.01, 0.01, 0.001, 0.1)
"""Powers, in squared gray levels, that are added before logarithms are taken, so that a place where
nothing changes has one: a part of what rounding to gray levels leaves."""
GRAY_UNIT = 64.0
"""Gray levels in one unit of the mean that the network sees, so that it spans few units."""


class DisplayRegion(nn.Module):
    """Gives each place of a film the log-odds that a display toggles there.

    >>> frames = torch.randint(0, 255, (13, 1, 360, 640)).float()
    >>> DisplayRegion()(frames).shape
    torch.Size([45, 80])
    """

    mean: Tensor
    """Mean of each feature over the training films, (6, 1, 1)."""
    deviation: Tensor
    """Standard deviation of each feature over the training films, (6, 1, 1)."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(FEATURES, 1, 1))
        self.register_buffer("deviation", torch.ones(FEATURES, 1, 1))
        self.fine = _two_convolutions(FEATURES * SQUARES**2, WIDTH)
        self.down = nn.ModuleList(
            [_two_convolutions(channels, DEEP) for channels in (WIDTH, DEEP, DEEP)]
        )
        self.up = nn.ModuleList([_two_convolutions(2 * DEEP, DEEP) for _ in range(2)])
        self.last = nn.Sequential(
            nn.Conv2d(WIDTH + DEEP, WIDTH, 3, padding=1), nn.ReLU(), nn.Conv2d(WIDTH, 1, 1)
        )

    def forward(self, frames: Tensor) -> Tensor:
        """Map where a display toggles.

        Args:
            frames: (T, 1, H, W) gray levels in [0, 255], at least three frames held still, whose
                longer side has about 640 pixels.

        Returns:
            (H // 8, W // 8) natural log-odds, of cells of 8 x 8 pixels.
        """
        odds: Tensor = self.odds(self.features(frames))[0]
        return odds

    @staticmethod
    def features(frames: Tensor) -> Tensor:
        """Measure how squares of `SQUARE_PX` change.

        Args:
            frames: as `forward` takes them.

        Returns:
            (1, 6, H // 4, W // 4): logarithms of the mean power of pixels' changes from frame to
            frame, of squares' changes, of their changes over two frames, and of their mean change,
            which is what drifts; mean gray levels; and the logarithm of the mean squared slope.
        """
        changes = frames[1:] - frames[:-1]
        blocks = avg_pool2d(changes, SQUARE_PX)
        mean = frames.mean(dim=0, keepdim=True)
        right = (mean[..., 1:-1, 2:] - mean[..., 1:-1, :-2]) / 2
        down = (mean[..., 2:, 1:-1] - mean[..., :-2, 1:-1]) / 2
        powers = (
            avg_pool2d((changes**2).mean(dim=0, keepdim=True), SQUARE_PX),
            (blocks**2).mean(dim=0, keepdim=True),
            ((blocks[1:] + blocks[:-1]) ** 2).mean(dim=0, keepdim=True),
            blocks.mean(dim=0, keepdim=True) ** 2,
            avg_pool2d(pad(right**2 + down**2, (1, 1, 1, 1)), SQUARE_PX),
        )
        *moved, slope = (
            torch.log(power + least) for power, least in zip(powers, LEAST, strict=True)
        )
        return torch.cat([*moved, avg_pool2d(mean, SQUARE_PX) / GRAY_UNIT, slope], dim=1)

    def odds(self, features: Tensor) -> Tensor:
        """Map the log-odds, (N, H // 8, W // 8), of `features` of N films."""
        height, width = (side // SQUARES * SQUARES for side in features.shape[-2:])
        usual = (features[..., :height, :width] - self.mean) / self.deviation
        scales = [self.fine(pixel_unshuffle(usual, SQUARES))]
        for down in self.down:
            scales.append(down(max_pool2d(scales[-1], 2)))
        coarse = scales.pop()
        for up in self.up:
            finer = scales.pop()
            coarse = up(torch.cat([finer, _resized(coarse, finer)], dim=1))
        (finest,) = scales
        odds: Tensor = self.last(torch.cat([finest, _resized(coarse, finest)], dim=1))
        return odds[:, 0]


def _two_convolutions(inputs: int, outputs: int) -> nn.Sequential:
    """Make two convolutions of 3 x 3, each followed by a rectifier."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(outputs, outputs, 3, padding=1),
        nn.ReLU(),
    )


def _resized(coarse: Tensor, fine: Tensor) -> Tensor:
    """Repeat values so that a map has as many rows and columns as a finer one."""
    return interpolate(coarse, size=fine.shape[-2:], mode="nearest")
