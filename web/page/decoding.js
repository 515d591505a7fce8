/**
 * The worker that runs the decoders' graphs, beside the worker that looks through the frames.
 *
 * So both load at once. The film decoder, which most presets need, is run once beforehand, as a
 * first run takes longer; the graphs of frame pairs are made ready when they are first needed.
 */

import { expose } from "comlink";
import * as ort from "onnxruntime-web/wasm";
import { Decoder } from "../port/export/decoder.js";
import { FilmGraph } from "../port/export/filmGraph.js";
import { Layout } from "../port/link/layout.js";
import { inTurn } from "./inTurn.js";
import { addressOf, checkVersion, load } from "./site.js";

/** @import { Observation } from "../port/export/filmGraph.js" */

/** @type {Decoder[]} */
const decoders = [];
/** The film decoder, once the graph is there. @type {FilmGraph | null} */
let film = null;

/** What the worker does for another one. @typedef {typeof functions} Decoding */
const functions = {
  /** Load onnxruntime with the film decoder; the other graphs' files are loaded with them. */
  prepare: () =>
    inTurn(async () => {
      ort.env.wasm.wasmPaths = { mjs: addressOf("ort.js"), wasm: addressOf("ort.wasm") };
      film = new FilmGraph(new Uint8Array(await (await load("models/film.onnx")).arrayBuffer()));
      await film.warm();
      for (const { model, layout } of await (await load("presets.json")).json()) {
        decoders.push(new Decoder(new Layout(layout), addressOf(model)));
      }
    }),

  /** @param {number} preset - whose graph is loaded, unless it is there */
  load: (preset) =>
    inTurn(async () => {
      await checkVersion();
      await decoders[preset].load();
    }),

  /** Load the film decoder's graph, unless it is there. */
  loadFilm: () => inTurn(() => film?.load()),

  /**
   * Score the frame pairs of a window of film.
   *
   * @param {Observation} observation
   * @returns {Promise<Float32Array>}
   */
  decodeFilm: (observation) =>
    inTurn(() => {
      if (film === null) throw new Error("the film decoder is not loaded yet");
      return film.decode(observation);
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
