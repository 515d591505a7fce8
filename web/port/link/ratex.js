/** Ratex patches: known tiles of gray, of which a rectified frame shows more or less. */

import { ratex } from "../../generated/constants.js";
import { dot } from "./linear.js";

export const { TILES, SAMPLES, STEPS, CLEAR_MATCH } = ratex;

/**
 * How the tiles of each ratex patch look in a frame, beside how they were displayed.
 *
 * @typedef {object} PatchMatch
 * @property {Float64Array} captured - (patches, 16) captured intensity of each tile less the mean
 *   of its patch, gray levels
 * @property {Float64Array} shown - (patches, 16) displayed intensity of each tile less the mean of
 *   its patch, gray levels
 * @property {Uint8Array} label - (patches, 16) 1 where the embedded frame is kappa brighter, else 0
 * @property {Float64Array} correlation - (patches,) correlation of `captured` and `shown`, in
 *   [-1, 1]; 0 where a patch is even
 */

/**
 * Compare the ratex patches of a rectified frame with the patches that were displayed.
 *
 * @param {Plane<Uint8Array>} frame - of any size
 * @param {import("./layout.js").Layout} layout - with at least one patch
 * @returns {PatchMatch}
 */
export function matchPatches(frame, layout) {
  const tiles = TILES * TILES;
  const patches = layout.ratex.length;
  const captured = new Float64Array(patches * tiles);
  const shown = new Float64Array(patches * tiles);
  const label = new Uint8Array(patches * tiles);
  const correlation = new Float64Array(patches);
  layout.ratex.forEach(([row, col], patch) => {
    const ys = samplePositions(row, layout.rows, frame.height);
    const xs = samplePositions(col, layout.cols, frame.width);
    const start = patch * tiles;
    for (let tile = 0; tile < tiles; tile++) {
      const down = (tile >> 2) * SAMPLES;
      const across = (tile & 3) * SAMPLES;
      let sum = 0;
      for (let i = 0; i < SAMPLES; i++) {
        const line = ys[down + i] * frame.width;
        for (let j = 0; j < SAMPLES; j++) sum += frame.data[line + xs[across + j]];
      }
      captured[start + tile] = sum / (SAMPLES * SAMPLES);
      shown[start + tile] = layout.tileLevels[patch][tile];
      label[start + tile] = layout.tileLabels[patch][tile];
    }
    const seen = captured.subarray(start, start + tiles);
    const drawn = shown.subarray(start, start + tiles);
    for (const values of [seen, drawn]) {
      const mean = values.reduce((sum, value) => sum + value) / tiles;
      for (let tile = 0; tile < tiles; tile++) values[tile] -= mean;
    }
    correlation[patch] = dot(seen, drawn) / (Math.sqrt(dot(seen, seen) * dot(drawn, drawn)) + 1e-9);
  });
  return { captured, shown, label, correlation };
}

/**
 * Find the pixels of the samples of a patch along one axis, tile by tile.
 *
 * @param {number} cell - row or column of the patch
 * @param {number} cells - number of rows or columns
 * @param {number} length - pixels of the axis
 * @returns {Int32Array} (TILES * SAMPLES,)
 */
function samplePositions(cell, cells, length) {
  const positions = new Int32Array(TILES * SAMPLES);
  for (let part = 0; part < TILES; part++) {
    const tile = TILES * cell + part;
    const start = Math.ceil((tile * length) / (TILES * cells));
    const stop = Math.ceil(((tile + 1) * length) / (TILES * cells));
    for (let sample = 0; sample < SAMPLES; sample++) {
      const step = 2 * sample + SAMPLES + 1;
      positions[part * SAMPLES + sample] = start + Math.floor((step * (stop - start)) / STEPS);
    }
  }
  return positions;
}
