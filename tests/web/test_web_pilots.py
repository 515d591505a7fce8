"""The page weighs pilots, maps toggling, holds frames still and moves corners as Python does."""

import cv2
import numpy as np
import pytest
import tolerances as within
from conftest import cases
from numpy.typing import NDArray
from pilot_films import (
    BENT_CORNERS,
    BENT_SIZE,
    FINE,
    block_views,
    moving_picture,
    pilots_alone,
    texture,
)
from port import Port, differences, same

from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import Layout, make_layout
from link.pilots import pilot_centres, pilot_signs, pilot_values
from link.steps import run_to_end
from link.types import Array
from receiver.pilots.compensate import Compensator, MovingPicture
from receiver.pilots.motion import map_size, moved_corners, without_slope
from receiver.pilots.search.all_blocks import block_fit, block_maps
from receiver.pilots.search.parts import COARSE_SIZE, coarse_shift
from receiver.pilots.search.stills import Stills
from receiver.pilots.signal import common_phase, pilot_evidence
from receiver.pilots.stabilise import Stabiliser, small_gray
from receiver.pilots.toggling import Wave
from receiver.pilots.waves import position, span_of, waves

SMALL = make_layout(12, 16, 128, 96, modulation="antipodal", pilots=40)
UNEVEN = make_layout(10, 14, 128, 96, modulation="antipodal", pilots=30)
HIDDEN = make_layout(48, 64, modulation="antipodal", pilots="auto")
CORNERS = np.array([[120.0, 70.0], [520.0, 90.0], [510.0, 390.0], [130.0, 360.0]])
CORNERS_JS, EVIDENCE_JS = "receiver/pilots/search/parts.js", "receiver/pilots/signal.js"
MOTION_JS = "receiver/pilots/motion.js"


def complex_plane(change: NDArray[np.complex64]) -> dict[str, object]:
    """A complex image as the page has it."""
    height, width = change.shape
    parts = {"real": change.real.reshape(-1), "imaginary": change.imag.reshape(-1)}
    return {"width": width, "height": height, **parts}


def same_motion(found: object, H: Array | None, size: tuple[int, int], tolerance: float) -> None:
    """Fail unless two homographies move all points of an image of a size alike."""
    __tracebackhide__ = True
    assert (found is None) == (H is None), f"{found}, not {H}"
    if H is None:
        return
    points = np.stack(np.meshgrid([0, 0.5, 1], [0, 0.5, 1]), axis=-1).reshape(-1, 2) * size
    same(transform(np.reshape(found, (3, 3)), points), transform(H, points), tolerance)


def test_medians_and_quantiles(port: Port) -> None:
    order, rng = port("link/order.js"), np.random.default_rng(0)
    for count in (3, 6, 101):
        values = rng.permutation(count).astype(np.float64)
        same(order.median(values), np.median(values))
        shares = [0.98, 0.123, 1.0]
        same(order.quantiles(values, shares), np.quantile(values, shares), within.SAME_STEPS)


RNG = np.random.default_rng(0)
DROPS = np.sort(RNG.choice(120, 26, replace=False)) + RNG.uniform(0, 0.4, 26)
GAPS = np.concatenate([np.arange(10), np.arange(1500, 1530)])


@cases(
    (np.arange(24), 0.0),
    (np.arange(24), 0.6),
    (np.arange(37), 1.5),
    (np.arange(3), 1.0),
    (DROPS, 1.0),
    (DROPS, 0.0),
    (GAPS, 1.0),
    (np.array([0, 30, 90, 95, 96, 101]), 1.0),
    ids=range(8),
)
def test_evidence_of_pilots(at: Array, strength: float, port: Port) -> None:
    rng, signs, module = np.random.default_rng(0), pilot_signs(FINE), port(EVIDENCE_JS)
    noise = rng.standard_normal((len(at), len(signs)))
    slow = 9 * np.cos(2 * np.pi * at / 150)[:, None] * rng.standard_normal(len(signs))
    wave = np.sign(np.cos(np.pi * (at + 0.5) / 2))
    values = noise + strength * wave[:, None] * signs + (slow if at[-1] > 40 else 0)
    same(port("link/pilots.js").pilotSigns(FINE), signs)
    found = module.pilotEvidence(list(values), FINE, at.tolist())
    same([found.evidence, found.frequency], pilot_evidence(list(values), FINE, at), within.FLOAT32)


