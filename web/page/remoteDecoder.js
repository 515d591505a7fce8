/** Decoders whose graphs run in another worker (decoding.js). */

import { wrap } from "comlink";

/** @import { Remote } from "comlink" */
/** @import { Layout } from "../port/link/layout.js" */
/** @import { Decoding } from "./decoding.js" */

/**
 * Start the worker that runs the graphs.
 *
 * @param {string} address - of its program
 * @returns {{ decoding: Remote<Decoding>, ready: Promise<void> }} its functions, and what resolves
 *   when it can decode and is rejected where it never will
 */
export function startDecoding(address) {
  const worker = new Worker(address, { type: "module" });
  /** @type {Remote<Decoding>} */
  const decoding = wrap(worker);
  const ready = new Promise((resolve, reject) => {
    worker.onerror = (event) => {
      event.preventDefault();
      reject(new Error(event.message || "the decoder's program could not be loaded"));
    };
    decoding.prepare().then(resolve, reject);
  });
  return { decoding, ready };
}

/** A decoder of one layout, as a `Decoder` (../decoder.js). */
export class RemoteDecoder {
  /**
   * @param {Layout} layout - that it decodes
   * @param {number} preset - number of the preset in presets.json
   * @param {Remote<Decoding>} decoding - functions of the worker
   */
  constructor(layout, preset, decoding) {
    this.layout = layout;
    this.preset = preset;
    this.decoding = decoding;
  }

  /** Load the graph, unless it is there. */
  async load() {
    await this.decoding.load(this.preset);
  }

  /**
   * Decode one frame pair.
   *
   * @param {Plane} original - rectified: the displayed picture fills it
   * @param {Plane} embedded - of the size of `original`
   * @returns {Promise<{ scores: Float32Array }>} (nBits,) scores
   */
  async decode(original, embedded) {
    return { scores: await this.decoding.decode(this.preset, original, embedded) };
  }
}

/**
 * Make a film decoder whose graph runs in another worker.
 *
 * @param {Remote<Decoding>} decoding - functions of the worker
 * @returns {import("../port/export/filmGraph.js").WindowDecoder}
 */
export function remoteFilm(decoding) {
  return {
    load: () => decoding.loadFilm(),
    decode: (observation) => decoding.decodeFilm(observation),
  };
}
