"""Quadrilaterals in a photograph that may bound a display: from straight lines and from contours.

Works on a small gray image. Lines: segments (LSD, Grompone von Gioi et al. 2010) that lie on one
straight line count as one, and four lines are a quadrilateral where segments cover enough of each
side. Contours: outlines of what is brighter than a threshold, where four corners describe them.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_SEGMENT_PX = 9.0
"""Smallest length, in pixels, of a segment that is used; shorter ones have no exact direction, and
there are many. Chosen by hand, as all pixels here, for an image whose longer side is 640."""
MAX_LINES = 44
"""Largest number of lines from which quadrilaterals are made. It bounds the work, which grows with
its fourth power. Chosen by hand."""
MAX_SEGMENTS = 350
"""Largest number of segments that are used, the longest first. It bounds the work, which grows with
its square. Chosen by hand."""
COLLINEAR_PX = 1.8
"""Largest distance, in pixels, of a segment's ends from the line that it is counted to, where both
are bright on one side."""
OPPOSED_PX = 0.7
"""Largest distance, in pixels, of a segment's ends from the line that it is counted to, where they
are bright on opposite sides: a thin bezel's two edges are two lines. Both were chosen by hand."""
MIN_AREA = 0.03
"""Smallest area of a quadrilateral, as a share of the image: blocks of a smaller display would have
few pixels. Chosen by hand."""
MIN_CROSSING_DEG = 35.0
"""Smallest angle between the lines of neighbouring sides; a display seen at 70 degrees still has
it."""
LEAST_SINE = 0.7 * np.sin(np.radians(MIN_CROSSING_DEG))
"""Smallest sine of an angle of a sound quadrilateral: corners found coarsely may still make an
angle of 24 degrees of one of `MIN_CROSSING_DEG`. Chosen by hand."""
MIN_SIDE_COVER, MIN_MEAN_COVER = 0.15, 0.45
"""Smallest shares that segments must cover of each side, and of all sides on average: a hand, or a
dark picture, may hide the edges of most of one side. Chosen by hand."""
LEAST_SIDE = 0.1
"""Smallest length of a side, as a share of the root of the image's area. With `MIN_AREA` it leaves
out slivers whose sides few segments cover by chance. Chosen by hand."""
SIZE_BONUS = 0.3
"""Rank that a quadrilateral as large as the image has over a tiny one, in shares of cover: longer
sides are less likely to be covered by chance. It grows with the root of the area. Chosen by
hand."""
SLACK = 0.01
"""Distance by which a corner may lie outside the image where the whole display is in view, as a
share of the image's longer side: lines found on a small image are that uncertain."""
BEYOND = 0.08
"""Distance from the image's border, as a share of its longer side, at which a line stands for the
side of a display that lies outside: the pilots' fit, which reaches a tenth of the display's width
(`receiver.pilots.search.parts`), then covers sides that are outside by up to some 15 %. Chosen
among 0.06 to 0.2 by 15 simulated films."""
SAME_PX = 3.0
"""Distance, in pixels, of corners below which two quadrilaterals are one: the sides of both then
snap to the same edges. Chosen by hand."""
NESTED = (0.65, 0.97)
"""Smallest and largest share of a bezel's area that the picture within may have: a bezel as wide as
an eighth of the picture's side, or as a hundredth, leaves about these. Chosen by hand."""
THRESHOLD_QUANTILES = (0.3, 0.5, 0.65, 0.8, 0.9)
"""Quantiles of the image's gray levels that serve as thresholds for outlines, for displays that
cover from a tenth to most of the image. Chosen by hand."""
OUTLINE_TOLERANCES = (0.015, 0.03, 0.06)
"""Tolerances, as shares of an outline's length, at which four corners may describe it; the first
that leaves four corners is taken. Chosen by hand."""


