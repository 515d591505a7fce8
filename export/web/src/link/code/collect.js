/**
 * The collector turns scores of frames, in the order they were seen, into their loop's message.
 *
 * Coarse and fine grids are framed in different ways, and the number of message blocks of a frame
 * says in which (`framing.js`). So there is a collector for each, and this one hands over to it.
 */

import { CoarseCollector } from "./collectCoarse.js";
import { FineCollector } from "./collectFine.js";
import { isFine } from "./framing.js";

/** @typedef {import("./message.js").Message} Message */

/**
 * Collects frames until the message is whole, and then until another one is.
 *
 * A message is returned once. It is returned again only after another one was.
 */
export class Collector {
  /**
   * @param {number} nBits - message blocks of a frame; an `InputError` is thrown where they are too
   *   few for a signature
   */
  constructor(nBits) {
    this._collector = isFine(nBits) ? new FineCollector(nBits) : new CoarseCollector(nBits);
  }

  /**
   * Information received, as a share of what is needed: about 1 when the message is whole.
   *
   * It is 1 while the display goes on showing a message that was returned.
   */
  get progress() {
    return this._collector.progress;
  }

  /** Number of times that decoding was tried. */
  get attempts() {
    return this._collector.attempts;
  }

  /** Whether scores are kept that may be those of a message not returned yet. */
  get collecting() {
    return this._collector.collecting;
  }

  /** Say that the next frame's distance to the earlier ones is not known. */
  startRun() {
    this._collector.startRun();
  }

  /**
   * Add one frame, and try to decode.
   *
   * @param {ArrayLike<number>} scores - (nBits) log-likelihood ratios, positive for 1; 0 for an
   *   erasure
   * @param {number} count - number of the frame on the display, from any start; rising within a run
   * @returns {Message | null} the message where it is whole now and not the one that was returned
   *   last
   */
  add(scores, count) {
    return this._collector.add(scores, count);
  }
}
