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
 * @param {number} [limit] - of the contrast in a part
 * @param {number} [parts] - along each side, of which each is changed by itself (CLAHE, Zuiderveld
 *   1994); the image as a whole where absent
 * @returns {BytePlane}
 */
export function equalised(image, limit = 0, parts = 0) {
  const result = bytePlane(image.width, image.height);
  call("equalised", [image, limit, parts], [result]);
  return result;
}
