/** A message as a collector returns it. */

import { codeMessage } from "../../generated/constants.js";

export const { MAX_SCORE } = codeMessage;

/** A message that arrived whole. */
export class Message {
  /**
   * @param {Uint8Array} data - the bytes that were sent
   * @param {number} frames - number of frames in the loop that carries the message
   * @param {number} seen - number of received frames whose scores were used
   * @param {number} agreement - share of the scores' weight that agrees with the message, 0 to 1
   * @param {boolean} [changed] - whether the display showed another message before, which was
   *   delivered
   */
  constructor(data, frames, seen, agreement, changed = false) {
    this.data = data;
    this.frames = frames;
    this.seen = seen;
    this.agreement = agreement;
    this.changed = changed;
  }

  /** The message read as UTF-8, with bytes that are no UTF-8 escaped, such as `\xff`. */
  get text() {
    return textOf(this.data);
  }
}

/**
 * Read bytes as UTF-8, and escape those that are none.
 *
 * @param {Uint8Array} data
 * @returns {string}
 */
export function textOf(data) {
  const decoder = new TextDecoder("utf-8", { ignoreBOM: true });
  const parts = [];
  let begin = 0;
  for (let at = 0; at < data.length; ) {
    const length = characterAt(data, at);
    if (length === 0) {
      parts.push(decoder.decode(data.subarray(begin, at)));
      parts.push(`\\x${data[at].toString(16).padStart(2, "0")}`);
      begin = at + 1;
    }
    at += Math.max(length, 1);
  }
  parts.push(decoder.decode(data.subarray(begin)));
  return parts.join("");
}

/**
 * Count the bytes of the UTF-8 character that begins at a place; 0 where none does.
 *
 * @param {Uint8Array} data
 * @param {number} at
 */
function characterAt(data, at) {
  const lead = data[at];
  if (lead < 0x80) return 1;
  const length = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || at + length > data.length) return 0;
  for (let next = at + 1; next < at + length; next++) if (data[next] >> 6 !== 2) return 0;
  const second = data[at + 1];
  const tooLong = (lead === 0xe0 && second < 0xa0) || (lead === 0xf0 && second < 0x90);
  const noCharacter = (lead === 0xed && second > 0x9f) || (lead === 0xf4 && second > 0x8f);
  return tooLong || noCharacter ? 0 : length;
}
