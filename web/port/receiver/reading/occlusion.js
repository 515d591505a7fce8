/** Find the blocks that something in front of the display covers; they become erasures. */

import { receiverReadingOcclusion } from "../../../generated/constants.js";
import { resizeArea } from "../../image/shrink.js";
import { median } from "../../link/order.js";

const { BLOCK_PX, ROWS_PX, HISTORY, STANDS_OUT, MIN_LEVELS, MAX_COVERED } = receiverReadingOcclusion;

/** Compares each original frame with the median of the last ones. */
export class Occlusion {
  /** @type {Uint8Array[]} */
  #history = [];

  /** @param {Layout} layout - of the display */
  constructor(layout) {
    this.layout = layout;
  }

  /**
   * Tell which message blocks are covered in the next original frame.
   *
   * @param {BytePlane} original - rectified
   * @returns {Uint8Array} (nBits,) of 0 and 1
   */
  covered(original) {
    const { rows, cols, messageBlocks } = this.layout;
    const side = Math.max(1, Math.min(BLOCK_PX, Math.floor(ROWS_PX / rows)));
    const small = resizeArea(original, cols * side, rows * side).data;
    this.#history.push(small);
    if (this.#history.length > HISTORY) this.#history.shift();
    const twice = twiceMedians(this.#history);
    const gain = (2 * middleOf(small, 256)) / Math.max(middleOf(twice, 511), 2);
    const residual = new Float64Array(rows * cols);
    const half = gain / 2;
    for (let y = 0, at = 0; y < rows * side; y++) {
      const row = Math.floor(y / side) * cols;
      for (let col = 0; col < cols; col++) {
        let sum = 0;
        for (let x = 0; x < side; x++, at++) sum += Math.abs(small[at] - half * twice[at]);
        residual[row + col] += sum;
      }
    }
    for (let block = 0; block < residual.length; block++) residual[block] /= side * side;
    const limit = Math.max(MIN_LEVELS, STANDS_OUT * median(residual));
    const count = residual.reduce((sum, value) => sum + Number(value > limit), 0);
    if (count / residual.length > MAX_COVERED) {
      this.#history = [small];
      return new Uint8Array(messageBlocks.length);
    }
    return Uint8Array.from(messageBlocks, (block) => Number(residual[block] > limit));
  }
}

/**
 * Find the median of each pixel over some images, doubled so that it is a whole number.
 *
 * @param {Uint8Array[]} images - at least one, all of one size
 */
function twiceMedians(images) {
  const count = images.length;
  const twice = new Uint16Array(images[0].length);
  const sorted = new Uint8Array(count);
  const high = count >> 1;
  const low = (count - 1) >> 1;
  for (let at = 0; at < twice.length; at++) {
    for (let i = 0; i < count; i++) {
      const value = images[i][at];
      let place = i;
      while (place > 0 && sorted[place - 1] > value) {
        sorted[place] = sorted[place - 1];
        place--;
      }
      sorted[place] = value;
    }
    twice[at] = sorted[low] + sorted[high];
  }
  return twice;
}

/**
 * Find the median of whole numbers by counting them.
 *
 * @param {Uint8Array | Uint16Array} values
 * @param {number} bound - above all values
 */
function middleOf(values, bound) {
  const counts = new Uint32Array(bound);
  for (let at = 0; at < values.length; at++) counts[values[at]]++;
  const ranked = (/** @type {number} */ rank) => {
    let value = 0;
    for (let below = counts[0]; below <= rank; below += counts[value]) value++;
    return value;
  };
  return (ranked((values.length - 1) >> 1) + ranked(values.length >> 1)) / 2;
}
