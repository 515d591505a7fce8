/**
 * Let a receiver read short films that Python has drawn, before the first frame of a camera.
 *
 * Browsers compile code while it runs: the first frames take many times as long as later ones, and
 * a camera does not wait. So all parts of the receiver run on small frames first, in which a
 * display of each kind, with patches and with pilots, is to be found, followed, and decoded
 * (export/web/warm.py).
 */

import { range, scrambled } from "../link/code/scrambled.js";
import { Receiver } from "./receiver.js";

/** Frames a second of the films. */
const WARM_FPS = 30;
/** Number of frame pairs that are decoded, and largest number of frames until then. */
const [DECODED, FRAMES] = [2, 60];
/** Largest noise of a pixel, in gray levels. */
const NOISE = 3;

/**
 * A film: what its display shows, and the frames of the display's two states without noise.
 *
 * @typedef {{ layout: Layout, states: BytePlane[] }} WarmFilm
 */

/**
 * Read films, each until frame pairs are decoded, or until it has taken long enough.
 *
 * @param {readonly WarmFilm[]} films
 * @param {number} [mostMs] - time that all have, in equal parts, milliseconds
 * @returns {Promise<number>} the number of frame pairs that were decoded
 */
export async function warmUp(films, mostMs = Infinity) {
  const start = performance.now();
  let decoded = 0;
  for (const [number, { layout, states }] of films.entries()) {
    const end = start + (mostMs * (number + 1)) / films.length;
    const receiver = new Receiver([{ layout, decode: async () => guesses(layout) }], WARM_FPS);
    for (let frame = 0; frame < FRAMES && receiver.decoded < DECODED; frame++) {
      if (performance.now() >= end) break;
      const state = layout.code.isPlain ? frame >> 1 : frame; // codes run at known rates alone
      const [, embedded] = layout.code.statesOf(state >> 1);
      const shown = states[Number(state === embedded)];
      await receiver.push(noisy(shown, frame), frame / WARM_FPS);
    }
    decoded += receiver.decoded;
  }
  return decoded;
}

/**
 * Add noise to a frame.
 *
 * @param {BytePlane} state
 * @param {number} frame - number of the frame, of which each has its own noise
 */
function noisy({ width, height, data }, frame) {
  const words = Array.from(scrambled(range(997), frame).low);
  const noise = words.map((word) => (word % (2 * NOISE + 1)) - NOISE);
  return { width, height, data: data.map((level, at) => level + noise[at % noise.length]) };
}

/**
 * Say scores of bits that were drawn, so that no message comes of them.
 *
 * @param {Layout} layout
 */
function guesses({ nBits }) {
  const words = scrambled(range(nBits), 0).low;
  return { scores: Float32Array.from(words, (word) => (word & 1 ? 4 : -4)) };
}
