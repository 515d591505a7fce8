/**
 * The decoder's ONNX graph, run by onnxruntime-web: plain wasm, one thread.
 *
 * Graphs come with the page, so nothing here guards against a stranger's graph as
 * export/runtime.py does. Where onnxruntime's wasm files lie is set by the page (`ort.env.wasm`).
 */

import * as ort from "onnxruntime-web/wasm";

ort.env.wasm.numThreads = 1;

/**
 * Open a graph.
 *
 * @param {string | Uint8Array} model - address of the graph's file, or its bytes
 * @returns {Promise<ort.InferenceSession>}
 */
export function openSession(model) {
  return ort.InferenceSession.create(/** @type {string} */ (model), {
    executionProviders: ["wasm"],
    graphOptimizationLevel: "basic", // more takes longer to load, and runs no faster in wasm
    logSeverityLevel: 3, // no warnings, which browsers show as errors
  });
}

/**
 * What a decoder says of a frame pair: a score for each message bit, row by row, positive for 1,
 * and the weights that it fitted to the pair.
 *
 * @typedef {{ scores: Float32Array, head: Float32Array }} SoftBits
 */

/** A decoder of one layout; its graph is loaded when it is first needed. */
export class Decoder {
  /** @type {Promise<ort.InferenceSession> | null} */
  #session = null;
  /** Room for the three channels of both frames. */
  #room = [new Uint8Array(0), new Uint8Array(0)];

  /**
   * @param {Layout} layout - that the graph decodes
   * @param {string | Uint8Array} model - address of the graph's file, or its bytes
   */
  constructor(layout, model) {
    this.layout = layout;
    this.model = model;
  }

  /**
   * Load the graph, which takes a second or more; later calls wait for the same graph.
   *
   * @returns {Promise<void>} rejected where the graph cannot be read, or is of another layout
   */
  async load() {
    await this.#loaded();
  }

  #loaded() {
    this.#session ??= this.#create().catch((error) => {
      this.#session = null; // the next call tries again
      throw error;
    });
    return this.#session;
  }

  async #create() {
    const session = await openSession(this.model);
    const scores = session.outputMetadata.find((output) => output.name === "scores");
    const count = scores?.isTensor ? scores.shape.at(-1) : undefined;
    if (count !== this.layout.nBits) {
      await session.release();
      const needed = `${this.layout.nBits} scores of its layout`;
      throw new Error(`the model gives ${count} scores where the page expects the ${needed}`);
    }
    return session;
  }

  /**
   * Decode one frame pair.
   *
   * @param {BytePlane} original - rectified: the displayed picture fills it, at any size
   * @param {BytePlane} embedded - of the size of `original`
   * @returns {Promise<SoftBits>} (nBits,) scores
   */
  async decode(original, embedded) {
    const { width, height } = original;
    if (embedded.width !== width || embedded.height !== height) {
      throw new Error("the frames of a pair must have one size");
    }
    const session = await this.#loaded();
    const [first, second] = [original, embedded].map(({ data }, which) => {
      if (this.#room[which].length !== 3 * data.length) {
        this.#room[which] = new Uint8Array(3 * data.length);
      }
      const channels = this.#room[which];
      for (let channel = 0; channel < 3; channel++) channels.set(data, channel * data.length);
      return new ort.Tensor("uint8", channels, [1, 3, height, width]);
    });
    const results = await session.run({ original: first, embedded: second });
    const scores = /** @type {Float32Array} */ (results.scores.data);
    const head = /** @type {Float32Array} */ (results.head.data);
    if (scores.length !== this.layout.nBits || !scores.every(Number.isFinite)) {
      throw new Error("the model returned no valid scores");
    }
    return { scores, head };
  }
}
