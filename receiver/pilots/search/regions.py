"""Outline displays in a map of where they toggle.

The map gives the log-odds that a cell shows a part of a display (`models.region.region`). If cells
were independent, a quadrilateral would be the display with a log-likelihood that is the sum of the
log-odds within it. The outline is the quadrilateral for which this sum is largest. It may reach
beyond the image, where nothing is known: there every cell speaks a little against it.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import UNIT_SQUARE, in_image
from link.types import Array
from receiver.locate.quads import distinct, nested, upright

SAME_CELLS = 0.5
"""Distance, in cells, of all corners below which two quadrilaterals are alike: some one and a half
blocks of the preset `hidden` in a display of a tenth of the image. Chosen by hand."""
REGIONS = 2
"""Largest number of displays that are outlined. It bounds the work; chosen by hand."""
LEAST_CELLS = 12
"""Smallest number of connected cells, each likelier than not, from which an outline begins: a
display of a three-hundredth of the image. Chosen by hand."""
MOST_ODDS = 4.0
"""Largest log-odds that a cell counts with, for or against: a sure cell must not outweigh a whole
side of unsure ones. Chosen by hand."""
BEYOND_CELLS, BEYOND_ODDS = 10, -0.08
"""Number of cells by which an outline may reach beyond the image, an eighth of its longer side, and
the log-odds of each. Chosen by hand."""
LEAVING_ODDS = 3.0
"""Log-odds that are added to those of each cell where a display may leave the image: cameras that
the network did not learn from show such displays less surely. Chosen with 24 films of another
simulation."""
WITH_BARS = 1.26
"""Height of a display as a share of the height of a wide film between black bars above and below:
from 1.18 to 1.4 for films of 2.1 to 2.5 times their height in displays of 16:9. The pilots' fit
reaches the others."""
PICTURE_SHARES = (3 / 4, 27 / 32, 9 / 10, 9 / 16, 81 / 256)
"""Widths of pictures of 4:3, 3:2, 16:10, 1:1 and 9:16 between black bars to their left and right,
as shares of the width of a display of 16:9."""
PORTRAIT_PART = 2 * PICTURE_SHARES[-1] / (1 + PICTURE_SHARES[-1])
"""Width of a picture of 9:16 in the middle of a display of 16:9, as a share of the width from one
of its sides to the opposite side of the display."""
PORTRAIT_SHAPE = 9 / 16
"""Width of portrait pictures over their height."""
PANEL_SHAPES = 16 / 9, 4 / 3
"""Widths of displays, and of pictures in windows, over their heights."""
PORTRAITS = 3
"""Largest number of portrait pictures that are proposed where a side of theirs is not seen. It
bounds the work; chosen by hand."""
FOCAL_SHARE = 1.0
"""Focal length as a share of an image's longer side, by which a picture's shape tells where a side
is that is not seen: between those of phones, some 0.75, and of cameras that are zoomed in."""
SURELY_LYING = 1.15
"""Ratio of width to height from which on an outline is taken to show a picture that is not turned:
turned ones of 4:3 that are seen from 50 degrees look so. Chosen by hand."""
STEPS = (6.0, 3.0, 1.5, 0.75, 0.4)
"""Distances, in cells, by which corners and sides are tried to be moved, one after the other: each
about half the last one, down to a part of a cell. Chosen by hand."""
MOST_MOVES = 20
"""Largest number of moves by each distance. It bounds the work; chosen by hand."""
EIGHT = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y], float)
"""Directions in which corners are tried to be moved, (8, 2)."""
FOUR = EIGHT[[1, 3, 4, 6]]
"""Directions in which sides are tried to be moved, (4, 2)."""


def outline_regions(log_odds: NDArray[np.float32]) -> list[Array]:
    """Outline the displays of a map.

    Args:
        log_odds: (h, w) natural log-odds of each cell.

    Returns:
        quadrilaterals, (4, 2) in cells, where (0, 0) is the corner of the first cell; clockwise,
        the likeliest first. They may reach beyond the map.

    >>> log_odds = np.full((20, 30), -2, np.float32)
    >>> log_odds[5:15, 8:24] = 2
    >>> (outline,) = outline_regions(log_odds)
    >>> bool(np.abs(outline - [[8, 5], [24, 5], [24, 15], [8, 15]]).max() < 1)
    True
    """
    _, parts, stats, _ = cv2.connectedComponentsWithStats(np.uint8(log_odds > 0), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    sums, found = _sums(log_odds), []
    for part in np.argsort(-areas, kind="stable")[:REGIONS]:
        if areas[part] >= LEAST_CELLS:
            start = _rectangle_of(parts == part + 1) + BEYOND_CELLS
            likelihood, outline = _climbed(start, sums)
            found.append((likelihood, outline - BEYOND_CELLS))
    return [outline for _, outline in sorted(found, key=lambda each: -each[0])]


def likeliest(quads: Array, log_odds: NDArray[np.float32], limit: int) -> NDArray[np.intp]:
    """Choose the quadrilaterals that are likeliest and differ from one another.

    Args:
        quads: (N, 4, 2) in cells, clockwise from the corner nearest to the image's top left.
        log_odds: (h, w) natural log-odds of each cell.
        limit: largest number chosen.

    Returns:
        (M,) indices, the likeliest first.

    >>> log_odds = np.full((20, 30), -2, np.float32)
    >>> log_odds[5:15, 8:24] = 2
    >>> bounding = np.array([[[8.0, 5], [24, 5], [24, 15], [8, 15]]])
    >>> likeliest(np.concatenate([bounding + 1, bounding, bounding + 0.1]), log_odds, 2).tolist()
    [1, 0]
    """
    sums = _within(quads + BEYOND_CELLS, _sums(log_odds))
    return distinct(quads, sums, limit, SAME_CELLS)


def leaving_regions(quads: Array, log_odds: NDArray[np.float32]) -> list[Array]:
    """Choose quadrilaterals that may be a display which leaves the image, if one does.

    Args:
        quads: (N, 4, 2) in cells, as `likeliest` takes them, which edges propose.
        log_odds: (h, w) natural log-odds of each cell.

    Returns:
        none where the outline of the likeliest cells keeps off the image's border; else the
        likeliest of ``quads``, if there are any, and this outline.
    """
    odds = leaning(log_odds)
    outlines = outline_regions(odds)[:1]
    last = np.array(log_odds.shape[::-1]) - 1
    if not outlines or ((outlines[0] > 1) & (outlines[0] < last)).all():
        return []
    return [*quads[likeliest(quads, odds, 1)], *outlines]


def leaning(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    """Make all cells of a map, (h, w), likelier, as where a display may leave the image."""
    return log_odds + np.float32(LEAVING_ODDS)


def about_middle(outline: Array, across: float = 1.0, down: float = 1.0) -> Array:
    """Make the outline of what has the same middle as another in the plane of a display.

    It may be narrower, where a picture is dark along its sides and differs little from the black
    bars beside it. Or it may be higher, where black bars above and below a film belong to the
    display.

    Args:
        outline: (4, 2) the outline of a panel or a film, clockwise.
        across: width of what is sought, as a share of the outline's longer side.
        down: its height, as a share of the outline's shorter side.

    Returns:
        (4, 2) what is sought, of which the first corner is the top left if the outline is upright,
        or turned to the left.

    >>> panel = np.array([[0.0, 0], [160, 0], [160, 90], [0, 90]])
    >>> about_middle(panel, across=3 / 4).round().tolist()
    [[20.0, 0.0], [140.0, 0.0], [140.0, 90.0], [20.0, 90.0]]
    """
    places = 0.5 + (UNIT_SQUARE - 0.5) * [across, down]
    return np.asarray(_on_quads(_lying(outline)[None], places)[0])


def portrait_parts(quads: Array, maps: Sequence[NDArray[np.float32]]) -> list[Array]:
    """Choose portrait pictures in quadrilaterals of which three sides bound one, if any does.

    Beside a picture of 9:16 the bars are wide, and a lamp that is mirrored in one of them hides
    where the picture ends. The fourth side is then that of the display. Which side it is nobody
    knows, so there are four pictures in each quadrilateral.

    Args:
        quads: (N, 4, 2) in cells, clockwise.
        maps: (h, w) natural log-odds of each cell, each.

    Returns:
        for each map, at most `PORTRAITS` pictures that differ, (4, 2) in cells, clockwise from the
        corner nearest to the image's top left; the likeliest first.

    >>> log_odds = np.full((20, 40), -2, np.float32)
    >>> log_odds[2:18, 24:32] = 2
    >>> bounded = np.array([[[15.0, 2], [32, 2], [32, 18], [15, 18]]])  # from bar to picture
    >>> portrait_parts(bounded, [log_odds])[0].round().tolist()
    [[24.0, 2.0], [32.0, 2.0], [32.0, 18.0], [24.0, 18.0]]
    """
    turned = np.concatenate([np.roll(quads, -side, axis=1) for side in range(4)])  # (4 N, 4, 2)
    parts = upright(_on_quads(turned, UNIT_SQUARE * [PORTRAIT_PART, 1]))
    return [part for odds in maps for part in parts[likeliest(parts, odds, PORTRAITS)]]


def reaching_beyond(quad: Array, shapes: Sequence[float], width: int, height: int) -> list[Array]:
    """Place what is not seen of a picture or panel that leaves the image, by its shape.

    Three sides of a rectangle tell how it lies in space, and one length the others.

    Args:
        quad: (4, 2) pixels, clockwise from the top left; a side of which both corners are outside
            the image is taken for a guess, and the others for right.
        shapes: widths over heights that it may have.
        width: width of the image, pixels.
        height: its height, pixels.

    Returns:
        (4, 2) for each side that is outside and each shape, with this side where a rectangle of the
        shape has it before a camera of `FOCAL_SHARE`.

    >>> guess = np.array([[400.0, -100], [800, -100], [800, 600], [400, 600]])
    >>> reaching_beyond(guess, [9 / 16], 1280, 720)[0].round().tolist()
    [[400.0, -111.0], [800.0, -111.0], [800.0, 600.0], [400.0, 600.0]]
    """
    middle, focal = np.array([width - 1, height - 1]) / 2, FOCAL_SHARE * max(width, height)
    found = []
    for side in range(4):
        turned = np.roll(quad, -side, axis=0)  # from the side that may be outside on
        if in_image(turned[:2], (height, width)).any():
            continue
        a, b, c, d = np.column_stack([(turned - middle) / focal, np.ones(4)])  # rays to the corners
        along = np.cross(np.cross(d, a), np.cross(c, b))  # where both other sides go to
        along *= np.sign(along @ (a - d)) / np.linalg.norm(along)
        across = np.cross(np.cross(d, c), along)
        c_side, d_side = np.cross(c, across), np.cross(d, across)
        corner = c * (c_side @ d_side) / (c_side @ c_side)  # so far away that it is beside d
        for shape in shapes:
            sides = shape if side % 2 else 1 / shape  # length along, in lengths across
            ends = np.array([d, corner]) + along * np.linalg.norm(corner - d) * sides
            if (ends[:, 2] > 0).all():  # before the camera
                placed = ends[:, :2] / ends[:, 2:] * focal + middle
                found.append(np.roll(np.concatenate([placed, turned[2:]]), side, axis=0))
    return found


def portrait_beyond(part: Array, width: int, height: int) -> list[Array]:
    """Place the ends of a portrait picture that is longer than the image (`reaching_beyond`)."""
    across, down = _lengths(part)
    shape = PORTRAIT_SHAPE if down > across else 1 / PORTRAIT_SHAPE
    return reaching_beyond(part, [shape], width, height)


def panels_of(quads: Sequence[Array]) -> list[Array]:
    """Choose what may be the whole of a panel: the outline of strongest edges, and one within it.

    Args:
        quads: (4, 2) outlines, clockwise, the strongest first.

    Returns:
        the strongest, and the strongest of those that lie within it at a bezel's distance.
    """
    within = [quad for quad in quads[1:] if nested(quad[None], quads[0])[0]]
    return [*quads[:1], *within[:1]]


def pictures_in(panels: Sequence[Array]) -> list[Array]:
    """Propose pictures between black bars to their left and right, in the middle of panels.

    Args:
        panels: (4, 2) outlines of displays of 16:9, clockwise, the likeliest first.

    Returns:
        (4, 2) as `about_middle`: pictures of the likeliest shape in each panel, then others.
    """
    shapes = product(PICTURE_SHARES, panels)
    return [about_middle(panel, across=share) for share, panel in shapes]


def ways_up(quads: Sequence[Array], *, likely: bool = True) -> Iterator[Array]:
    """Turn outlines in each way that is likely for a picture of such a shape, or in the other ways.

    Pictures are taken to be wider than they are high, and not to stand upside down. What is about
    as wide as high may be turned or not: seen from the side, it looks narrower than it is.

    Args:
        quads: (4, 2) outlines, clockwise from the corner nearest to the image's top left; the
            likeliest first.
        likely: whether the likely ways are asked for, or all others.

    Yields:
        (4, 2) the outline from the picture's top left corner on; the likeliest way of each outline
        before the next one of any.

    >>> [way[0].tolist() for way in ways_up([np.array([[0, 0], [90, 0], [90, 160], [0, 160]])])]
    [[0, 160], [90, 0]]
    """
    turns = [likely_turns(quad) for quad in quads]
    if not likely:
        turns = [tuple({0, 1, 2, 3} - set(each)) for each in turns]
    for rank in range(4):
        for quad, order in zip(quads, turns, strict=True):
            if rank < len(order):
                yield np.roll(quad, -order[rank], axis=0)


def likely_turns(quad: Array) -> tuple[int, ...]:
    """List the quarter turns that are likely for an outline, as `ways_up` says."""
    across, down = _lengths(quad)
    if across > SURELY_LYING * down:
        return (0,)
    return (3, 1) if down > SURELY_LYING * across else (0, 3, 1)


def _on_quads(quads: Array, places: Array) -> Array:
    """Find where places of rectangles are in their perspective pictures.

    If each corner weighs as much as the triangle of the other three has area, the picture of the
    rectangle's middle is the weighted mean of the corners, and that of other places likewise.

    Args:
        quads: (N, 4, 2) pictures of rectangles, clockwise from the top left.
        places: (P, 2) places x and y, which are 0 and 1 at the corners of a rectangle.

    Returns:
        (N, P, 2).
    """
    ahead, across, back = (np.roll(quads, -k, axis=1) for k in (1, 2, 3))
    one, other = across - ahead, back - ahead
    areas = np.abs(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])  # (N, 4)
    x, y = places.T
    near = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)  # (P, 4)
    weights = near * areas[:, None]  # (N, P, 4)
    return np.asarray(weights @ quads / weights.sum(axis=2, keepdims=True))


def _lying(quad: Array) -> Array:
    """Roll the corners of a (4, 2) quadrilateral until its longer sides are above and below."""
    across, down = _lengths(quad)
    return quad if across >= down else np.roll(quad, -1, axis=0)


def _lengths(quad: Array) -> tuple[float, float]:
    """Add up the lengths of the sides above and below, and of those to the left and right."""
    lengths = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    return float(lengths[::2].sum()), float(lengths[1::2].sum())


def _sums(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sum the log-odds to the left of each cell, with what lies beyond: (rows, cols + 1)."""
    clipped = np.clip(log_odds, -MOST_ODDS, MOST_ODDS)
    beyond = ((BEYOND_CELLS, BEYOND_CELLS),) * 2
    sums = np.cumsum(np.pad(clipped, beyond, constant_values=BEYOND_ODDS), axis=1)
    return np.asarray(np.pad(sums, ((0, 0), (1, 0))))


