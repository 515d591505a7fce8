"""The page finds displays in films, follows and loses them as Python does."""

import numpy as np
import pytest
from pilot_films import FINE, filmed
from port import Port, PortError, same
from tolerances import MOVED_PX, PILOTS_CLOSE_PX

from link.layout import make_layout
from receiver.tracking.judge import CHECK_EVERY, PATIENCE
from receiver.tracking.pilots import PilotTracker

PILOTS_JS = "receiver/tracking/pilots.js"


def test_layouts_need_pilots(port: Port) -> None:
    with pytest.raises(PortError, match="pilots"):
        port(PILOTS_JS).PilotTracker([make_layout()], 30)


@pytest.mark.exhaustive
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
