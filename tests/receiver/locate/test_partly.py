"""A display partly in view: found, followed and decoded; and what a search in vain may cost."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np
import pytest
from conftest import slow
from drawn_scenes import HEIGHT, LAYOUT, WIDTH, content, room, scene, with_corner_out
from streams import Stream, states_of

import receiver.tracking.patches as track
from data_gen.pictures.library import load_pictures
from export.runtime import Decoder
from link.embed import embed
from link.geometry import (
    check_corners,
    frame_corners,
    homography_from_corners,
    in_image,
    transform,
)
from link.layout import Layout, make_layout
from link.steps import Steps, run_to_end
from link.types import Array, Image
from models import PRETRAINED
from receiver.locate.candidates import Located
from receiver.locate.find import locate, search_steps
from receiver.locate.patches import patches_in_view, seen_correlation
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.receiver import Receiver
from receiver.tracking.patches import Tracker

TEXT = b"hidden"
IN_VIEW_PX = 6.0
"""Largest error of a place of the display that is in view, in these scenes of 640 x 480."""
SEARCH_WORK = 450
"""Units of work that a whole search in vain takes at most; a frame at 1280 x 720 takes 0.3 ms a
unit on two idle cores."""


def error_in_view(found: Array, corners: Array) -> float:
    """Largest error of the display's places that lie in the image, pixels."""
    x, y = np.meshgrid(np.linspace(0, LAYOUT.width, 9), np.linspace(0, LAYOUT.height, 9))
    places = np.column_stack([x.ravel(), y.ravel()]) - 0.5
    H = [homography_from_corners(c, LAYOUT.width, LAYOUT.height) for c in (found, corners)]
    one, two = (transform(each, places) for each in H)
    seen = in_image(two, (HEIGHT, WIDTH))
    return float(np.linalg.norm(one - two, axis=1)[seen].max())


@pytest.mark.parametrize("corner", [0, slow(2)])
def test_a_display_with_a_corner_out_of_view_is_found(corner: int) -> None:
    corners = with_corner_out(corner)
    assert not in_image(corners, (HEIGHT, WIDTH))[corner]
    found = locate(scene(content(LAYOUT), corners), LAYOUT)
    assert error_in_view(found.corners, corners) < IN_VIEW_PX


@pytest.mark.slow
@pytest.mark.parametrize("cells", [((0, 0), (7, 7)), ((7, 0),)])
def test_a_display_with_covered_patches_is_found(cells: tuple[tuple[int, int], ...]) -> None:
    shown = content(LAYOUT)
    for row, col in cells:
        top, bottom, left, right = LAYOUT.cell_box(row, col)
        shown[top:bottom, left:right] = (150, 110, 90)
    corners = np.array([[150.2, 95.7], [520.4, 120.3], [490.8, 380.1], [130.6, 350.9]])
    found = locate(scene(shown, corners), LAYOUT)
    assert error_in_view(found.corners, corners) < IN_VIEW_PX


@pytest.mark.slow
def test_photographs_without_a_display_show_none() -> None:
    pictures = load_pictures("test", 640, 360)
    bare = [p.rgb for p in pictures if p.name.startswith("photo/")][:4]
    for image in bare:
        assert locate(image, LAYOUT) is None


def test_patches_out_of_view_are_left_out() -> None:
    corners = frame_corners(WIDTH, HEIGHT) + np.array([-100, 0])
    in_view = patches_in_view(corners, LAYOUT, (HEIGHT, WIDTH))
    assert in_view.tolist() == [False, True, True, False, True]  # left column out
    match = np.array([0.1, 0.97, 0.98, 0.2, 0.99])
    assert seen_correlation(match, in_view) == pytest.approx(0.98 - 0.08)
    assert seen_correlation(match, np.array([0, 1, 0, 0, 1], bool)) == -1
    assert seen_correlation(np.full(5, 0.95), np.ones(5, bool)) == pytest.approx(0.95)
    by_chance = np.array([0.99, 0.22, 0.84, 1.0, -0.25])  # two patches, and what looks like a third
    assert seen_correlation(by_chance, np.ones(5, bool)) == pytest.approx(0.56)


