/** How well each part of a display matches what should toggle there, wherever it is shifted to. */

import { call } from "../../image/opencv.js";

/**
 * Amplitudes at one frequency: real and imaginary part of each pixel of a map.
 *
 * @typedef {{ width: number, height: number, real: Float32Array, imaginary: Float32Array }}
 *   Amplitudes
 */

/**
 * Matches of one part for shifts from -reach to reach along y and, faster, along x: of the real
 * part of amplitudes, and of the imaginary part.
 *
 * @typedef {{ real: Float32Array, imaginary: Float32Array }} Matches
 */

/**
 * Match each part of a map.
 *
 * @param {Amplitudes} change
 * @param {ArrayLike<number>} blocks - (rows * cols,) what is expected of each block
 * @param {number} rows
 * @param {number} cols
 * @param {number[]} ys - the rows of the map at which parts begin and end
 * @param {number[]} xs - the columns of the map at which parts begin and end
 * @param {[number, number]} reach - largest shift along x and along y, pixels
 * @returns {Matches[]} of each part, from the top left on, row by row
 */
export function matchParts(change, blocks, rows, cols, ys, xs, reach) {
  const { width, height } = change;
  const expected = { width: cols, height: rows, data: Float32Array.from(blocks) };
  const parts = [Int32Array.from(ys), Int32Array.from(xs)];
  const each = (2 * reach[0] + 1) * (2 * reach[1] + 1);
  const [real, imaginary] = [change.real, change.imaginary].map((data) => {
    const matches = new Float32Array((ys.length - 1) * (xs.length - 1) * each);
    if (data.every((value) => value === 0)) return matches;
    call("matchParts", [{ width, height, data }, expected, ...parts, ...reach], [matches]);
    return matches;
  });
  return Array.from({ length: real.length / each }, (_, part) => {
    const [start, end] = [part * each, (part + 1) * each];
    return { real: real.subarray(start, end), imaginary: imaginary.subarray(start, end) };
  });
}
