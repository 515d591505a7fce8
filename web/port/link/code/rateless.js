/**
 * A rateless code: from a block of information, as many coded bits as anyone wants.
 *
 * It is a Raptor code (Shokrollahi 2006; over noisy channels Etesami & Shokrollahi 2006). A block's
 * information bits and a few parity bits are its *intermediate* bits. Coded bit number t is the sum
 * modulo 2 of some intermediate bits, which its number chooses (link/code/rateless.py).
 */

import { codeRateless } from "../../../generated/constants.js";
import { addParity } from "./ldpc.js";
import { Propagation } from "./propagation.js";
import { remembered } from "./remembered.js";
import { range, scrambled, shuffled } from "./scrambled.js";

export const { MIN_INFORMATION, MAX_INFORMATION } = codeRateless;
const {
  DEGREES, PRECODE_COPIES, ITERATIONS, PATIENCE, LEAST_GROWTH, MAX_HALF_LLR, MAX_PRODUCT,
  GRAPH_WORK,
} = codeRateless;

/** Number of blocks that are decoded together, and given up together. */
const MAX_COLUMNS = 16;
/** @type {import("./propagation.js").Bounds} */
const BOUNDS = { leastTanh: 0, mostTanh: Math.tanh(MAX_HALF_LLR), mostProduct: MAX_PRODUCT };

/** Number of draws of a coded bit's degree, which are all as likely. */
const DRAWS = [...DEGREES.values()].reduce((sum, share) => sum + share, 0);
/** Degrees of coded bits, by the random number drawn for each. */
const DEGREE_OF_DRAW = Uint8Array.from(
  [...DEGREES].flatMap(([degree, share]) => new Array(share).fill(degree)),
);

/** @typedef {import("./propagation.js").Sums} Sums */

/** The code of blocks of a given number of information bits. */
export class RatelessCode {
  /**
   * @param {number} information - number of information bits in a block; they are the first
   *   intermediate bits
   * @param {number} intermediate - number of intermediate bits in a block, a prime
   * @param {Sums} precode - intermediate bits in each check of the precode; the last two are the
   *   check's own parity bit and the one before it. The number `intermediate` stands for a bit that
   *   does not exist and counts as 0.
   */
  constructor(information, intermediate, precode) {
    this.information = information;
    this.intermediate = intermediate;
    this.precode = precode;
  }

  /**
   * Make coded bits.
   *
   * @param {Uint8Array} information - bits of all blocks, one block after the other
   * @param {number} count - number of coded bits for each block
   * @returns {Uint8Array} (count * blocks) coded bits 0 to count - 1, by turns from each block
   */
  encode(information, count) {
    const blocks = information.length / this.information;
    const { starts, members } = this.sums(range(count));
    const coded = new Uint8Array(count * blocks);
    const bits = new Uint8Array(this.intermediate + 1);
    for (let block = 0; block < blocks; block++) {
      const first = block * this.information;
      bits.set(information.subarray(first, first + this.information));
      addParity(bits, this.information, this.precode);
      for (let number = 0; number < count; number++) {
        let sum = 0;
        for (let at = starts[number]; at < starts[number + 1]; at++) sum ^= bits[members[at]];
        coded[number * blocks + block] = sum;
      }
    }
    return coded;
  }

  /**
   * List the members of coded bits.
   *
   * They are an arithmetic progression modulo the number of intermediate bits. That is a prime, so
   * they are all different.
   *
   * @param {Uint32Array} numbers - numbers of coded bits
   * @returns {Sums}
   */
  sums(numbers) {
    const prime = this.intermediate;
    const { high, low } = scrambled(numbers, prime);
    const starts = new Int32Array(numbers.length + 1);
    const degrees = numbers.map((_, at) => DEGREE_OF_DRAW[modulo(high[at], low[at], DRAWS)]);
    for (let at = 0; at < numbers.length; at++) starts[at + 1] = starts[at] + degrees[at];
    const members = new Int32Array(starts[numbers.length]);
    for (let at = 0; at < numbers.length; at++) {
      let member = modulo(high[at] >>> 10, (low[at] >>> 10) | (high[at] << 22), prime);
      const step = ((high[at] >>> 4) % (prime - 1)) + 1;
      for (let edge = starts[at]; edge < starts[at + 1]; edge++) {
        members[edge] = member;
        member += step;
        if (member >= prime) member -= prime;
      }
    }
    return { starts, members };
  }

