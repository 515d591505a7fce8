/** The worker that makes loops, which may take seconds. */

import { expose } from "comlink";
import { sign } from "../port/link/code/authenticate.js";
import { makeLoop } from "../port/sender/loop.js";

/** @import { Picture } from "../port/link/strength.js" */
/** @import { SendPreset } from "../port/sender/loop.js" */

/** What the worker does for the page. @typedef {typeof functions} Sending */
const functions = {
  /**
   * Make a loop.
   *
   * @param {SendPreset} preset
   * @param {Uint8Array} message
   * @param {{ key: Uint8Array, stamp: number } | null} signature - what signs it, or null
   * @param {Picture} picture
   */
  make(preset, message, signature, picture) {
    const data = signature ? sign(message, signature.key, signature.stamp) : message;
    return makeLoop(preset, { data, signed: signature !== null }, picture);
  },
};
expose(functions);
