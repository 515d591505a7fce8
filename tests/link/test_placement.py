"""Where a picture lies on a display: nothing is cut unless asked, and the grid turns with it."""

import numpy as np
import pytest

from link.code import framing
from link.errors import InputError
from link.layout import make_layout
from link.loop import Loop
from link.placement import FITS, Placement
from link.types import Image

LAYOUT = make_layout(4, 6, 96, 64, modulation="antipodal", pilots=4)
SIZES = {"lying": (192, 108), "upright": (108, 192), "square": (144, 144)}


def ramp(width: int, height: int) -> Image:
    """A picture whose red grows from left to right, and whose green grows from top to bottom."""
    red = np.broadcast_to(np.linspace(40, 200, width), (height, width))
    green = np.broadcast_to(np.linspace(40, 200, height)[:, None], (height, width))
    return np.stack([red, green, np.full((height, width), 90.0)], axis=2).astype(np.uint8)


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("given", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("display", SIZES.values(), ids=SIZES)
def test_a_frame_on_the_display_is_the_picture_that_was_laid_there(
    display: tuple[int, int], given: tuple[int, int], fit: str
) -> None:
    placement = Placement(display, fit, given)
    picture = ramp(*given)
    frame = placement.grid_frame(picture, LAYOUT)
    layout = placement.layout(LAYOUT)
    assert frame.shape == (layout.height, layout.width, 3)
    assert layout.width >= layout.height  # it lies as the layout does
    shown = placement.display_frame(frame, LAYOUT)
    assert shown.shape == (display[1], display[0], 3)
    lit = np.argwhere(shown.any(axis=2))
    (top, left), (bottom, right) = lit.min(axis=0), lit.max(axis=0) + 1
    assert (right - left, bottom - top) == placement.picture_size
    inside = shown[top:bottom, left:right].astype(int)
    assert (np.diff(inside[:, :, 0], axis=1) >= 0).all()  # neither turned nor mirrored
    assert (np.diff(inside[:, :, 1], axis=0) >= 0).all()
    if fit != "cover":  # both ends of the picture are seen
        assert np.abs(inside[[0, -1], [0, -1], :2] - picture[[0, -1], [0, -1], :2]).max() <= 1
    if fit == "contain":
        assert (right - left) / (bottom - top) == pytest.approx(given[0] / given[1], rel=0.02)


def test_at_the_same_size_every_pixel_stays() -> None:
    noise = np.random.default_rng(0).integers(1, 256, (192, 108, 3), dtype=np.uint8)
    placement = Placement((108, 192), "contain", (108, 192))
    shown = placement.display_frame(placement.grid_frame(noise, LAYOUT), LAYOUT)
    np.testing.assert_array_equal(shown, noise)


def test_an_upright_grid_on_an_upright_display_is_not_turned() -> None:
    upright = make_layout(6, 4, 64, 96, modulation="antipodal", pilots=4)
    assert not Placement((108, 192), "contain", (108, 192)).turns(upright)
    assert Placement((192, 108), "contain", (192, 108)).turns(upright)


def test_a_display_that_stands_shows_the_bits_of_one_that_lies_turned_by_a_quarter() -> None:
    bits = framing.encode(b"turned", LAYOUT.n_bits)
    lying, upright = (
        Loop(LAYOUT, 3, bits, lambda size=size: iter([ramp(*size)]), size, "contain")
        for size in ((192, 108), (108, 192))
    )
    assert lying.shown_layout == upright.shown_layout
    for one, other in zip(lying.states(), upright.states(), strict=True):
        assert (one.shape[:2], other.shape[:2]) == ((108, 192), (192, 108))
    for carriers in zip(lying.carriers(), upright.carriers(), strict=True):
        one, other = (carrier.displayed() for carrier in carriers)
        changes = [pair.embedded.astype(int) - pair.original for pair in (one, other)]
        np.testing.assert_array_equal(*changes)
    assert upright.report(6, 30.0)["display"] == {
        "width": 108, "height": 192, "fit": "contain", "turned": True
    }  # fmt: skip


def test_pictures_that_would_lie_elsewhere_are_refused() -> None:
    pictures = [ramp(160, 90), ramp(120, 90)]
    bits = framing.encode(b"two", LAYOUT.n_bits)
    with pytest.raises(InputError, match="would not lie where one of 160x90 did; choose fit cover"):
        list(Loop(LAYOUT, 3, bits, lambda: iter(pictures), (160, 90), "contain").carriers())
    assert list(Loop(LAYOUT, 3, bits, lambda: iter(pictures), (160, 90), "cover").carriers())


def test_a_picture_that_is_too_narrow_for_the_blocks_is_refused() -> None:
    with pytest.raises(InputError, match="need a frame of at least 24x16"):
        Placement((36, 64), "contain", (900, 300)).layout(LAYOUT)
    with pytest.raises(InputError, match="longer than 3:1"):
        Placement((96, 64), "contain", (900, 60))
