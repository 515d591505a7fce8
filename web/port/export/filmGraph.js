/** The film decoder's ONNX graph, run by onnxruntime-web; one serves all layouts. */

import * as ort from "onnxruntime-web/wasm";
import { openSession } from "./decoder.js";

/**
 * Successive frames of a display whose clock is known, as `FilmWindow` of export/film_graph.py:
 * frames, what they show, and the pilots, one after the other; and the sizes of these arrays,
 * which are frames, height, width, rows and columns.
 *
 * @typedef {object} FilmWindow
 * @property {Float32Array} frames
 * @property {Float32Array} seen
 * @property {Float32Array} known
 * @property {Float64Array} times
 * @property {Float64Array} clock
 * @property {number[]} pairs
 * @property {Float32Array} order
 * @property {[number, number, number, number, number] | number[]} size
 */

/**
 * What a receiver asks of a film decoder: the scores of all blocks of all pairs of a window.
 *
 * @typedef {object} FilmScorer
 * @property {(window: FilmWindow) => Promise<Float32Array>} score
 * @property {() => Promise<void>} [load]
 */

/** The film decoder; its graph is loaded when it is first needed. */
export class FilmGraph {
  /** @type {Promise<ort.InferenceSession> | null} */
  #session = null;

  /** @param {string | Uint8Array} model - address of the graph's file, or its bytes */
  constructor(model) {
    this.model = model;
  }

  /** Load the graph; later calls wait for the same graph. */
  async load() {
    await (this.#session ??= openSession(this.model));
  }

  /** Load the graph and run it once, for a window in which nothing is seen. */
  async warm() {
    const [side, rows, pairs] = [32, 8, [0, 1, 2, 3]];
    const times = Float64Array.from({ length: 8 }, (_, frame) => frame / 30);
    await this.score({
      frames: new Float32Array(times.length * side * side),
      seen: new Float32Array(times.length * rows * rows).fill(1),
      known: new Float32Array(rows * rows).fill(1),
      times,
      clock: Float64Array.of(1 / 30, 0, 0, 0, 1 / 60),
      pairs,
      order: new Float32Array(pairs.length).fill(1),
      size: [times.length, side, side, rows, rows],
    });
  }

  /**
   * Score the blocks of all frame pairs in a window.
   *
   * @param {FilmWindow} window
   * @returns {Promise<Float32Array>} (pairs rows cols,) natural log-likelihood ratios
   */
  async score({ frames, seen, known, times, clock, pairs, order, size }) {
    await this.load();
    const [length, height, width, rows, cols] = size;
    const numbers = BigInt64Array.from(pairs, BigInt);
    const session = /** @type {ort.InferenceSession} */ (await this.#session);
    const { scores } = await session.run({
      frames: new ort.Tensor("float32", frames, [length, 1, height, width]),
      seen: new ort.Tensor("float32", seen, [length, rows, cols]),
      known: new ort.Tensor("float32", known, [rows, cols]),
      times: new ort.Tensor("float64", times, [length]),
      clock: new ort.Tensor("float64", clock, [5]),
      pairs: new ort.Tensor("int64", numbers, [pairs.length]),
      order: new ort.Tensor("float32", order, [pairs.length]),
    });
    const found = /** @type {Float32Array} */ (scores.data);
    if (!found.every(Number.isFinite)) throw new Error("the model returned no valid scores");
    return found;
  }
}
