/** The graphs, which run in another worker (decoding.js). */

import { wrap } from "comlink";

/** @import { Remote } from "comlink" */
/** @import { Decoding } from "./decoding.js" */

/**
 * Start the worker that runs the graphs.
 *
 * @param {string} address - of its program
 * @returns {{ decoding: Remote<Decoding>, ready: Promise<void> }} what runs the graphs, and what
 *   resolves when it can do so and is rejected where it never will
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