  /**
   * Find the information by belief propagation (sum-product), step by step.
   *
   * @param {Float32Array} llr - (count * blocks) log-likelihood ratios of coded bits 0 to
   *   count - 1, by turns from each block, positive for 1; 0 where nothing was received
   * @param {number} blocks - number of blocks
   * @returns {Steps<Uint8Array | null>} bits of all blocks, one block after the other; null where
   *   those of some block could not be found
   */
  *decodingSteps(llr, blocks) {
    const graph = new Graph(this, receivedNumbers(llr, blocks));
    yield GRAPH_WORK * graph.edges;
    const bits = new Uint8Array(blocks * this.information);
    for (let first = 0; first < blocks; first += MAX_COLUMNS) {
      const end = Math.min(first + MAX_COLUMNS, blocks);
      const columns = Array.from(
        { length: end - first },
        (_, at) => new Column(graph, llr, blocks, first + at),
      );
      if (!(yield* decodeTogether(columns, graph.edges))) return null;
      columns.forEach((column, at) => bits.set(column.bits(), (first + at) * this.information));
    }
    return bits;
  }
}

/**
 * Find the remainder of a number of 64 bits.
 *
 * @param {number} high - its upper half; any whole number of 32 bits, as are those that follow
 * @param {number} low - its lower half
 * @param {number} divisor - from 1 to 2 ** 21, so that no product exceeds 53 bits
 */
function modulo(high, low, divisor) {
  return (((high >>> 0) % divisor) * 2 ** 32 + (low >>> 0)) % divisor;
}

/**
 * List the numbers of the coded bits of which something was received in some block.
 *
 * @param {Float32Array} llr
 * @param {number} blocks
 */
function receivedNumbers(llr, blocks) {
  const numbers = [];
  for (let first = 0; first < llr.length; first += blocks) {
    let at = first;
    while (at < first + blocks && llr[at] === 0) at++;
    if (at < first + blocks) numbers.push(first / blocks);
  }
  return Uint32Array.from(numbers);
}

/**
 * Decode some blocks; they are given up together once none of them becomes surer.
 *
 * @param {Column[]} columns
 * @param {number} edges - of the graph, each of which is a unit of work in each round
 * @returns {Steps<boolean>} whether all were decoded
 */
function* decodeTogether(columns, edges) {
  let active = columns;
  for (let first = 0; first < ITERATIONS; first += PATIENCE) {
    const turns = Math.min(PATIENCE, ITERATIONS - first);
    const left = [];
    for (const column of active) {
      if (!column.run(turns)) left.push(column);
      yield turns * edges;
    }
    active = left;
    if (active.length === 0) return true;
    if (turns === PATIENCE && !active.filter((column) => column.grows()).length) break;
  }
  return false;
}

/** Received coded bits of degree 2 or more and the precode as a graph, for belief propagation. */
class Graph {
  /**
   * @param {RatelessCode} code
   * @param {Uint32Array} received - numbers of the coded bits that were received
   */
  constructor(code, received) {
    const coded = code.sums(received);
    this.code = code;
    /** Numbers of the coded bits that are one intermediate bit, and which. @type {number[][]} */
    this.single = [];
    /** Numbers of the other coded bits. @type {number[]} */
    this.numbers = [];
    const ends = [0];
    const joined = new Int32Array(coded.members.length + code.precode.members.length);
    let edges = 0;
    // by degree, because loops of one length are faster
    const { starts } = coded;
    for (const [degree] of DEGREES) {
      for (let at = 0; at < received.length; at++) {
        const first = starts[at];
        if (starts[at + 1] - first !== degree) continue;
        if (degree === 1) {
          this.single.push([received[at], coded.members[first]]);
          continue;
        }
        this.numbers.push(received[at]);
        for (let edge = first; edge < starts[at + 1]; edge++) joined[edges++] = coded.members[edge];
        ends.push(edges);
      }
    }
    joined.set(code.precode.members, edges);
    for (const end of code.precode.starts.subarray(1)) ends.push(edges + end);
    const members = joined.slice(0, ends[ends.length - 1]);
    /** The other coded bits, and after them the checks of the precode. @type {Sums} */
    this.sums = { starts: Int32Array.from(ends), members };
    /** Number of messages between bits and sums. */
    this.edges = members.length;
  }
}

