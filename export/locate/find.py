"""Find the lit display in a photograph.

python -m export.locate IMAGE... [--model MODEL | --layout FILE] [--show DIR]

Quadrilaterals come from straight lines and outlines on a small image, their sides snap to edges,
and a score ranks them. Where the layout has ratex patches, these decide: which quadrilateral, which
way up, and where its corners are to sub-pixels.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from export.locate.edges import FEATURES, evidence, fit_edges, snap
from export.locate.patches import Pyramid, align, place, pyramid, search
from export.locate.quads import (
    SAME_PX,
    distinct,
    from_contours,
    from_lines,
    is_sound,
    nested,
    upright,
)
from export.locate.spots import from_spots
from link.errors import InputError, run_cli
from link.geometry import as_corners, homography_from_corners, rectify
from link.images import as_rgb, read_image, write_image
from link.layout import Layout
from link.ratex import visibility

WORK_PX = 640
"""Longer side of the image on which quadrilaterals are sought."""
SMALL_ERROR_PX = 2.0
"""Of a candidate's side on that image: farther off, another edge may be stronger."""
REFINED = 0.015
"""Reach of `refine` on edges, as a share of the display's side."""
SNAP_PX = 5.0
LINE_QUADS = 70
TRIED, LIKELY = 20, 6
"""Candidates whose ratex patches are sought, and those sought before
`export.locate.spots` is asked."""
SPOT_QUADS = 30
TURNS = (0, 1, 2, 3)
REACHES = (0.09, 0.09, 0.03)
"""Of the searches for patches before they are aligned, as shares of the display's side: what is
found first brings the others into reach."""
MIN_VISIBILITY = {1: 0.88, 2: 0.85}
"""Of `link.ratex.visibility`, by number of patches; `USUAL_VISIBILITY` for more."""
USUAL_VISIBILITY = 0.8
"""Between what aligned displays have and what wrong turns reach by chance, most of all with few
patches: reports.lab.locate prints both."""
SURE_VISIBILITY = 0.93
"""No further candidate is tried."""
PROMISING = 0.55
"""Mean correlation of single patches near their places that is worth aligning: true displays had
0.69 and more, turned ones up to 0.65."""
MIN_SCORE = 0.04
"""Of a display without patches. Photographs of the training split that show none score 0.011 at
most; nine in ten simulated displays score more (reports.lab.locate_weights)."""
NEAR = 3.0
"""Log-odds by which a picture may be less likely than the outline of its bezel."""
WEIGHTS = np.array([11.0, 1.57, 15.14, 4.98, 1.93, -2.3, 6.83, 5.43, -11.79])
BIAS = -22.02
"""Log-odds by `export.locate.edges.FEATURES`, fitted on simulated photographs:
reports.lab.locate_weights."""


@dataclass(frozen=True)
class Located:
    """A display found in an image."""

    corners: NDArray[np.float64]
    """(4, 2) px, convention of `link.geometry`: top-left of the displayed picture first where ratex
    patches told the orientation, else the corner order nearest to upright in the image."""
    score: float
    """In [0, 1]. With ratex patches `link.ratex.visibility`; else a logistic score of the evidence
    along the four sides, see `export.locate.edges.evidence`."""


def candidates(image: NDArray[np.uint8], limit: int = TRIED) -> list[Located]:
    """Quadrilaterals that may bound a lit display, the likeliest first.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.
        limit: largest number returned.

    Returns:
        corners to about 2 px of an image of 640, with scores without regard to patches.
    """
    quads, features, scale = gather(image)
    if not len(quads):
        return []
    odds = features @ WEIGHTS + BIAS
    first = top = int(odds.argmax())
    # a light bezel's outline may show more edges than the picture within
    while len(within := np.flatnonzero(nested(quads, quads[first]) & (odds > odds[top] - NEAR))):
        first = int(within[odds[within].argmax()])
    odds[first] = odds[top] + 1e-6
    chosen = distinct(quads, odds, limit, SAME_PX)
    scores = 1 / (1 + np.exp(-odds))
    return [Located((quads[i] + 0.5) * scale - 0.5, float(scores[i])) for i in chosen]


