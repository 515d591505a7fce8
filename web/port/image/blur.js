/** Averages around the pixels of real gray levels. */

import { call, floatPlane } from "./opencv.js";

/**
 * Blur a plane as `cv2.GaussianBlur` blurs floats, or bytes before it rounds them; beyond the border
 * the image is mirrored.
 *
 * @param {BytePlane | FloatPlane} plane
 * @param {number} sigma - standard deviation, in pixels
 * @returns {FloatPlane}
 */
export function blurred(plane, sigma) {
  const result = floatPlane(plane.width, plane.height);
  call("blurred", [plane, sigma], [result]);
  return result;
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
  const result = floatPlane(plane.width, plane.height);
  call("lessMeanAround", [plane, across, down], [result]);
  return result;
}