@cases((SMALL, (128, 96)), (UNEVEN, (128, 96)), (SMALL, (100, 60)))
def test_values_of_pilots_in_a_frame(layout: Layout, size: tuple[int, int], port: Port) -> None:
    gray = np.random.default_rng(0).integers(0, 256, size[::-1], dtype=np.uint8)
    found = port("link/pilots.js").pilotValues(gray, layout)
    same(found, pilot_values(gray, layout), within.FLOAT32_SUM)


@pytest.mark.parametrize("slope", [(3.2, 0.0), (0.0, -1.4)])
def test_phases_that_slope(port: Port, slope: tuple[float, float]) -> None:
    rng, centres = np.random.default_rng(8), pilot_centres(FINE) - 0.5
    noise = rng.normal(0, 0.3, (2, FINE.pilots))
    seen = pilot_signs(FINE) * np.exp(1j * (centres @ slope + 0.4)) + noise[0] + 1j * noise[1]
    known, phase = common_phase(seen, FINE)
    found = port(EVIDENCE_JS).commonPhase({"real": seen.real, "imaginary": seen.imag}, FINE)
    same([*found.slope, found.phase], [*known, phase], within.FLOAT64)


@cases((30.0, 1.0, 3), (120.0, 1.0, 6), (60.0, 0.4, 3), (29.97, 0.5, 2))
def test_times_of_frames_and_waves_at_them(
    fps: float, kept: float, digits: int, port: Port
) -> None:
    """The times are rounded, and some frames are missing."""
    rng, module = np.random.default_rng(9), port("receiver/pilots/waves.js")
    seconds = np.round(np.flatnonzero(rng.random(60) < kept) / fps, digits)
    seconds -= seconds[0]
    at = [position(second, fps) for second in seconds]
    assert [module.position(second, fps) for second in seconds] == at
    span, fastest = span_of(at)
    found = module.spanOf(at)
    assert (found.span, found.fastest) == (span, fastest)
    frequencies, slower = np.arange(2, fastest + 1) / span, np.arange(2) / span
    made = waves(at, frequencies, slower)
    waved = module.waves(at, frequencies.tolist(), slower.tolist())
    same([wave.real for wave in waved], made.real.reshape(len(waved), -1), within.FLOAT64)
    same([wave.imaginary for wave in waved], made.imag.reshape(len(waved), -1), within.FLOAT64)


TILT = np.array([[8.0, -6], [-9, 4], [12, 10], [3, -7]])


@cases(
    ([0.0, 0.0], 0.3, False),
    ([17.0, -12.0], 0.3, False),
    ([40.0, 30.0], 0.5, True),
    (TILT, 0.3, False),
    ([9.0, 5.0], 3.0, False),
    ([150.0, 0.0], 2.0, False),
    ids=["still", "shifted", "far", "tilted", "noisy", "absent"],
)
def test_corners_move_by_parts_of_a_display(
    move: object, noise: float, far: bool, port: Port
) -> None:
    rng, module = np.random.default_rng(1), port(CORNERS_JS)
    square = frame_corners(FINE.width, FINE.height)
    H = homography_from_corners(np.add(square, move), FINE.width, FINE.height)
    shown = cv2.warpPerspective(pilots_alone(FINE, (FINE.width, FINE.height)), H, (512, 384))
    seen = cv2.resize(shown, COARSE_SIZE, interpolation=cv2.INTER_AREA)
    real, imaginary = seen[None] * np.array([0.8, 0.6])[:, None, None] + rng.normal(
        0, noise, (2, *seen.shape)
    )
    change = (real + 1j * imaginary).astype(np.complex64)
    known = coarse_shift(
        change, pilots_alone(FINE, (FINE.cols, FINE.rows)).astype(np.float64), FINE, far=far
    )
    blocks = port("link/pilots.js").expectedChanges(FINE)
    found = module.coarseShift(complex_plane(change), blocks, FINE, far)
    assert (found is None) == (known is None)
    if known is not None:
        assert found.parts == known[1]
        same_motion(found.HOldFromNew, known[0], (FINE.width, FINE.height), within.CORNERS_PX)


