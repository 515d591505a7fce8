/** Places where an image is steep in all directions, as ratex patches are. */

import { blurred } from "../image/blur.js";
import { cv, floatPlane, matOf, withMats } from "../image/opencv.js";

/** Standard deviation, in pixels, of the blur before gradients are taken. */
const BLUR_PX = 0.8;
/** Gray level that is added before logarithms are taken. */
const DARK = 4;
/** Half the side, in pixels, of the square in which a place must be the steepest. */
const ALONE_PX = 3;
/** Smallest steepness that counts. */
const LEAST = 1e-6;
/** Units of work of the blur, of the logarithms, and of the steepness. */
const BLUR_WORK = 1;
const LIGHT_WORK = 1;
const STEEP_WORK = 3;

/**
 * Find the places where the logarithm of an image is steepest in all directions.
 *
 * @param {BytePlane} image
 * @param {number} side - of the square over which gradients are summed, pixels; an odd number
 * @param {number} limit - largest number of places
 * @returns {Steps<[x: number, y: number][]>} pixels, the steepest first
 */
export function* steepestSteps(image, side, limit) {
  const light = blurred(image, BLUR_PX);
  yield BLUR_WORK;
  for (let at = 0; at < light.data.length; at++) light.data[at] = Math.log(light.data[at] + DARK);
  yield LIGHT_WORK;
  const steep = leastSteepness(light, side);
  yield STEEP_WORK;
  return peaks(steep, limit);
}

/**
 * Find the smaller eigenvalue of the gradients' covariance around each pixel, as
 * `cv2.cornerMinEigenVal` does with its gradients of three pixels.
 *
 * @param {FloatPlane} light
 * @param {number} side
 * @returns {FloatPlane}
 */
function leastSteepness(light, side) {
  return withMats((keep) => {
    const steep = keep(new cv.Mat());
    cv.cornerMinEigenVal(keep(matOf(light)), steep, side);
    return floatPlane(steep);
  });
}

/**
 * @param {FloatPlane} steep
 * @param {number} limit
 * @returns {[number, number][]}
 */
function peaks({ width, height, data }, limit) {
  /** @type {number[]} */
  const found = [];
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at++) {
      const value = data[at];
      if (!(value > LEAST)) continue;
      if (x > 0 && data[at - 1] > value) continue;
      if (x < width - 1 && data[at + 1] > value) continue;
      if (y > 0 && data[at - width] > value) continue;
      if (y < height - 1 && data[at + width] > value) continue;
      if (isPeak(data, width, height, x, y)) found.push(at);
    }
  }
  found.sort((one, other) => data[other] - data[one]);
  return found.slice(0, limit).map((at) => [at % width, Math.floor(at / width)]);
}

/**
 * @param {Float32Array} data
 * @param {number} width
 * @param {number} height
 * @param {number} x
 * @param {number} y
 */
function isPeak(data, width, height, x, y) {
  const value = data[y * width + x];
  const right = Math.min(width - 1, x + ALONE_PX);
  for (let row = Math.max(0, y - ALONE_PX); row <= Math.min(height - 1, y + ALONE_PX); row++) {
    for (let col = Math.max(0, x - ALONE_PX); col <= right; col++) {
      if (data[row * width + col] > value) return false;
    }
  }
  return true;
}