def gather(
    image: NDArray[np.uint8],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """All quadrilaterals that lines, outlines and edges make, and what speaks for each.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.

    Returns:
        (N, 4, 2) px of a small copy of the image, (N, features) of `export.locate.edges.evidence`,
        and (2,) pixels of the image in one of the copy.
    """
    small, scale = _small(image)
    gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
    quads = np.concatenate([from_lines(gray, LINE_QUADS), from_contours(gray)])
    if len(quads):
        smooth = cv2.GaussianBlur(gray, (0, 0), 0.7).astype(np.float32)
        quads = np.concatenate([snap(smooth, quads, SNAP_PX), quads])
        quads = upright(quads[is_sound(quads, gray.shape[1], gray.shape[0])])
    if len(quads):  # many snap to the same edges
        quads = quads[np.unique(np.rint(quads / 1.5).reshape(-1, 8), axis=0, return_index=True)[1]]
    features = evidence(small, quads) if len(quads) else np.empty((0, len(FEATURES)))
    return quads, features, scale


def refine(
    image: NDArray[np.uint8], corners: ArrayLike, layout: Layout | None = None
) -> NDArray[np.float64]:
    """Sub-pixel corners from corners a few per cent off.

    On the display's edges, and where ``layout`` has ratex patches and they are seen, on these.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.
        corners: (4, 2) px, in the corner order of the result.
        layout: of what is displayed.

    Returns:
        (4, 2); ``corners`` where the image shows neither edges nor patches there.
    """
    given = as_corners(corners)
    gray = _gray(image)
    if layout is not None and layout.ratex:
        found, seen = lock(image, pyramid(gray), given, layout)
        if seen >= _needed(layout):
            return found
    side = float(np.sqrt(cv2.contourArea(given.astype(np.float32))))
    return _inside(_on_edges(gray, given, REFINED * side + 2), gray.shape)


def locate(image: NDArray[np.uint8], layout: Layout | None = None) -> Located | None:
    """The lit display in an image, or None.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.
        layout: of what is displayed; its ratex patches tell the orientation.

    Returns:
        corners and score; None where nothing looks like a display, or shows the patches.
    """
    ranked = candidates(image)
    if layout is None or not layout.ratex:
        if not ranked or ranked[0].score < MIN_SCORE:
            return None
        gray = _gray(image)
        reach = SMALL_ERROR_PX * max(1.0, max(gray.shape) / WORK_PX)
        corners = _inside(_on_edges(gray, ranked[0].corners, reach), gray.shape)
        return Located(upright(corners[None])[0], ranked[0].score)
    images = pyramid(_gray(image))
    found = _best(image, images, layout, [c.corners for c in ranked[:LIKELY]], TURNS)
    if found is None:
        small, scale = _small(image)
        spots = from_spots(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), layout, SPOT_QUADS)
        found = _best(image, images, layout, [(q + 0.5) * scale - 0.5 for q in spots], TURNS[:1])
    if found is None:
        found = _best(image, images, layout, [c.corners for c in ranked[LIKELY:]], TURNS)
    return found


def _best(
    image: NDArray[np.uint8],
    images: Pyramid,
    layout: Layout,
    quads: list[NDArray[np.float64]],
    turns: tuple[int, ...],
) -> Located | None:
    """Where the patches are seen best, or the first place where they surely are, or None."""
    best: Located | None = None
    for quad in quads:
        turned = [np.roll(quad, -turn, axis=0) for turn in turns]
        promise = [search(images, corners, layout)[0] for corners in turned]
        for turn in np.argsort(promise)[::-1][:2]:
            if promise[turn] < PROMISING:
                continue
            corners, seen = lock(image, images, turned[turn], layout)
            if seen >= _needed(layout) and (best is None or seen > best.score):
                best = Located(corners, min(1.0, seen))
        if best is not None and best.score >= SURE_VISIBILITY:
            break
    return best