@pytest.mark.parametrize("layout", [FINE, SMALL], ids=["fine", "small"])
def test_maps_without_slope(port: Port, layout: Layout) -> None:
    module, size = port(MOTION_JS), map_size(layout)
    change = np.random.default_rng(2).normal(0, 1, size[::-1]).astype(np.float32)
    block = np.array([size[0] / layout.cols, size[1] / layout.rows])
    found = module.withoutSlope(change, block.tolist())
    same(found, without_slope(change, block), within.FLOAT32_SUM)


@cases(
    (SMALL, 4, 0.0, 1.0),
    (UNEVEN, 4, 2.0, 1.0),
    (SMALL, 2, 0.0, 2.0),
    (SMALL, 4, 0.0, 30.0),
    ids=["plain", "slope", "fast", "noisy"],
)
def test_corners_move_by_all_blocks(
    layout: Layout, period: int, slope: float, noise: float, port: Port
) -> None:
    """Corners are off by less than a block."""
    module = port("receiver/pilots/search/allBlocks.js")
    off = np.array([[2.0, -1.0], [-1.5, 1.0], [1.0, 2.0], [-1.0, -2.0]])
    views = block_views(layout, off, 5 * period, period, slope=slope, noise=noise)
    at = [number + 0.25 * (number % 3 == 0) for number in range(len(views))]
    maps = module.blockMaps(layout)
    assert maps.size == list(views.shape[:0:-1])
    toggling = port("receiver/pilots/toggling.js").Wave(1 / period)
    ported = run_to_end(iter(module.blockFitSteps(maps, list(views), at, toggling)))
    fit = run_to_end(block_fit(block_maps(layout), views, at, Wave(1 / period)))
    same(ported.changes, fit.changes, within.PILOT_CHANGE)
    for _ in range(5):
        settled = fit.step()
        assert run_to_end(iter(ported.moveSteps())) == settled
        if settled:
            break
    same_motion(ported.shift(), fit.shift(), (layout.width, layout.height), within.SUBPIXEL_PX)


@pytest.mark.parametrize("k", [-0.1, 0.05, 0.0])
def test_all_blocks_tell_how_a_lens_bends_the_display(port: Port, k: float) -> None:
    module = port("receiver/pilots/search/allBlocks.js")
    views, at = block_views(FINE, np.zeros((4, 2)), 16, 4, k=k), list(range(16))
    toggling = port("receiver/pilots/toggling.js").Wave(0.25)
    steps = module.blockFitSteps(module.blockMaps(FINE), list(views), at, toggling)
    ported = run_to_end(iter(steps))
    fit = run_to_end(block_fit(block_maps(FINE), views, at, Wave(0.25)))
    fit.free_lens(BENT_CORNERS, BENT_SIZE)
    ported.freeLens(BENT_CORNERS.tolist(), *BENT_SIZE)
    for _ in range(12):
        settled = fit.step()
        assert run_to_end(iter(ported.moveSteps())) == settled
        assert ported.bends() == fit.bends()
        if settled:
            break
    same(ported.k, fit.k, within.LENS_K)
    same_motion(ported.shift(), fit.shift(), (FINE.width, FINE.height), within.SUBPIXEL_PX)


def test_corners_of_what_lies_elsewhere_in_its_rectified_image(port: Port) -> None:
    H = np.array([[1.01, 0.02, 3.0], [-0.01, 0.99, -2.0], [1e-5, -2e-5, 1.0]])
    found = port(MOTION_JS).movedCorners(CORNERS.tolist(), H, FINE)
    same(found, moved_corners(CORNERS, H, FINE), within.MOVED_PX)


