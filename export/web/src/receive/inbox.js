/** What becomes of a message that arrived whole: it is delivered, or refused and said why. */

import { equalBytes } from "../link/code/bits.js";
import { Message } from "../link/code/message.js";

/** @typedef {import("../link/code/authenticate.js").Verifier} Verifier */

/**
 * A message that was judged: without stamp and tag where they fit; the stamp, or null where there
 * is none that counts; why it is not delivered, or null where it is; and whether it is authentic
 * but too old, as it is where a recording is shown again.
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
    let taken = message;
    if (signed !== null) {
      const changed = this.last !== null && !equalBytes(this.last.data, signed.data);
      taken = new Message(signed.data, message.frames, message.seen, message.agreement, changed);
    }
    const refused = judged?.refused ?? null;
    if (refused === null) this.last = taken;
    else this.refused += 1;
    const stale = judged?.stale ?? false;
    return { message: taken, stamp: signed?.stamp ?? null, refused, stale };
  }
}
