/**
 * Seek the ratex patches near a coarse quadrilateral, and move its corners to where they are.
 *
 * Patches tell which way up the display is and, four of them in the corners, where its corners
 * are, whatever the picture shows and whatever surrounds it.
 */

import { receiverLocatePatches } from "../../../generated/constants.js";
import { call } from "../../image/opencv.js";
import { shrunkByWhole } from "../../image/shrink.js";
import { warped } from "../../image/warp.js";
import {
  homographyFromCorners,
  homographyFromPoints,
  inImage,
  sideLengths,
  transform,
} from "../../link/geometry.js";
import { multiply3 } from "../../link/linear.js";
import { TILES } from "../../link/ratex.js";
import { reweighted, ridgeSolution } from "../../link/robust.js";
import { pointsByCorners } from "./cornerMotion.js";

/**
 * Gray levels of an image at 1, 1/2, 1/4, ... of its size.
 *
 * @typedef {BytePlane[]} Pyramid
 */
/**
 * Where a patch's centre was found, in display units from 0 to 1, and the correlation there.
 *
 * @typedef {[x: number, y: number, match: number]} FoundPatch
 */

const {
  TILE_PX, SEARCH, SEARCH_ERROR, PLACE_ERROR, LEAST_PATCHES, MISSED_PATCHES, CLEAR_KEPT,
  COVERED_LOSS, LEAST_HALVED_PX, FINEST_PX,
} = receiverLocatePatches;

/** Corners of the display, in display units. */
const SQUARE = /** @type {Quad} */ ([
  [0, 0],
  [1, 0],
  [1, 1],
  [0, 1],
]);

/**
 * Halve a gray image again and again, until it has about 80 px on a side.
 *
 * @param {BytePlane} gray
 * @returns {Pyramid}
 */
export function imagePyramid(gray) {
  const levels = [gray];
  for (;;) {
    const last = levels[levels.length - 1];
    if (Math.min(last.width, last.height) < LEAST_HALVED_PX) return levels;
    levels.push(shrunkByWhole(last, 2));
  }
}

/**
 * Express corners, in pixels of the image, in pixels of a level of its pyramid.
 *
 * @param {Quad} corners
 * @param {number} level
 * @returns {Quad}
 */
export function atLevel(corners, level) {
  return corners.map(([x, y]) => [(x + 0.5) / 2 ** level - 0.5, (y + 0.5) / 2 ** level - 0.5]);
}

/**
 * Choose the level of a pyramid on which a display is looked at.
 *
 * @param {Quad} corners - pixels of the image
 * @param {number} width - samples across the display
 * @param {number} height - samples down the display
 * @param {number} levels - number of levels in the pyramid
 * @returns {number} the level whose pixels are about as fine as the samples, or up to half as fine
 *   again
 */
export function levelFor(corners, width, height, levels) {
  const [top, right, bottom, left] = sideLengths(corners);
  const ratio = Math.min(Math.min(top, bottom) / width, Math.min(left, right) / height);
  const level = Math.floor(Math.log2(Math.max(ratio, 1e-3) / FINEST_PX) + 0.5);
  return Math.min(Math.max(level, 0), levels - 1);
}

/**
 * Find the centres of the patches on the display, in [0, 1].
 *
 * @param {Layout} layout
 * @returns {Point[]}
 */
export function patchCentres(layout) {
  return layout.ratex.map(([row, col]) => [(col + 0.5) / layout.cols, (row + 0.5) / layout.rows]);
}

/**
 * Tell which patches lie wholly in the image.
 *
 * @param {Quad} corners - pixels of the image
 * @param {Layout} layout - with patches
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @returns {Uint8Array} (patches,) 1 for each that does
 */
export function patchesInView(corners, layout, width, height) {
  const H = homographyFromCorners(corners, layout.width, layout.height);
  return Uint8Array.from(layout.ratex, ([row, col]) => {
    const [top, bottom, left, right] = layout.cellBox(row, col).map((end) => end - 0.5);
    return allIn(transform(H, boxCorners(left, top, right, bottom)), width, height);
  });
}

/**
 * @param {number} left
 * @param {number} top
 * @param {number} right
 * @param {number} bottom
 * @returns {Quad}
 */
function boxCorners(left, top, right, bottom) {
  return [
    [left, top],
    [right, top],
    [right, bottom],
    [left, bottom],
  ];
}

/**
 * @param {Point[]} points
 * @param {number} width
 * @param {number} height
 * @returns {0 | 1}
 */
function allIn(points, width, height) {
  return inImage(points, width, height).every((inside) => inside === 1) ? 1 : 0;
}

/**
 * Tell how well a rectified frame shows the patches, some of which may be covered.
 *
 * @param {ArrayLike<number>} match - (patches,) correlations, from `matchPatches`
 * @param {ArrayLike<number>} inView - (patches,) which patches the image holds, from
 *   `patchesInView`
 * @returns {number} mean correlation of all patches; or, where that is more, that of the patches
 *   that are seen best, less `COVERED_LOSS`, if each of them has `CLEAR_KEPT`. At most
 *   `MISSED_PATCHES` are left out, and `LEAST_PATCHES` must be in view, or the value is -1.
 */
export function seenCorrelation(match, inView) {
  const all = Array.from(match);
  const seen = all.filter((_, patch) => inView[patch]).sort((one, other) => other - one);
  const needed = Math.min(all.length, Math.max(LEAST_PATCHES, all.length - MISSED_PATCHES));
  if (seen.length < needed) return -1;
  const kept = seen.slice(0, needed);
  const best = kept[needed - 1] >= CLEAR_KEPT ? mean(kept) - COVERED_LOSS : -1;
  return seen.length === all.length ? Math.max(mean(all), best) : best;
}

