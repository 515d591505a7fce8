/**
 * A decoder's ONNX graph, run by onnxruntime-web: plain wasm, one thread.
 *
 * Graphs come with the page, so nothing here guards against a stranger's graph as export/runtime.py
 * does. Where onnxruntime's wasm files lie is set by the page (`ort.env.wasm`).
 */

import * as ort from "onnxruntime-web/wasm";

ort.env.wasm.numThreads = 1;

/** A graph, which is loaded when it is first needed. */
export class Graph {
  /** @type {Promise<ort.InferenceSession> | null} */
  #session = null;

  /** @param {string | Uint8Array} model - address of the graph's file, or its bytes */
  constructor(model) {
    this.model = model;
  }

  /** Load the graph; later calls wait for the same graph. */
  async load() {
    this.#session ??= ort.InferenceSession.create(/** @type {string} */ (this.model), {
      executionProviders: ["wasm"],
      graphOptimizationLevel: "basic", // more takes longer to load, and runs no faster in wasm
      logSeverityLevel: 3, // no warnings, which browsers show as errors
    });
    await this.#session;
  }

  /**
   * Run the graph, which is loaded where it is not there yet.
   *
   * @param {Record<string, ort.Tensor>} inputs
   * @param {string} output - name of what is wanted
   * @returns {Promise<Float32Array>} rejected where a number of it is not finite
   */
  async run(inputs, output) {
    await this.load();
    const session = /** @type {ort.InferenceSession} */ (await this.#session);
    const found = /** @type {Float32Array} */ ((await session.run(inputs))[output].data);
    if (!found.every(Number.isFinite)) throw new Error(`the model returned no valid ${output}`);
    return found;
  }
}
