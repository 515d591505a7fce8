"""The page follows displays by what surrounds them, and notices pictures that move, as Python."""

import cv2
import numpy as np
import pytest
from conftest import cases
from pilot_films import CORNERS, FINE, texture
from port import Port, same
from tolerances import CORNERS_PX, FLOAT64, FOLLOWED_PX, PROFILE_LEVELS, SAME_PX

from link.geometry import homography_from_corners, transform
from link.types import Array, Floats, Image
from receiver.pilots.outline import Border, Outline, border_profiles
from receiver.pilots.search.film import APART, VOTES, HeldFrame, MovingOutline, Surrounded
from receiver.pilots.search.watch import Watch
from receiver.tracking.follow import Follower

OUTLINE_JS, FILM_JS = "receiver/pilots/outline.js", "receiver/pilots/search/film.js"
FRAMES, PAN_PX = 7, 2


def hand(number: int) -> Array:
    """A camera's motion since the first frame: a homography between images of 640 x 480."""
    turn, x, y = 0.004 * number, 3 * np.sin(number / 2), -1.5 * number
    return np.array([[1 + turn / 3, turn, x], [-turn, 1, y], [1e-6 * number, 0, 1]])


def moving_film(pan: float) -> tuple[list[Image], Array]:
    """Frames of a bezel before a wall; the picture within pans by itself; and its corners."""
    rng, (width, height) = np.random.default_rng(5), (FINE.width, FINE.height)
    wall, images = 70 + 12 * texture((480, 640), 1), []
    bezel = np.round(CORNERS.mean(axis=0) + 1.06 * (CORNERS - CORNERS.mean(axis=0))).astype(int)
    cv2.fillConvexPoly(wall, bezel, 20.0)
    wide: Floats = 130 + 30 * texture((height, width + FRAMES * PAN_PX), 2, 3)
    H = homography_from_corners(CORNERS, width, height)
    for number in range(FRAMES):
        first = round(pan * number)
        view = wall.copy()
        shown = np.ascontiguousarray(wide[:, first : first + width])
        cv2.warpPerspective(shown, H, (640, 480), view, borderMode=cv2.BORDER_TRANSPARENT)
        view = cv2.warpPerspective(view, hand(number), (640, 480), borderMode=cv2.BORDER_REPLICATE)
        images.append(np.clip(view + rng.normal(0, 1, view.shape) + 0.5, 0, 255).astype(np.uint8))
    return images, np.array([transform(hand(number), CORNERS) for number in range(FRAMES)])


def test_the_edges_along_the_border_tell_where_the_display_is(port: Port) -> None:
    """One place of the newest frame is right, the other has moved on with the picture."""
    images, corners = moving_film(PAN_PX)
    right, wrong = corners[-1], corners[-1] + [4.0, 0.0]
    profiles = port(OUTLINE_JS).borderProfiles(images[0], CORNERS.tolist())
    same(profiles, border_profiles(images[0], CORNERS), PROFILE_LEVELS)
    border, ported = (
        Border(images[0], CORNERS),
        port(OUTLINE_JS).Border(images[0], CORNERS.tolist()),
    )
    for one, other in ((right, wrong), (wrong, right)):
        known = border.is_rather(images[-1], one, other)
        assert known is (one is right)
        assert ported.isRather(images[-1], one.tolist(), other.tolist()) is known


@cases((0.0, 160), (PAN_PX, 160), (PAN_PX, 96), ids=["still", "moving", "small"])
def test_what_surrounds_a_display_is_followed(pan: float, width: int, port: Port) -> None:
    """The last frame shows something else, and what is followed comes again after it."""
    images, corners = moving_film(pan)
    images.insert(-1, images[0][::-1, ::-1].copy())
    outline = Outline(images[0], CORNERS, width)
    ported = port(OUTLINE_JS).Outline(images[0], CORNERS.tolist(), width)
    assert outline.is_clear is ported.isClear is True
    for number, image in enumerate(images[1:-2], 1):
        known, found = outline.follow(image), ported.follow(image)
        same(found, known, SAME_PX)
        assert np.abs(known - corners[number]).max() < FOLLOWED_PX
    assert outline.follow(images[-2]) is ported.follow(images[-2]) is None
    guess = corners[-1] + 0.5
    same(ported.follow(images[-1], guess.tolist()), outline.follow(images[-1], guess), SAME_PX)


@cases("wall", "outside")
def test_plain_surroundings_tell_nothing(where: str, port: Port) -> None:
    """Those of a display before an even wall, and of one that fills the image."""
    corners = CORNERS if where == "wall" else np.array([[0, 0], [639, 0], [639, 479], [0, 479.0]])
    gray = np.full((480, 640), 90, np.uint8)
    cv2.fillConvexPoly(gray, np.round(0.9 * (CORNERS - 300) + 300).astype(int), 140)
    assert Outline(gray, corners).is_clear is False
    assert port(OUTLINE_JS).Outline(gray, corners.tolist()).isClear is False


