/** Points of an image that can be found again, and what motion they share. Points are x, y, x, ... */

import { call } from "./opencv.js";

/** Largest number of steps towards a point, and length of a last one, pixels, as OpenCV has them. */
const USUAL_ENDS = [30, 0.01];

/** @typedef {Float32Array | Float64Array} Points */

/**
 * Choose the points whose surroundings differ most from all that lie near, as
 * `cv2.goodFeaturesToTrack` does (Shi & Tomasi 1994).
 *
 * @param {BytePlane} image
 * @param {number} count - largest number of points
 * @param {number} quality - smallest strength, as a share of the greatest one in the mask
 * @param {number} apart - smallest distance between two points, pixels
 * @param {BytePlane | null} [mask] - nonzero for each pixel that may be chosen; all where absent
 * @returns {Float32Array<ArrayBuffer>} the strongest first
 */
export function chooseFeatures(image, count, quality, apart, mask = null) {
  const points = new Float32Array(2 * count);
  return points.slice(0, 2 * call("features", [image, mask, quality, apart], [points]));
}

/**
 * Find points of an image in a later one by their surroundings, as `cv2.calcOpticalFlowPyrLK` does
 * (Bouguet 2000).
 *
 * @param {BytePlane} reference
 * @param {BytePlane} image - of the size of the reference
 * @param {Float32Array} points - of the reference
 * @param {number} side - of the surroundings, pixels
 * @param {number} halvings - number of times that the images are halved
 * @param {Float32Array | null} [guess] - where each point is expected; where it was, where absent
 * @param {readonly number[]} [ends] - number of steps, and pixels, as `USUAL_ENDS`
 * @returns {{ moved: Float32Array<ArrayBuffer>, found: Uint8Array<ArrayBuffer> }} where each point
 *   lies, and 1 for each that was followed to there
 */
export function follow(reference, image, points, side, halvings, guess = null, ends = USUAL_ENDS) {
  const moved = new Float32Array(points.length);
  const found = new Uint8Array(points.length / 2);
  call("flow", [reference, image, points, guess, side, halvings, ...ends], [moved, found]);
  return { moved, found };
}

/**
 * Fit a homography or an affine transform to pairs of points, some of which are wrong (RANSAC).
 *
 * @param {Points} from
 * @param {Points} to - where each of them went
 * @param {number} apart - largest distance, in pixels, of a point from where the motion puts it
 * @param {boolean} [affine]
 * @param {number} [tries] - largest number of motions that are tried; OpenCV's own where not given
 * @returns {{ H: Float64Array<ArrayBuffer>, same: Uint8Array<ArrayBuffer>, count: number } | null}
 *   nine numbers, 1 for each pair that agrees, and their number; null where nothing fits
 */
export function fitMotion(from, to, apart, affine = false, tries = 2000) {
  if (from.length < 8) return null;
  const H = new Float64Array(9);
  const same = new Uint8Array(from.length / 2);
  const count = call("motion", [from, to, apart, Number(affine), tries], [H, same]);
  return count > 0 ? { H, same, count } : null;
}

/**
 * Measure the smallest convex region that holds points, in square pixels.
 *
 * @param {Float32Array} points
 * @returns {number}
 */
export function hullArea(points) {
  return call("hullArea", [points]);
}

/**
 * @param {Float32Array} flat
 * @returns {Point[]}
 */
export function pointsOf(flat) {
  return Array.from({ length: flat.length / 2 }, (_, i) => [flat[2 * i], flat[2 * i + 1]]);
}

/**
 * Choose some of many points.
 *
 * @param {Float32Array} points
 * @param {(point: number) => unknown} isChosen - by the number of the point
 */
export function chosen(points, isChosen) {
  const kept = new Float32Array(points.length);
  let count = 0;
  for (let i = 0; i < points.length; i += 2) {
    if (!isChosen(i / 2)) continue;
    kept[count++] = points[i];
    kept[count++] = points[i + 1];
  }
  return kept.slice(0, count);
}
