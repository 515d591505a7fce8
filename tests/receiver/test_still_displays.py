"""A display that is followed in vain keeps no other from being found, nor itself."""

import numpy as np
import pytest
from drawn_scenes import content
from pilot_films import BlockMeans, beside_print, filmed

import receiver.tracking.judge as judge_module
from link.code.framing import encode
from link.frames import SoftBits
from link.geometry import frame_corners
from link.images import as_gray
from link.layout import make_layout
from link.presets import PRESETS
from link.types import Image
from receiver.locate.find import is_at
from receiver.receiver import Receiver
from receiver.tracking.judge import STILL_S
from receiver.tracking.patches import ASIDE_S, Tracker

PAPER, ROBUST = PRESETS["paper"].layout, PRESETS["robust"].layout
TEXT = b"it lives"
UPRIGHT = frame_corners(PAPER.width, PAPER.height)


def wall_with_prints(*lefts: int) -> Image:
    """A gray wall, 1280 x 480, on which still frames of the preset paper hang."""
    wall = np.full((480, 1280), 90, np.uint8)
    for number, left in enumerate(lefts):
        wall[40:440, left - 8 : left + 520] = 12
        wall[48:432, left : left + 512] = as_gray(content(PAPER, number))
    return wall


@pytest.mark.exhaustive
def test_a_place_that_was_set_aside_is_passed_over_for_a_time() -> None:
    wall, tracker = wall_with_prints(60, 700), Tracker(PAPER)
    found = []
    for number in range(100):
        tracked = tracker.follow(wall, number / 30)
        if tracked is None:
            assert not found
            continue
        if tracked.anew or not found:
            found.append(tracked.corners)
        tracker.set_aside(number / 30, forget=False)
    both = [UPRIGHT + np.array([left, 48]) for left in (60, 700)]
    assert len(found) == 2
    assert all(any(is_at(corners, [place]) for corners in found) for place in both)
    tracker.set_aside(4.0, forget=True)
    assert tracker.follow(wall, 4.1) is None
    assert any(tracker.follow(wall, 4.1 + ASIDE_S + number / 30) for number in range(20))


@pytest.mark.exhaustive
def test_a_still_print_keeps_no_display_from_being_read() -> None:
    """The camera moves the print and the display alike."""
    loop = encode(TEXT, ROBUST.n_bits)
    shown = as_gray(content(PAPER))
    images, corners = filmed(ROBUST, 180, 3, message=loop)
    receiver = Receiver([BlockMeans(PAPER), BlockMeans(ROBUST)], 30.0)
    first, message = None, None
    for number, image in enumerate(beside_print(images, corners, shown)):
        step = receiver.push(image, number / 30)
        first = first or (step.tracked and receiver.layout)
        if step.message is not None:
            message = step.message.data
            break
    assert first == PAPER
    assert message == TEXT
    assert STILL_S < number / 30 < STILL_S + 3.0


@pytest.mark.slow
def test_a_display_of_which_nothing_is_read_is_looked_for_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As where some of its corners lie elsewhere, and its pilots are seen all the same."""
    monkeypatch.setattr(judge_module, "AMISS_PAIRS", 8)
    rng, found, message = np.random.default_rng(0), 0, None
    decoder = BlockMeans(ROBUST)
    right = decoder.decode

    def amiss(original: Image, embedded: Image) -> SoftBits:
        return right(original, embedded) if found > 1 else SoftBits(rng.normal(0, 1, ROBUST.n_bits))

    decoder.decode = amiss  # type: ignore[method-assign]
    receiver = Receiver(decoder, 30.0)
    images, _ = filmed(ROBUST, 90, 3, message=encode(TEXT, ROBUST.n_bits))
    for number, image in enumerate(images):
        step = receiver.push(image, number / 30)
        found += step.tracked is not None and step.tracked.anew
        if step.message is not None:
            message = step.message.data
            break
    assert found == 2
    assert message == TEXT


def test_displays_are_at_one_place_that_nearly_coincide() -> None:
    other = make_layout(width=400)
    assert is_at(UPRIGHT, [UPRIGHT + 500, UPRIGHT + 20])
    assert not is_at(UPRIGHT, [])
    assert not is_at(UPRIGHT, [np.roll(UPRIGHT, 1, axis=0)])
    assert not is_at(UPRIGHT, [frame_corners(other.width // 2, other.height // 2)])
