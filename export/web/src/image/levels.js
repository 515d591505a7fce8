/** Gray levels of an image, changed all alike. */

import { bytePlane, call } from "./opencv.js";

/**
 * Stretch gray levels so that they have a mean and a standard deviation.
 *
 * Levels that go below 0 come back from there, as `cv2.convertScaleAbs` has it.
 *
 * @param {BytePlane} image
 * @param {number} mean - gray levels
 * @param {number} deviation - gray levels; less is reached where the image is nearly even
 * @returns {BytePlane}
 */
export function stretched(image, mean, deviation) {
  const result = bytePlane(image.width, image.height);
  call("stretched", [image, mean, deviation], [result]);
  return result;
}

/**
 * Spread gray levels over the whole range, so that all are about as frequent.
 *
 * @param {BytePlane} image
 * @returns {BytePlane}
 */
export function equalised(image) {
  const result = bytePlane(image.width, image.height);
  call("equalised", [image], [result]);
  return result;
}
