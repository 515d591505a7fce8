/** A message as a collector returns it. */

import { codeMessage } from "../../../generated/constants.js";

export const { MAX_SCORE } = codeMessage;

/**
 * What a loop carries: the bytes that were sent, and whether they end with a stamp and a tag
 * (authenticate.js), as the framing says.
 *
 * @typedef {{ data: Uint8Array, signed: boolean }} Content
 */

/** A message that arrived whole. */
export class Message {
  /**
   * @param {Uint8Array} data - the bytes that were sent
   * @param {number} frames - number of frames in the loop that carries the message
   * @param {number} seen - number of received frames whose scores were used
   * @param {number} agreement - share of the scores' weight that agrees with the message, 0 to 1
   * @param {boolean} [changed] - whether the display showed another message before, which was
   *   delivered
   * @param {boolean} [signed] - whether the framing says that stamp and tag end the bytes
   */
  constructor(data, frames, seen, agreement, changed = false, signed = false) {
    this.data = data;
    this.frames = frames;
    this.seen = seen;
    this.agreement = agreement;
    this.changed = changed;
    this.signed = signed;
  }

  /** The message read as UTF-8, with bytes that are no UTF-8 escaped, such as `\xff`. */
  get text() {
    return textOf(this.data);
  }
}

/**
 * Read bytes as UTF-8; bytes that are no UTF-8 are shown as \xff, as Python shows them.
 *
 * @param {Uint8Array} data
 * @returns {string}
 */
export function textOf(data) {
  const whole = utf8Of(data);
  if (whole !== null) return whole;
  let text = "";
  for (let at = 0; at < data.length; ) {
    const lead = data[at];
    const length = lead < 0x80 ? 1 : lead < 0xe0 ? 2 : lead < 0xf0 ? 3 : 4;
    const letter = utf8Of(data.subarray(at, at + length));
    text += letter ?? `\\x${lead.toString(16).padStart(2, "0")}`;
    at += letter === null ? 1 : length;
  }
  return text;
}

/**
 * Read bytes as UTF-8.
 *
 * @param {Uint8Array} data
 * @returns {string | null} null where they are no UTF-8
 */
export function utf8Of(data) {
  try {
    return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(data);
  } catch {
    return null;
  }
}
