/**
 * The worker that runs the film decoder's graph, beside the worker that looks through the frames.
 *
 * So both load at once. The graph is run once beforehand, as a first run takes longer.
 */

import { expose } from "comlink";
import * as ort from "onnxruntime-web/wasm";
import { FilmGraph } from "../port/export/filmGraph.js";
import { inTurn } from "./inTurn.js";
import { addressOf, load } from "./site.js";

/** @import { Observation } from "../port/export/filmGraph.js" */

/** The film decoder, once the graph is there. @type {FilmGraph | null} */
let film = null;

/** Functions of this worker that another worker may call. @typedef {typeof functions} Decoding */
const functions = {
  /** Load onnxruntime with the film decoder. */
  prepare: () =>
    inTurn(async () => {
      ort.env.wasm.wasmPaths = { mjs: addressOf("ort.js"), wasm: addressOf("ort.wasm") };
      film = new FilmGraph(new Uint8Array(await (await load("models/film.onnx")).arrayBuffer()));
      await film.warm();
    }),

  /** Load the film decoder's graph, unless it is there. */
  load: () => inTurn(() => film?.load()),

  /**
   * Score the frame pairs of a window of film.
   *
   * @param {Observation} observation
   * @returns {Promise<Float32Array>}
   */
  decode: (observation) =>
    inTurn(() => {
      if (film === null) throw new Error("the film decoder is not loaded yet");
      return film.decode(observation);
    }),
};
expose(functions);
