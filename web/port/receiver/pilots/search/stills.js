/** The film as it is searched: small frames that are held still by the camera's motion. */

import { Copies } from "../../../image/copies.js";
import { homographyFromCorners, pixelsInOne } from "../../../link/geometry.js";
import { rolled } from "../../locate/quads.js";

/** Frames that are held still, of which quadrilaterals are shown in small views. */
export class Stills {
  /** @type {BytePlane[]} */
  #stills = [];
  /** What views show of the frames, which is looked at coarsely. @type {Copies[]} */
  #copies = [];

  /**
   * @param {number} width - of the frames that will come
   * @param {number} height - of the frames that will come
   */
  constructor(width, height) {
    this.width = width;
    this.height = height;
  }

  /**
   * Take the next frame, aligned with those before.
   *
   * @param {BytePlane} still - is kept
   * @param {BytePlane} [shown] - what views show instead of it; is kept
   */
  add(still, shown = still) {
    this.#stills.push(still);
    this.#copies.push(new Copies(shown));
  }

  /** All frames so far. */
  get frames() {
    return [...this.#stills];
  }

  /**
   * Average all frames so far; what is behind the point is dropped.
   *
   * @returns {BytePlane}
   */
  mean() {
    const { width, height } = this;
    const sums = new Uint32Array(width * height);
    for (const { data } of this.#stills) for (let i = 0; i < sums.length; i++) sums[i] += data[i];
    return { width, height, data: Uint8Array.from(sums, (sum) => sum / this.#stills.length) };
  }

  /**
   * Show what a quadrilateral bounds in frames, in small maps. Frames are averaged down where the
   * maps are coarser, without rounding.
   *
   * @param {Point[][]} quads - pixels of the stills: one for all frames, or one for each of the first
   * @param {number} width - of the small maps
   * @param {number} height - of the small maps
   * @param {number} [turn] - number of quarter turns after which they are upright
   * @param {number} [first] - number of the first frame that is shown
   * @returns {FloatPlane[]}
   */
  views(quads, width, height, turn = 0, first = 0) {
    const factor = Math.floor(pixelsInOne(rolled(quads[0], turn), width, height));
    const [from, end] = quads.length === 1 ? [0, this.#copies.length] : [first, quads.length];
    const ways = quads
      .slice(from)
      .map((quad) => homographyFromCorners(rolled(quad, turn), width, height));
    return this.#copies
      .slice(first, end)
      .map((still, at) => still.sampled(ways[at] ?? ways[0], factor, width, height));
  }
}
