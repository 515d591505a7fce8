/** Pilots, the blocks whose bits the receiver knows: where they lie, and how they change. */

import { arraysOf, filled, floatPlane, rowsOf } from "../image/opencv.js";

/** @typedef {Plane<Uint8Array | Float32Array>} AnyPlane */

/**
 * Give the signs with which the pilots toggle.
 *
 * @param {Layout} layout
 * @returns {Float64Array} (pilots,) of 1 and -1
 */
export function pilotSigns(layout) {
  return Float64Array.from(layout.pilotBits, (bit) => 2 * bit - 1);
}

/**
 * Give the centres of the pilots on the display.
 *
 * @param {Layout} layout
 * @returns {Point[]} x and y in [0, 1]
 */
export function pilotCentres({ rows, cols, pilotBlocks }) {
  return Array.from(pilotBlocks, (block) => [
    ((block % cols) + 0.5) / cols,
    (Math.floor(block / cols) + 0.5) / rows,
  ]);
}

/**
 * List the expected changes of the blocks: the pilots' signs, 0 elsewhere.
 *
 * @param {Layout} layout
 * @returns {Float64Array} (rows * cols,)
 */
export function expectedChanges(layout) {
  const blocks = new Float64Array(layout.rows * layout.cols);
  pilotSigns(layout).forEach((sign, i) => (blocks[layout.pilotBlocks[i]] = sign));
  return blocks;
}

/**
 * Measure by how much each pilot is brighter than its neighbourhood of 3 x 3 blocks.
 *
 * @param {AnyPlane} view - the rectified display, of any size
 * @param {Layout} layout - with pilots
 * @returns {Float32Array} (pilots,) gray levels
 */
export function pilotValues(view, layout) {
  return picked(standingOut([view], layout)[0], layout.pilotBlocks);
}

/** Pick values. @type {(values: Float32Array, numbers: ArrayLike<number>) => Float32Array} */
export function picked(values, numbers) {
  const some = new Float32Array(numbers.length);
  for (let i = 0; i < some.length; i++) some[i] = values[numbers[i]];
  return some;
}

/**
 * Measure by how much each block is brighter than its neighbourhood of 3 x 3 blocks.
 *
 * @param {readonly AnyPlane[]} views - the rectified display in some frames, of any one size
 * @param {Layout} layout - says how many blocks there are
 * @returns {Float32Array[]} (rows * cols,) levels, for each view
 */
export function standingOut(views, { rows, cols }) {
  const given = [rowsOf(views.map(({ data }) => data)), views[0].width, cols];
  return arraysOf(filled("standingOut", given, floatPlane(rows * cols, views.length)));
}
