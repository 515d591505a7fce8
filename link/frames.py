"""What passes from stage to stage: displayed and captured frame pairs, and soft bits."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.geometry import check_corners, homography_from_corners, rectify
from link.layout import Layout
from link.observation import Observation
from link.types import Corners, Image


def check_same_size(original: Image, embedded: Image) -> None:
    """Raise an `InputError` unless both frames have one shape."""
    if original.shape[:2] != embedded.shape[:2]:
        sizes = [f"{frame.shape[1]}x{frame.shape[0]}" for frame in (original, embedded)]
        raise InputError(
            f"original is {sizes[0]} and embedded is {sizes[1]}; "
            "give two frames of one camera at one size"
        )
    if original.ndim != embedded.ndim:
        raise InputError("original is gray and embedded colour, or the other way; give both alike")


@dataclass(frozen=True)
class Displayed:
    """One frame pair as the display shows it."""

    original: Image
    """Frame without the message, an `Image`."""
    embedded: Image
    """Frame that carries the message, of the shape of ``original``."""
    bits: NDArray[np.intp]
    """(n_bits,) 0 or 1, row-major over the message cells."""
    layout: Layout
    """Grid of blocks and ratex patches that the frames show."""
    kappa: int
    """Gray levels of [0, 255] added where the bit is 1, and in ratex tiles of label 1."""


@dataclass(frozen=True)
class Captured:
    """One frame pair as the camera saw it, with the display's corners."""

    original: Image
    """The captured original frame, an `Image`."""
    embedded: Image
    """The captured embedded frame, of the shape of ``original``."""
    layout: Layout
    """Grid of blocks and ratex patches that the display shows."""
    corners: Corners
    """Pixels in the original frame."""
    corners_embedded: Corners
    """Pixels in the embedded frame."""
    bits: NDArray[np.intp] | None = None
    """(n_bits,) the bits that were sent, -1 where unknown; None where nothing is known."""
    kappa: int | None = None
    """Gray levels added where the bit is 1, and in ratex tiles of label 1; None where the receiver
    does not know it."""
    meta: dict[str, object] = field(default_factory=dict)
    """Further keys of the manifest, such as pair, view_deg, picture and seed."""

    def rectified(self) -> Observation:
        """Resample both frames to the layout's frame, by bilinear interpolation.

        Raises:
            InputError: the frames differ in size, or the corners do not lie in them.
        """
        check_same_size(self.original, self.embedded)
        width, height = self.layout.width, self.layout.height
        frames = []
        for image, corners in (
            (self.original, self.corners),
            (self.embedded, self.corners_embedded),
        ):
            H = homography_from_corners(check_corners(corners, image.shape), width, height)
            frames.append(rectify(image, H, width, height))
        return Observation.still(frames[0], frames[1], self.layout, self.kappa)


@dataclass(frozen=True)
class SoftBits:
    """A score for each message bit of an observation; what a decoder returns."""

    scores: NDArray[np.float64]
    """(P n_bits,) frame pair after frame pair, row-major over the message cells; positive means bit
    1."""
    head: NDArray[np.float64] | None = None
    """Weights that the method fitted to the observation, or None; their meaning is the method's."""

    @property
    def bits(self) -> NDArray[np.intp]:
        """(P n_bits,) hard decisions, 0 or 1."""
        return (self.scores > 0).astype(np.intp)
