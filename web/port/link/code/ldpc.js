/**
 * A low-density parity-check code of any length, in which the page sends.
 *
 * Irregular repeat-accumulate (Jin, Khandekar & McEliece 2000, as in DVB-S2): parity bit j is
 *     p_j = p_(j-1) + (sum of the information bits of check j)  mod 2,
 * so encoding is a running sum. The graph depends on the number of bits alone: both ends build the
 * same one (link/code/ldpc.py).
 */

import { codeLdpc } from "../../../generated/constants.js";
import { shuffled } from "./scrambled.js";

/** @typedef {import("./propagation.js").Sums} Sums */

const { DEGREES } = codeLdpc;

/** Number of free sockets that are looked through for one that closes no short cycle. */
const LOOK_AHEAD = 64;

/** A code as a graph of checks, which are sums of bits that must be 0. */
export class Code {
  /**
   * @param {number} information - number of information bits; they come first in a codeword
   * @param {number} parity - number of parity bits, which is the number of checks
   * @param {Sums} checks - bits of each check in rising order
   */
  constructor(information, parity, checks) {
    this.information = information;
    this.parity = parity;
    this.checks = checks;
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
    addParity(codeword, this.information, this.checks);
    return codeword;
  }
}

/**
 * Work out the parity bits that follow information bits.
 *
 * @param {Uint8Array} bits - of which those of the information are there
 * @param {number} information - number of information bits
 * @param {Sums} checks - information bits of each check, among others that count as 0 here
 */
export function addParity(bits, information, { starts, members }) {
  let sum = 0; // that of the check before, which is its parity bit
  for (let check = 0; check + 1 < starts.length; check++) {
    for (let edge = starts[check]; edge < starts[check + 1]; edge++) {
      if (members[edge] < information) sum ^= bits[members[edge]];
    }
    bits[information + check] = sum;
  }
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
  const bits = [];
  for (let check = 0; check < parity; check++) {
    for (const member of members[check]) bits.push(member);
    if (check > 0) bits.push(information + check - 1);
    bits.push(information + check);
    starts[check + 1] = bits.length;
  }
  return new Code(information, parity, { starts, members: Int32Array.from(bits) });
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
