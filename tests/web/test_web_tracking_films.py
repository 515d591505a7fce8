"""The page finds displays in films, follows and loses them as Python does."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pilot_films import FINE, filmed
from port import Port, PortError, same
from test_web_tracking import SIZE, WHOLE, hand, picture
from test_web_tracking import filmed as photographed
from tolerances import FOLLOWED_PX, FOUND_PX, MOVED_PX, PILOTS_CLOSE_PX

from link.layout import make_layout
from receiver.locate.find import is_at
from receiver.tracking.judge import CHECK_EVERY, PATIENCE
from receiver.tracking.patches import ASIDE_S, Tracker
from receiver.tracking.pilots import PilotTracker

PATCHES = make_layout(8, 8, 256, 192)
STILL, MOVING = 6, 8
"""Numbers of frames at first, and after that with a camera that moves."""
PATCHES_JS, PILOTS_JS = "receiver/tracking/patches.js", "receiver/tracking/pilots.js"


@pytest.mark.slow
def test_a_display_with_patches_is_found_followed_lost_and_found_again(port: Port) -> None:
    shown = picture(PATCHES, 0)
    corners = [hand(WHOLE, max(0, number - STILL + 1)) for number in range(STILL + MOVING)]
    images = [photographed(shown, there, number) for number, there in enumerate(corners)]
    tracker, ported = Tracker(PATCHES), port(PATCHES_JS).Tracker(PATCHES)
    seen = [tracker.follow(image, number / 60) for number, image in enumerate(images)]
    assert None not in seen[STILL:]

    def follow() -> int:
        """How many frames the page sees the display in, once it has found it in all."""
        found = 0
        for image, there, known in zip(images, corners, seen, strict=True):
            tracked = ported.follow(image, 0)
            assert tracked is not None or found == 0
            if tracked is None:
                continue
            found += 1
            assert tracked.rectified.shape == (192, 256)
            same(tracked.corners, there, FOLLOWED_PX)
            if known is not None:
                same(known.corners, there, FOLLOWED_PX)
                same(tracked.corners, known.corners, FOUND_PX)
        return found

    assert follow() >= 8
    for _ in range(3):
        assert ported.follow(np.zeros_like(images[0]), 0) is None
    assert follow() >= 6


@pytest.mark.slow
def test_what_was_set_aside_is_passed_over_for_a_time(port: Port) -> None:
    """Two displays hang side by side, and neither toggles."""
    shown, width = picture(PATCHES, 0), SIZE[0]
    image = np.hstack([photographed(shown, WHOLE, 1), photographed(shown, WHOLE, 2)])
    places = [WHOLE, WHOLE + np.array([width, 0])]

    def found_by(follow: Callable[..., Any], set_aside: Callable[..., None]) -> list[int]:
        """Which of the two is found, in turn, until both are aside and one is not any more."""
        found: list[int] = []
        for number in range(120):
            tracked = follow(image, number / 30)
            if tracked is not None and (getattr(tracked, "anew", False) or not found):
                found += [n for n in (0, 1) if is_at(np.array(tracked.corners), [places[n]])]
            set_aside(number / 30, False)
        set_aside(4.0, True)
        assert follow(image, 4.1) is None
        later = (follow(image, 4.1 + ASIDE_S + number / 30) for number in range(30))
        assert any(tracked is not None for tracked in later)
        return found

    tracker, ported = Tracker(PATCHES), port(PATCHES_JS).Tracker(PATCHES)
    known = found_by(tracker.follow, lambda time, forget: tracker.set_aside(time, forget=forget))
    assert sorted(known) == [0, 1]
    assert found_by(ported.follow, ported.setAside) == known


def test_layouts_need_what_their_trackers_look_for(port: Port) -> None:
    with pytest.raises(PortError, match="patches"):
        port(PATCHES_JS).Tracker(FINE)
    with pytest.raises(PortError, match="pilots"):
        port(PILOTS_JS).PilotTracker([PATCHES], 30)


@pytest.mark.slow
def test_a_display_with_pilots_is_found_moved_and_lost_when_it_stops_toggling(port: Port) -> None:
    images, corners = filmed(FINE, 40, seed=0, kappa=5.0)
    tracker, frames = PilotTracker([FINE], 60.0), len(images)
    is_known = []
    for number, (image, there) in enumerate(zip(images, corners, strict=True)):
        known = tracker.follow(image, number / 60)
        is_known.append(known is not None)
        if known is not None:
            same(known.corners, there, PILOTS_CLOSE_PX)
    assert is_known == sorted(is_known)
    assert is_known[-1]

    plain, moved = (port(PILOTS_JS).PilotTracker([FINE], 60) for _ in range(2))
    shift, found = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]]), 0
    for number, (image, there) in enumerate(zip(images, corners, strict=True)):
        here, elsewhere = (ported.follow(image, number / 60) for ported in (plain, moved))
        assert (here is None) == (elsewhere is None)
        assert here is not None or found == 0, f"frame {number}"
        if here is None:
            continue
        found += 1
        same(here.corners, there, PILOTS_CLOSE_PX)
        if found == 2:
            assert np.abs(np.subtract(elsewhere.corners, here.corners)).max() > 3
        else:
            same(elsewhere.corners, here.corners, MOVED_PX)
        if found == 1:
            moved.correct(2 * shift)  # the scale of a homography means nothing
        elif found == 2:
            moved.correct(np.linalg.inv(shift))
    assert found >= frames - is_known.index(True) - 4

    rng = np.random.default_rng(0)
    for still in range(300):
        noise = rng.integers(-2, 3, images[-1].shape)
        grainy = np.clip(images[-1] + noise, 0, 255).astype(np.uint8)
        if plain.follow(grainy, (frames + still) / 60) is None:
            break
    else:
        pytest.fail("the display is never lost")
    assert CHECK_EVERY * PATIENCE - frames < still <= CHECK_EVERY * 6
