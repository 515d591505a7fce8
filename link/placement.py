"""How a picture lies on a display: how large it is shown, what is cut, and how the grid is turned.

A layout's grid lies in fractions of the picture, so that the picture may be shown at any size. The
layout's own width and height are only the size at which receivers work. Where the picture is shown
upright and the layout lies on its side, the grid is turned with it: its top-left corner is then the
bottom-left corner of the picture, and its rows run upwards. A receiver finds displays whichever way
up they are, and so needs to know nothing of it.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, choose
from link.images import fit_picture
from link.layout import Layout
from link.types import Image

FITS = {
    "contain": "the whole picture, as large as it fits; what is left of the display is black",
    "cover": "the whole display; what reaches beyond it is cut off evenly at both ends",
    "stretch": "the whole picture over the whole display, whatever its proportions",
}
"""Ways to lay a picture on a display whose proportions differ, by name, and what each shows of
both."""


USUAL_DISPLAY = (1920, 1080)
"""Width and height, in pixels, of the display for which pictures are made where none is named; an
upright picture takes it upright."""
MAX_ASPECT = 3.0
"""Largest ratio of the longer side of a shown picture to the shorter one."""


def usual_size(given_size: tuple[int, int], layout: Layout) -> tuple[int, int]:
    """Choose the size of a picture for a display that is not known: its own pixels, if they fit.

    A picture that is larger than `USUAL_DISPLAY` is shrunk to fit, and one with a side shorter than
    the layout's is enlarged. Sides are even numbers, as video files need them.

    Args:
        given_size: width and height of the picture, in pixels.
        layout: grid whose width and height are the size at which receivers work.

    >>> from link.layout import make_layout
    >>> [usual_size(size, make_layout()) for size in ((4000, 3000), (800, 600), (90, 120))]
    [(1440, 1080), (800, 600), (384, 512)]
    """
    short, long = sorted(given_size)
    least = max(max(layout.width, layout.height) / long, min(layout.width, layout.height) / short)
    scale = max(least, min(1.0, USUAL_DISPLAY[0] / long, USUAL_DISPLAY[1] / short))
    width, height = (2 * round(scale * side / 2) for side in given_size)
    return width, height


@dataclass(frozen=True)
class Placement:
    """Where pictures lie on a display.

    >>> upright = Placement((1080, 1920), "contain", (600, 800))
    >>> upright.picture_size
    (1080, 1440)
    >>> from link.layout import make_layout
    >>> shown = upright.layout(make_layout())
    >>> (shown.width, shown.height)
    (1440, 1080)

    Raises:
        InputError: ``fit`` is unknown, or the picture would be longer than `MAX_ASPECT` allows.
    """

    display_size: tuple[int, int]
    """Width and height of the display, in pixels."""
    fit: str
    """Way in which a picture of other proportions lies on the display; a key of `FITS`."""
    given_size: tuple[int, int]
    """Width and height of the pictures before they are resized, in pixels."""

    def __post_init__(self) -> None:
        choose(FITS, self.fit, "fit")
        width, height = self.picture_size
        if max(width, height) > MAX_ASPECT * min(width, height) + 1:
            raise InputError(
                f"a shown picture of {width}x{height} is longer than {MAX_ASPECT:g}:1; crop it, or "
                "choose fit cover and another size"
            )

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of the picture on the display, in pixels."""
        if self.fit != "contain":
            return self.display_size
        scale = min(
            room / side for room, side in zip(self.display_size, self.given_size, strict=True)
        )
        width, height = (max(1, round(scale * side)) for side in self.given_size)
        return width, height

    def turns(self, layout: Layout) -> bool:
        """Tell whether the picture stands upright where the layout lies, or lies where it stands.

        Args:
            layout: grid whose width and height are the size at which receivers work.
        """
        width, height = self.picture_size
        return (width - height) * (layout.width - layout.height) < 0

    def layout(self, layout: Layout) -> Layout:
        """Give the grid the size at which it is shown, as it lies before it is turned.

        Args:
            layout: grid whose width and height are the size at which receivers work.

        Raises:
            InputError: the picture is too small for the grid's blocks, or too large.
        """
        width, height = self.picture_size
        if self.turns(layout):
            width, height = height, width
        return replace(layout, width=width, height=height)

    def grid_frame(self, picture: NDArray[np.uint8], layout: Layout) -> NDArray[np.uint8]:
        """Resize a picture for the display, and turn it so that it lies as the grid does.

        Args:
            picture: (H, W, 3) uint8, encoded RGB.
            layout: grid whose width and height are the size at which receivers work.

        Returns:
            (height, width, 3) uint8 of the size that `layout` gives the grid.

        Raises:
            InputError: ``picture`` has other proportions than the first one, so that it would be
                shown elsewhere.
        """
        width, height = self.picture_size
        if self.fit == "cover":
            shown = fit_picture(picture, width, height)
        else:
            size = picture.shape[1], picture.shape[0]
            if Placement(self.display_size, self.fit, size).picture_size != (width, height):
                raise InputError(
                    f"a picture of {size[0]}x{size[1]} would not lie where one of "
                    f"{self.given_size[0]}x{self.given_size[1]} did; choose fit cover or stretch"
                )
            averaged = size[0] * size[1] >= width * height
            how = cv2.INTER_AREA if averaged else cv2.INTER_LINEAR
            shown = np.asarray(cv2.resize(picture, (width, height), interpolation=how), np.uint8)
        return np.ascontiguousarray(np.rot90(shown, -1)) if self.turns(layout) else shown

    def display_frame(self, frame: Image, layout: Layout) -> Image:
        """Lay a frame of the grid on the display, with black beside it where the picture ends.

        Args:
            frame: an `Image` that lies as the grid does, of the size that `layout` gives it.
            layout: grid whose width and height are the size at which receivers work.

        Returns:
            an `Image` of the display's size.
        """
        upright = np.rot90(frame) if self.turns(layout) else frame
        width, height = self.display_size
        shown = np.zeros((height, width, *frame.shape[2:]), np.uint8)
        rows, cols = upright.shape[:2]
        top, left = (height - rows) // 2, (width - cols) // 2
        shown[top : top + rows, left : left + cols] = upright
        return shown