def test_a_picture_that_moves_by_itself_is_noticed(port: Port) -> None:
    """Frames know where corners near the quadrilateral lie, from whichever of them on."""
    images, corners = moving_film(PAN_PX)
    module = port(FILM_JS)
    outline = MovingOutline(images[0], CORNERS)
    ported = module.MovingOutline(images[0], CORNERS.tolist())
    far = APART * float(np.sqrt(cv2.contourArea(CORNERS.astype(np.float32))))
    off = [0.0, 0.5 * far, *[max(4.0, 2 * far)] * VOTES]
    for number, (image, apart) in enumerate(zip(images[1:], off, strict=False), 1):
        shown = corners[number] + [apart, 0]
        known, found = outline.take(image, shown), ported.take(image, shown.tolist())
        assert isinstance(known, Surrounded)
        motions = known.motion, found.motion.reshape(3, 3)
        same(*(transform(H, CORNERS) for H in motions), SAME_PX)
        assert outline.picture_moves == ported.pictureMoves == (number == len(off))
        near = np.roll(1.1 * (CORNERS - 300) + 300, 1, axis=0)
        same(ported.distance(near.tolist()), known.outline.distance(near), FLOAT64)
        for quad in (near, CORNERS + 120):
            frame = HeldFrame(image, np.eye(3), 1.0, 0.1, surrounded=(known,))
            page = module.HeldFrame(image, np.eye(3).reshape(-1), 1, 0.1, None, [found])
            same(page.corners(quad.tolist()), frame.corners(quad), SAME_PX)
            moved = bool(np.abs(frame.corners(quad) - quad).max() > 0)
            assert moved == (outline.picture_moves and quad is near)
    assert outline.take(images[0][::-1], None) is ported.take(images[0][::-1].copy(), None) is None


@pytest.mark.parametrize("pan", [0.0, PAN_PX])
def test_followers_notice_that_pictures_move(pan: float, port: Port) -> None:
    """Until they do, they follow points of the picture, of which chance chooses some."""
    images, corners = moving_film(pan)
    follower, ported = Follower(FINE), port("receiver/tracking/follow.js").Follower(FINE)
    view = follower.rectified(images[0], CORNERS)
    assert view is not None
    follower.begin(images[0], CORNERS, view)
    ported.begin(images[0], CORNERS.tolist(), ported.rectified(images[0], CORNERS.tolist()))
    for image in images[1:]:
        step, found = follower.step(image), ported.step(image)
        assert step is not None
        if follower._picture_moves or not pan:
            same(found.corners, step[0], CORNERS_PX)
            assert found.fresh == step[1]
        follower.advance(step[0])
        ported.advance(found.corners)
    assert follower._picture_moves == (pan > 0)
    assert np.abs(step[0] - corners[-1]).max() < FOLLOWED_PX


def test_a_cut_in_the_picture_does_not_end_a_watch(port: Port) -> None:
    """The bezel before a plain wall holds the film still, where all points are the picture's.

    What is proposed late follows it, too, in all frames watched. A frame of another size ends it.
    """
    images, corners = moving_film(0.0)
    rng = np.random.default_rng(1)
    for number, (image, at) in enumerate(zip(images, corners, strict=True)):
        bezel = np.round(at.mean(axis=0) + 1.06 * (at - at.mean(axis=0))).astype(int)
        beyond = cv2.fillConvexPoly(np.zeros_like(image), bezel, 1) == 0
        image[beyond] = 70
        inside = cv2.fillConvexPoly(np.zeros_like(image), at.round().astype(int), 1) > 0
        if number > 2:
            image[inside] = rng.integers(0, 256, image.shape)[inside]
    watch = Watch(images[0], 0.0, 30.0, picture_moves=False)
    ported = port("receiver/pilots/search/watch.js").Watch(images[0], 0.0, 30, False)
    watch.surround([CORNERS])
    ported.surround([CORNERS.tolist()])
    for number, image in enumerate(images[1:], 1):
        assert watch.take(image, number / 30)
        assert ported.take(image, number / 30)
    found = watch.held[-1].corners(CORNERS)
    assert np.abs(found - corners[-1]).max() < FOLLOWED_PX
    same(ported.newest.corners(CORNERS.tolist()), found, CORNERS_PX)
    assert watch.moves(CORNERS)
    for frames, places, motion, on_image in (
        (watch.frames, watch.places(CORNERS), "H_image_from_reference", watch.on_image),
        (
            ported.frames,
            ported.places(CORNERS.tolist(), None),
            "HFrameFromReference",
            ported.onImage,
        ),
    ):
        assert len(places) == len(frames)
        for frame, place, at in zip(frames, places, corners, strict=False):
            H = np.reshape(getattr(frame, motion), (3, 3))  # JavaScript's are flat
            assert np.abs(transform(H, np.array(on_image(place))) - at).max() < FOLLOWED_PX
    for each in (watch, ported):
        assert not each.take(np.ascontiguousarray(images[-1][:-1]), len(images) / 30)
