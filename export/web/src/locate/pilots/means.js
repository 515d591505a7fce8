/** Averages over rectangles of pixels that are not rounded. */

import { resizeArea } from "../../image/shrink.js";

/** @typedef {import("../../image/opencv.js").Plane<Uint8Array | Float32Array>} AnyPlane */

/**
 * Resize a plane by averaging over areas, as `cv2.resize` with INTER_AREA does with floats.
 *
 * @param {AnyPlane} plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {FloatPlane}
 */
export function areaMeans(plane, width, height) {
  const across = plane.width / width;
  const down = plane.height / height;
  const { data: source } = plane;
  if (!Number.isInteger(across) || !Number.isInteger(down)) {
    const floats = source instanceof Float32Array ? source : Float32Array.from(source);
    return resizeArea({ width: plane.width, height: plane.height, data: floats }, width, height);
  }
  const data = new Float32Array(width * height);
  if (across === 1 && down === 1) {
    data.set(source);
  } else if (across === 2 && down === 2) {
    const stride = plane.width;
    for (let y = 0, to = 0; y < height; y++) {
      for (let x = 0, at = 2 * y * stride; x < width; x++, at += 2, to++) {
        const below = at + stride;
        data[to] = (source[at] + source[at + 1] + source[below] + source[below + 1]) / 4;
      }
    }
  } else {
    const share = 1 / (across * down);
    const sums = new Float64Array(width);
    for (let y = 0, at = 0; y < height; y++) {
      sums.fill(0);
      for (let row = 0; row < down; row++) {
        for (let x = 0; x < width; x++) {
          let sum = 0;
          for (const end = at + across; at < end; at++) sum += source[at];
          sums[x] += sum;
        }
      }
      for (let x = 0; x < width; x++) data[y * width + x] = sums[x] * share;
    }
  }
  return { width, height, data };
}
