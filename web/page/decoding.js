/**
 * The worker that runs the graphs, beside the worker that looks through the frames.
 *
 * So both load at once. Each graph is run once beforehand, as a first run takes longer.
 */

import { expose } from "comlink";
import * as ort from "onnxruntime-web/wasm";
import { FilmGraph } from "../port/export/filmGraph.js";
import { RegionGraph } from "../port/export/regionGraph.js";
import { inTurn } from "./inTurn.js";
import { addressOf, load } from "./site.js";

/** @import { Observation } from "../port/export/filmGraph.js" */

/** The graphs, once they are there. @type {{ film: FilmGraph, region: RegionGraph } | null} */
let graphs = null;

/**
 * Run a graph after all that was asked for before.
 *
 * @template Result
 * @param {(loaded: { film: FilmGraph, region: RegionGraph }) => Promise<Result>} task
 */
function withGraphs(task) {
  return inTurn(() => {
    if (graphs === null) throw new Error("the graphs are not loaded yet");
    return task(graphs);
  });
}

/** @param {string} name @returns {Promise<Uint8Array>} the file of a graph */
async function fileOf(name) {
  return new Uint8Array(await (await load(`models/${name}.onnx`)).arrayBuffer());
}

/** Functions of this worker that another worker may call. @typedef {typeof functions} Decoding */
const functions = {
  /** Load onnxruntime with the graphs. */
  prepare: () =>
    inTurn(async () => {
      ort.env.wasm.wasmPaths = { mjs: addressOf("ort.js"), wasm: addressOf("ort.wasm") };
      const [film, region] = await Promise.all(["film", "region"].map(fileOf));
      graphs = { film: new FilmGraph(film), region: new RegionGraph(region) };
      await graphs.film.warm();
      await graphs.region.warm();
    }),

  /** Load the film decoder's graph, unless it is there. */
  load: () => withGraphs(({ film }) => film.load()),

  /**
   * Score the frame pairs of a window of film.
   *
   * @param {Observation} observation
   * @returns {Promise<Float32Array>}
   */
  decode: (observation) => withGraphs(({ film }) => film.decode(observation)),

  /**
   * Map where a display toggles.
   *
   * @param {BytePlane[]} stills
   * @returns {Promise<Float32Array>}
   */
  logOdds: (stills) => withGraphs(({ region }) => region.logOdds(stills)),
};
expose(functions);