def test_corners_may_lie_outside_as_far_as_is_said() -> None:
    corners = np.array([[-20.0, 10], [90, 10], [90, 90], [10, 90]])
    assert check_corners(corners, (100, 100), outside=0.25).shape == (4, 2)
    with pytest.raises(ValueError, match="lies outside"):
        check_corners(corners, (100, 100), outside=0.15)


# what a search costs: units of work, counted and not timed


@dataclass
class Counted:
    """Counts the work of each frame's steps, in place of a search that finds nothing."""

    steps: int = 20
    each: int = 18
    work: int = 0

    def __call__(
        self, image: Image, layout: Layout, avoid: Sequence[Array]
    ) -> Steps[Located | None]:
        for _ in range(self.steps):
            self.work += self.each
            yield self.each
        return None


def noisy(level: int, rng: np.random.Generator) -> Image:
    return np.clip(rng.normal(level, 3, (120, 160, 3)), 0, 255).astype(np.uint8)


def test_the_work_of_a_frame_is_bounded_and_falls_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    counted, rng = Counted(), np.random.default_rng(0)
    monkeypatch.setattr(track, "search_steps", counted)
    tracker, works = Tracker(LAYOUT), []
    for number in range(120):
        counted.work = 0
        assert tracker.follow(noisy(90, rng), number / 30) is None
        works.append(counted.work)
    assert max(works) < track.QUICK_WORK + counted.each
    assert np.mean(works[40:]) < SEARCH_WORK / 4 / 4  # of a search in every fourth frame


class Noted(Counted):
    """Notes the frames at which searches begin and end."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0
        self.searches: list[tuple[int, int]] = []

    def __call__(
        self, image: Image, layout: Layout, avoid: Sequence[Array]
    ) -> Steps[Located | None]:
        begun = self.now
        yield from super().__call__(image, layout, avoid)
        self.searches.append((begun, self.now))
        return None


@pytest.mark.parametrize("before", [0, 40, 54])
def test_a_display_that_appears_is_looked_for_at_once(
    before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the state of a search in vain, a whole one ends within half a second."""
    rng, noted = np.random.default_rng(0), Noted()
    monkeypatch.setattr(track, "search_steps", noted)
    tracker = Tracker(LAYOUT)
    for noted.now in range(before + 16):
        image = noisy(90, rng)
        if noted.now >= before:
            image[30:60, 40:120] = 200
        tracker.follow(image, noted.now / 30)
    first = next(end for begun, end in noted.searches if begun >= before)
    assert first - before <= 15


def test_the_steps_of_a_search_are_small_and_tell_their_work() -> None:
    image = np.clip(room(), 0, 255).astype(np.uint8)
    steps, works = search_steps(image, LAYOUT), []
    try:
        while True:
            works.append(next(steps))
    except StopIteration as end:
        assert end.value is None
    assert max(works) <= 65
    assert sum(works) <= SEARCH_WORK
    assert run_to_end(search_steps(np.zeros((40, 2000, 3), np.uint8), LAYOUT)) is None


# decoding what is seen


@pytest.fixture(scope="module")
def decoder() -> Decoder:
    return Decoder(PRETRAINED / "decoder.onnx")


