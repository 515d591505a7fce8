/**
 * A low-density parity-check code of any length, and belief propagation.
 *
 * Irregular repeat-accumulate (Jin, Khandekar & McEliece 2000, as in DVB-S2): parity bit j is
 *     p_j = p_(j-1) + (sum of the information bits of check j)  mod 2,
 * so encoding is a running sum. The graph depends on the number of bits alone: both ends build the
 * same one (link/code/ldpc.py).
 */

import { shuffled } from "./scrambled.js";

/** Shares of the information bits, and in how many checks each stands (DVB-S2 at rate 1/2). */
const DEGREES = [
  [0.4, 8],
  [0.6, 3],
];
/** Largest magnitude of a log-likelihood ratio in belief propagation; larger ones are cut. */
const MAX_LLR = 30;
/** Number of rounds after which belief propagation gives up. */
const ITERATIONS = 60;
/** Number of free sockets that are looked through for one that closes no short cycle. */
const LOOK_AHEAD = 64;
/** Smallest magnitude of a hyperbolic tangent, and distance of the largest product from 1. */
const SMALLEST = 1e-12;

/** A code as a graph whose edges join bits and checks, sorted by check. */
export class Code {
  /**
   * @param {number} information - number of information bits; they come first in a codeword
   * @param {number} parity - number of parity bits, which is the number of checks
   * @param {Int32Array} bit - bit of each edge
   * @param {Int32Array} starts - (parity + 1) first edge of each check, and the number of edges
   */
  constructor(information, parity, bit, starts) {
    this.information = information;
    this.parity = parity;
    this.bit = bit;
    this.starts = starts;
  }

  /** Number of bits in a codeword. */
  get length() {
    return this.information + this.parity;
  }

  /**
   * Append parity to information bits.
   *
   * @param {Uint8Array} information - (information) bits, 0 or 1
   * @returns {Uint8Array} (length) bits, a codeword
   */
  encode(information) {
    const codeword = new Uint8Array(this.length);
    codeword.set(information);
    let sum = 0;
    for (let check = 0; check < this.parity; check++) {
      for (let edge = this.starts[check]; edge < this.starts[check + 1]; edge++) {
        const bit = this.bit[edge];
        if (bit < this.information) sum ^= information[bit];
      }
      codeword[this.information + check] = sum;
    }
    return codeword;
  }

  /**
   * Tell whether a word satisfies every check.
   *
   * @param {Uint8Array} word - (length) bits
   */
  isCodeword(word) {
    for (let check = 0; check < this.parity; check++) {
      let sum = 0;
      for (let edge = this.starts[check]; edge < this.starts[check + 1]; edge++) {
        sum ^= word[this.bit[edge]];
      }
      if (sum) return false;
    }
    return true;
  }

  /**
   * Find the codeword by belief propagation (sum-product; all checks, then all bits).
   *
   * @param {Float64Array} llr - (length) log-likelihood ratios, positive for 1; 0 where nothing
   *   was received
   * @param {number} [iterations] - number of rounds after which it gives up
   * @returns {Uint8Array | null} (length) bits, a codeword, or null where none was found
   */
  decode(llr, iterations = ITERATIONS) {
    const { bit, starts } = this;
    const channel = llr.map((value) => clipped(Number.isNaN(value) ? 0 : value, MAX_LLR));
    let posterior = channel;
    const back = new Float64Array(bit.length);
    const tanh = new Float64Array(bit.length);
    const word = new Uint8Array(this.length);
    for (let turn = 0; turn < iterations; turn++) {
      const next = channel.slice();
      for (let check = 0; check < this.parity; check++) {
        const first = starts[check];
        const end = starts[check + 1];
        // each message back is the product of all others: of those before it and those after it;
        // positive for 1, so every factor but the first turns the sign once more
        let product = -1;
        for (let edge = first; edge < end; edge++) {
          const told = Math.tanh(clipped(posterior[bit[edge]] - back[edge], MAX_LLR) / 2);
          const size = Math.max(Math.abs(told), SMALLEST);
          tanh[edge] = told >= 0 ? -size : size;
          back[edge] = product;
          product *= tanh[edge];
        }
        product = 1;
        for (let edge = end - 1; edge >= first; edge--) {
          back[edge] = 2 * Math.atanh(clipped(back[edge] * product, 1 - SMALLEST));
          product *= tanh[edge];
          next[bit[edge]] += back[edge];
        }
      }
      posterior = next;
      for (let at = 0; at < word.length; at++) word[at] = posterior[at] > 0 ? 1 : 0;
      if (this.isCodeword(word)) return word;
    }
    return null;
  }
}

/**
 * Cut a number to a magnitude.
 *
 * @param {number} value
 * @param {number} most
 */
function clipped(value, most) {
  return value > most ? most : value < -most ? -most : value;
}

/**
 * Make the code with given numbers of information and parity bits, at least 8 each.
 *
 * Each information bit in turn takes the next free sockets of the checks, in a scrambled order,
 * passing over those that would close a cycle of length four.
 *
 * @param {number} information
 * @param {number} parity
 * @returns {Code}
 */
export function makeCode(information, parity) {
  const degree = degreesOf(information);
  const perCheck = Math.ceil(degree.reduce((sum, one) => sum + one, 0) / parity);
  // the next free socket is the last
  const free = shuffled(parity * perCheck, parity)
    .reverse()
    .map((number) => number % parity);
  let left = free.length;
  /** @type {number[][]} */
  const members = Array.from({ length: parity }, () => []);
  /** @type {number[][]} */
  const checksOf = [];
  // by check the last bit for which it was barred: it would close a cycle, or stands beside another
  const barredFor = new Int32Array(parity).fill(-1);
  for (let number = 0; number < information; number++) {
    /** @type {number[]} */
    const chosen = [];
    for (let turn = 0; turn < degree[number]; turn++) {
      const least = Math.max(left - LOOK_AHEAD, 0);
      let best = left - 1;
      while (best >= least && barredFor[free[best]] === number) best--;
      if (best < least) {
        best = left - 1;
        while (best >= least && chosen.includes(free[best])) best--;
      }
      if (best < least) break;
      const socket = free[best];
      free.copyWithin(best, best + 1, left);
      left--;
      chosen.push(socket);
      barredFor[socket] = number;
      if (socket > 0) barredFor[socket - 1] = number;
      if (socket < parity - 1) barredFor[socket + 1] = number;
      for (const member of members[socket]) {
        for (const other of checksOf[member]) barredFor[other] = number;
      }
    }
    for (const socket of chosen) members[socket].push(number);
    checksOf.push(chosen);
  }
  const starts = new Int32Array(parity + 1);
  /** @type {number[]} */
  const bit = [];
  for (let check = 0; check < parity; check++) {
    for (const member of members[check]) bit.push(member);
    if (check > 0) bit.push(information + check - 1);
    bit.push(information + check);
    starts[check + 1] = bit.length;
  }
  return new Code(information, parity, Int32Array.from(bit), starts);
}

/**
 * List in how many checks each information bit stands.
 *
 * @param {number} information
 */
function degreesOf(information) {
  const degree = DEGREES.flatMap(([share, times]) =>
    new Array(Math.round(share * information)).fill(times),
  );
  // rounding may leave one bit too many or too few
  return Array.from({ length: information }, (_, at) => degree[at % degree.length]);
}
