/**
 * The worker that runs the decoders' graphs, beside the worker that looks through the frames.
 *
 * So both load at once, and graphs that nobody needs yet are made ready while the display is still
 * being looked for: all are loaded and run once, one after the other, as a first run takes longer.
 */

import * as ort from "onnxruntime-web/wasm";
import { Decoder } from "../decoder.js";
import { Layout } from "../link/layout.js";
import { addressOf, load } from "./site.js";

/** @import { Plane } from "../image/opencv.js" */
/** @import { DecodingAnswer, DecodingRequest } from "./remoteDecoder.js" */

const scope = /** @type {DedicatedWorkerGlobalScope} */ (/** @type {unknown} */ (self));

/** @type {Decoder[]} */
const decoders = [];

/** Load onnxruntime, and the graph of the first preset. */
async function prepare() {
  ort.env.wasm.wasmPaths = { wasm: addressOf("ort-wasm-simd-threaded.wasm") };
  for (const { model, layout } of await (await load("presets.json")).json()) {
    const graph = new Uint8Array(await (await load(model)).arrayBuffer());
    decoders.push(new Decoder(new Layout(layout), graph));
  }
  await decoders[0].load();
}

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
    work = work.then(() => warm(decoder)).catch(() => {});
    await work;
    await new Promise((resolve) => setTimeout(resolve)); // requests that came meanwhile are next
  }
}

/** @param {DecodingAnswer} answer */
function say(answer) {
  scope.postMessage(answer);
}

/** @param {DecodingRequest} request */
async function answer({ number, preset, pair }) {
  try {
    await decoders[preset].load();
    const scores = pair ? (await decoders[preset].decode(...pair)).scores : null;
    say({ number, scores, reason: null });
  } catch (error) {
    say({ number, scores: null, reason: error instanceof Error ? error.message : String(error) });
  }
}

// one request after another
let work = prepare();
work.then(
  () => {
    say({ number: 0, scores: null, reason: null });
    void warmAll();
  },
  (error) => say({ number: 0, scores: null, reason: error.message ?? String(error) }),
);
scope.onmessage = (/** @type {MessageEvent<DecodingRequest>} */ { data }) => {
  work = work.then(() => answer(data));
};