def signed_areas(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure the areas, (N,), of quadrilaterals (N, 4, 2); clockwise ones are positive."""
    x, y = quads[..., 0], quads[..., 1]
    x_next, y_next = np.roll(x, -1, axis=-1), np.roll(y, -1, axis=-1)
    return np.asarray((x * y_next - x_next * y).sum(axis=-1) / 2)


def is_sound(
    quads: NDArray[np.float64], width: int, height: int, outside: float = SLACK
) -> NDArray[np.bool_]:
    """Tell which quadrilaterals are clockwise, convex, large enough, no slivers, and in the image.

    Args:
        quads: (N, 4, 2) pixels.
        width: width of the image, pixels.
        height: height of the image, pixels.
        outside: distance by which corners may lie outside the image, as a share of its longer side.

    Returns:
        (N,) bool.
    """
    edges = np.roll(quads, -1, axis=1) - quads
    length = np.linalg.norm(edges, axis=2) + 1e-9
    following = np.roll(edges, -1, axis=1)
    cross = edges[..., 0] * following[..., 1] - edges[..., 1] * following[..., 0]
    sine = cross / (length * np.roll(length, -1, axis=1))
    slack = outside * max(width, height)
    low, high = -0.5 - slack, np.array([width, height]) - 0.5 + slack
    inside = ((quads >= low) & (quads <= high)).all(axis=(1, 2))
    large = signed_areas(quads) >= MIN_AREA * width * height
    return np.asarray(inside & large & (sine > LEAST_SINE).all(axis=1))


def upright(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate the corner order of (N, 4, 2) quadrilaterals to the one nearest to upright."""
    turned = np.stack([np.roll(quads, -k, axis=1) for k in range(4)])  # -> (4, N, 4, 2)
    top = turned[..., 1, :] - turned[..., 0, :]
    bottom = turned[..., 2, :] - turned[..., 3, :]
    across = top / (np.linalg.norm(top, axis=-1, keepdims=True) + 1e-9)
    across += bottom / (np.linalg.norm(bottom, axis=-1, keepdims=True) + 1e-9)
    return np.asarray(turned[across[..., 0].argmax(axis=0), np.arange(len(quads))])


def segments(gray: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Find the longest straight segments of a (H, W) uint8 image, as (N, 4) x1, y1, x2, y2."""
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(gray)[0]
    if found is None:
        return np.empty((0, 4))
    ends = found.reshape(-1, 4).astype(np.float64)
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    order = np.argsort(-length)[:MAX_SEGMENTS]
    return np.asarray(ends[order][length[order] >= MIN_SEGMENT_PX])


def merge_segments(
    ends: NDArray[np.float64], diagonal: float
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Find the lines that segments lie on, and where along the lines segments are.

    Args:
        ends: (N, 4) segments x1, y1, x2, y2.
        diagonal: diagonal of the image, pixels.

    Returns:
        lines (M, 4): a point and the unit direction, of the best-covered lines; and (M, T) float32
        the length of line that segments cover up to t - T // 2 px from the point.
    """
    start, end = ends[:, :2], ends[:, 2:]
    along = end - start
    length = np.linalg.norm(along, axis=1)
    direction = along / length[:, None]
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    level = (normal * start).sum(axis=1)
    far = np.maximum(
        np.abs(normal @ start.T - level[:, None]), np.abs(normal @ end.T - level[:, None])
    )  # (N, N): distance of segment j's ends from the line of segment i
    same = direction @ direction.T > 0  # LSD: which side is bright
    near = far < np.where(same, COLLINEAR_PX, OPPOSED_PX)
    free = np.ones(len(ends), bool)
    members: list[NDArray[np.intp]] = []
    for i in range(len(ends)):
        if free[i]:
            group = np.flatnonzero(near[i] & free)
            free[group] = False
            members.append(np.union1d(group, [i]))
    support = np.array([length[group].sum() for group in members])
    best = np.argsort(-support)[:MAX_LINES]
    lines = np.empty((len(best), 4))
    for row, k in enumerate(best):
        group = members[k]
        points, weight = np.concatenate([start[group], end[group]]), np.tile(length[group], 2)
        centre = weight @ points / weight.sum()
        spread = (points - centre).T @ ((points - centre) * weight[:, None])
        lines[row] = [*centre, *np.linalg.eigh(spread)[1][:, 1]]
    half = int(diagonal) + 2
    cover = np.zeros((len(best), 2 * half), np.float32)
    for row, k in enumerate(best):
        centre, axis = lines[row, :2], lines[row, 2:]
        for i in members[k]:
            a, b = sorted(((start[i] - centre) @ axis, (end[i] - centre) @ axis))
            cover[row, max(0, round(a) + half) : max(0, round(b) + half)] = 1
    return lines, np.cumsum(cover, axis=1)


def nested(quads: NDArray[np.float64], outer: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which quadrilaterals lie inside another, at most a bezel's width from it.

    Args:
        quads: (N, 4, 2) pixels, clockwise.
        outer: (4, 2) pixels, clockwise.

    Returns:
        (N,) bool.
    """
    along = np.roll(outer, -1, axis=0) - outer
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    depth = np.einsum("nkc,sc->nks", quads, normal) - (outer * normal).sum(axis=1)
    share = signed_areas(quads) / signed_areas(outer[None])
    return np.asarray((depth.min(axis=(1, 2)) > 1) & (share > NESTED[0]) & (share < NESTED[1]))


def distinct(
    quads: NDArray[np.float64], rank: NDArray[np.float64], limit: int, tolerance: float
) -> NDArray[np.intp]:
    """Choose the quadrilaterals of highest rank that differ from one another.

    Only the first ``8 * limit`` are looked at.

    Args:
        quads: (N, 4, 2) pixels.
        rank: (N,) the higher, the better.
        limit: largest number chosen.
        tolerance: distance, in pixels, of all corners below which two are alike.

    Returns:
        (M,) indices, the best first.
    """
    left = np.argsort(-rank)[: 8 * limit]
    chosen: list[int] = []
    while len(left) and len(chosen) < limit:
        chosen.append(int(left[0]))
        left = left[np.abs(quads[left] - quads[left[0]]).max(axis=(1, 2)) >= tolerance]
    return np.array(chosen, np.intp)


def from_lines(gray: NDArray[np.uint8], limit: int, outside: float = SLACK) -> NDArray[np.float64]:
    """Make quadrilaterals of straight lines.

    Args:
        gray: (h, w) uint8.
        limit: largest number returned.
        outside: distance by which corners may lie outside the image, as a share of its longer side.
            Where it is more than `SLACK`, only quadrilaterals with a corner outside are made, and
            one side, or two that face each other, may be lines outside of which nothing is seen
            (`BEYOND`).

    Returns:
        (N, 4, 2) pixels, those first of whose sides most is in view, and of that, lines cover
        most.
    """
    height, width = gray.shape
    ends = segments(gray)
    if len(ends) < 2:
        return np.empty((0, 4, 2))
    lines, covered = merge_segments(ends, float(np.hypot(width, height)))
    seen_lines = len(lines)
    if outside > SLACK:
        lines = np.concatenate([lines, _beyond(width, height)])
        covered = np.pad(covered, ((0, len(lines) - seen_lines), (0, 0)))
    t, corner, usable = _crossings(lines, width, height, outside)
    seen = np.clip(t, *_in_view(lines, width, height))
    cover = _cover(covered, seen)
    cover[seen_lines:] = 1
    whole, in_view = (np.abs(x[:, :, None] - x[:, None, :]) for x in (t, seen))  # (M, M, M) pixels
    long = whole > LEAST_SIDE * np.sqrt(width * height)
    sides = usable[:, :, None] & usable[:, None, :] & (cover >= MIN_SIDE_COVER) & long
    a, b, c, d = _quadruples(sides)
    of_quads = np.stack([a, b, c, d])
    unseen = of_quads >= seen_lines
    # one side may be unseen, or two that face each other
    a, b, c, d = of_quads[:, ~unseen[:2].any(axis=0) | ~unseen[2:].any(axis=0)]
    of_sides = (a, c, d), (b, c, d), (c, a, b), (d, a, b)
    covers = [cover[side] for side in of_sides]
    mean, least = sum(covers) / 4, np.minimum.reduce(covers)
    quads = np.stack([corner[a, c], corner[a, d], corner[b, d], corner[b, c]], axis=1)
    quads = np.where(signed_areas(quads)[:, None, None] < 0, quads[:, ::-1], quads)
    sound = (mean >= MIN_MEAN_COVER) & is_sound(quads, width, height, outside)
    if outside > SLACK:
        sound &= ~is_sound(quads, width, height)
    outline, outline_in_view = (sum(each[side] for side in of_sides) for each in (whole, in_view))
    share = outline_in_view / np.maximum(outline, 1)
    quads, rank = upright(quads[sound]), (mean * share + least)[sound]
    rank = rank + SIZE_BONUS * np.sqrt(signed_areas(quads) / (width * height))
    return quads[distinct(quads, rank, limit, SAME_PX)]


def _crossings(
    lines: NDArray[np.float64], width: int, height: int, outside: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Find where (M, 4) lines, each a point and a direction, cross one another.

    Returns:
        (M, M) where the second line crosses the first, in pixels along the first from its point;
        (M, M, 2) these crossings; and (M, M) whether they may be corners.
    """
    point, axis = lines[:, :2], lines[:, 2:]
    cross = axis[:, None, 0] * axis[None, :, 1] - axis[:, None, 1] * axis[None, :, 0]
    apart = point[None] - point[:, None]
    safe = np.where(np.abs(cross) < 1e-6, 1e-6, cross)
    t = (apart[..., 0] * axis[None, :, 1] - apart[..., 1] * axis[None, :, 0]) / safe
    corner = point[:, None] + t[..., None] * axis[:, None]
    slack = outside * float(np.hypot(width, height))
    usable = np.abs(cross) > np.sin(np.radians(MIN_CROSSING_DEG))
    usable &= ((corner >= -slack) & (corner <= np.array([width, height]) + slack)).all(axis=2)
    return t, corner, usable


def _beyond(width: int, height: int) -> NDArray[np.float64]:
    """Make four lines, (4, 4), that stand for a side of which nothing is seen.

    They are parallel to the image's borders, `BEYOND` outside of them. A line is a point and a
    direction.
    """
    x, y, out = width / 2, height / 2, BEYOND * max(width, height)
    above, below = [x, -out, 1, 0], [x, height + out, 1, 0]
    return np.array([above, below, [-out, y, 0, 1], [width + out, y, 0, 1]], float)


def _in_view(
    lines: NDArray[np.float64], width: int, height: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find where (M, 4) lines enter and leave the image, (M, 1) pixels from their points each."""
    point, axis = lines[:, :2], lines[:, 2:]
    safe = np.where(np.abs(axis) < 1e-9, 1e-9, axis)
    last = np.array([width, height]) - 0.5
    borders = np.stack([-0.5 - point, last - point]) / safe  # (2, M, x and y)
    enter, leave = borders.min(axis=0).max(axis=1), borders.max(axis=0).min(axis=1)
    return enter[:, None], np.maximum(enter, leave)[:, None]


def _cover(covered: NDArray[np.float32], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tell by which share segments cover a line between two others that cross it, (M, M, M).

    Args:
        covered: (M, T) covered length along each line, from `merge_segments`.
        t: (M, M) where the second line crosses the first, or the first leaves the image before
            that, pixels along the first.
    """
    half = covered.shape[1] // 2
    index = np.clip(np.rint(np.clip(t, -half, half)).astype(int) + half, 0, 2 * half - 1)
    run = np.take_along_axis(covered, index, axis=1)
    span = np.abs(t[:, :, None] - t[:, None, :])
    return np.asarray(np.abs(run[:, :, None] - run[:, None, :]) / np.maximum(span, 1))


def _quadruples(sides: NDArray[np.bool_]) -> NDArray[np.intp]:
    """List the four lines, (4, N), that bound a quadrilateral: two, and the two that cross them.

    Args:
        sides: (M, M, M) whether the first line may have a side between the others.
    """
    k, m = np.triu_indices(len(sides), 1)
    both = sides[:, k, m]  # (M, P): line i has a side between the lines of pair p
    match = both[k] & both[m]  # (P, P): both lines of pair q have a side between those of pair p
    q, p = np.nonzero(np.triu(match & match.T))
    return np.stack([k[q], m[q], k[p], m[p]])


def from_contours(gray: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Make quadrilaterals, (N, 4, 2), of the outlines of what is brighter than some thresholds."""
    height, width = gray.shape
    levels = {float(level) for level in np.quantile(gray[::2, ::2], THRESHOLD_QUANTILES)}
    levels.add(float(cv2.threshold(gray, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]))
    found = []
    for level in sorted(levels):
        mask = cv2.morphologyEx(
            (gray > level).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
        )
        outlines = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)[0]
        for outline in outlines:
            if cv2.contourArea(outline) < MIN_AREA * width * height:
                continue
            hull = cv2.convexHull(outline)
            for tolerance in OUTLINE_TOLERANCES:
                corners = cv2.approxPolyDP(hull, tolerance * cv2.arcLength(hull, True), True)
                if len(corners) == 4:
                    found.append(corners.reshape(4, 2).astype(np.float64))
                    break
    if not found:
        return np.empty((0, 4, 2))
    quads = np.array(found)
    quads = np.where(signed_areas(quads)[:, None, None] < 0, quads[:, ::-1], quads)
    sound = is_sound(quads, width, height)
    # an outline that runs along the image's border bounds the image, not a display
    at_border = (quads <= 1) | (quads >= np.array([width, height]) - 2)
    return np.asarray(quads[sound & (at_border.any(axis=2).sum(axis=1) < 2)])