@pytest.mark.parametrize("patches", [1, 2])
def test_unseen_blocks_cost_the_others_nothing(patches: int, decoder: Decoder) -> None:
    rng = np.random.default_rng(3)
    picture = load_pictures("test", LAYOUT.width, LAYOUT.height)[1].rgb
    bits = rng.integers(0, 2, LAYOUT.n_bits)
    shown = embed(picture, bits, LAYOUT, kappa=4)
    images = []
    for image, gain in ((shown.original, 0.9), (shown.embedded, 0.91)):  # exposure drifts
        seen = gain * image + rng.normal(0, 1.5, image.shape)
        seen[:, : LAYOUT.width // 8] = seen[:, LAYOUT.width // 8, None]  # as beyond an image
        if patches == 1:
            seen[LAYOUT.height // 2 :, : LAYOUT.width // 8] = (
                gain * image[LAYOUT.height // 2 :, : LAYOUT.width // 8]
            )
        images.append(np.clip(seen, 0, 255).astype(np.uint8))
    purity = np.ones((16, 16))
    purity[: 8 if patches == 1 else 16, :2] = 0
    unseen = unseen_blocks(images[0], images[1], purity, LAYOUT)
    assert unseen[:, 1:].sum() == 0
    assert unseen[:, 0].sum() == (4 if patches == 1 else 8)
    scores = decoder.decode(*fill_unseen(images, unseen, LAYOUT)).scores
    told = ~unseen[LAYOUT.message_mask]
    assert ((scores > 0) == (bits == 1))[told].all()
    assert (np.abs(scores[told]) > 2).mean() > 0.95


def test_nothing_hidden_changes_nothing() -> None:
    images = [np.zeros((LAYOUT.height, LAYOUT.width), np.uint8)] * 2
    nothing = np.zeros((8, 8), bool)
    assert fill_unseen(images, nothing, LAYOUT)[0] is images[0]
    assert fill_unseen(images, ~nothing, LAYOUT)[0] is images[0]  # and where all is


def numbered(layout: Layout) -> Image:
    """An image whose blocks have the colours of their row and column."""
    image = np.zeros((layout.height, layout.width, 3), np.uint8)
    for row, col in np.ndindex(layout.rows, layout.cols):
        top, bottom, left, right = layout.cell_box(row, col)
        image[top:bottom, left:right] = (row, col, 7)
    return image


def test_hidden_blocks_take_the_pixels_of_the_nearest_and_pilots_stay() -> None:
    layout = make_layout(24, 32, 500, 380, modulation="antipodal", pilots="auto")
    unseen = np.zeros((24, 32), bool)
    unseen[:, 20:] = unseen[:6] = True
    image = numbered(layout)
    first, second = fill_unseen([image, image[:, :, 0].copy()], unseen, layout)
    np.testing.assert_array_equal(second, first[:, :, 0])
    for row, col in np.ndindex(unseen.shape):
        top, bottom, left, right = layout.cell_box(row, col)
        block = first[top:bottom, left:right].reshape(-1, 3)
        assert (block == block[0]).all()  # of one source, whole
        seen = np.argwhere(layout.message_mask & ~unseen)
        nearest = seen[np.abs(seen - [row, col]).sum(axis=1).argmin()]
        is_filled = unseen[row, col] and layout.message_mask[row, col]
        np.testing.assert_array_equal(block[0, :2], nearest if is_filled else (row, col))


def test_the_finest_grid_is_filled_soon() -> None:
    layout = make_layout(96, 128, modulation="antipodal", pilots="auto")
    purity = np.ones((16, 16))
    purity[:, :8] = 0
    image = np.random.default_rng(0).integers(0, 256, (layout.height, layout.width), np.uint8)
    unseen = unseen_blocks(image, image, purity, layout)
    assert 0.5 <= unseen.mean() < 0.6
    began = process_time()
    filled = fill_unseen([image, image], unseen, layout)
    assert process_time() - began < 0.4  # about 0.03 s
    assert (filled[0][:, : layout.width // 2] != image[:, : layout.width // 2]).any()
    seen = np.kron(~unseen, np.ones((4, 4), bool))
    np.testing.assert_array_equal(filled[0][seen], image[seen])


@dataclass(frozen=True)
class CutOff(Stream):
    """A stream whose display has a corner out of view."""

    def corners(self, time: float) -> Array:
        swing = 4 * np.sin(1.3 * time + np.arange(8).reshape(4, 2) / 9)
        return np.asarray(with_corner_out(2, 0.12) + swing)


@pytest.mark.slow
def test_a_message_comes_with_a_corner_out_of_view(decoder: Decoder) -> None:
    states = states_of(TEXT, LAYOUT, np.random.default_rng(5))
    receiver, message = Receiver(decoder, 30), None
    for time, image, corners in CutOff().frames(states, 4, np.random.default_rng(6)):
        step = receiver.push(image, time)
        if step.tracked is not None:
            assert error_in_view(step.tracked.corners, corners) < IN_VIEW_PX
        message = step.message
        if message is not None:
            break
    assert message is not None and message.data == TEXT
