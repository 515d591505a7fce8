/**
 * The terms of a short message are guessed before each of their words is sure by itself.
 *
 * A loop's terms (`fine.js`) are 72 bits in six words. Most messages are short, and most loops are
 * as long as is usual. Of such a loop only the mark and the length are open, so the six words
 * together tell the terms much earlier than each of them tells its own 12 bits
 * (link/code/likely_terms.py).
 */

import { codeFine, codeLikelyTerms } from "../../generated/constants.js";
import { Terms, fineFrames, maskOf } from "./fine.js";
import { remembered } from "./remembered.js";
import { range } from "./scrambled.js";
import { NUMBERS, largestAt, logSumExp, overChance } from "./words.js";

const { SHORT, DOUBT, MOST_MARKS } = codeLikelyTerms;

/** Logarithm of the number of terms that a short message in a loop of usual length may have. */
const OPEN_TERMS = Math.log(2 ** (8 * codeFine.MARK_BYTES) * SHORT);
/** Least log-likelihood, over chance, of terms that are believed. */
const NEEDED = OPEN_TERMS - Math.log(DOUBT);

/**
 * A mark that may be the right one, the numbers by which it scrambles the pieces, and the
 * log-likelihood of the pieces that tell it.
 *
 * @typedef {{ mark: number, mask: number[], score: number }} Marked
 */

/**
 * Guess the terms of a short message whose loop has the usual number of frames.
 *
 * @param {Float64Array[]} evidence - by word of the terms, (4096) log-likelihood of each number
 *   that it may tell, summed up over frames; 0 where the word was not seen
 * @param {number} nBits - message blocks of a frame
 * @returns {Terms | null} the likeliest terms, or null while others are not improbable
 */
export function likelyTerms(evidence, nBits) {
  const words = evidence.map(overChance);
  const most = words.map((word) => word[largestAt(word)]);
  if (sumOf(most) < NEEDED) return null;
  const marks = likelyMarks(words, sumOf(most.slice(2)), sumOf(most.slice(3)));
  if (marks.length === 0) return null;
  const usual = usualTerms(nBits);
  const totals = new Float64Array(marks.length * SHORT);
  marks.forEach(({ mark, mask, score }, row) => {
    const markCheck = new Terms(1, 1, mark).check ^ new Terms(1, 1, 0).check; // a CRC is linear
    usual.forEach(({ nBytes, frames, check }, column) => {
      const sum = check ^ markCheck;
      const last = frames - 1;
      totals[row * SHORT + column] =
        score +
        words[3][(((nBytes - 1) << 4) | (last >>> 8)) ^ mask[3]] +
        words[4][(((last & 0xff) << 4) | (sum >>> 12)) ^ mask[4]] +
        words[5][(sum & 0xfff) ^ mask[5]];
    });
  });
  const best = largestAt(totals);
  const others = Math.exp(logSumExp(totals) - totals[best]) - 1;
  if (others + Math.exp(OPEN_TERMS - totals[best]) > DOUBT) return null;
  const { nBytes, frames } = usual[best % SHORT];
  return new Terms(nBytes, frames, marks[Math.floor(best / SHORT)].mark);
}

/**
 * List the likeliest marks, each with the word that all short lengths share.
 *
 * @param {Float64Array[]} words
 * @param {number} left - largest log-likelihood of the words that do not tell the mark
 * @param {number} later - the same without the word that all short lengths share
 */
function likelyMarks([first, second, third], left, later) {
  const [highs, lows] = [first, second].map((word) =>
    range(NUMBERS).sort((one, other) => word[other] - word[one]),
  );
  /** @type {Marked[]} */
  const marks = [];
  highs.forEach((high, rank) => {
    // a pair of the ranks a and b, counted from 0, has (a + 1) (b + 1) - 1 that are no worse
    for (const low of lows.subarray(0, Math.floor(NUMBERS / (rank + 1)))) {
      const told = first[high] + second[low];
      if (told + left < NEEDED) break;
      const mark = (high << 12) | low;
      const mask = maskOf(mark);
      const score = told + third[mask[2]];
      if (score + later >= NEEDED) marks.push({ mark, mask, score });
    }
  });
  return marks.sort((one, other) => other.score - one.score).slice(0, MOST_MARKS);
}

/** Terms of all short messages in loops of the usual length, but for their marks. */
const usualTerms = remembered((/** @type {number} */ nBits) =>
  Array.from({ length: SHORT }, (_, at) => {
    const { nBytes, frames, check } = new Terms(at + 1, fineFrames(at + 1, nBits), 0);
    return { nBytes, frames, check };
  }),
);

/** @param {number[]} numbers */
function sumOf(numbers) {
  return numbers.reduce((sum, number) => sum + number, 0);
}
