/** Images seen through a homography or a lens, sampled between pixels. */

import { filled, floatPlane, planeLike } from "./opencv.js";

/**
 * Sample a plane where a homography leads, bilinearly; beyond the border its last pixel counts.
 *
 * The result is that of `cv2.warpPerspective` with INTER_LINEAR, WARP_INVERSE_MAP and
 * BORDER_REPLICATE.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {Plane<Samples>} plane
 * @param {ArrayLike<number>} H - (3, 3) from pixels of the result to pixels of the plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {Plane<Samples>} rounded where samples are bytes
 */
export function warped(plane, H, width, height) {
  return filled("warped", [plane, Float64Array.from(H)], planeLike(plane, width, height));
}

/**
 * Sample a plane where a homography leads, as `warped` does, without rounding.
 *
 * @param {Plane<Uint8Array | Float32Array>} plane
 * @param {ArrayLike<number>} H - (3, 3) from pixels of the result to pixels of the plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {FloatPlane}
 */
export function warpedFloats(plane, H, width, height) {
  return filled("warped", [plane, Float64Array.from(H)], floatPlane(width, height));
}

/**
 * Sample a plane at any places, as `warped` does; the result is that of `cv2.remap`.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {Plane<Samples>} plane
 * @param {Float32Array[]} places - x and y in the plane, for each pixel of the result, row by row
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {Plane<Samples>} rounded where samples are bytes
 */
export function remapped(plane, [xs, ys], width, height) {
  return filled("remapped", [plane, xs, ys], planeLike(plane, width, height));
}
