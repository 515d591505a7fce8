/**
 * Belief propagation (sum-product) on a graph of bits and of sums of bits modulo 2.
 *
 * Python adds log-likelihood ratios; here their exponentials are multiplied, which spares a
 * hyperbolic tangent and a logarithm for each message: where R and r are the exponentials of all
 * that a bit is told and of one message, tanh of half the difference is (R - r) / (R + r).
 * Log-likelihood ratios are positive for 0 here, so that signs multiply as bits add. The rounds are
 * done by opencv/code.cpp.
 */

import { call } from "../../image/opencv.js";

/**
 * Sums as a graph: the members of sum s are `members[starts[s]]` to `members[starts[s + 1] - 1]`.
 *
 * @typedef {{ starts: Int32Array, members: Int32Array }} Sums
 */

/**
 * Bounds that keep messages finite: smallest and largest magnitude of the hyperbolic tangent of
 * half of what a bit is told, and largest magnitude of a product of such tangents.
 *
 * @typedef {{ leastTanh: number, mostTanh: number, mostProduct: number }} Bounds
 */

/** Largest magnitude of a log-likelihood ratio, far beyond certainty and far from overflow. */
const MAX_TOTAL = 345;

/** Beliefs about bits, and how they change from round to round. */
export class Propagation {
  #bounds;
  #known;
  #messages;
  #sumTanh;
  #sums;

  /**
   * @param {Sums} sums - which bits add up to each sum
   * @param {Float64Array} sumTanh - (sums) hyperbolic tangent of half of what is known of each sum:
   *   1 where it is 0
   * @param {Float64Array} known - (bits) log-likelihood ratio that is known of each bit
   * @param {Bounds} bounds
   */
  constructor(sums, sumTanh, known, bounds) {
    this.#sums = sums;
    this.#sumTanh = sumTanh;
    this.#bounds = bounds;
    this.#known = known.map((llr) => Math.exp(Math.min(Math.max(llr, -MAX_TOTAL), MAX_TOTAL)));
    /** (bits) exponential of all that each bit is told: below 1 where it is thought to be 1. */
    this.total = this.#known.slice();
    /** (members) exponential of the message of each sum to each of its members. */
    this.#messages = new Float64Array(sums.members.length).fill(1);
  }

  /**
   * Do rounds: messages of all sums, then beliefs about all bits.
   *
   * @param {number} rounds - largest number of rounds
   * @param {Sums} checks - sums that must be 0; once the bits satisfy them, no round follows
   * @param {number} missing - number of a bit that does not exist, of which no sum tells anything;
   *   every other bit must have been told something, too
   * @returns {boolean} whether the bits satisfy the checks
   */
  run(rounds, checks, missing) {
    const { leastTanh, mostTanh, mostProduct } = this.#bounds;
    const graph = [this.#sums.starts, this.#sums.members, this.#sumTanh, this.#known];
    const numbers = [leastTanh, mostTanh, mostProduct, Math.exp(MAX_TOTAL), missing, rounds];
    const state = [this.#messages, this.total];
    const given = [...graph, checks.starts, checks.members, ...numbers, ...state];
    return call("propagated", given, state) === 1;
  }

  /**
   * Decide on the bits.
   *
   * @param {number} count - number of bits, from the first on
   * @returns {Uint8Array} 0 or 1
   */
  bits(count) {
    return Uint8Array.from(this.total.subarray(0, count), (told) => (told < 1 ? 1 : 0));
  }
}
