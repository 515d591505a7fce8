/** Frame pairs that each exposure of a film mixes, and their shares, as in link/observation.py. */

import { observation } from "../../generated/constants.js";

const { SLOTS } = observation;

/**
 * Which frame pairs each exposure mixes, and in which shares.
 *
 * @typedef {object} Mixture
 * @property {number} slots - S, as many as exposures are long, 2 to `SLOTS`
 * @property {Float32Array} shares - (T, S, rows, cols) half differences of the shares that the
 *   embedded and the original state of a frame pair have of an exposure, in [-1/2, 1/2]; 0 in slots
 *   that no pair fills
 * @property {BigInt64Array} pair - (T, S) place among the pairs of the one that fills each slot of
 *   a frame; -1 for none
 * @property {number} count - of frame pairs
 */

/**
 * Work out the share that a state has of an exposure.
 *
 * @param {number} begin - by how many states' time the exposure begins after the state does
 * @param {number} length - duration of the exposure, in states
 */
function exposureShare(begin, length) {
  const inside = Math.min(begin + length, 1) - Math.max(begin, 0);
  return Math.min(Math.max(inside / length, 0), 1);
}

/**
 * Work out what each exposure of a film mixes.
 *
 * @param {DisplayClock} clock - says when the display shows which state
 * @param {readonly number[]} times - of the frames, seconds
 * @param {Layout} layout - grid of the blocks, and the code that orders the states of frame pairs
 * @param {number} first - number of the first frame pair that is asked for
 * @param {number} count - number of frame pairs that are asked for
 * @returns {Mixture}
 */
export function mixtureOfExposures(clock, times, { rows, cols, code }, first, count) {
  const blocks = rows * cols;
  const length = clock.shutter / clock.period;
  const longest = (clock.latest - clock.earliest) / (2 * clock.period);
  const slots = Math.min(Math.floor(longest) + 2, SLOTS);
  const shares = new Float32Array(times.length * slots * blocks);
  const pair = new BigInt64Array(times.length * slots).fill(-1n);
  const delays = Float64Array.from({ length: blocks }, (_, at) => {
    const delayX = (clock.delayX * (2 * (at % cols) + 1)) / (2 * cols);
    return delayX + (clock.delayY * (2 * Math.floor(at / cols) + 1)) / (2 * rows);
  });
  times.forEach((time, frame) => {
    const begins = delays.map((delay) => (time + delay - clock.start) / clock.period);
    const earliest = Math.floor(begins.reduce((least, begin) => Math.min(least, begin)) / 2);
    const end = begins.reduce((most, begin) => Math.max(most, begin)) + length;
    for (let slot = 0; slot < slots; slot++) {
      const number = earliest + slot;
      if (number < first || number >= first + count) continue;
      pair[frame * slots + slot] = BigInt(number - first);
      if (2 * number >= end) continue;
      const way = code.sign(number) / 2;
      const from = (frame * slots + slot) * blocks;
      for (let at = 0; at < blocks; at++) {
        const since = begins[at] - 2 * number;
        shares[from + at] = way * (exposureShare(since - 1, length) - exposureShare(since, length));
      }
    }
  });
  return { slots, shares, pair, count };
}