/** One block on its way to being decoded; from here on, scores are positive for 0. */
class Column {
  #beliefs;
  #certainty;
  #code;

  /**
   * @param {Graph} graph
   * @param {Float32Array} llr - as `RatelessCode.decodingSteps` takes it
   * @param {number} blocks - number of all blocks
   * @param {number} block - number of this one
   */
  constructor(graph, llr, blocks, block) {
    const { code, sums } = graph;
    const received = new Float64Array(sums.starts.length - 1).fill(1);
    graph.numbers.forEach((number, at) => {
      received[at] = Math.tanh(halfOf(llr[number * blocks + block]));
    });
    const known = new Float64Array(code.intermediate + 1);
    for (const [number, bit] of graph.single) {
      known[bit] += 2 * halfOf(llr[number * blocks + block]);
    }
    known[code.intermediate] = 2 * MAX_HALF_LLR;
    this.#code = code;
    this.#beliefs = new Propagation(sums, received, known, BOUNDS);
    this.#certainty = 0;
  }

  /**
   * Do some rounds of belief propagation.
   *
   * @param {number} turns - number of rounds
   * @returns {boolean} whether the block is decoded; no round follows then
   */
  run(turns) {
    return this.#beliefs.run(turns, this.#code.precode, this.#code.intermediate);
  }

  /** Whether the mean certainty has grown since this was asked last. */
  grows() {
    const before = this.#certainty;
    const { intermediate } = this.#code;
    let sum = 0;
    for (let bit = 0; bit < intermediate; bit++) {
      sum += Math.abs(Math.log(this.#beliefs.total[bit]));
    }
    this.#certainty = sum / intermediate;
    return this.#certainty > LEAST_GROWTH * before;
  }

  /** The (information) bits. */
  bits() {
    return this.#beliefs.bits(this.#code.information);
  }
}

/**
 * Halve a log-likelihood ratio that is positive for 1 into one that is positive for 0.
 *
 * @param {number} llr
 */
function halfOf(llr) {
  return -Math.min(Math.max(llr / 2, -MAX_HALF_LLR), MAX_HALF_LLR);
}

/**
 * Makes the code of blocks of a number of information bits, at least `MIN_INFORMATION`.
 *
 * The precode has about one parity bit for 50 information bits, and 16 more. Each is the parity bit
 * before it plus the information bits that three pseudo-random orders assign to it.
 */
export const makeRateless = remembered((/** @type {number} */ information) => {
  let intermediate = information + Math.floor(information / 50) + 16;
  while (!isPrime(intermediate)) intermediate++;
  const checks = intermediate - information;
  /** @type {number[][]} */
  const lists = Array.from({ length: checks }, () => []);
  let at = 0;
  for (let copy = 0; copy < PRECODE_COPIES; copy++) {
    for (const bit of shuffled(information, information + copy)) lists[at++ % checks].push(bit);
  }
  const length = Math.ceil((PRECODE_COPIES * information) / checks);
  const starts = Int32Array.from({ length: checks + 1 }, (_, check) => check * (length + 2));
  const members = new Int32Array(starts[checks]).fill(intermediate);
  lists.forEach((list, check) => {
    list.sort((one, other) => one - other);
    list.forEach((bit, row) => {
      // a bit that stands twice in a check stands for nothing
      const twice = bit === list[row - 1] || bit === list[row + 1];
      members[starts[check] + row] = twice ? intermediate : bit;
    });
    members[starts[check] + length] = information + check;
    if (check > 0) members[starts[check] + length + 1] = information + check - 1;
  });
  return new RatelessCode(information, intermediate, { starts, members });
});

/** @param {number} number - at least 2 */
function isPrime(number) {
  for (let factor = 2; factor * factor <= number; factor++) if (number % factor === 0) return false;
  return true;
}
