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
import { median, quantile } from "../link/order.js";

const { CELL_PX, CELLS, QUANTILES, REPEATED, MIN_NOISE_LEVELS, HISTORY, FIRST } = receiverRepeats;
/** Share of the cells in which an image differs less than `Repeats.change` says. */
const CHANGED = 0.9;
/** Variance of the noise, in gray levels squared, where an image has none. */
const LEAST_VARIANCE = 0.05;

/**
 * Small squares of pixels, spread evenly over an image, cell by cell.
 *
 * @typedef {{ cells: number, across: number, area: number, levels: Uint8Array }} Cells
 */

/** Compares each frame with the one before. */
export class Repeats {
  /** @type {Cells | null} */
  #before = null;
  /** @type {ReturnType<typeof differences> | null} */
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
    return quantile(
      means.map((mean, i) => (area * (mean - usual) ** 2) / (spread[i] ** 2 + LEAST_VARIANCE)),
      CHANGED,
    );
  }

  /**
   * Tell whether a frame shows again what the frame before showed.
   *
   * @param {BytePlane} image - the next frame of the film
   * @returns {boolean}
   */
  isRepeat(image) {
    const now = sampleCells(image);
    const before = this.#before;
    this.#before = now;
    if (
      before === null ||
      before.levels.length !== now.levels.length ||
      before.across !== now.across ||
      before.area !== now.area
    ) {
      this.#changes = [];
      return false;
    }
    this.#newest = differences(now, before);
    const { spread } = this.#newest;
    const change = QUANTILES.map((share) => quantile(spread, share));
    if (this.#changes.length >= FIRST) {
      const usual = QUANTILES.map((_, i) => median(this.#changes.map((values) => values[i])));
      const same = change.every((value, i) => value <= REPEATED[i] * usual[i]);
      if (usual[0] >= MIN_NOISE_LEVELS && same) {
        return true;
      }
    }
    this.#changes.push(change);
    if (this.#changes.length > HISTORY) this.#changes.shift();
    return false;
  }
}

/**
 * Take small squares of pixels, spread evenly over an image.
 *
 * @param {BytePlane} image
 */
function sampleCells({ width, height, data }) {
  const stepY = Math.max(1, Math.floor(height / CELLS));
  const stepX = Math.max(1, Math.floor(width / CELLS));
  const down = Math.floor(height / stepY);
  const across = Math.floor(width / stepX);
  const tall = Math.min(CELL_PX, stepY);
  const wide = Math.min(CELL_PX, stepX);
  const area = tall * wide;
  const levels = new Uint8Array(down * across * area);
  for (let row = 0, to = 0; row < down; row++) {
    for (let col = 0; col < across; col++) {
      for (let y = 0; y < tall; y++) {
        const from = (row * stepY + y) * width + col * stepX;
        for (let x = 0; x < wide; x++) levels[to++] = data[from + x];
      }
    }
  }
  return { cells: down * across, across, area, levels };
}

/**
 * Find the mean and the standard deviation of the differences within each cell: a bit, or a change of
 * exposure, moves all of its pixels alike.
 *
 * @param {Cells} now
 * @param {Cells} before
 * @returns {{ spread: Float64Array, means: Float64Array, area: number }} gray levels, and pixels of a
 *   cell
 */
function differences(now, before) {
  const spread = new Float64Array(now.cells);
  const means = new Float64Array(now.cells);
  for (let cell = 0, at = 0; cell < now.cells; cell++) {
    let sum = 0;
    let squares = 0;
    for (let end = at + now.area; at < end; at++) {
      const change = now.levels[at] - before.levels[at];
      sum += change;
      squares += change * change;
    }
    const mean = (means[cell] = sum / now.area);
    spread[cell] = Math.sqrt(Math.max(0, squares / now.area - mean * mean));
  }
  return { spread, means, area: now.area };
}
