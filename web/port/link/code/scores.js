/** Scores as the collectors use them. */

import { MAX_SCORE } from "./message.js";

/**
 * Cut scores to `MAX_SCORE`; those that are no numbers tell nothing.
 *
 * @template {Float32Array | Float64Array} Scores
 * @param {ArrayLike<number>} received
 * @param {Scores} cut - where they go; as many
 * @returns {Scores} `cut`
 */
export function cutScores(received, cut) {
  for (let at = 0; at < cut.length; at++) {
    const score = received[at] || 0;
    cut[at] = score > MAX_SCORE ? MAX_SCORE : score < -MAX_SCORE ? -MAX_SCORE : score;
  }
  return cut;
}

/**
 * Add up the information that log-likelihood ratios hold, in bits.
 *
 * @param {Float32Array | Float64Array} llr - natural logarithms
 */
export function informationOf(llr) {
  let nats = 0;
  for (let at = 0; at < llr.length; at++) {
    if (llr[at] === 0) nats += Math.LN2;
    else nats += entropyOf(Math.abs(llr[at]));
  }
  return llr.length - nats / Math.LN2;
}

/** @param {number} size - magnitude of a log-likelihood ratio */
function entropyOf(size) {
  const odds = Math.exp(-size);
  return Math.log1p(odds) + (size * odds) / (1 + odds);
}

/**
 * Find the share of the scores' weight that agrees with bits.
 *
 * @param {Float32Array | Float64Array} scores - positive for 1
 * @param {Uint8Array} bits - as many, 0 or 1
 */
export function agreementOf(scores, bits) {
  let agreeing = 0;
  let weight = 0;
  for (let at = 0; at < scores.length; at++) {
    const size = Math.abs(scores[at]);
    weight += size;
    if (scores[at] > 0 === (bits[at] === 1)) agreeing += size;
  }
  return agreeing / weight;
}

/**
 * Find the remainder of a whole number, which is never negative.
 *
 * @param {number} number
 * @param {number} divisor - at least 1
 */
export function remainder(number, divisor) {
  return ((number % divisor) + divisor) % divisor;
}
