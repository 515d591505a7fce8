"""Find and read the display in two photographs, one of each state of a frame pair.

Ratex patches are seen in a single photograph. Pilots show only in what changes between the two, so
these are looked at by turns, like a film whose states last one frame each. Such a search is as sure
as one in a film: its odds are about where the pilots lie, not about time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, NoDisplayError
from link.frames import Captured
from link.layout import Layout
from link.pilots import pilots_toggled
from link.ratex import match_patches
from link.types import Corners, Image
from receiver.decoders import PairDecoder
from receiver.locate.find import locate
from receiver.pilots.search.pilot_search import PilotDisplay, PilotSearch
from receiver.reading.reader import DecodedPair
from receiver.reading.shown import States
from receiver.reading.states import DisplayState
from receiver.seen import MESH
from receiver.timing.toggles import patch_toggles

FPS, HOLD, LOOKS = 30.0, 2, 60
"""Rate at which a film shows the two photographs by turns, number of its frames for which it shows
each, and number after which the search ends: displays were found within 40, or not at all. Each is
shown twice because the map of what toggles has learned from no film whose states last a frame."""

STILL = 2.0
"""Smallest change of the toggles between two images, in standard errors over patches or pilots, at
which the images show different states."""


@dataclass(frozen=True)
class DisplayInBoth:
    """A display that two photographs show."""

    layout: Layout
    """Layout that the display shows, one of those looked for."""
    corners: tuple[Corners, Corners]
    """Pixels of the first and of the second photograph."""


def find_in_both(first: Image, second: Image, layouts: Sequence[Layout]) -> DisplayInBoth | None:
    """Find the display in two photographs of a frame pair, in either order.

    Args:
        first: an `Image`.
        second: an `Image` of the shape of ``first``.
        layouts: those looked for, each with ratex patches or with pilots.

    Returns:
        None where no such display is in both.
    """
    for layout in layouts:
        if layout.ratex:
            places = [locate(image, layout) for image in (first, second)]
            if places[0] is not None and places[1] is not None:
                return DisplayInBoth(layout, (places[0].corners, places[1].corners))
    with_pilots = [layout for layout in layouts if layout.pilots]
    if not with_pilots:
        return None
    found = _by_turns(first, second, with_pilots)
    other = found and _by_turns(second, first, [found.layout])
    if not found or not other:
        return None
    return DisplayInBoth(found.layout, (found.first_corners, other.first_corners))


def _by_turns(first: Image, second: Image, layouts: Sequence[Layout]) -> PilotDisplay | None:
    """Search a film of both photographs by turns, which begins with the first."""
    search = PilotSearch(layouts, FPS)
    looks = (search.push((first, second)[at // HOLD % 2], at / FPS) for at in range(LOOKS))
    return next((found for found in looks if found is not None), None)


def decode_in_both(
    decoder: PairDecoder, first: Image, second: Image, corners: tuple[Corners, Corners]
) -> DecodedPair:
    """Decode two photographs of one frame pair, in either order.

    Args:
        decoder: decoder of the display's layout.
        first: an `Image` of either state.
        second: an `Image` of the other state, of the same shape.
        corners: pixels of the display in the first and in the second photograph.

    Raises:
        InputError: images of unlike size, corners that do not fit, or patches or pilots that do
            not differ between the images.
    """
    layout = decoder.layout
    if not layout.ratex and not layout.pilots:
        raise InputError("the layout has no ratex patches and no pilots, which tell both states")
    seen = Captured(first, second, layout, *corners).rectified()
    change = state_change(seen.original, seen.embedded, layout)
    if abs(change) <= STILL:
        raise NoDisplayError("the two images show the same state; take one of each")
    original, embedded = (seen.original, seen.embedded)[:: 1 if change > 0 else -1]
    first_state, second_state = (
        DisplayState(image, np.ones((MESH, MESH)), 1) for image in (original, embedded)
    )
    shown = States(first_state, second_state, layout.message_mask)
    return DecodedPair(0, 0.0, decoder.decode(original, embedded), shown, 0.0)


def state_change(first: Image, second: Image, layout: Layout) -> float:
    """Measure how surely two rectified images show both states of a frame pair.

    Args:
        first: an `Image`.
        second: an `Image` of the shape of ``first``.
        layout: layout with ratex patches or pilots.

    Returns:
        change of the toggles in standard errors, below 0 where the embedded frame is the first; 0
        where nothing is seen of them.
    """
    if layout.pilots:
        return pilots_toggled(first, second, layout)
    before, after = (patch_toggles(match_patches(image, layout)) for image in (first, second))
    gain: NDArray[np.float64] = after - before
    gain = gain[np.isfinite(gain)]
    if gain.size == 0:
        return 0.0
    return float(gain.mean() / (gain.std() / np.sqrt(gain.size) + 1e-9))
