"""The page weighs pilots, maps toggling, holds frames still and moves corners as Python does."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pilot_films import FINE, MOVING_OUTLINE, block_views, moving_picture, texture
from web_fixtures import run_node_tests, write_fixture

from export.locate.pilots.all_blocks import BlockFit, BlockMaps
from export.locate.pilots.climb import climb_to_pilots
from export.locate.pilots.corners import (
    COARSE_SIZE,
    coarse_shift,
    map_size,
    moved_corners,
    without_slope,
)
from export.locate.pilots.evidence import (
    common_phase,
    pilot_centres,
    pilot_evidence,
    pilot_signs,
    pilot_values,
    standing_out,
)
from export.locate.pilots.stabilise import Stabiliser
from export.locate.pilots.toggle_map import ToggleMap
from export.locate.pilots.waves import position, span_of, waves
from export.web.tables import layout_table
from link.geometry import frame_corners, homography_from_corners
from link.layout import Layout, make_layout

SMALL = make_layout(12, 16, 128, 96, modulation="antipodal", pilots=40)
UNEVEN = make_layout(10, 14, 128, 96, modulation="antipodal", pilots=30)
HIDDEN = make_layout(48, 64, modulation="antipodal", pilots="auto")
CORNERS = np.array([[120.0, 70.0], [520.0, 90.0], [510.0, 390.0], [130.0, 360.0]])


def expected(layout: Layout) -> NDArray[np.float64]:
    blocks = np.zeros(layout.rows * layout.cols)
    blocks[layout.pilot_blocks] = pilot_signs(layout)
    return blocks.reshape(layout.rows, layout.cols)


def drawn(layout: Layout, size: tuple[int, int]) -> NDArray[np.float32]:
    return cv2.resize(expected(layout).astype("f4"), size, interpolation=cv2.INTER_NEAREST)


def evidence() -> dict[str, object]:
    rng, signs, cases = np.random.default_rng(0), pilot_signs(FINE), []
    drops = np.sort(rng.choice(120, 26, replace=False)) + rng.uniform(0, 0.4, 26)
    gaps = np.concatenate([np.arange(10), np.arange(1500, 1530)])
    for at, strength in (
        (np.arange(24), 0.0),
        (np.arange(24), 0.6),
        (np.arange(37), 1.5),
        (np.arange(3), 1.0),
        (drops, 1.0),
        (drops, 0.0),
        (gaps, 1.0),
        (np.array([0, 30, 90, 95, 96, 101]), 1.0),
    ):
        noise = rng.standard_normal((len(at), len(signs)))
        slow = 9 * np.cos(2 * np.pi * at / 150)[:, None] * rng.standard_normal(len(signs))
        wave = np.sign(np.cos(np.pi * (at + 0.5) / 2))
        values = noise + strength * wave[:, None] * signs + (slow if at[-1] > 40 else 0)
        found = pilot_evidence(list(values), FINE, at)
        cases.append({"values": values, "at": at.astype(np.float64), "found": found})
    grays = []
    for layout, (width, height) in ((SMALL, (128, 96)), (UNEVEN, (128, 96)), (SMALL, (100, 60))):
        gray = rng.integers(0, 256, (height, width), dtype=np.uint8)
        grays.append(
            {
                "layout": layout_table(layout),
                "gray": gray,
                "blocks": standing_out(gray, layout),
                "pilots": pilot_values(gray, layout),
            }
        )
    return {"signs": signs, "layout": layout_table(FINE), "cases": cases, "grays": grays}


def times() -> list[dict[str, object]]:
    """Frames of several rates whose times are rounded, and of which some are missing."""
    rng, cases = np.random.default_rng(9), []
    for fps, kept, digits in ((30.0, 1.0, 3), (120.0, 1.0, 6), (60.0, 0.4, 3), (29.97, 0.5, 2)):
        numbers = np.flatnonzero(rng.random(60) < kept)
        seconds = np.round(numbers / fps, digits)
        at = [position(second - seconds[0], fps) for second in seconds]
        span, fastest = span_of(at)
        made = waves(at, np.arange(2, fastest + 1) / span, np.arange(2) / span)
        cases.append(
            {
                "fps": fps,
                "seconds": seconds,
                "at": at,
                "span": (span, fastest),
                "real": made.real,
                "imaginary": made.imag,
            }
        )
    return cases


def phases() -> list[dict[str, object]]:
    """Pilots whose phase slopes from left to right, or from top to bottom."""
    rng, centres = np.random.default_rng(8), pilot_centres(FINE) - 0.5
    cases = []
    for slope in (np.array([3.2, 0.0]), np.array([0.0, -1.4])):
        noise = rng.normal(0, 0.3, (2, FINE.pilots))
        seen = pilot_signs(FINE) * np.exp(1j * (centres @ slope + 0.4)) + noise[0] + 1j * noise[1]
        found, phase = common_phase(seen, FINE)
        cases.append({"real": seen.real, "imaginary": seen.imag, "slope": found, "phase": phase})
    return cases


def coarse() -> list[dict[str, object]]:
    """Pilots that are shifted, tilted, turned, or absent, so that each kind of fit is made."""
    rng, cases = np.random.default_rng(1), []
    square = frame_corners(FINE.width, FINE.height)
    tilt = np.array([[8.0, -6], [-9, 4], [12, 10], [3, -7]])
    for move, noise, far in (
        ([0.0, 0.0], 0.3, False),
        ([17.0, -12.0], 0.3, False),
        ([40.0, 30.0], 0.5, True),
        (tilt, 0.3, False),
        ([9.0, 5.0], 3.0, False),
        ([150.0, 0.0], 2.0, False),
    ):
        H = homography_from_corners(np.add(square, move), FINE.width, FINE.height)
        shown = cv2.warpPerspective(drawn(FINE, (FINE.width, FINE.height)), H, (512, 384))
        seen = cv2.resize(shown, COARSE_SIZE, interpolation=cv2.INTER_AREA)
        real, imaginary = seen[None] * np.array([0.8, 0.6])[:, None, None] + rng.normal(
            0, noise, (2, *seen.shape)
        )
        change = (real + 1j * imaginary).astype(np.complex64)
        fit = coarse_shift(change, expected(FINE), FINE, far=far)
        cases.append(
            {
                "real": change.real,
                "imaginary": change.imag,
                "far": far,
                "H": None if fit is None else fit[0],
                "parts": None if fit is None else fit[1],
            }
        )
    return cases


def slopeless() -> list[dict[str, object]]:
    """Maps of two layouts, and what is left of their pixels without the mean around each."""
    rng, cases = np.random.default_rng(2), []
    for layout in (FINE, SMALL):
        size = map_size(layout)
        change = rng.normal(0, 1, size[::-1]).astype(np.float32)
        block = np.array([size[0] / layout.cols, size[1] / layout.rows])
        left = without_slope(change, block)
        table = layout_table(layout)
        cases.append({"layout": table, "size": size, "change": change, "slopeless": left})
    return cases


def all_blocks() -> list[dict[str, object]]:
    """Displays whose corners are off by less than a block, of two rates, one with a slope."""
    off = np.array([[2.0, -1.0], [-1.5, 1.0], [1.0, 2.0], [-1.0, -2.0]])
    cases = []
    for layout, period, slope, noise in (
        (SMALL, 4, 0.0, 1.0),
        (UNEVEN, 4, 2.0, 1.0),
        (SMALL, 2, 0.0, 2.0),
        (SMALL, 4, 0.0, 30.0),
    ):
        views = block_views(layout, off, 5 * period, period, slope=slope, noise=noise)
        at = [number + 0.25 * (number % 3 == 0) for number in range(len(views))]
        fit = BlockFit(BlockMaps(layout), views, at, 1 / period)
        settled = []
        while len(settled) < 5 and not (settled and settled[-1]):
            settled.append(fit.step())
        cases.append(
            {
                "layout": layout_table(layout),
                "views": views,
                "at": at,
                "frequency": 1 / period,
                "changes": fit.changes,
                "settled": settled,
                "H": fit.shift(),
            }
        )
    return cases


def climb() -> dict[str, object]:
    rng, size = np.random.default_rng(3), map_size(HIDDEN)
    right = frame_corners(*size).astype("f4")
    seen = np.add(right, [[0, 0], [5, -4], [-6, 5], [3, 0]]).astype("f4")
    H = cv2.getPerspectiveTransform(right, seen)
    shown = cv2.warpPerspective(drawn(HIDDEN, size), H, size)
    noise = rng.normal(0, 1.5, (2, *shown.shape))
    change = np.asarray(shown * np.exp(1j) + noise[0] + 1j * noise[1], np.complex64)
    return {
        "layout": layout_table(HIDDEN),
        "real": change.real,
        "imaginary": change.imag,
        "H": climb_to_pilots(change, HIDDEN),
    }


def moved() -> dict[str, object]:
    H = np.array([[1.01, 0.02, 3.0], [-0.01, 0.99, -2.0], [1e-5, -2e-5, 1.0]])
    layout = layout_table(FINE)
    return {"corners": CORNERS, "H": H, "layout": layout, "moved": moved_corners(CORNERS, H, FINE)}


def toggling() -> dict[str, object]:
    """A display of random blocks toggles in front of a texture."""
    rng = np.random.default_rng(4)
    room = 100 + 20 * texture((200, 300), 5)
    signs = cv2.resize(rng.choice([-1.0, 1.0], (24, 32)), (128, 96), interpolation=0)
    toggle_map = ToggleMap()
    stills = []
    for number in range(24):
        still = room + rng.normal(0, 1, room.shape)
        still[50:146, 80:208] += 6 * signs * (-1) ** (number // 2)
        stills.append(np.clip(still + 0.5, 0, 255).astype(np.uint8))
        toggle_map.add(stills[-1], number)
    frequencies = [0.25, 0.0, 0.5]
    outlines = [toggle_map.outline(frequency) for frequency in frequencies]
    right = np.array([[80.0, 50.0], [208.0, 50.0], [208.0, 146.0], [80.0, 146.0]])
    quads = [right, right + 30, right[::-1] - 9, right[[0, 2, 1, 3]]]
    return {
        "stills": np.array(stills),
        "logs": [toggle_map._logs[number] for number in (4, 12)],
        "frequencies": frequencies,
        "outlines": outlines,
        "quads": quads,
        "worths": [toggle_map.worth(quad) for quad in quads],
        "views": list(toggle_map.views(right, 48, 48)[:2]),
    }


def two_motions() -> dict[str, object]:
    before, after = moving_picture(0), moving_picture(6)
    outlines = {"picture": MOVING_OUTLINE, "everything": frame_corners(640, 640)}
    return {"before": before, "after": after, "moved": 6.0, **outlines}


def stabilising() -> dict[str, object]:
    """Frames of a texture seen by a hand that moves; the last shows something else."""
    wide = np.clip(120 + 40 * texture((560, 1000), 6, sigma=3), 0, 255).astype(np.uint8)
    moves = [np.eye(3)] * 3
    moves[1] = np.array([[1, 0.01, 6.0], [-0.01, 1, -4.0], [1e-6, 0, 1]])
    moves[2] = np.array([[1.01, 0.02, 9.0], [-0.02, 1.01, 2.5], [2e-6, -1e-6, 1]])
    frames = [cv2.warpPerspective(wide, move, (960, 540)) for move in moves]
    frames.append(np.full((540, 960), 90, np.uint8))
    stabiliser = Stabiliser()
    stabiliser.begin(frames[0])
    found = [stabiliser.follow(frame) for frame in frames]
    still = stabiliser.still(frames[1], found[1])
    points = stabiliser.on_image(np.array([[0.0, 0.0], [100.0, 50.0]]))
    np.testing.assert_allclose(stabiliser.on_copy(points), [[0, 0], [100, 50]], atol=1e-9)
    return {"frames": frames, "H": found, "still": still, "points": points}


def test_pilots_are_weighed_and_corners_moved_as_in_python(tmp_path: Path) -> None:
    parts = (evidence, times, phases, coarse, slopeless, all_blocks, climb, moved, toggling)
    for part in (*parts, stabilising, two_motions):
        write_fixture(tmp_path, part.__name__, part())
    run_node_tests("pilots", tmp_path)
