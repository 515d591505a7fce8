/** Averages of the pixels that lie in each pixel of a smaller image, as OpenCV's INTER_AREA. */

import { roundHalfEven } from "./round.js";

/**
 * Resize a plane by averaging over areas, as `cv2.resize` with INTER_AREA does.
 *
 * A plane that grows along an axis is interpolated, within the width of one pixel of the result.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {import("./opencv.js").Plane<Samples>} plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {import("./opencv.js").Plane<Samples>} rounded where samples are bytes
 */
export function resizeArea(plane, width, height) {
  const given = /** @type {import("./opencv.js").Plane<any>} */ (plane);
  if (width === plane.width && height === plane.height) {
    return { width, height, data: given.data.slice() };
  }
  if (width > plane.width || height > plane.height) return grown(given, width, height);
  const bytes = plane.data instanceof Uint8Array;
  const across = plane.width / width;
  const down = plane.height / height;
  if (bytes && Number.isInteger(across) && Number.isInteger(down)) {
    return /** @type {any} */ (shrunkByWhole(given, across, down));
  }
  return shrunk(given, width, height);
}

/**
 * Average rectangles of pixels of a plane of bytes; rows and columns left over are dropped.
 *
 * @param {BytePlane} plane
 * @param {number} across - width of the rectangles, pixels
 * @param {number} [down] - height of the rectangles, pixels; their width where absent
 * @returns {BytePlane}
 */
export function shrunkByWhole(plane, across, down = across) {
  const width = Math.floor(plane.width / across);
  const height = Math.floor(plane.height / down);
  const data = new Uint8Array(width * height);
  const { width: stride, data: source } = plane;
  if (across === 2 && down === 2) {
    for (let y = 0, to = 0; y < height; y++) {
      for (let x = 0, at = 2 * y * stride; x < width; x++, at += 2, to++) {
        const below = at + stride;
        data[to] = (source[at] + source[at + 1] + source[below] + source[below + 1] + 2) >> 2;
      }
    }
    return { width, height, data };
  }
  const sums = new Uint32Array(width);
  const share = Math.fround(1 / (across * down));
  for (let y = 0, to = 0; y < height; y++) {
    sums.fill(0);
    for (let row = 0; row < down; row++) {
      let at = (y * down + row) * stride;
      for (let x = 0; x < width; x++) {
        let sum = 0;
        for (let k = 0; k < across; k++) sum += source[at++];
        sums[x] += sum;
      }
    }
    for (let x = 0; x < width; x++) data[to++] = roundHalfEven(Math.fround(sums[x] * share));
  }
  return { width, height, data };
}

/**
 * @param {import("./opencv.js").Plane<any>} plane
 * @param {number} width
 * @param {number} height
 * @returns {import("./opencv.js").Plane<any>}
 */
function shrunk(plane, width, height) {
  const { width: stride, data: source } = plane;
  const bytes = source instanceof Uint8Array;
  const data = bytes ? new Uint8Array(width * height) : new Float32Array(width * height);
  const across = overlaps(stride, width);
  const down = overlaps(plane.height, height);
  const sums = new Float64Array(stride);
  for (let y = 0, to = 0; y < height; y++) {
    sums.fill(0);
    let from = down.first[y] * stride;
    for (let n = down.start[y]; n < down.start[y + 1]; n++, from += stride) {
      const share = down.share[n];
      for (let x = 0; x < stride; x++) sums[x] += share * source[from + x];
    }
    for (let x = 0, n = 0; x < width; x++, to++) {
      let at = across.first[x];
      let sum = 0;
      for (const end = across.start[x + 1]; n < end; n++, at++) sum += sums[at] * across.share[n];
      // as floats of 32 bits, sums that should end on a half mostly do
      data[to] = bytes ? roundHalfEven(Math.fround(sum)) : sum;
    }
  }
  return { width, height, data };
}

/**
 * Which pixels of an axis lie in each pixel of a shorter one: the first of them, and the shares
 * of it and of those that follow, which begin and end at `start`.
 *
 * @typedef {{ first: Int32Array, start: Int32Array, share: Float64Array }} Overlaps
 */

/**
 * @param {number} length
 * @param {number} shorter
 * @returns {Overlaps}
 */
function overlaps(length, shorter) {
  const scale = length / shorter;
  const first = new Int32Array(shorter);
  const start = new Int32Array(shorter + 1);
  const share = new Float64Array(length + 2 * shorter);
  let count = 0;
  for (let at = 0; at < shorter; at++) {
    const begin = at * scale;
    const end = begin + scale;
    const cell = Math.min(scale, length - begin);
    const last = Math.min(Math.floor(end), length - 1);
    const whole = Math.min(Math.ceil(begin), last);
    first[at] = whole;
    if (whole - begin > 1e-3) {
      first[at]--;
      share[count++] = Math.fround((whole - begin) / cell);
    }
    share.fill(Math.fround(1 / cell), count, count + last - whole);
    count += last - whole;
    if (end - last > 1e-3) share[count++] = Math.fround(Math.min(end - last, 1, cell) / cell);
    start[at + 1] = count;
  }
  return { first, start, share };
}

/**
 * @param {import("./opencv.js").Plane<any>} plane
 * @param {number} width
 * @param {number} height
 * @returns {import("./opencv.js").Plane<any>}
 */
function grown(plane, width, height) {
  const { width: stride, data: source } = plane;
  const bytes = source instanceof Uint8Array;
  const data = bytes ? new Uint8Array(width * height) : new Float32Array(width * height);
  const across = between(stride, width);
  const down = between(plane.height, height);
  for (let y = 0, to = 0; y < height; y++) {
    const above = down.from[y] * stride;
    const below = Math.min(down.from[y] + 1, plane.height - 1) * stride;
    for (let x = 0; x < width; x++, to++) {
      const left = across.from[x];
      const right = Math.min(left + 1, stride - 1);
      const share = across.share[x];
      const one = source[above + left] * (1 - share) + source[above + right] * share;
      const two = source[below + left] * (1 - share) + source[below + right] * share;
      const value = one * (1 - down.share[y]) + two * down.share[y];
      data[to] = bytes ? roundHalfEven(value) : value;
    }
  }
  return { width, height, data };
}

/**
 * Find the pixel before each pixel of a resized axis, and the share of the pixel after it.
 *
 * @param {number} length
 * @param {number} resized
 */
function between(length, resized) {
  const from = new Int32Array(resized);
  const share = new Float32Array(resized);
  const growth = resized / length;
  for (let at = 0; at < resized; at++) {
    from[at] = Math.min(Math.floor(at * (1 / growth)), length - 1);
    const part = Math.fround(at + 1 - (from[at] + 1) * growth);
    if (part > 0) share[at] = part - Math.floor(part);
  }
  return { from, share };
}
