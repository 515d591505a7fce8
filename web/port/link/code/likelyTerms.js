/**
 * The terms of a short message are guessed before each of their words is sure by itself.
 *
 * A loop's terms (`fine.js`) are 72 bits in six words. Most messages are short, and most loops are
 * as long as is usual. Of such a loop only the mark and the length are open, so the six words
 * together tell the terms much earlier than each of them tells its own 12 bits
 * (link/code/likely_terms.py). The likeliest terms are found by opencv/code.cpp.
 */

import { codeFine, codeLikelyTerms } from "../../../generated/constants.js";
import { call, rowsOf } from "../../image/opencv.js";
import { Terms, fineFrames } from "./fine.js";
import { remembered } from "./remembered.js";

const { SHORT, DOUBT, MOST_MARKS } = codeLikelyTerms;

/** Number of bits of the mark. */
const MARK_BITS = 8 * codeFine.MARK_BYTES;
/** Logarithm of the number of terms that a short message in a loop of usual length may have. */
const OPEN_TERMS = Math.log(2 ** MARK_BITS * SHORT);

/**
 * Guess the terms of a short message whose loop has the usual number of frames.
 *
 * @param {Float64Array[]} evidence - by word of the terms, (4096) log-likelihood of each number
 *   that it may tell, summed up over frames; 0 where the word was not seen
 * @param {number} nBits - message blocks of a frame
 * @returns {Terms | null} the likeliest terms, or null while others are not improbable
 */
export function likelyTerms(evidence, nBits) {
  const { frames, told, markChecks } = usualTerms(nBits);
  const best = new Float64Array(2);
  const given = [rowsOf(evidence), told, markChecks, OPEN_TERMS, DOUBT, MOST_MARKS];
  if (call("likelyTerms", given, [best]) === 0) return null;
  const [mark, length] = best;
  return new Terms(length + 1, frames[length], mark);
}

/**
 * Tell of all short messages in loops of the usual length the number of frames, and in rows what the
 * fourth word tells, the upper bits of the fifth, and the check without the mark; and by bit of the
 * mark, the lowest first, what it changes in the check: a CRC is linear.
 */
const usualTerms = remembered((/** @type {number} */ nBits) => {
  const usual = Array.from({ length: SHORT }, (_, at) => {
    return new Terms(at + 1, fineFrames(at + 1, nBits), 0);
  });
  const frames = usual.map((terms) => terms.frames);
  const fourth = frames.map((count, at) => (at << 4) | ((count - 1) >>> 8));
  const fifth = frames.map((count) => ((count - 1) & 0xff) << 4);
  const checks = usual.map(({ check }) => check);
  const data = Int32Array.from([...fourth, ...fifth, ...checks]);
  const markChecks = Int32Array.from({ length: MARK_BITS }, (_, bit) => {
    return new Terms(1, frames[0], 2 ** bit).check ^ checks[0];
  });
  return { frames, told: { width: SHORT, height: 3, data }, markChecks };
});
