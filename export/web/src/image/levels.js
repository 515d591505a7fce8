/** Gray levels of an image, changed all alike. */

import { roundHalfEven } from "./round.js";

/**
 * Stretch gray levels, in place, so that they have a mean and a standard deviation.
 *
 * Levels that go below 0 come back from there, as `cv2.convertScaleAbs` has it.
 *
 * @param {BytePlane} image - changed
 * @param {number} mean - gray levels
 * @param {number} deviation - gray levels; less is reached where the image is nearly even
 * @returns {BytePlane} the image
 */
export function stretched(image, mean, deviation) {
  const { data } = image;
  const counts = new Uint32Array(256);
  for (let at = 0; at < data.length; at++) counts[data[at]]++;
  let sum = 0;
  let squares = 0;
  for (let level = 0; level < 256; level++) {
    sum += counts[level] * level;
    squares += counts[level] * level * level;
  }
  const before = sum / data.length;
  const spread = Math.sqrt(Math.max(0, squares / data.length - before * before));
  const gain = deviation / Math.max(spread, 1);
  const offset = mean - gain * before;
  const table = new Uint8Array(256);
  for (let level = 0; level < 256; level++) {
    table[level] = Math.min(255, roundHalfEven(Math.abs(Math.fround(level * gain + offset))));
  }
  for (let at = 0; at < data.length; at++) data[at] = table[data[at]];
  return image;
}
