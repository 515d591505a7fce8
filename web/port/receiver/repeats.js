/**
 * Recognise frames that show again what the frame before showed, because a camera repeated it.
 *
 * A camera that is late, and a program that evens out the rate of a film, hand over the same image
 * twice. The second one was not exposed at the time that it bears. It differs from the first far
 * less than two exposures would: sensor noise alone makes these differ everywhere.
 *
 * Where frames are free of noise, as in a recording of the screen, equal frames are no repeats: the
 * display stood still. There is no floor of noise then, and nothing counts as repeated.
 */

import { receiverRepeats } from "../../generated/constants.js";
import { median, quantiles, spreadOf } from "../link/order.js";

const { CELL_PX, CELLS, QUANTILES, REPEATED, MIN_NOISE_LEVELS, HISTORY, FIRST } = receiverRepeats;

/** Compares each frame with the one before. */
export class Repeats {
  /** @type {BytePlane | null} */
  #before = null;
  /** Differences of the last frames at each of `QUANTILES`. @type {number[][]} */
  #changes = [];

  /**
   * Tell whether a frame shows again what the frame before showed.
   *
   * @param {BytePlane} image - the next frame of the film; it is kept
   * @returns {boolean}
   */
  isRepeat(image) {
    const before = this.#before;
    this.#before = image;
    if (before === null || before.width !== image.width || before.height !== image.height) {
      this.#changes = [];
      return false;
    }
    const change = quantiles(differences(image, before), QUANTILES);
    if (this.#changes.length >= FIRST) {
      const usual = QUANTILES.map((_, i) => median(this.#changes.map((values) => values[i])));
      const same = change.every((value, i) => value <= REPEATED[i] * usual[i]);
      if (usual[0] >= MIN_NOISE_LEVELS && same) return true;
    }
    this.#changes.push(change);
    if (this.#changes.length > HISTORY) this.#changes.shift();
    return false;
  }
}

/**
 * Compare two images in small squares of pixels that are spread evenly over them: a bit, or a change
 * of exposure, moves all pixels of such a cell alike.
 *
 * @param {BytePlane} now
 * @param {BytePlane} before - of its size
 * @returns {number[]} the standard deviation of what differs in each cell, gray levels
 */
function differences({ width, height, data }, before) {
  const [stepX, stepY] = [width, height].map((side) => Math.max(1, Math.floor(side / CELLS)));
  const [wide, tall] = [stepX, stepY].map((step) => Math.min(CELL_PX, step));
  const changes = new Int16Array(wide * tall);
  const spread = [];
  for (let top = 0; top + stepY <= height; top += stepY) {
    for (let left = 0; left + stepX <= width; left += stepX) {
      for (let i = 0; i < changes.length; i++) {
        const at = (top + Math.floor(i / wide)) * width + left + (i % wide);
        changes[i] = data[at] - before.data[at];
      }
      spread.push(spreadOf(changes)[1]);
    }
  }
  return spread;
}
