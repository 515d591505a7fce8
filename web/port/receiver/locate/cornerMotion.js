/** How a homography through four corners moves points when the corners move. */

import { homographyFromPoints } from "../../link/geometry.js";

/**
 * Map points by the homography of four corners to four others, and say how these move them.
 *
 * @param {Point[]} source - four corners
 * @param {Point[]} target - where each of them goes
 * @param {ArrayLike<number>} points - (N, 2) in the frame of `source`
 * @returns {{ at: Float64Array, byCorners: Float64Array }} (N, 2) mapped points, and (N, 2, 8)
 *   their derivatives by x and y of the target's corners
 */
export function pointsByCorners(source, target, points) {
  const count = points.length / 2;
  const at = mapped(homographyFromPoints(source, target), points);
  const byCorners = new Float64Array(count * 16);
  const bump = 1e-2 * halfSize(target);
  for (let k = 0; k < 8; k++) {
    const other = target.map(([x, y]) => /** @type {Point} */ ([x, y]));
    other[k >> 1][k & 1] += bump;
    const there = mapped(homographyFromPoints(source, other), points);
    for (let n = 0; n < 2 * count; n++) byCorners[n * 8 + k] = (there[n] - at[n]) / bump;
  }
  return { at, byCorners };
}

/** @param {Point[]} corners */
function halfSize(corners) {
  const meanX = corners.reduce((sum, [x]) => sum + x, 0) / 4;
  const meanY = corners.reduce((sum, [, y]) => sum + y, 0) / 4;
  return Math.max(...corners.flatMap(([x, y]) => [Math.abs(x - meanX), Math.abs(y - meanY)]));
}

/**
 * @param {Float64Array} H
 * @param {ArrayLike<number>} points
 */
function mapped(H, points) {
  const there = new Float64Array(points.length);
  for (let n = 0; n < points.length; n += 2) {
    const x = points[n];
    const y = points[n + 1];
    const w = H[6] * x + H[7] * y + H[8];
    there[n] = (H[0] * x + H[1] * y + H[2]) / w;
    there[n + 1] = (H[3] * x + H[4] * y + H[5]) / w;
  }
  return there;
}
