/** Places where an image is steep in all directions, as ratex patches are. */

import { blurred } from "../image/blur.js";

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
function leastSteepness({ width, height, data }, side) {
  const half = side >> 1;
  const scale = 1 / (4 * side);
  const size = width * height;
  const across = new Float32Array(size);
  const down = new Float32Array(size);
  for (let y = 0; y < height; y++) {
    const line = y * width;
    const above = mirrored(y - 1, height) * width;
    const below = mirrored(y + 1, height) * width;
    for (let x = 0; x < width; x++) {
      const left = x > 0 ? x - 1 : mirrored(-1, width);
      const right = x < width - 1 ? x + 1 : mirrored(width, width);
      const [a, b, c] = [data[above + left], data[above + x], data[above + right]];
      const [d, e, f] = [data[below + left], data[below + x], data[below + right]];
      across[line + x] = (c - a + f - d + 2 * (data[line + right] - data[line + left])) * scale;
      down[line + x] = (d - a + f - c + 2 * (e - b)) * scale;
    }
  }
  // sums over the rows of the square, of each column and beyond both ends
  const long = width + 2 * half;
  const [xx, xy, yy] = [new Float64Array(long), new Float64Array(long), new Float64Array(long)];
  const add = (/** @type {number} */ row, /** @type {number} */ sign) => {
    const line = mirrored(row, height) * width;
    for (let x = 0; x < width; x++) {
      const [gx, gy] = [across[line + x], sign * down[line + x]];
      xx[half + x] += sign * gx * gx;
      xy[half + x] += gx * gy;
      yy[half + x] += gy * down[line + x];
    }
  };
  for (let row = -half; row < half; row++) add(row, 1);
  const steep = new Float32Array(size);
  for (let y = 0; y < height; y++) {
    add(y + half, 1);
    for (let i = 1; i <= half; i++) {
      for (const sums of [xx, xy, yy]) {
        sums[half - i] = sums[half + mirrored(-i, width)];
        sums[half + width - 1 + i] = sums[half + mirrored(width - 1 + i, width)];
      }
    }
    let [a, b, c] = [0, 0, 0];
    for (let x = 0; x < side - 1; x++) {
      a += xx[x];
      b += xy[x];
      c += yy[x];
    }
    const line = y * width;
    for (let x = 0; x < width; x++) {
      a += xx[x + side - 1];
      b += xy[x + side - 1];
      c += yy[x + side - 1];
      const apart = (a - c) / 2;
      steep[line + x] = (a + c) / 2 - Math.sqrt(apart * apart + b * b);
      a -= xx[x];
      b -= xy[x];
      c -= yy[x];
    }
    add(y - half, -1);
  }
  return { width, height, data: steep };
}

/**
 * Find the pixel that stands for one beyond an end of an axis.
 *
 * @param {number} at
 * @param {number} length - more than the distance beyond
 */
function mirrored(at, length) {
  if (at < 0) return -at;
  return at < length ? at : 2 * length - 2 - at;
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