/** @param {number[]} values */
function mean(values) {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/**
 * Look for each patch around the place where the corners put it.
 *
 * @param {Pyramid} pyramid - `imagePyramid` of the image
 * @param {Quad} corners - coarse, in the corner order to be tried
 * @param {Layout} layout - with patches
 * @param {number} [share] - distance on each axis that is searched, as a share of the display's
 *   side
 * @returns {{ promise: number, found: FoundPatch[] }} mean over the patches in view of the best
 *   correlation in reach, in [-1, 1], or -1 where too few are in view; and where each patch was
 *   found, with correlation 0 for one out of view
 */
export function searchPatches(pyramid, corners, layout, share = SEARCH) {
  const size = TILES * TILE_PX;
  const width = layout.cols * size;
  const height = layout.rows * size;
  const reachX = Math.max(3, Math.round(share * width));
  const reachY = Math.max(3, Math.round(share * height));
  const level = levelFor(corners, width, height, pyramid.length);
  const H = homographyFromCorners(atLevel(corners, level), width, height);
  const shifted = multiply3(H, [1, 0, -reachX, 0, 1, -reachY, 0, 0, 1]);
  const seen = warped(pyramid[level], shifted, width + 2 * reachX, height + 2 * reachY);
  /** @type {FoundPatch[]} */
  const found = layout.ratex.map(([row, col], patch) => {
    const template = templateOf(layout.tileLevelsToggled[patch]);
    const place = [col * size, row * size, size + 2 * reachX, size + 2 * reachY];
    const best = new Float64Array(3);
    call("bestMatch", [seen, ...place, template], [best]);
    return [
      ((col + 0.5) * size + best[0] - reachX) / width,
      ((row + 0.5) * size + best[1] - reachY) / height,
      best[2],
    ];
  });
  const [whole] = pyramid;
  if (allIn(corners, whole.width, whole.height)) {
    return { promise: mean(found.map(([, , match]) => match)), found };
  }
  const [halfX, halfY] = [0.5 / layout.cols, 0.5 / layout.rows];
  const inView = found.map(([x, y]) => {
    const box = boxCorners(x - halfX, y - halfY, x + halfX, y + halfY);
    /** @type {Quad} */
    const ends = box.map(([u, v]) => [u * width - 0.5, v * height - 0.5]);
    return allIn(transform(H, ends), pyramid[level].width, pyramid[level].height);
  });
  const centres = patchCentres(layout);
  inView.forEach((inside, patch) => {
    if (!inside) found[patch] = [...centres[patch], 0];
  });
  const matches = found.filter((_, patch) => inView[patch]).map(([, , match]) => match);
  const enough = matches.length >= Math.min(LEAST_PATCHES, found.length);
  return { promise: enough ? mean(matches) : -1, found };
}

/** @type {WeakMap<number[], BytePlane>} */
const templates = new WeakMap();

/**
 * Draw a patch with `TILE_PX` pixels along each axis of a tile.
 *
 * @param {number[]} tiles - levels of the patch's tiles
 * @returns {BytePlane}
 */
function templateOf(tiles) {
  let template = templates.get(tiles);
  if (!template) {
    const size = TILES * TILE_PX;
    const data = Uint8Array.from({ length: size * size }, (_, at) => {
      const row = Math.floor(at / size / TILE_PX);
      return tiles[row * TILES + Math.floor((at % size) / TILE_PX)];
    });
    template = { width: size, height: size, data };
    templates.set(tiles, template);
  }
  return template;
}

/**
 * Move corners so that the patches lie where they were found.
 *
 * Least squares on the corners' motion in the display's frame, with a ridge: patches of low
 * correlation count little, and a corner that no patch tells about stays. A patch that was found
 * in a wrong place disagrees with the others and counts little, too.
 *
 * @param {Quad} corners - pixels of the image
 * @param {FoundPatch[]} found - as `searchPatches` returns them
 * @param {Layout} layout - with patches
 * @returns {Quad} pixels of the image
 */
export function cornersFromPatches(corners, found, layout) {
  const nominal = patchCentres(layout);
  const places = nominal.flat();
  const weight = found.map(([, , match]) =>
    match === 0 ? 0 : Math.min(Math.max(match, 0.05), 1) ** 8 / PLACE_ERROR ** 2,
  );
  const hold = 1 / SEARCH_ERROR ** 2;
  const ridge = new Float64Array(64);
  for (let i = 0; i < 8; i++) ridge[i * 9] = hold;

  /** Two Gauss-Newton steps from the unit square. */
  const solve = (/** @type {Float64Array} */ robust) => {
    let target = SQUARE;
    for (let round = 0; round < 2; round++) {
      const { at, byCorners } = pointsByCorners(SQUARE, target, places);
      const step = ridgeSolution(
        byCorners,
        Float64Array.from(at, (value, n) => found[n >> 1][n & 1] - value),
        Float64Array.from(at, (_, n) => weight[n >> 1] * robust[n >> 1]),
        ridge,
        target.flatMap(([x, y], i) => [hold * (SQUARE[i][0] - x), hold * (SQUARE[i][1] - y)]),
      );
      target = target.map(([x, y], i) => [x + step[2 * i], y + step[2 * i + 1]]);
    }
    return target;
  };
  const { solution } = reweighted({
    solve,
    residualsOf: (target) => {
      const there = transform(homographyFromPoints(SQUARE, target), nominal);
      return Float64Array.from(there, ([x, y], patch) =>
        Math.hypot(found[patch][0] - x, found[patch][1] - y),
      );
    },
    scaleOf: () => 2 * PLACE_ERROR,
    rounds: 4,
    weights: new Float64Array(found.length).fill(1),
  });
  return transform(homographyFromPoints(SQUARE, corners), solution);
}
