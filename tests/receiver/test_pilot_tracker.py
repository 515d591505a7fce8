"""A display with pilots is found, followed, moved, lost and found again; odd frames do no harm."""

import copy
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from conftest import exhaustive
from pilot_films import FINE, OTHER, BlockMeans, filmed, moving_picture

from link.presets import PRESETS
from link.types import Array, Image
from receiver.pilots.search.watch import Watch
from receiver.pilots.stabilise import WIDTH, Stabiliser, small_gray
from receiver.receiver import Receiver
from receiver.seen import SeenFrame
from receiver.timing.synchronise import MIN_FRAMES
from receiver.tracking.judge import CHECK_EVERY, PATIENCE
from receiver.tracking.pilots import PilotTracker

FPS = 60.0
"""Frames a second of the films."""
CLOSE_PX = 4.0
"""A third of a block as it is filmed; what is left is mended when blocks have been decoded."""

Film = tuple[list[Image], Array]
"""Images, and the display's corners in each."""


@pytest.fixture(scope="module")
def film() -> Film:
    return filmed(FINE, 40, seed=2)


def found_in(look: Callable[[Image, float], SeenFrame | None], images: list[Image]) -> int | None:
    """Number of the first frame with the display."""
    for number, image in enumerate(images):
        if look(image, number / FPS) is not None:
            return number
    return None


@pytest.mark.slow
def test_a_display_is_found_and_followed(film: Film) -> None:
    """Found to parts of a pixel; then the hand leads it astray."""
    images, corners = film
    tracker, seen, off = PilotTracker([OTHER, FINE], FPS), [], []
    for number, (image, expected) in enumerate(zip(images, corners, strict=True)):
        tracked = tracker.follow(image, number / FPS)
        if tracked is not None:
            assert tracked.layout == FINE
            off.append(np.abs(tracked.corners - expected).max())
            assert tracked.rectified.shape == (FINE.height, FINE.width)
        seen.append(tracked is not None)
    assert seen == sorted(seen)  # once found it stays
    assert sum(seen) > 10
    assert off[0] < 1
    assert max(off) < CLOSE_PX


@pytest.mark.slow
def test_a_display_that_is_found_is_shown_in_the_frames_before(
    film: Film,
) -> None:
    images, corners = film
    images = [cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) for image in images]
    tracker = PilotTracker([OTHER, FINE], FPS)
    number, tracked = next(
        (number, tracked)
        for number, image in enumerate(images)
        if (tracked := tracker.follow(image, number / FPS)) is not None
    )
    times = [seen.time for seen in tracked.before]
    assert times == [earlier / FPS for earlier in range(number - len(times), number)]
    assert len(times) > 12
    for earlier, seen in zip(range(number - len(times), number), tracked.before, strict=True):
        assert np.abs(seen.corners - corners[earlier]).max() < CLOSE_PX
        assert seen.rectified.shape == tracked.rectified.shape
        assert not seen.before
    following = tracker.follow(images[number + 1], (number + 1) / FPS)
    assert following is not None
    assert following.before == ()


@pytest.mark.slow
def test_the_clock_counts_the_frames_of_the_search(film: Film) -> None:
    images, _ = film
    receiver, known = Receiver(BlockMeans(FINE), FPS), []
    for number, image in enumerate(images):
        step = receiver.push(image, number / FPS)
        known.append((step.tracked is not None, receiver.synchronised))
    found, clock = (list(column).index(True) for column in zip(*known, strict=True))
    assert found <= clock <= max(found + 2, MIN_FRAMES)


@pytest.mark.slow
def test_a_display_whose_picture_moves_is_found_and_followed() -> None:
    images, corners = filmed(FINE, 100, seed=2, pan=4.0)
    receiver, off = Receiver(BlockMeans(FINE), FPS), []
    for number, (image, expected) in enumerate(zip(images, corners, strict=True)):
        tracked = receiver.push(image, number / FPS).tracked
        off.append(np.inf if tracked is None else np.abs(tracked.corners - expected).max())
    assert max(off[-40:]) < CLOSE_PX


