/** The worker of live.js: loads the package, and reads the frames that it is sent. */

import { InputError } from "./errors.js";
import { load, Receiver } from "./index.js";

/** @type {Receiver} */
let receiver;

/**
 * Functions that the page may call, by their names.
 * @type {Record<string, (...given: any[]) => unknown>}
 */
const functions = {
  async start(fps, options, folder) {
    await load(folder);
    receiver = new Receiver(fps, options);
  },
  push: (frame, time) => receiver.push(frame, time),
  finish: () => receiver.finish(),
  explanation: () => receiver.explanation,
};

/** Ends when all that was asked for is answered, in the order in which it was. */
let last = Promise.resolve();
self.onmessage = ({ data }) => void (last = last.then(() => answer(data)));

/** @param {{ name: string, given: any[] }} asked */
async function answer({ name, given }) {
  try {
    self.postMessage({ result: await functions[name](...given) });
  } catch (error) {
    const code = error instanceof InputError ? error.code : "failed";
    self.postMessage({ error: { code, message: error instanceof Error ? error.message : String(error) } });
  }
}
