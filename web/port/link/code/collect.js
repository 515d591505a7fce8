/**
 * The collector turns scores of frames, in the order they were seen, into their loop's message.
 *
 * Coarse and fine grids are framed in different ways, and the number of message blocks of a frame
 * says in which (`framing.js`). So there is a collector for each.
 */

import { CoarseCollector } from "./collectCoarse.js";
import { FineCollector } from "./collectFine.js";
import { isFine } from "./framing.js";

/**
 * Collects frames until the message is whole, and then until another one is.
 *
 * A message is returned once. It is returned again only after another one was. `add` takes the
 * scores of a frame (log-likelihood ratios, positive for 1; 0 for an erasure) and its number on the
 * display, from any start and rising within a run; it returns the message, or null. `startRun` says
 * that the next frame's distance to the earlier ones is not known. `progress` is the information
 * received, as a share of what is needed: about 1 when the message is whole, and 1 while the
 * display goes on showing a message that was returned. Decoding a long message takes as long as
 * several camera frames: `add` takes a number of units of work after which it leaves decoding to
 * `goOn`, and `decoding` says whether there is any to go on with.
 *
 * @typedef {CoarseCollector | FineCollector} Collector
 */

/**
 * Make the collector for frames of a number of message blocks.
 *
 * @param {number} nBits - message blocks of a frame; an `InputError` is thrown where they are too
 *   few for a signature
 * @returns {Collector}
 */
export function makeCollector(nBits) {
  return isFine(nBits) ? new FineCollector(nBits) : new CoarseCollector(nBits);
}
