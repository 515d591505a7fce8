/** The film decoder's graph (models/film/decoder.py). It serves all layouts. */

import * as ort from "onnxruntime-web/wasm";
import { Graph } from "./graph.js";

/** @typedef {import("../link/observation.js").Mixture} Mixture */

/**
 * A window of film, as `Observation` of link/observation.py: frames, what they show, the pilots, and
 * what each exposure mixes; and the sizes of these arrays, which are frames, height, width, rows and
 * columns.
 *
 * @typedef {object} Observation
 * @property {Float32Array} frames
 * @property {Float32Array} seen
 * @property {Float32Array} known
 * @property {Mixture} mixture
 * @property {[number, number, number, number, number] | number[]} size
 */

/**
 * What a receiver asks of a film decoder: the scores of all blocks of all pairs of a window.
 *
 * @typedef {object} WindowDecoder
 * @property {(observation: Observation) => Promise<Float32Array>} decode
 * @property {() => Promise<void>} [load]
 */

/** The film decoder. */
export class FilmGraph extends Graph {
  /** Load the graph and run it once, for a window in which nothing is seen. */
  async warm() {
    const [length, slots, side, rows] = [8, 2, 32, 8];
    await this.decode({
      frames: new Float32Array(length * side * side),
      seen: new Float32Array(length * rows * rows).fill(1),
      known: new Float32Array(rows * rows).fill(1),
      mixture: {
        slots,
        shares: new Float32Array(length * slots * rows * rows),
        pair: new BigInt64Array(length * slots).fill(-1n),
        count: length / 2,
      },
      size: [length, side, side, rows, rows],
    });
  }

  /**
   * Score the blocks of all frame pairs in a window.
   *
   * @param {Observation} observation
   * @returns {Promise<Float32Array>} (pairs rows cols,) natural log-likelihood ratios
   */
  async decode({ frames, seen, known, mixture, size }) {
    const [length, height, width, rows, cols] = size;
    const { slots, shares, pair, count } = mixture;
    const pairs = BigInt64Array.from({ length: count }, (_, number) => BigInt(number));
    const inputs = {
      frames: new ort.Tensor("float32", frames, [length, 1, height, width]),
      seen: new ort.Tensor("float32", seen, [length, rows, cols]),
      known: new ort.Tensor("float32", known, [rows, cols]),
      shares: new ort.Tensor("float32", shares, [length, slots, rows, cols]),
      pair: new ort.Tensor("int64", pair, [length, slots]),
      pairs: new ort.Tensor("int64", pairs, [count]),
    };
    return this.run(inputs, "scores");
  }
}
