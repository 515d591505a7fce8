/**
 * Rank the quadrilaterals of a photograph by how likely each is to bound a lit display.
 *
 * Quadrilaterals come from straight lines and outlines on a small copy of the image, their sides
 * snap to edges, and a score ranks them by what the image shows along their sides.
 */

import { receiverLocateCandidates, receiverLocateRefine } from "../../../generated/constants.js";
import { blurred } from "../../image/blur.js";
import { keptWithImage } from "../../image/copies.js";
import { resizeArea } from "../../image/shrink.js";
import { edgeLevels, sideFeatures, snapToEdges } from "./edges.js";
import {
  SAME_PX,
  distinct,
  isNested,
  isSound,
  lineSteps,
  outlineSteps,
  upright,
} from "./quads.js";

const { WORK_PX, SNAP_PX, LINE_QUADS, NEAR, WEIGHTS, BIAS } = receiverLocateCandidates;
const { OUTSIDE } = receiverLocateRefine;

/** Units of work of moving all quadrilaterals onto edges, and of looking at all their sides. */
const SNAP_WORK = 8;
const FEATURES_WORK = 7;
/** Size, in pixels of the small copy, of the cells in which corners of alike quadrilaterals lie. */
const ALIKE_PX = 1.5;

/**
 * List quadrilaterals that may bound a lit display, step by step, the likeliest first.
 *
 * @param {BytePlane} image - it must stay as it is, as its small copy is kept
 * @param {number} limit - largest number returned
 * @returns {Steps<Quad[]>} corners to about 2 px of an image of 640, in the order nearest to upright
 */
export function* candidateSteps(image, limit) {
  const { copy, scale } = smallCopy(image);
  const quads = yield* gatheringSteps(copy);
  if (!quads.length) return [];
  const levels = edgeLevels(copy);
  const odds = quads.map((quad) =>
    sideFeatures(copy, quad, levels).reduce((sum, value, i) => sum + value * WEIGHTS[i], BIAS),
  );
  const top = Math.max(...odds);
  let first = odds.indexOf(top);
  // a light bezel's outline may show more edges than the picture within
  for (;;) {
    const outer = quads[first];
    let inner = -1;
    quads.forEach((quad, i) => {
      if (odds[i] <= top - NEAR || (inner >= 0 && odds[i] <= odds[inner])) return;
      if (isNested(quad, outer)) inner = i;
    });
    if (inner < 0) break;
    first = inner;
  }
  odds[first] = top + 1e-6;
  yield FEATURES_WORK;
  return distinct(quads, odds, limit, SAME_PX).map((i) => onFullImage(quads[i], scale));
}

/**
 * Collect all quadrilaterals that lines, outlines and edges make.
 *
 * @param {BytePlane} small - a small copy of the image
 * @returns {Steps<Quad[]>} pixels of the copy
 */
function* gatheringSteps(small) {
  const lines = yield* lineSteps(small, LINE_QUADS);
  const outlines = yield* outlineSteps(small);
  const rough = [...lines, ...outlines];
  if (!rough.length) return [];
  const smooth = blurred(small, 0.7);
  const snapped = rough.map((quad) => snapToEdges(smooth, quad, SNAP_PX));
  yield SNAP_WORK;
  /** @type {Map<string, Quad>} */
  const different = new Map(); // many snap to the same edges
  for (const quad of [...snapped, ...rough]) {
    if (!isSound(quad, small.width, small.height)) continue;
    const turned = upright(quad);
    const key = turned.flat().map((value) => Math.round(value / ALIKE_PX)).join();
    if (!different.has(key)) different.set(key, turned);
  }
  return [...different.values()];
}

/**
 * List quadrilaterals of straight lines that may bound a display which is partly in view.
 *
 * @param {BytePlane} image - it must stay as it is
 * @param {number} limit - largest number returned
 * @returns {Steps<Quad[]>} of which at least one corner lies outside the image, by at most `OUTSIDE`
 *   of its longer side; those whose sides the lines cover best come first
 */
export function* leavingSteps(image, limit) {
  const { copy, scale } = smallCopy(image);
  const leaving = yield* lineSteps(copy, limit, OUTSIDE);
  return leaving.map((quad) => onFullImage(quad, scale));
}

/**
 * Shrinks an image until its longer side has `WORK_PX` pixels; a smaller one keeps its size. Gives
 * the copy, and pixels of the image in one of it, on both axes.
 */
const smallCopy = keptWithImage((image) => {
  const factor = Math.max(1, Math.max(image.height, image.width) / WORK_PX);
  const width = Math.max(1, Math.round(image.width / factor));
  const height = Math.max(1, Math.round(image.height / factor));
  const scale = /** @type {Point} */ ([image.width / width, image.height / height]);
  return { copy: resizeArea(image, width, height), scale };
});

/**
 * Move points from the small copy to the image.
 *
 * @param {Quad} points
 * @param {Point} scale - of `smallCopy`
 * @returns {Quad}
 */
function onFullImage(points, [scaleX, scaleY]) {
  return points.map(([x, y]) => [(x + 0.5) * scaleX - 0.5, (y + 0.5) * scaleY - 0.5]);
}
