/** Averages around the pixels of real gray levels. */

import { filled, floatPlane } from "./opencv.js";

/**
 * Blur a plane as `cv2.GaussianBlur` blurs floats, or bytes before it rounds them; beyond the border
 * the image is mirrored.
 *
 * @param {BytePlane | FloatPlane} plane
 * @param {number} sigma - standard deviation, in pixels
 * @returns {FloatPlane}
 */
export function blurred(plane, sigma) {
  return filled("blurred", [plane, sigma], floatPlane(plane.width, plane.height));
}

/**
 * Take off the mean around each pixel; beyond the border the image is mirrored.
 *
 * @param {FloatPlane} plane
 * @param {number} across - width of what counts as around, pixels, odd
 * @param {number} down - its height, pixels, odd
 * @returns {FloatPlane}
 */
export function lessMeanAround(plane, across, down) {
  return filled("lessMeanAround", [plane, across, down], floatPlane(plane.width, plane.height));
}
