/** Rounding as OpenCV rounds. */

/** Number at which neighbouring 64-bit floats are 1 apart; to add it rounds. */
const COARSE = 1.5 * 2 ** 52;

/**
 * Round a number to the nearest whole one, and halves to the even one.
 *
 * @param {number} value - smaller than 2 to the power of 51
 * @returns {number}
 */
export function roundHalfEven(value) {
  return value + COARSE - COARSE;
}