def lock(
    image: NDArray[np.uint8], images: Pyramid, corners: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64], float]:
    """Align corners to the patches around them.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.
        images: `export.locate.patches.pyramid` of its gray levels.
        corners: (4, 2) px within about 9 % of the side, in the corner order to be tried.
        layout: with patches.

    Returns:
        (4, 2), and `link.ratex.visibility` there; -1 where the corners make no display.
    """
    for reach in REACHES:
        corners = place(corners, search(images, corners, layout, reach)[1], layout)
    corners = _inside(align(images, corners, layout), image.shape)
    height, width = image.shape[:2]
    if not is_sound(corners[None], width, height)[0]:
        return corners, -1.0
    H = homography_from_corners(corners, layout.width, layout.height)
    return corners, visibility(rectify(image, H, layout.width, layout.height), layout)


def _on_edges(
    gray: NDArray[np.uint8], corners: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Corners on the edges within ``reach`` px, coarse to fine."""
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.0).astype(np.float32)
    for pixels in (reach, min(reach, 4.0)):
        corners, _ = fit_edges(smooth, corners, pixels)
    return corners


def _needed(layout: Layout) -> float:
    return MIN_VISIBILITY.get(len(layout.ratex), USUAL_VISIBILITY)


def _inside(corners: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Corners clipped to the image."""
    return np.clip(corners, -0.5, [shape[1] - 0.5, shape[0] - 0.5])


def _gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(
        image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8
    )


def _small(image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """The image with a longer side of `WORK_PX`, and (2,) pixels of the image in one of it."""
    height, width = image.shape[:2]
    factor = max(1.0, max(height, width) / WORK_PX)
    size = (round(width / factor), round(height / factor))
    small = cv2.resize(as_rgb(image), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), np.array([width / size[0], height / size[1]])


def draw(image: NDArray[np.uint8], found: Located | None) -> NDArray[np.uint8]:
    """The image with the display's outline and the corners' names."""
    shown = as_rgb(image).copy()
    if found is None:
        return shown
    thick = max(1, round(max(image.shape) / 640))
    points = (found.corners * 16).round().astype(np.int32)
    cv2.polylines(shown, [points], True, (255, 0, 0), thick, cv2.LINE_AA, 4)
    for name, (x, y) in zip(("TL", "TR", "BR", "BL"), found.corners, strict=True):
        at = (round(float(x)), round(float(y)))
        cv2.putText(shown, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * thick, (255, 255, 0), thick)
    return shown


def _layout(args: argparse.Namespace) -> Layout | None:
    if args.model is not None:
        from export.runtime import Decoder

        return Decoder(args.model).layout
    if args.layout is None:
        return None
    try:
        return Layout.from_dict(json.loads(args.layout.read_text()))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{args.layout}: not a readable layout: {error}") from None


def main() -> None:
    """Print where the display is, one JSON line an image."""
    parser = argparse.ArgumentParser(prog="python -m export.locate", description=main.__doc__)
    parser.add_argument("images", type=Path, nargs="+", metavar="IMAGE")
    known = parser.add_mutually_exclusive_group()
    known.add_argument("--model", type=Path, help="an .onnx decoder, which carries its layout")
    known.add_argument("--layout", type=Path, help="a JSON file with the layout displayed")
    parser.add_argument("--show", type=Path, metavar="DIR", help="write images with the outline")
    args = parser.parse_args()
    layout, failed = _layout(args), False
    for path in args.images:
        try:
            image = read_image(path)
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            failed = True
            continue
        found = locate(image, layout)
        result: dict[str, Any] = {"image": str(path), "corners": None, "score": None}
        if found is not None:
            result["corners"] = found.corners.round(2).tolist()
            result["score"] = round(found.score, 4)
        print(json.dumps(result), flush=True)
        if args.show is not None:
            write_image(args.show / f"{path.stem}.png", draw(image, found))
    if failed:
        sys.exit(2)


if __name__ == "__main__":
    run_cli(main)
