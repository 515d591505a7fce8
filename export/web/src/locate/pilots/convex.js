/** Polygons that bend one way only. */

/**
 * Tell whether a polygon is convex, whichever way round it goes (`cv2.isContourConvex`).
 *
 * @param {import("../../link/geometry.js").Point[]} points
 * @returns {boolean} false where three neighbours lie on a line, or a number is not finite
 */
export function isConvex(points) {
  let left = 0;
  let right = 0;
  for (let i = 0; i < points.length; i++) {
    const [a, b, c] = [0, 1, 2].map((k) => points[(i + k) % points.length].map(Math.fround));
    const turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
    if (turn > 0) right++;
    if (turn < 0) left++;
  }
  return left === points.length || right === points.length;
}
