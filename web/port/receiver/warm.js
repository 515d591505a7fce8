/**
 * Let a receiver read a short film that Python has drawn, before the first frame of a camera.
 *
 * Browsers compile code while it runs: the first frames take many times as long as later ones, and
 * a camera does not wait. So the receiver runs on small frames first, in which a display with pilots
 * is to be found, followed, and decoded (web/host/warm.py).
 */

import { range, scrambled } from "../link/code/scrambled.js";
import { Receiver } from "./receiver.js";

/** @typedef {import("../export/filmGraph.js").Observation} Observation */

/** Frames a second of the film. */
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
 * Read a film until frame pairs are decoded, or until it has taken long enough.
 *
 * @param {WarmFilm} film
 * @param {number} [mostMs] - time after which no frame is read any more, milliseconds
 * @returns {Promise<number>} the number of frame pairs that were decoded
 */
export async function warmUp({ layout, states }, mostMs = Infinity) {
  const end = performance.now() + mostMs;
  const graphs = { film: { decode: guesses }, region: { logOdds: async () => new Float32Array(0) } };
  const receiver = new Receiver([layout], graphs, WARM_FPS);
  for (let state = 0; state < FRAMES && receiver.decoded < DECODED; state++) {
    if (performance.now() >= end) break;
    const [, embedded] = layout.code.statesOf(state >> 1);
    await receiver.push(noisy(states[Number(state === embedded)], state), state / WARM_FPS);
  }
  return receiver.decoded;
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
 * @param {Observation} observation - whose blocks are scored, for each of its frame pairs
 */
async function guesses({ mixture, size: [, , , rows, cols] }) {
  const words = scrambled(range(mixture.count * rows * cols), 0).low;
  return Float32Array.from(words, (word) => (word & 1 ? 4 : -4));
}
