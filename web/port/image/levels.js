/** Gray levels of an image, changed. */

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
 */
export function equalised(image) {
  const result = bytePlane(image.width, image.height);
  call("equalised", [image], [result]);
  return result;
}

/**
 * Take off details that are smaller than a square, by opening and closing.
 *
 * @param {BytePlane} image
 * @param {number} side - of the square, pixels
 * @param {boolean} brightFirst - whether bright ones go before dark ones
 */
export function withoutDetails(image, side, brightFirst) {
  const result = bytePlane(image.width, image.height);
  call("withoutDetails", [image, side, Number(brightFirst)], [result]);
  return result;
}
