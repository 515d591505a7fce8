/** Places where an image is steep in all directions, as ratex patches are. */

import { call } from "../../image/opencv.js";

/** Standard deviation, in pixels, of the blur before gradients are taken. */
const BLUR_PX = 0.8;
/** Gray level that is added before logarithms are taken. */
const DARK = 4;
/** Side, in pixels, of the square in which a place must be the steepest. */
const ALONE_PX = 7;
/** Smallest steepness that counts. */
const LEAST = 1e-6;

/**
 * Find the places where the logarithm of an image is steepest in all directions: the smaller
 * eigenvalue of its gradients' covariance, as `cv2.cornerMinEigenVal` has it.
 *
 * @param {BytePlane} image
 * @param {number} side - of the square over which gradients are summed, pixels; an odd number
 * @param {number} limit - largest number of places
 * @returns {Point[]} pixels, the steepest first
 */
export function steepestPlaces(image, side, limit) {
  const places = new Int32Array(2 * limit);
  const count = call("steepest", [image, BLUR_PX, DARK, side, ALONE_PX, LEAST], [places]);
  return Array.from({ length: count }, (_, i) => [places[2 * i], places[2 * i + 1]]);
}
