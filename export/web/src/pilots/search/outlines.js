/** Quadrilaterals around the largest part of a mask, and how they are fitted to a map. */

import { pilotsSearchToggleMap } from "../../generated/constants.js";
import { cv, matOf, withMats } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { isConvex } from "../../link/geometry.js";

export const { CLOSED_PX, OPENED_PX, FIT_PX, FIT_STEPS, LEAST_SHARE } = pilotsSearchToggleMap;

/** Directions in which corners are tried to be moved. */
export const MOVES = [-1, 0, 1]
  .flatMap((x) => [-1, 0, 1].map((y) => [x, y]))
  .filter(([x, y]) => x || y);

/**
 * Bound the largest part of a mask, specks dropped and holes closed.
 *
 * @param {BytePlane} mask - of 0 and 1
 * @returns {Point[][]} the smallest quadrilateral and the smallest rectangle around it, pixels;
 *   none where no part is large enough
 */
export function outlines(mask) {
  const margin = CLOSED_PX;
  let around = padded(mask, margin);
  around = eroded(dilated(around, CLOSED_PX), CLOSED_PX);
  around = dilated(eroded(around, OPENED_PX), OPENED_PX);
  return withMats((keep) => {
    const contours = keep(new cv.MatVector());
    const tree = keep(new cv.Mat());
    cv.findContours(
      keep(matOf(around)),
      contours,
      tree,
      cv.RETR_EXTERNAL,
      cv.CHAIN_APPROX_NONE,
    );
    let area = LEAST_SHARE * mask.width * mask.height;
    let largest = null;
    for (let i = 0; i < contours.size(); i++) {
      const contour = keep(contours.get(i));
      const here = cv.contourArea(contour);
      if (largest === null ? here < area : here <= area) continue;
      area = here;
      largest = contour;
    }
    if (largest === null) return [];
    const hull = keep(new cv.Mat());
    cv.convexHull(largest, hull);
    const quad = keep(new cv.Mat());
    cv.approxPolyN(hull, quad, 4, -1, true);
    const numbers = quad.depth() === cv.CV_32F ? quad.data32F : quad.data32S;
    const corners = [0, 1, 2, 3].map((i) => [numbers[2 * i], numbers[2 * i + 1]]);
    return [corners, boxCorners(cv.minAreaRect(largest))].map((points) =>
      points.map(([x, y]) => /** @type {Point} */ ([x - margin, y - margin])),
    );
  });
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
 * Sum maps within one quadrilateral after the other.
 *
 * @template Result
 * @param {FloatPlane} gain - of `fitCopy`
 * @param {(sumWithin: (quad: Point[]) => number) => Result} work - takes a function that sums what
 *   lies within pixels of the map, minus infinity where they are not convex
 * @returns {Result}
 */
export function withSums(gain, work) {
  return withMats((keep) => {
    const mask = keep(new cv.Mat(gain.height, gain.width, cv.CV_8UC1));
    const points = keep(new cv.Mat(4, 1, cv.CV_32SC2));
    const one = new cv.Scalar(1);
    return work((quad) => {
      if (!isConvex(quad)) return -Infinity;
      const drawn = mask.data;
      drawn.fill(0);
      points.data32S.set(quad.flat().map((value) => roundHalfEven((value / FIT_PX) * 16)));
      cv.fillConvexPoly(mask, points, one, cv.LINE_8, 4);
      let sum = 0;
      for (let i = 0; i < drawn.length; i++) if (drawn[i]) sum += gain.data[i];
      return sum;
    });
  });
}

/**
 * Move the corners of a quadrilateral, one by one, while that adds to the sum within it.
 *
 * @param {Point[]} quad - pixels of the map
 * @param {FloatPlane} gain - what each pixel adds, of `fitCopy`
 * @returns {{ corners: Point[], sum: number }}
 */
export function fittedOutline(quad, gain) {
  return withSums(gain, (worth) => {
    let corners = quad;
    let best = worth(quad);
    for (const step of FIT_STEPS) {
      for (let improved = true; improved; ) {
        improved = false;
        for (let corner = 0; corner < 4; corner++) {
          for (const [x, y] of MOVES) {
            const tried = corners.slice();
            tried[corner] = [corners[corner][0] + step * x, corners[corner][1] + step * y];
            const now = worth(tried);
            if (!(now > best + 1e-6)) continue;
            [best, corners, improved] = [now, tried, true];
          }
        }
      }
    }
    return { corners, sum: best };
  });
}

/**
 * List the corners of OpenCV's rotated rectangle, in the order of `cv2.boxPoints`.
 *
 * @param {{ center: { x: number, y: number }, size: { width: number, height: number },
 *   angle: number }} box
 * @returns {number[][]}
 */
function boxCorners({ center, size, angle }) {
  const turn = (angle * Math.PI) / 180;
  const [b, a] = [Math.cos(turn) / 2, Math.sin(turn) / 2];
  const first = [
    center.x - a * size.height - b * size.width,
    center.y + b * size.height - a * size.width,
  ];
  const second = [
    center.x + a * size.height - b * size.width,
    center.y - b * size.height - a * size.width,
  ];
  const opposite = (/** @type {number[]} */ [x, y]) => [2 * center.x - x, 2 * center.y - y];
  return [first, second, opposite(first), opposite(second)];
}

/**
 * @param {BytePlane} plane
 * @param {number} margin - pixels of 0 on all sides
 * @returns {BytePlane}
 */
function padded(plane, margin) {
  const width = plane.width + 2 * margin;
  const height = plane.height + 2 * margin;
  const data = new Uint8Array(width * height);
  for (let y = 0; y < plane.height; y++) {
    const row = plane.data.subarray(y * plane.width, (y + 1) * plane.width);
    data.set(row, (y + margin) * width + margin);
  }
  return { width, height, data };
}

/**
 * Grow what is 1 by OpenCV's ellipse of a size, a run of a row at a time: `cv2.dilate` is slow.
 *
 * @param {BytePlane} mask - of 0 and 1
 * @param {number} size - of the ellipse, pixels, odd
 * @returns {BytePlane}
 */
function dilated(mask, size) {
  const { width, height } = mask;
  const radius = size >> 1;
  const reaches = Array.from({ length: size }, (_, row) =>
    roundHalfEven(Math.sqrt(radius ** 2 - (row - radius) ** 2)),
  );
  const data = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) {
    const row = mask.data.subarray(y * width, (y + 1) * width);
    for (let start = row.indexOf(1); start >= 0; ) {
      const gap = row.indexOf(0, start);
      const stop = gap < 0 ? width : gap;
      for (let dy = -radius; dy <= radius; dy++) {
        if (y + dy < 0 || y + dy >= height) continue;
        const reach = reaches[dy + radius];
        const line = (y + dy) * width;
        data.fill(1, line + Math.max(0, start - reach), line + Math.min(width, stop + reach));
      }
      start = gap < 0 ? -1 : row.indexOf(1, stop);
    }
  }
  return { width, height, data };
}

/**
 * Shrink what is 1 by OpenCV's ellipse of a size.
 *
 * @param {BytePlane} mask - of 0 and 1
 * @param {number} size - of the ellipse, pixels, odd
 * @returns {BytePlane}
 */
function eroded(mask, size) {
  return inverted(dilated(inverted(mask), size));
}

/**
 * @param {BytePlane} mask - of 0 and 1
 * @returns {BytePlane}
 */
function inverted({ width, height, data }) {
  const other = new Uint8Array(data.length);
  for (let i = 0; i < data.length; i++) other[i] = 1 - data[i];
  return { width, height, data: other };
}
