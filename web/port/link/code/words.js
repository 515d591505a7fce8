/**
 * Words: numbers below 4096, each told by 48 bits that differ in 14 places from any other word.
 *
 * A frame of a fine grid says by words which one it is. Words are all sums modulo 2 of twelve
 * pseudo-random ones, so bit p of the word of a number is the parity of (number & `COLUMNS`[p]),
 * and a fast Walsh-Hadamard transform weighs all of them at once.
 */

import { codeWords } from "../../../generated/constants.js";

export const { NUMBERS, WORD } = codeWords;
const { COLUMNS } = codeWords;

/**
 * Tell a number by the (48) bits of its word.
 *
 * @param {number} number - below 4096
 * @returns {Uint8Array}
 */
export function wordOf(number) {
  return Uint8Array.from(COLUMNS, (column) => {
    let parity = number & column;
    for (let shift = 8; shift > 0; shift >>= 1) parity ^= parity >> shift;
    return parity & 1;
  });
}

/**
 * Weigh all words against what was received, relative to chance.
 *
 * @param {Float32Array} scores - log-likelihood ratios of bits, positive for 1
 * @param {number} [first] - where the 48 scores of the word begin
 * @returns {Float64Array} (4096) logarithm of each number's likelihood over the mean likelihood of
 *   all numbers
 */
export function weighWord(scores, first = 0) {
  const weight = new Float64Array(NUMBERS);
  for (let place = 0; place < WORD; place++) weight[COLUMNS[place]] -= scores[first + place] / 2;
  for (let half = 1; half < NUMBERS; half *= 2) {
    for (let begin = 0; begin < NUMBERS; begin += 2 * half) {
      for (let at = begin; at < begin + half; at++) {
        const one = weight[at];
        const other = weight[at + half];
        weight[at] = one + other;
        weight[at + half] = one - other;
      }
    }
  }
  const chance = logSumExp(weight) - Math.log(NUMBERS);
  for (let number = 0; number < NUMBERS; number++) weight[number] -= chance;
  return weight;
}

/**
 * Add up numbers that are given by their logarithms; the result is the logarithm of the sum.
 *
 * @param {Float64Array} logarithms
 * @returns {number}
 */
export function logSumExp(logarithms) {
  const most = logarithms[largestAt(logarithms)];
  let sum = 0;
  for (let at = 0; at < logarithms.length; at++) sum += Math.exp(logarithms[at] - most);
  return most + Math.log(sum);
}

/**
 * Find the largest number; the first of them where several are equal.
 *
 * @param {Float64Array | Float32Array} numbers
 * @returns {number} its place
 */
export function largestAt(numbers) {
  let best = 0;
  for (let at = 1; at < numbers.length; at++) if (numbers[at] > numbers[best]) best = at;
  return best;
}
