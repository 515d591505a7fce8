/** The worker that makes loops, which may take seconds. */

import { expose } from "comlink";
import { sign } from "../port/link/code/authenticate.js";
import { makeFilmLoop, makeLoop } from "../port/sender/loop.js";

/** @import { Picture } from "../port/link/strength.js" */
/** @import { SendPreset } from "../port/sender/loop.js" */

/** @typedef {{ key: Uint8Array, stamp: number } | null} Signature */

/** Functions of this worker that the page may call. @typedef {typeof functions} Sending */
const functions = {
  /**
   * Make a loop.
   *
   * @param {SendPreset} preset
   * @param {Uint8Array} message
   * @param {Signature} signature - what signs it, or null
   * @param {Picture} picture
   */
  make: (preset, message, signature, picture) =>
    makeLoop(preset, contentOf(message, signature), picture),
  /**
   * Make a loop over a film.
   *
   * @param {SendPreset} preset
   * @param {Uint8Array} message
   * @param {Signature} signature - what signs it, or null
   * @param {{ size: number[], shown: number[] }} film - as `makeFilmLoop` takes it
   */
  makeOverFilm: (preset, message, signature, film) =>
    makeFilmLoop(preset, contentOf(message, signature), film),
};
/** @param {Uint8Array} message @param {Signature} signature */
function contentOf(message, signature) {
  const data = signature ? sign(message, signature.key, signature.stamp) : message;
  return { data, signed: signature !== null };
}
expose(functions);