def test_of_two_motions_that_of_the_points_that_lie_farther_apart_is_chosen() -> None:
    for far_apart, moved in ((False, 6.0), (True, 0.0)):
        stabiliser = Stabiliser(moving_picture(0), far_apart=far_apart)
        H = stabiliser.follow(moving_picture(6))
        middle = H @ [320.0, 320.0, 1.0]
        assert middle[0] / middle[2] - 320 == pytest.approx(moved, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("blank", [exhaustive(1), 2])
def test_blank_frames_before_a_display_do_not_hold_it_up(film: Film, blank: int) -> None:
    images, _ = film
    found = [
        found_in(PilotTracker([FINE], FPS).follow, [*before, *images])
        for before in ([], [np.zeros_like(images[0])] * blank)
    ]
    assert found[1] == found[0] + blank


@pytest.mark.slow
def test_a_display_that_stops_toggling_is_lost_and_found_again(film: Film) -> None:
    images, _ = film
    rng = np.random.default_rng(1)
    receiver, start = Receiver(BlockMeans(FINE), FPS), 0.0

    def look(image: Image, time: float) -> SeenFrame | None:
        return receiver.push(image, start + time).tracked

    assert found_in(look, images) is not None
    grainy = [
        np.clip(images[-1] + rng.normal(0, 1, images[-1].shape), 0, 255).astype(np.uint8)
        for _ in range(8)
    ]
    start = len(images) / FPS
    lost = next(n for n in range(300) if look(grainy[n % 8], n / FPS) is None)
    assert CHECK_EVERY * PATIENCE - len(images) < lost <= CHECK_EVERY * (PATIENCE + 3)
    again, corners = filmed(FINE, 50, seed=9)
    start += (lost + 1) / FPS
    number = found_in(look, again)
    tracked = look(again[number + 1], (number + 1) / FPS)
    assert np.abs(tracked.corners - corners[number + 1]).max() < CLOSE_PX


@pytest.mark.slow
def test_a_display_that_the_room_loses_is_followed_by_its_picture_next(film: Film) -> None:
    """The room may be dark; the picture may not move after all."""
    images, _ = film
    tracker = PilotTracker([FINE], FPS)
    tracker._search.doubt_picture()
    assert found_in(tracker.follow, images) is not None
    assert tracker.follow(np.full_like(images[0], 60), len(images) / FPS) is None
    assert tracker._search.picture_moves and tracker._search._begun == 0


# odd frames


def noise(*shape: int) -> Image:
    return np.random.default_rng(list(shape)).integers(0, 256, shape, np.uint8)


def changing(*images: Image) -> Callable[[int], Image]:
    """Some frames of each image in turn."""
    return lambda number: images[number // 14 % len(images)]


WALL = np.repeat(noise(24, 32), 5, axis=0).repeat(5, axis=1)
"""A still picture of 160 x 120 with enough to follow."""
ODD: dict[str, Callable[[int], Image]] = {
    "black": lambda _: np.zeros((120, 160, 3), np.uint8),
    "tiny": lambda _: noise(16, 16, 3),
    "wide": lambda _: noise(17, 1200),
    "tall": lambda _: noise(1200, 17),
    "gray": lambda _: WALL,
    "noise": lambda number: np.random.default_rng(number).integers(0, 256, (60, 80, 3), np.uint8),
    "sizes": changing(WALL, noise(90, 110, 3), WALL[:100, :140]),
    "gray and RGB": changing(WALL, np.repeat(WALL[:, :, None], 3, axis=2)),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*list(ODD)[:-1], exhaustive("gray and RGB")])
def test_odd_frames_hold_no_display(kind: str) -> None:
    decoders = [BlockMeans(preset.layout) for preset in PRESETS.values()]
    receiver = Receiver(decoders, 30.0)
    for number in range(27):
        step = receiver.push(ODD[kind](number), number / 30)
        assert (step.tracked, step.pairs, step.message) == (None, [], None)
    assert receiver.finish().pairs == []
    assert receiver.found == sum(decoder.pairs for decoder in decoders) == 0


@pytest.mark.parametrize(
    "shape", [(16, 16), (17, 70_000), (3000, 16), (480, 641), (16, 700)], ids=str
)
def test_copies_of_any_shape_are_held_still(shape: tuple[int, int]) -> None:
    gray = noise(*shape)
    stabiliser = Stabiliser(gray)
    height, width = stabiliser.still(small_gray(gray), np.eye(3)).shape
    assert height >= 1
    assert 1 <= width <= WIDTH
    H = stabiliser.follow(small_gray(gray))
    if H is not None:
        np.testing.assert_allclose(H / H[2, 2], np.eye(3), atol=1e-2)
    corner = np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])
    np.testing.assert_allclose(
        stabiliser.on_image(corner), [[-0.5, -0.5], [shape[1] - 0.5, shape[0] - 0.5]], atol=1e-6
    )
    assert not Watch(gray, 0.0, 30.0, picture_moves=True).take(np.zeros((50, 50), np.uint8), 0.1)


@pytest.fixture(scope="module")
def following(film: Film) -> PilotTracker:
    """A tracker that has found the display of the film; each test goes on with a copy."""
    tracker = PilotTracker([FINE], FPS)
    assert found_in(tracker.follow, film[0]) is not None
    return tracker


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["size", "colour", "black"])
def test_a_followed_display_bears_a_change_of_the_frames(
    kind: str, film: Film, following: PilotTracker
) -> None:
    images, _ = film
    tracker = copy.deepcopy(following)
    changed = {
        "size": images[-1][:300, :400],
        "colour": np.repeat(images[-1][:, :, None], 3, axis=2),
        "black": np.zeros_like(images[-1]),
    }[kind]
    for number in range(3):
        tracked = tracker.follow(np.ascontiguousarray(changed), (len(images) + number) / FPS)
        assert (tracked is not None) == (kind == "colour")