def _rectangle_of(part: NDArray[np.bool_]) -> Array:
    """Make the rectangle, (4, 2) clockwise, whose centre and moments are those of some cells."""
    y, x = np.nonzero(part)
    variances, axes = np.linalg.eigh(np.cov([x, y]) + np.eye(2) / 12)  # a cell is a square itself
    short, long = axes.T * np.sqrt(3 * variances)[:, None]
    if long[0] * short[1] - long[1] * short[0] < 0:
        short = -short
    centre = np.array([x.mean(), y.mean()]) + 0.5
    from_centre = np.array([-long - short, long - short, long + short, short - long])
    return np.asarray(centre + from_centre)


def _climbed(outline: Array, sums: NDArray[np.float32]) -> tuple[float, Array]:
    """Move corners and sides as long as the sum of the log-odds within grows; it, and where."""
    best = float(_within(outline[None], sums)[0])
    end = np.array([sums.shape[1] - 1, sums.shape[0]])
    for step in STEPS:
        for _ in range(MOST_MOVES):
            moved = outline + step * MOVES
            sound = _convex(moved) & ((moved >= 0) & (moved <= end)).all(axis=(1, 2))
            likelihoods = np.where(sound, _within(moved, sums), -np.inf)
            first = int(likelihoods.argmax())
            if not likelihoods[first] > best:
                break
            best, outline = float(likelihoods[first]), moved[first]
    return best, outline


