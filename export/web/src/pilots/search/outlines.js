/** Quadrilaterals around the largest part of a mask, and how they are fitted to a map. */

import { pilotsSearchToggleMap } from "../../generated/constants.js";
import { call } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { quadOf } from "../../locate/quads.js";

export const { CLOSED_PX, OPENED_PX, FIT_PX, FIT_STEPS, LEAST_SHARE } = pilotsSearchToggleMap;

/**
 * Bound the largest part of a mask, specks dropped and holes closed.
 *
 * @param {BytePlane} mask - of 0 and 1
 * @returns {Point[][]} the smallest quadrilateral and the smallest rectangle around it, pixels;
 *   none where no part is large enough
 */
export function outlines(mask) {
  const quads = new Float64Array(16);
  const area = LEAST_SHARE * mask.width * mask.height;
  const isFound = call("outlines", [mask, CLOSED_PX, OPENED_PX, area], [quads]);
  return isFound ? [quadOf(quads), quadOf(quads.subarray(8))] : [];
}

/**
 * Shrink a map to the copy to which outlines are fitted.
 *
 * @param {FloatPlane} gain
 * @returns {FloatPlane} `FIT_PX` times smaller
 */
export function fitCopy(gain) {
  const [width, height] = [gain.width, gain.height].map((side) =>
    Math.max(1, roundHalfEven(side / FIT_PX)),
  );
  return resizeArea(gain, width, height);
}

/**
 * Sum a map within quadrilaterals.
 *
 * @param {FloatPlane} gain - of `fitCopy`
 * @param {Point[][]} quads - pixels of the map
 * @returns {Float64Array} minus infinity for those that are not convex
 */
export function sumsWithin(gain, quads) {
  const sums = new Float64Array(quads.length);
  call("sumsWithin", [gain, Float64Array.from(quads.flat(2)), FIT_PX], [sums]);
  return sums;
}

/**
 * Move the corners of a quadrilateral, one by one, while that adds to the sum within it.
 *
 * @param {Point[]} quad - pixels of the map
 * @param {FloatPlane} gain - what each pixel adds, of `fitCopy`
 * @returns {{ corners: Point[], sum: number }}
 */
export function fittedOutline(quad, gain) {
  const fitted = new Float64Array(8);
  const start = Float64Array.from(quad.flat());
  const sum = call("fittedOutline", [gain, start, FIT_PX, Float64Array.from(FIT_STEPS)], [fitted]);
  return { corners: quadOf(fitted), sum };
}
