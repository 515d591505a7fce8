/** What the receiver says of frame pairs and messages, as receiver/stream.py says it. */

import { receiverStream } from "../generated/constants.js";

/** @typedef {import("../generated/events.js").PairEvent} PairEvent */
/** @typedef {import("../generated/events.js").MessageEvent} MessageEvent */
/** @typedef {import("../generated/events.js").RefusedEvent} RefusedEvent */

/**
 * Round a number.
 *
 * @param {number} value
 * @param {number} [digits] - after the point
 */
export function rounded(value, digits = 4) {
  return Number(value.toFixed(digits));
}

/**
 * Say what a frame pair brought.
 *
 * @param {import("../port/receiver/reading/reader.js").DecodedPair} pair
 * @param {boolean} withScores - whether its scores are said, too
 * @returns {PairEvent}
 */
export function pairEvent({ number, time, scores, frames, progress }, withScores) {
  const sure = scores.reduce((sum, score) => sum + 1 / (1 + Math.exp(-Math.abs(score))), 0);
  /** @type {PairEvent} */
  const event = {
    event: "pair",
    pair: number,
    time: rounded(time),
    erased: scores.filter((score) => score === 0).length,
    confidence: rounded(sure / scores.length),
    frames,
    progress: rounded(progress),
  };
  if (withScores || scores.length <= receiverStream.MAX_PRINTED_BITS) {
    event.bits = Array.from(scores, (score) => (score > 0 ? "1" : "0")).join("");
  }
  if (withScores) event.scores = Array.from(scores, (score) => rounded(score, 3));
  return event;
}

/**
 * Say what became of a message.
 *
 * @param {import("../port/receiver/inbox.js").Delivery} delivery
 * @returns {MessageEvent | RefusedEvent}
 */
export function messageEvent({ message, stamp, refused, stale }) {
  const { text, data, frames, seen, agreement, changed } = message;
  const hex = Array.from(data, (byte) => byte.toString(16).padStart(2, "0")).join("");
  if (refused !== null) {
    const shown = stamp === null ? {} : { text, hex, stamp };
    const bytes = data.length;
    return { event: "refused", reason: refused, stale, bytes, loop_frames: frames, ...shown };
  }
  return {
    event: "message",
    text,
    hex,
    loop_frames: frames,
    pairs_used: seen,
    confidence: rounded(agreement),
    ...(changed ? { changed } : {}),
    ...(stamp === null ? {} : { stamp }),
    ...(stamp === null && message.signed ? { signed: "not checked" } : {}),
  };
}
