/**
 * The worker that runs the decoders' graphs, beside the worker that looks through the frames.
 *
 * So both load at once, and graphs that nobody needs yet are made ready while the display is still
 * being looked for: all are loaded and run once, one after the other, as a first run takes longer.
 */

import { expose } from "comlink";
import * as ort from "onnxruntime-web/wasm";
import { Decoder } from "../decoder.js";
import { FilmGraph } from "../filmGraph.js";
import { Layout } from "../link/layout.js";
import { inTurn } from "./inTurn.js";
import { addressOf, load } from "./site.js";

/** @import { FilmWindow } from "../filmGraph.js" */

/** @type {Decoder[]} */
const decoders = [];
/** The film decoder, once the graph is there. @type {FilmGraph | null} */
let film = null;

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
  await inTurn(() => film?.warm()).catch(() => {});
}

/** What the worker does for another one. @typedef {typeof functions} Decoding */
const functions = {
  /** Load onnxruntime, and the graph of the first preset. */
  prepare: () =>
    inTurn(async () => {
      ort.env.wasm.wasmPaths = { mjs: addressOf("ort.js"), wasm: addressOf("ort.wasm") };
      for (const { model, layout } of await (await load("presets.json")).json()) {
        const graph = new Uint8Array(await (await load(model)).arrayBuffer());
        decoders.push(new Decoder(new Layout(layout), graph));
      }
      film = new FilmGraph(new Uint8Array(await (await load("models/film.onnx")).arrayBuffer()));
      await decoders[0].load();
      void warmAll();
    }),

  /** @param {number} preset - whose graph is loaded, unless it is there */
  load: (preset) => inTurn(() => decoders[preset].load()),

  /** Load the film decoder's graph, unless it is there. */
  loadFilm: () => inTurn(() => film?.load()),

  /**
   * Score the frame pairs of a window of film.
   *
   * @param {FilmWindow} window
   * @returns {Promise<Float32Array>}
   */
  score: (window) =>
    inTurn(() => {
      if (film === null) throw new Error("the film decoder is not loaded yet");
      return film.score(window);
    }),

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
