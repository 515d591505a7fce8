/** Averages of the pixels that lie in each pixel of a smaller image, as OpenCV's INTER_AREA. */

import { roundHalfEven } from "./round.js";

/** @typedef {import("./opencv.js").Plane<Uint8Array>} BytePlane */
/** @typedef {import("./opencv.js").Plane<Float32Array>} FloatPlane */

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
  const line = new Float32Array(width);
  const sums = new Float32Array(width);
  for (let k = 0, y = 0; y < height; y++) {
    sums.fill(0);
    for (; k < down.count && down.to[k] === y; k++) {
      const start = down.from[k] * stride;
      const share = down.share[k];
      line.fill(0);
      for (let n = 0; n < across.count; n++) {
        line[across.to[n]] += source[start + across.from[n]] * across.share[n];
      }
      for (let x = 0; x < width; x++) sums[x] += share * line[x];
    }
    const to = y * width;
    if (bytes) for (let x = 0; x < width; x++) data[to + x] = roundHalfEven(sums[x]);
    else data.set(sums, to);
  }
  return { width, height, data };
}

/**
 * List which pixels of an axis lie in each pixel of a shorter one, in order, and by which share.
 *
 * @param {number} length
 * @param {number} shorter
 */
function overlaps(length, shorter) {
  const scale = length / shorter;
  const most = length + 2 * shorter;
  const from = new Int32Array(most);
  const to = new Int32Array(most);
  const share = new Float32Array(most);
  let count = 0;
  /**
   * @param {number} source
   * @param {number} at
   * @param {number} part
   */
  const add = (source, at, part) => {
    from[count] = source;
    to[count] = at;
    share[count++] = part;
  };
  for (let at = 0; at < shorter; at++) {
    const start = at * scale;
    const end = start + scale;
    const cell = Math.min(scale, length - start);
    const last = Math.min(Math.floor(end), length - 1);
    const first = Math.min(Math.ceil(start), last);
    if (first - start > 1e-3) add(first - 1, at, (first - start) / cell);
    for (let source = first; source < last; source++) add(source, at, 1 / cell);
    if (end - last > 1e-3) add(last, at, Math.min(Math.min(end - last, 1), cell) / cell);
  }
  return { from, to, share, count };
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
