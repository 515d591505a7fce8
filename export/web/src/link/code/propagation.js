/**
 * Belief propagation (sum-product) on a graph of bits and of sums of bits modulo 2.
 *
 * Python adds log-likelihood ratios; here their exponentials are multiplied, which spares a
 * hyperbolic tangent and a logarithm for each message: where R and r are the exponentials of all
 * that a bit is told and of one message, tanh of half the difference is (R - r) / (R + r).
 * Log-likelihood ratios are positive for 0 here, so that signs multiply as bits add.
 */

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
/** Exponential of the largest log-likelihood ratio. */
const MOST = Math.exp(MAX_TOTAL);
/** Exponential of the smallest log-likelihood ratio. */
const LEAST = Math.exp(-MAX_TOTAL);

/** Beliefs about bits, and how they change from round to round. */
export class Propagation {
  #bounds;
  #known;
  #messages;
  #next;
  #sumTanh;
  #sums;
  #tanhs;

  /**
   * @param {Sums} sums - which bits add up to each sum
   * @param {Float64Array} sumTanh - (sums) hyperbolic tangent of half of what is known of each sum:
   *   1 where it is 0
   * @param {Float64Array} known - (bits) log-likelihood ratio that is known of each bit
   * @param {Bounds} bounds
   */
  constructor(sums, sumTanh, known, bounds) {
    const { starts, members } = sums;
    this.#sums = sums;
    this.#sumTanh = sumTanh;
    this.#bounds = bounds;
    this.#known = known.map((llr) => Math.exp(Math.min(Math.max(llr, -MAX_TOTAL), MAX_TOTAL)));
    /** (bits) exponential of all that each bit is told: below 1 where it is thought to be 1. */
    this.total = this.#known.slice();
    this.#next = new Float64Array(known.length);
    /** (members) exponential of the message of each sum to each of its members. */
    this.#messages = new Float64Array(members.length).fill(1);
    const most = starts.reduce((longest, start, sum) => {
      return sum ? Math.max(longest, start - starts[sum - 1]) : 0;
    }, 0);
    /** Room for the hyperbolic tangents of what the members of one sum are told. */
    this.#tanhs = new Float64Array(most);
  }

  /** Do one round: messages of all sums, then beliefs about all bits. */
  step() {
    const { starts, members } = this.#sums;
    const { leastTanh, mostTanh, mostProduct } = this.#bounds;
    const { total } = this;
    const next = this.#next;
    const messages = this.#messages;
    const sumTanh = this.#sumTanh;
    const tanhs = this.#tanhs;
    next.set(this.#known);
    for (let sum = 0; sum < sumTanh.length; sum++) {
      const first = starts[sum];
      const end = starts[sum + 1];
      // each message is the product of all others: of those before it and those after it
      let product = sumTanh[sum];
      for (let edge = first; edge < end; edge++) {
        const all = total[members[edge]];
        const mine = messages[edge];
        let tanh = (all - mine) / (all + mine);
        // no branch depends on a sign, which no processor could predict
        tanh = Math.min(Math.max(tanh, -mostTanh), mostTanh);
        if (Math.abs(tanh) < leastTanh) tanh = tanh > 0 ? leastTanh : -leastTanh;
        tanhs[edge - first] = tanh;
        messages[edge] = product;
        product *= tanh;
      }
      product = 1;
      for (let edge = end - 1; edge >= first; edge--) {
        const told = messages[edge] * product;
        product *= tanhs[edge - first];
        const message = Math.min(Math.max(told, -mostProduct), mostProduct);
        const factor = (1 + message) / (1 - message);
        messages[edge] = factor;
        const grown = next[members[edge]] * factor;
        next[members[edge]] = grown > MOST ? MOST : grown < LEAST ? LEAST : grown;
      }
    }
    this.total = next;
    this.#next = total;
  }

  /**
   * Decide on the bits.
   *
   * @param {number} count - number of bits, from the first on
   * @returns {Uint8Array} 0 or 1
   */
  bits(count) {
    const bits = new Uint8Array(count);
    for (let bit = 0; bit < count; bit++) bits[bit] = this.total[bit] < 1 ? 1 : 0;
    return bits;
  }

  /**
   * Tell whether the bits, as they would be decided, satisfy sums that must be 0.
   *
   * @param {Sums} sums
   */
  satisfies({ starts, members }) {
    for (let sum = 0; sum + 1 < starts.length; sum++) {
      let odd = false;
      for (let edge = starts[sum]; edge < starts[sum + 1]; edge++) {
        if (this.total[members[edge]] < 1) odd = !odd;
      }
      if (odd) return false;
    }
    return true;
  }
}
