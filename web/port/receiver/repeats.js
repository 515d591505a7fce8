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
/** Share of the cells in which an image differs less than `Repeats.change` says. */
const CHANGED = 0.9;
/** Variance of the noise, in gray levels squared, where an image has none. */
const LEAST_VARIANCE = 0.05;

/**
 * What differs between two frames in small squares of pixels: mean and standard deviation of each, in
 * gray levels, and their number of pixels.
 *
 * @typedef {{ means: number[], spread: number[], area: number }} Differences
 */

/** Compares each frame with the one before. */
export class Repeats {
  /** @type {BytePlane | null} */
  #before = null;
  /** @type {Differences | null} */
  #newest = null;
  /** Differences of the last frames at each of `QUANTILES`. @type {number[][]} */
  #changes = [];

  /**
   * By how much the newest frame differs from the one before: the square of the mean difference in a
   * cell, in those of its noise alone; nine tenths of the cells differ by less.
   */
  get change() {
    if (this.#newest === null) return 0;
    const { spread, means, area } = this.#newest;
    const usual = median(means);
    const powers = means.map(
      (mean, i) => (area * (mean - usual) ** 2) / (spread[i] ** 2 + LEAST_VARIANCE),
    );
    return quantiles(powers, [CHANGED])[0];
  }

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
    this.#newest = differences(image, before);
    const change = quantiles(this.#newest.spread, QUANTILES);
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
 * @returns {Differences}
 */
function differences({ width, height, data }, before) {
  const [stepX, stepY] = [width, height].map((side) => Math.max(1, Math.floor(side / CELLS)));
  const [wide, tall] = [stepX, stepY].map((step) => Math.min(CELL_PX, step));
  const changes = new Int16Array(wide * tall);
  /** @type {Differences} */
  const found = { means: [], spread: [], area: changes.length };
  for (let top = 0; top + stepY <= height; top += stepY) {
    for (let left = 0; left + stepX <= width; left += stepX) {
      for (let i = 0; i < changes.length; i++) {
        const at = (top + Math.floor(i / wide)) * width + left + (i % wide);
        changes[i] = data[at] - before.data[at];
      }
      const [mean, deviation] = spreadOf(changes);
      found.means.push(mean);
      found.spread.push(deviation);
    }
  }
  return found;
}
