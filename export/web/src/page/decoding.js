/**
 * The worker that runs the decoders' graphs, beside the worker that looks through the frames.
 *
 * So both load at once, and graphs that nobody needs yet are made ready while the display is still
 * being looked for: all are loaded and run once, one after the other, as a first run takes longer.
 */

import { expose } from "comlink";
import * as ort from "onnxruntime-web/wasm";
import { Decoder } from "../decoder.js";
import { Layout } from "../link/layout.js";
import { inTurn } from "./inTurn.js";
import { addressOf, load } from "./site.js";

/** @import { Plane } from "../image/opencv.js" */

/** @type {Decoder[]} */
const decoders = [];

/** @param {Layout} layout @returns {Plane} something gray */
function grayFrame({ width, height }) {
  return { width, height, data: Uint8Array.from({ length: width * height }, (_, at) => at % 251) };
}

/**
 * Load a graph and run it once.
 *
 * @param {Decoder} decoder
 */
async function warm(decoder) {
  await decoder.decode(grayFrame(decoder.layout), grayFrame(decoder.layout));
}

/** Make all graphs ready, and do meanwhile what is asked for. */
async function warmAll() {
  for (const decoder of decoders) {
    // what fails here fails again, and is told, when the graph is needed
    await inTurn(() => warm(decoder)).catch(() => {});
    await new Promise((resolve) => setTimeout(resolve)); // requests that came meanwhile are next
  }
}

/** What the worker does for another one. @typedef {typeof functions} Decoding */
const functions = {
  /** Load onnxruntime, and the graph of the first preset. */
  async prepare() {
    ort.env.wasm.wasmPaths = { wasm: addressOf("ort-wasm-simd-threaded.wasm") };
    for (const { model, layout } of await (await load("presets.json")).json()) {
      const graph = new Uint8Array(await (await load(model)).arrayBuffer());
      decoders.push(new Decoder(new Layout(layout), graph));
    }
    await decoders[0].load();
    void warmAll();
  },

  /** @param {number} preset - whose graph is loaded, unless it is there */
  load: (preset) => inTurn(() => decoders[preset].load()),

  /**
   * Decode a frame pair.
   *
   * @param {number} preset
   * @param {Plane} original - rectified
   * @param {Plane} embedded - rectified
   * @returns {Promise<Float32Array>} (nBits,) scores
   */
  decode: (preset, original, embedded) =>
    inTurn(async () => (await decoders[preset].decode(original, embedded)).scores),
};
expose(functions);
