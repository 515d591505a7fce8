/** The common motion of points of which some move otherwise. */

import { cv, withMats } from "./opencv.js";

/** @typedef {[number, number]} Point */

/**
 * Fit a homography to pairs of points, some of which are wrong (`cv2.findHomography`, RANSAC).
 *
 * @param {Point[]} from - at least four points
 * @param {Point[]} to - where each of them went
 * @param {number} threshold - largest distance, in pixels, of a point from where the homography
 *   puts it
 * @returns {{ H: Float64Array, inliers: Uint8Array, count: number } | null} nine numbers, 1 for
 *   each pair that agrees, and their number; null where nothing fits
 */
export function findHomography(from, to, threshold) {
  if (from.length < 4) return null;
  return withMats((keep) => {
    const [source, target] = [from, to].map((points) =>
      keep(cv.matFromArray(points.length, 1, cv.CV_32FC2, points.flat())),
    );
    const mask = keep(new cv.Mat());
    const H = keep(cv.findHomography(source, target, cv.RANSAC, threshold, mask));
    if (H.empty()) return null;
    const inliers = Uint8Array.from(mask.data, (/** @type {number} */ value) => Number(value > 0));
    return {
      H: Float64Array.from(H.data64F),
      inliers,
      count: inliers.reduce((sum, value) => sum + value, 0),
    };
  });
}
