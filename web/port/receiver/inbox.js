/** The inbox delivers a message that arrived whole, or refuses it and says why. */

import { unchecked } from "../link/code/authenticate.js";
import { equalBytes } from "../link/code/bits.js";
import { Message } from "../link/code/message.js";

/** @typedef {import("../link/code/authenticate.js").Verifier} Verifier */

/**
 * A message that was judged: without stamp and tag where they fit or nobody has a key; the stamp, or
 * null where there is none that counts; why it is not delivered, or null where it is; and whether it
 * is authentic but too old, as it is where a recording is shown again.
 *
 * @typedef {object} Delivery
 * @property {Message} message
 * @property {number | null} stamp
 * @property {string | null} refused
 * @property {boolean} stale
 */

/** Decides which messages are delivered, and counts the others. */
export class Inbox {
  #verifier;

  /** @param {Verifier | null} verifier - decides; null where all messages are delivered */
  constructor(verifier) {
    this.#verifier = verifier;
    /** The message that was delivered last. @type {Message | null} */
    this.last = null;
    /** Number of messages that were refused. */
    this.refused = 0;
  }

  /**
   * Deliver a message, or say why not.
   *
   * @param {Message} message - as the receiver returned it
   * @param {number} now - seconds since 1970
   * @returns {Delivery}
   */
  take(message, now) {
    const judged = this.#verifier?.judge(message.data, now) ?? null;
    const signed = judged?.signed ?? null;
    let { data, changed } = message;
    if (signed !== null) {
      data = signed.data;
      changed = this.last !== null && !equalBytes(this.last.data, data);
    } else if (this.#verifier === null && message.signed) data = unchecked(data);
    const { frames, seen, agreement } = message;
    const taken = new Message(data, frames, seen, agreement, changed, message.signed);
    const refused = judged?.refused ?? null;
    if (refused === null) this.last = taken;
    else this.refused += 1;
    const stale = judged?.stale ?? false;
    return { message: taken, stamp: signed?.stamp ?? null, refused, stale };
  }
}
