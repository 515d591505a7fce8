/** Programs of the site that run beside a page. */

import { wrap } from "comlink";
import { addressOf } from "./site.js";

/**
 * Start a worker.
 *
 * @template Functions
 * @param {string} name - of its program
 * @param {(error: Error) => void} failed - is told where the program does not run
 * @returns {import("comlink").Remote<Functions>} the functions of the program
 */
export function startWorker(name, failed) {
  const worker = new Worker(addressOf(name), { type: "module" });
  worker.onerror = (event) => {
    event.preventDefault();
    failed(new Error(event.message || `${name} is missing on the server`));
  };
  return wrap(worker);
}
