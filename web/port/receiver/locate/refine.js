/** Move corners that are a few per cent off onto the ratex patches. */

import { receiverLocateRefine } from "../../../generated/constants.js";
import { homographyFromCorners, rectify } from "../../link/geometry.js";
import { CLEAR_MATCH, matchPatches } from "../../link/ratex.js";
import { alignSteps } from "./align.js";
import {
  cornersFromPatches,
  patchesInView,
  searchPatches,
  seenCorrelation,
} from "./patches.js";
import { SLACK, isSound } from "./quads.js";
import { runToEnd } from "../../link/steps.js";

/** @typedef {import("./patches.js").Pyramid} Pyramid */
/**
 * Corners in pixels of the image, and how well the patches are seen there: `seenCorrelation`, or -1
 * where the corners make no display.
 *
 * @typedef {{ corners: Quad, seen: number }} OnPatches
 */

export const { OUTSIDE } = receiverLocateRefine;
const { SEARCHES, FEW_PATCHES_CORRELATION, USUAL_CORRELATION, PARTLY_SPREADS } = receiverLocateRefine;

/** Units of work of the searches for patches, and of looking at them. */
const SEARCH_WORK = 4;
const LOOK_WORK = 2;

/**
 * Say how visible a layout's patches must be, in [0, 1], for corners to be believed.
 *
 * @param {Layout} layout
 * @returns {number}
 */
export function neededCorrelation(layout) {
  return FEW_PATCHES_CORRELATION.get(layout.ratex.length) ?? USUAL_CORRELATION;
}

/**
 * Move corners so that the image shows the ratex patches where the layout has them.
 *
 * Patches may be out of view, or covered, as `seenCorrelation` allows.
 *
 * @param {BytePlane} image
 * @param {Pyramid} pyramid - `imagePyramid` of it
 * @param {Quad} corners - within about 9 % of the side, in the corner order to be tried
 * @param {Layout} layout - with patches
 * @returns {OnPatches}
 */
export function cornersOnPatches(image, pyramid, corners, layout) {
  return runToEnd(cornersOnPatchesSteps(image, pyramid, corners, layout));
}

/**
 * Move corners as `cornersOnPatches` does, step by step.
 *
 * @param {BytePlane} image
 * @param {Pyramid} pyramid
 * @param {Quad} corners
 * @param {Layout} layout
 * @returns {Steps<OnPatches>}
 */
export function* cornersOnPatchesSteps(image, pyramid, corners, layout) {
  for (const reach of SEARCHES) {
    const { found } = searchPatches(pyramid, corners, layout, reach);
    corners = cornersFromPatches(corners, found, layout);
  }
  yield SEARCH_WORK;
  corners = yield* alignSteps(pyramid, corners, layout);
  let judged = judge(image, corners, layout);
  yield LOOK_WORK;
  const clear = judged.match.map((match) => Number(match >= CLEAR_MATCH));
  if (judged.seen >= neededCorrelation(layout) && clear.includes(0)) {
    // a patch that is cut off or covered must not hold the corners
    corners = judged.corners;
    for (const spread of PARTLY_SPREADS) {
      corners = yield* alignSteps(pyramid, corners, layout, spread, clear);
    }
    judged = judge(image, corners, layout);
  }
  return { corners: judged.corners, seen: judged.seen };
}

/**
 * Clip corners that lie a little outside, and look at the patches.
 *
 * @param {BytePlane} image
 * @param {Quad} corners
 * @param {Layout} layout
 * @returns {OnPatches & { match: number[] }} corners, what each patch and what all are seen by
 */
function judge(image, corners, layout) {
  const { width, height } = image;
  const clipped = clippedToImage(corners, width, height);
  const outside = Math.max(
    ...corners.flatMap(([x, y], i) => [Math.abs(x - clipped[i][0]), Math.abs(y - clipped[i][1])]),
  );
  if (outside <= SLACK * Math.max(width, height)) corners = clipped;
  if (!isSound(corners, width, height, OUTSIDE)) {
    return { corners, match: layout.ratex.map(() => 0), seen: -1 };
  }
  const H = homographyFromCorners(corners, layout.width, layout.height);
  const rectified = rectify(image, H, layout.width, layout.height);
  const match = Array.from(matchPatches(rectified, layout).correlation);
  const inView = patchesInView(corners, layout, width, height);
  return { corners, match, seen: seenCorrelation(match, inView) };
}

/**
 * Move corners that lie outside an image to its border.
 *
 * @param {Quad} corners
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @returns {Quad}
 */
function clippedToImage(corners, width, height) {
  return corners.map(([x, y]) => [
    Math.min(Math.max(x, -0.5), width - 0.5),
    Math.min(Math.max(y, -0.5), height - 0.5),
  ]);
}
