/** Gray levels of an image, changed. */

import { bytePlane, filled } from "./opencv.js";

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
  return filled("stretched", [image, mean, deviation], bytePlane(image.width, image.height));
}

/**
 * Spread gray levels over the whole range, so that all are about as frequent.
 *
 * @param {BytePlane} image
 */
export function equalised(image) {
  return filled("equalised", [image], bytePlane(image.width, image.height));
}

/**
 * Take off details that are smaller than a square, by opening and closing.
 *
 * @param {BytePlane} image
 * @param {number} side - of the square, pixels
 * @param {boolean} brightFirst - whether bright ones go before dark ones
 */
export function withoutDetails(image, side, brightFirst) {
  return filled("withoutDetails", [image, side, Number(brightFirst)], bytePlane(image.width, image.height));
}
