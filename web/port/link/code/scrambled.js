/**
 * Pseudo-random words of 64 bits that are equal on every machine (splitmix64).
 *
 * A word is kept as two halves of 32 bits, because BigInt is about fifty times slower.
 */

import { codeScrambled } from "../../../generated/constants.js";

/**
 * Words of 64 bits, by their upper and lower halves.
 *
 * @typedef {{ high: Uint32Array, low: Uint32Array }} Words
 */

const [FIRST, SECOND, LAST] = codeScrambled.SHIFTS;
/** Upper and lower half of the distance between successive states. */
const [GOLDEN_HIGH, GOLDEN_LOW] = [0x9e3779b9, 0x7f4a7c15];

/**
 * List consecutive numbers.
 *
 * @param {number} count - how many
 * @param {number} [first] - the first of them
 * @returns {Uint32Array}
 */
export function range(count, first = 0) {
  const numbers = new Uint32Array(count);
  for (let at = 0; at < count; at++) numbers[at] = first + at;
  return numbers;
}

/**
 * Turn whole numbers into pseudo-random words.
 *
 * @param {Uint32Array} numbers
 * @param {number} seed - chooses one of many sequences; a whole number from 0, below 2 ** 32 - 1
 * @returns {Words}
 */
export function scrambled(numbers, seed) {
  const times = seed + 1;
  const offsetHigh = upperHalf(times, GOLDEN_LOW) + Math.imul(times, GOLDEN_HIGH);
  const offsetLow = Math.imul(times, GOLDEN_LOW) >>> 0;
  const high = new Uint32Array(numbers.length);
  const low = new Uint32Array(numbers.length);
  for (let at = 0; at < numbers.length; at++) {
    const sum = numbers[at] + offsetLow;
    let lo = sum >>> 0;
    let hi = (offsetHigh + (sum > 0xffffffff ? 1 : 0)) | 0;

    lo ^= (lo >>> FIRST) | (hi << (32 - FIRST));
    hi ^= hi >>> FIRST;
    // times 0xbf58476d1ce4e5b9
    hi = (upperHalf(lo, 0x1ce4e5b9) + Math.imul(lo, 0xbf58476d) + Math.imul(hi, 0x1ce4e5b9)) | 0;
    lo = Math.imul(lo, 0x1ce4e5b9);

    lo ^= (lo >>> SECOND) | (hi << (32 - SECOND));
    hi ^= hi >>> SECOND;
    // times 0x94d049bb133111eb
    hi = (upperHalf(lo, 0x133111eb) + Math.imul(lo, 0x94d049bb) + Math.imul(hi, 0x133111eb)) | 0;
    lo = Math.imul(lo, 0x133111eb);

    low[at] = lo ^ ((lo >>> LAST) | (hi << (32 - LAST)));
    high[at] = hi ^ (hi >>> LAST);
  }
  return { high, low };
}

/**
 * Find the upper 32 bits of the product of two numbers of 32 bits, as a signed number.
 *
 * @param {number} one
 * @param {number} other
 */
function upperHalf(one, other) {
  const oneLow = one & 0xffff;
  const oneHigh = one >>> 16;
  const otherLow = other & 0xffff;
  const otherHigh = other >>> 16;
  // no sum here exceeds 32 bits, but Math.imul gives signed ones
  const middle = (Math.imul(oneHigh, otherLow) + (Math.imul(oneLow, otherLow) >>> 16)) | 0;
  const rest = (Math.imul(oneLow, otherHigh) + (middle & 0xffff)) | 0;
  return (Math.imul(oneHigh, otherHigh) + (middle >>> 16) + (rest >>> 16)) | 0;
}

/**
 * List the numbers from 0 in the rising order of their words; numbers of equal words keep theirs.
 *
 * @param {number} count - how many numbers
 * @param {number} seed - of the words
 * @returns {Uint32Array} a permutation of the numbers
 */
export function shuffled(count, seed) {
  const { high, low } = scrambled(range(count), seed);
  return range(count).sort((one, other) => high[one] - high[other] || low[one] - low[other]);
}
