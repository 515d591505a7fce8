"""Configuration of the torch decoder, without torch, so that what only names it starts fast."""

from dataclasses import asdict, dataclass

from link.errors import ParameterError, choose
from link.images import LUMA

MAX_DEGREE = 12
"""Largest degree of the inverse response that is accepted; the paper's is 4."""
MAX_ROUNDS = 8
"""Largest number of rounds of refinement."""
CHANNELS: dict[str, tuple[tuple[float, ...], ...]] = {
    "luma": (LUMA,),
    "quiet": ((0.27, 0.5, 0.23),),
    "rgb": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Weights of R, G and B in each intensity, by name; they sum to 1. "luma" is what the paper's
methods look at. With "quiet" a camera's noise is least: its colour matrix subtracts what crosstalk
added, and neighbouring channels then err against each other. "rgb" makes Phi of each colour
channel, with one head that they share."""


def check_degrees(degree: int, drift_degree: int) -> None:
    """Raise a `ParameterError` that names the degree that is out of range."""
    if not 1 <= degree <= MAX_DEGREE:
        raise ParameterError("degree", f"need 1 to {MAX_DEGREE}, got {degree}")
    if not 0 <= drift_degree <= degree:
        raise ParameterError("drift_degree", f"need 0 to degree {degree}, got {drift_degree}")


@dataclass(frozen=True)
class DecoderConfig:
    """What defines the decoder's graph; it is saved in config.json beside the weights.

    Raises:
        ParameterError: a value is out of range or of another type.

    >>> DecoderConfig(coarsen=3)
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: coarsen: need 1 or 2, got 3
    """

    degree: int = 4
    """Degree of the inverse response g."""
    drift_degree: int = 0
    """Degree of the polynomial of i_o that stands beside Phi and explains drift; 0 leaves it
    out."""
    channels: str = "luma"
    """Which intensities are made of a frame's colours: "luma", "quiet" or "rgb", as
    `CHANNELS` says."""
    register: bool = False
    """Whether the motion between the frames is removed first."""
    train_on: str = "tile"
    """What a training sample of a frame pair is. "tile" is the mean over 36 points of a ratex
    tile's inner half, "area" the mean over the tile without its margin."""
    coarsen: int = 1
    """Number of pixels averaged along each axis before all else. 1 keeps all of them; 2 takes a
    quarter of the time."""
    texture: float = 0.0
    """Gradient, in intensity per pixel, at which a pixel's weight in its block is halved. Where the
    picture is steep, little light scatters but motion changes much. 0 weighs all pixels alike."""
    refine: int = 0
    """Number of rounds of decision-directed refinement; 0 leaves it out."""
    rows: bool = False
    """Whether every row of blocks has a gain of its own, for flicker; needs refinement."""
    space: bool = False
    """Whether the calibration varies smoothly over the display; needs refinement."""

    def __post_init__(self) -> None:
        choose(CHANNELS, self.channels, "channels")
        choose(dict.fromkeys(("tile", "area")), self.train_on, "train_on")
        for field, value in asdict(self).items():
            kind = type(getattr(DecoderConfig, field))
            if type(value) is not kind:
                raise ParameterError(field, f"must be of type {kind.__name__}, got {value!r}")
        check_degrees(self.degree, self.drift_degree)
        if self.coarsen not in (1, 2):
            raise ParameterError("coarsen", f"need 1 or 2, got {self.coarsen}")
        if not 0 <= self.refine <= MAX_ROUNDS:
            raise ParameterError("refine", f"need 0 to {MAX_ROUNDS}, got {self.refine}")
        if not 0 <= self.texture < 1:
            raise ParameterError("texture", f"need at least 0 and below 1, got {self.texture}")
        for field in ("rows", "space"):
            if getattr(self, field) and self.refine == 0:
                raise ParameterError(field, "needs refine of at least 1")


FULL = DecoderConfig(
    drift_degree=2,
    register=True,
    channels="quiet",
    train_on="area",
    coarsen=2,
    texture=0.02,
    refine=3,
    rows=True,
    space=True,
)
"""Configuration of the shipped decoder: every part that pays in docs/results.md."""
