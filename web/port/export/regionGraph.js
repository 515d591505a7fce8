/** The graph that maps where displays toggle (models/region/region.py). */

import * as ort from "onnxruntime-web/wasm";
import { Graph } from "./graph.js";

/**
 * What a search asks for a map of where displays toggle.
 *
 * @typedef {object} RegionMapper
 * @property {(stills: BytePlane[]) => Promise<Float32Array>} logOdds
 */

/** Maps where displays toggle. */
export class RegionGraph extends Graph {
  /** Load the graph and run it once, for frames in which nothing is seen. */
  async warm() {
    const [width, height] = [640, 360];
    const black = { width, height, data: new Uint8Array(width * height) };
    await this.logOdds([black, black, black]);
  }

  /**
   * Map where a display toggles.
   *
   * @param {BytePlane[]} stills - at least three frames of one size, held still, no side of which is
   *   shorter than `LEAST_PX` of models/region
   * @returns {Promise<Float32Array>} natural log-odds of cells of 8 x 8 pixels, row by row
   */
  async logOdds(stills) {
    const [{ width, height }] = stills;
    const frames = new Float32Array(stills.length * width * height);
    stills.forEach(({ data }, number) => frames.set(data, number * width * height));
    const shape = [stills.length, 1, height, width];
    return this.run({ frames: new ort.Tensor("float32", frames, shape) }, "log_odds");
  }
}