def test_small_views_of_frames_are_the_same(port: Port) -> None:
    stills, ported = Stills(), port("receiver/pilots/search/stills.js").Stills(300, 200)
    for shown in np.random.default_rng(4).integers(0, 256, (3, 200, 300), np.uint8):
        stills.add(shown)
        ported.add(shown)
    right = np.array([[80.0, 50.0], [208.0, 50.0], [208.0, 146.0], [80.0, 146.0]])
    views = ported.views([right.tolist()], 48, 48)
    for found, view in zip(views, stills.views([right], 48, 48), strict=True):
        assert differences(found, view)[1] < within.VIEW_MEAN


def test_of_two_motions_that_of_the_points_that_lie_farther_apart_is_chosen(port: Port) -> None:
    module = port("receiver/pilots/stabilise.js")
    for far_apart, expected_px in ((False, 6), (True, 0)):
        H = module.Stabiliser(moving_picture(0), far_apart).follow(moving_picture(6))
        moved = transform(H.reshape(3, 3), np.array([[320.0, 320.0]]))[0, 0] - 320
        assert abs(moved - expected_px) < within.FOUND_PX


@pytest.mark.parametrize("size", [(360, 640), (203, 357), (16, 11)])
def test_what_has_only_moved_is_taken_off_frames(port: Port, size: tuple[int, int]) -> None:
    """But for the border: what comes into sight there is found nowhere, or anywhere."""
    border = min(size) // 10
    inner = np.s_[border:-border, border:-border]
    wide = np.clip(120 + 40 * texture((size[0] + 20, size[1] + 40), 6), 0, 255).astype(np.uint8)
    frames = [wide[5 * n : size[0] + 5 * n, 9 * n : size[1] + 9 * n] for n in range(4)]
    for fps in (30, 60):
        compensator = Compensator(fps)
        ported = port("receiver/pilots/compensate.js").Compensator(fps)
        for frame in map(np.ascontiguousarray, frames):
            found, known = ported.take(frame), compensator.take(frame)
            assert differences(found[inner], known[inner])[1] < within.COMPENSATED_MEAN
    picture = MovingPicture()
    ported = port("receiver/pilots/compensate.js").MovingPicture()
    for frame in frames:
        known = picture.take(frame.astype(np.float32))
        found = np.asarray(ported.take(frame.astype(np.float32))).reshape(size)
        assert differences(found[inner], known[inner])[1] < within.COMPENSATED_MEAN


def test_frames_are_held_still(port: Port) -> None:
    """Frames of a texture seen by a hand that moves; the last shows something else."""
    wide = np.clip(120 + 40 * texture((560, 1000), 6, sigma=3), 0, 255).astype(np.uint8)
    moves = [np.eye(3)] * 3
    moves[1] = np.array([[1, 0.01, 6.0], [-0.01, 1, -4.0], [1e-6, 0, 1]])
    moves[2] = np.array([[1.01, 0.02, 9.0], [-0.02, 1.01, 2.5], [2e-6, -1e-6, 1]])
    frames = [cv2.warpPerspective(wide, move, (960, 540)) for move in moves]
    frames.append(np.full((540, 960), 90, np.uint8))
    stabiliser = Stabiliser(frames[0])
    ported = port("receiver/pilots/stabilise.js").Stabiliser(frames[0])
    motions = [stabiliser.follow(small_gray(frame)) for frame in frames]
    assert motions[3] is None
    for frame, H in zip(frames, motions, strict=True):
        same_motion(ported.follow(frame), H, (960, 540), within.CORNERS_PX)
    still = stabiliser.still(small_gray(frames[1]), motions[1])
    assert ported.reference.shape == still.shape
    found = ported.still(ported.copyOf(frames[1]), motions[1])
    assert differences(found, still)[1] < within.STILL_MEAN
    places = [[0.0, 0.0], [100.0, 50.0]]
    points = stabiliser.on_image(np.array(places))
    same(stabiliser.on_copy(points), places, within.FLOAT64)
    same(ported.onImage(places), points, within.FLOAT64)
    same(ported.onCopy(points.tolist()), places, within.FLOAT64)
