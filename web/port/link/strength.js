/**
 * By how much each block changes, so that the eye sees all blocks alike: kappa times a factor that
 * follows from the picture's light and texture (link/strength.py).
 */

import { strength } from "../../generated/constants.js";
import { interpolated } from "../image/interpolated.js";

const {
  LUMINANCE_FROM_RGB, STEPS_PER_OCTAVE, FACTORS, LIGHT, EVEN, EVEN_LIGHT, MASKING_WEIGHT, MASKING_EXPONENT,
  MASKING_SCALE, SIGNAL_EXPONENT, STILL_SENSITIVITY, UNCERTAINTY_BLOCKS, AROUND_BLOCKS,
} = strength;

/** Light of black, of the display and the room, in units of white's. */
const BLACK = 1e-3;
/** Factors at the lights of `EVEN_LIGHT`. */
const EVEN_FACTORS = [...EVEN.values()];

/** A picture, red, green and blue for each pixel. @typedef {{ width: number, height: number,
 *   data: Uint8Array }} Picture */

/**
 * Choose how strongly each block of a picture may change.
 *
 * @param {Picture} picture
 * @param {number} rows - of blocks
 * @param {number} cols - of blocks
 * @returns {Uint8Array} (rows * cols) numbers of steps, indices of `FACTORS`
 */
export function blockSteps({ width, height, data }, rows, cols) {
  const sums = new Float64Array(3 * rows * cols);
  const counts = new Float64Array(rows * cols);
  for (let y = 0, at = 0; y < height; y++) {
    const row = Math.floor((y * rows) / height) * cols;
    for (let x = 0; x < width; x++) {
      const block = row + Math.floor((x * cols) / width);
      counts[block]++;
      for (let channel = 0; channel < 3; channel++) sums[3 * block + channel] += LIGHT[data[at++]];
    }
  }
  const light = counts.map((count, block) =>
    LUMINANCE_FROM_RGB.reduce((sum, share, i) => sum + share * (sums[3 * block + i] / count), 0),
  );
  const masks = masking(light, rows, cols);
  return Uint8Array.from(light, (value, block) => {
    const factor = interpolated(value, EVEN_LIGHT, EVEN_FACTORS) * masks[block];
    const step = Math.floor(STEPS_PER_OCTAVE * Math.log2(factor) + 1e-9);
    return Math.min(Math.max(step, 0), FACTORS.length - 1);
  });
}

/**
 * Work out by which factor the picture's texture raises the threshold of each block's flicker.
 *
 * @param {Float64Array} light - of the blocks
 * @param {number} rows
 * @param {number} cols
 */
function masking(light, rows, cols) {
  const around = blurred(light, rows, cols, AROUND_BLOCKS, (at, last) =>
    Math.min(Math.max(at, 0), last),
  );
  const contrast = light.map((value, i) => Math.abs(value - around[i]) / (around[i] + BLACK));
  const mirrored = (/** @type {number} */ at, /** @type {number} */ last) =>
    last - Math.abs(last - Math.abs(at));
  return blurred(contrast, rows, cols, UNCERTAINTY_BLOCKS, mirrored).map((value) => {
    const seen = MASKING_SCALE * STILL_SENSITIVITY * value;
    return (1 + MASKING_WEIGHT * seen ** MASKING_EXPONENT) ** (1 / SIGNAL_EXPONENT);
  });
}

/**
 * Blur blocks as `cv2.GaussianBlur` blurs 64-bit floats.
 *
 * @param {Float64Array} blocks
 * @param {number} rows
 * @param {number} cols
 * @param {number} sigma - in blocks
 * @param {(at: number, last: number) => number} within - says which place stands for one outside
 */
function blurred(blocks, rows, cols, sigma, within) {
  const reach = Math.round(8 * sigma + 1) >> 1;
  const weights = Array.from({ length: 2 * reach + 1 }, (_, i) =>
    Math.exp(-((i - reach) ** 2) / (2 * sigma * sigma)),
  );
  const sum = weights.reduce((total, weight) => total + weight);
  /** @param {Float64Array} from @param {number} step @param {number} last */
  const along = (from, step, last) =>
    from.map((_, i) => {
      const place = Math.floor(i / step) % (last + 1);
      return weights.reduce((total, weight, k) => {
        const other = within(place + k - reach, last);
        return total + (weight / sum) * from[i + (other - place) * step];
      }, 0);
    });
  return along(along(blocks, 1, cols - 1), cols, rows - 1);
}
