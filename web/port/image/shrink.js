/** Averages of the pixels that lie in each pixel of a smaller image. */

import { bytePlane, filled, floatPlane, planeLike } from "./opencv.js";

/**
 * Resize a plane by averaging over areas, as `cv2.resize` with INTER_AREA does.
 *
 * A plane that grows along an axis is interpolated, within the width of one pixel of the result.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {Plane<Samples>} plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {Plane<Samples>} rounded where samples are bytes
 */
export function resizeArea(plane, width, height) {
  return filled("resized", [plane, plane.width, plane.height], planeLike(plane, width, height));
}

/**
 * Resize a plane by averaging over areas without rounding, as `cv2.resize` does with floats.
 *
 * @param {Plane<Uint8Array | Float32Array>} plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {FloatPlane}
 */
export function areaMeans(plane, width, height) {
  return filled("resized", [plane, plane.width, plane.height], floatPlane(width, height));
}

/**
 * Average squares of pixels of a plane of bytes; rows and columns left over are dropped.
 *
 * @param {BytePlane} plane
 * @param {number} side - width and height of the squares, pixels
 * @returns {BytePlane}
 */
export function shrunkByWhole(plane, side) {
  const [width, height] = [Math.floor(plane.width / side), Math.floor(plane.height / side)];
  return filled("resized", [plane, side * width, side * height], bytePlane(width, height));
}