def _all_moves() -> Array:
    """List the moves of corners and sides by a unit, (48, 4, 2)."""
    corners, sides = np.zeros((4, 8, 4, 2)), np.zeros((4, 4, 4, 2))
    for corner in range(4):
        corners[corner, :, corner] = EIGHT
        sides[corner, :, corner] = sides[corner, :, (corner + 1) % 4] = FOUR
    moves = [each.reshape(-1, 4, 2) for each in (corners, sides)]  # (4, 8 or 4, 4, 2) -> (N, 4, 2)
    return np.concatenate(moves)


MOVES = _all_moves()
"""Moves of corners and sides by a unit, (48, 4, 2)."""


def _convex(quads: Array) -> NDArray[np.bool_]:
    """Tell which quadrilaterals (N, 4, 2) are convex and clockwise."""
    sides = np.roll(quads, -1, axis=1) - quads
    following = np.roll(sides, -1, axis=1)
    cross = sides[..., 0] * following[..., 1] - sides[..., 1] * following[..., 0]
    return np.asarray((cross > 0).all(axis=1))


def _within(quads: Array, sums: NDArray[np.float32]) -> NDArray[np.float64]:
    """Add up a map within quadrilaterals, by the sums of each row up to their sides.

    Args:
        quads: (N, 4, 2) clockwise, in cells.
        sums: (h, w + 1) sums of the cells to the left, in each row.

    Returns:
        (N,) sums over the rows whose middle lies within; parts of cells count as such.
    """
    rows = np.arange(len(sums))
    begin, end = quads, np.roll(quads, -1, axis=1)
    x, y = begin[..., 0, None], begin[..., 1, None]
    across, down = end[..., 0, None] - x, end[..., 1, None] - y  # (N, 4, 1)
    middle = rows + 0.5
    crosses = (middle >= np.minimum(y, y + down)) & (middle < np.maximum(y, y + down))
    at = x + (middle - y) / np.where(down == 0, 1, down) * across  # (N, 4, h)
    at = np.clip(at, 0, sums.shape[1] - 1)
    left = np.minimum(at.astype(int), sums.shape[1] - 2)
    share = at - left
    up_to = sums[rows, left] * (1 - share) + sums[rows, left + 1] * share
    return np.asarray((np.sign(down) * crosses * up_to).sum(axis=(1, 2)))
