/**
 * The collector of coarse grids turns scores of frames, as they come, into their loop's message.
 *
 * The receiver may join the loop anywhere, does not know its length N, and may lose count when the
 * display leaves the view. Frames whose mutual distance is known form a *run*; every pair (N, first
 * frame) is a hypothesis, and the signatures of the run's frames weigh them. Once one stands out,
 * the run's scores are added to those of earlier runs and loops.
 *
 * Once a message is delivered, each frame is held against it. Frames that agree bring nothing new.
 * From the first frame that contradicts it, scores are collected afresh, while the delivered
 * message stands until another one is whole (link/code/collect_coarse.py).
 */

import { codeCollectCoarse } from "../../../generated/constants.js";
import { equalBytes } from "./bits.js";
import {
  MAX_FRAMES,
  SIGNATURE,
  checkBits,
  decode,
  encode,
  informationBytes,
  parityMask,
  signatures,
} from "./framing.js";
import { Message } from "./message.js";
import { remembered } from "./remembered.js";
import { agreementOf, cutScores, informationOf, remainder } from "./scores.js";
import { logSumExp } from "./words.js";

const { SURE, MAX_RUN, DOUBT, MEMORY_LOOPS, TOLERATED, DOUBTED_LOOPS, TRIED_AGAIN } = codeCollectCoarse;

/** Difference of log-likelihoods below which a hypothesis adds nothing that counts. */
const HOPELESS = -40;

/** A frame of a run: its count, and its scores. @typedef {[number, Float64Array]} Counted */

/** Makes the signatures of all loops end to end: of the loop of 1 frame, of that of 2, ... */
const allSignatures = remembered(() => {
  const words = new Uint8Array(startOf(MAX_FRAMES + 1));
  for (let frames = 1; frames <= MAX_FRAMES; frames++) {
    words.set(signatures(frames), startOf(frames));
  }
  return words;
});

/**
 * Find where a loop begins among the frames of all loops end to end.
 *
 * @param {number} frames - number of frames in the loop
 */
function startOf(frames) {
  return (frames * (frames - 1)) / 2;
}

/**
 * Weigh all words that a signature may be.
 *
 * @param {Float64Array} scores - of a frame; the first `SIGNATURE` are those of the signature
 * @returns {Float64Array} (2 ** SIGNATURE) log-likelihood of each word, but for a constant
 */
export function wordLikelihoods(scores) {
  const words = new Float64Array(2 ** SIGNATURE);
  for (let word = 0; word < words.length; word++) {
    let sum = 0;
    for (let bit = 0; bit < SIGNATURE; bit++) {
      sum += ((word >> (SIGNATURE - 1 - bit)) & 1 ? 0.5 : -0.5) * scores[bit];
    }
    words[word] = sum;
  }
  return words;
}

/** Scores of a loop's frames, summed over all times that each frame was seen. */
class LoopScores {
  /** @type {number | null} */
  #progress = null;

  /**
   * @param {number} frames - number of frames in the loop
   * @param {number} nBits - message blocks of a frame
   */
  constructor(frames, nBits) {
    this.frames = frames;
    this.nBits = nBits;
    /** (frames * nBits) log-likelihood ratios. */
    this.sums = new Float64Array(frames * nBits);
    /** Number of received frames that were added. */
    this.seen = 0;
    /** Value of `progress` when decoding was last tried. */
    this.tried = 0;
    /** @type {number | null} */
  }

  /**
   * Add the scores of frame number `at` of the loop; older ones fade a little.
   *
   * @param {number} at
   * @param {Float64Array} scores
   */
  add(at, scores) {
    const factor = 1 - 1 / (MEMORY_LOOPS * this.frames);
    for (let place = 0; place < this.sums.length; place++) this.sums[place] *= factor;
    const first = at * this.nBits;
    for (let place = 0; place < this.nBits; place++) this.sums[first + place] += scores[place];
    this.seen += 1;
    this.#progress = null;
  }

  /** Information received, as a share of what is needed: about 1 when the message is whole. */
  get progress() {
    if (this.#progress === null) {
      let received = 0;
      for (let first = 0; first < this.sums.length; first += this.nBits) {
        received += informationOf(this.sums.subarray(first + SIGNATURE, first + this.nBits));
      }
      this.#progress = received / (8 * informationBytes(this.frames, this.nBits));
    }
    return this.#progress;
  }

  /** Whether there is enough that is new since decoding was last tried. */
  worthDecoding() {
    const enough = this.progress >= Math.max(1, TRIED_AGAIN * this.tried);
    const turn = Math.max(1, Math.floor(this.frames / 4));
    return enough || (2 * this.seen >= this.frames && this.seen % turn === 0);
  }
}

/**
 * A message that was delivered, and the doubt whether the display still shows it.
 *
 * Doubt is a cumulative sum (Page 1954): it rises with the parity bits of a frame that contradict
 * the message, beyond the share that noise explains, and falls with those that agree. It is never
 * below 0, so frames from before a change do not delay its discovery.
 */
class DeliveredMessage {
  #limit;
  #nBits;
  #parityBits;
  #signs;

  /**
   * @param {Message} message - what was delivered
   * @param {number} nBits - message blocks of a frame
   */
  constructor(message, nBits) {
    this.message = message;
    /** Parity bits beyond those tolerated that contradict the message, in frames; at least 0. */
    this.doubt = 0;
    this.#nBits = nBits;
    const bits = encode(message, nBits);
    this.#signs = new Int8Array(bits.length);
    this.#parityBits = new Int32Array(message.frames);
    parityMask(message.frames, nBits).forEach((parity, at) => {
      this.#signs[at] = parity ? 2 * bits[at] - 1 : 0;
      this.#parityBits[Math.floor(at / nBits)] += parity;
    });
    this.#limit = DOUBTED_LOOPS * message.frames * (0.5 - TOLERATED);
  }

  /**
   * Say whether the display still shows the message, after one more frame.
   *
   * @param {number} at - number of the frame in the loop, from 0
   * @param {Float64Array} scores - (nBits) log-likelihood ratios, positive for 1; 0 for an erasure
   */
  isShown(at, scores) {
    let excess = 0;
    for (let place = 0; place < this.#nBits; place++) {
      const agreement = this.#signs[at * this.#nBits + place] * scores[place];
      const certainty = Math.tanh(Math.abs(agreement) / 2); // 1 - 2 P(the decision is wrong)
      excess += certainty * ((agreement < 0 ? 1 : 0) - TOLERATED);
    }
    excess /= Math.max(this.#parityBits[at], 1);
    this.doubt = Math.min(Math.max(0, this.doubt + excess), this.#limit);
    return this.doubt === 0;
  }
}

/** Collects frames of a coarse grid (`Collector` of collect.js). */
export class CoarseCollector {
  /** @type {DeliveredMessage | null} */
  #delivered = null;
  /** @type {LoopScores | null} */
  #loop = null;

  /** Frames that wait for the place of their run. @type {Counted[]} */
  #waiting = [];
  /**
   * By hypothesis its log-likelihood, in the order of `allSignatures`.
   *
   * @type {Float32Array | null}
   */
  #belief = null;
  /** Frames in the loop, and which of them has count 0. @type {[number, number] | null} */
  #place = null;
  /** What the last signatures say for the place. @type {number[]} */
  #trust = [];

  /** @param {number} nBits - message blocks of a frame */
  constructor(nBits) {
    checkBits(nBits);
    this.nBits = nBits;
    /** Information received, as a share of what is needed. */
    this.progress = 0;
    /** Number of times that decoding was tried. */
    this.attempts = 0;
  }

  /** Whether decoding is under way: never, for a coarse grid is decoded at once. */
  get decoding() {
    return false;
  }

  /** Go on with decoding that is under way; there is none. @returns {Message | null} */
  goOn() {
    return null;
  }

  /** Say that the next frame's distance to the earlier ones is not known. */
  startRun() {
    this.#waiting = [];
    this.#belief = null;
    this.#place = null;
    this.#trust = [];
  }

  /**
   * Add one frame, and try to decode.
   *
   * @param {ArrayLike<number>} received - (nBits) log-likelihood ratios, positive for 1
   * @param {number} count - number of the frame on the display, from any start
   * @returns {Message | null}
   */
  add(received, count) {
    const scores = cutScores(received, new Float64Array(this.nBits));
    const words = wordLikelihoods(scores);
    if (this.#place && this.#lost(this.#place, words, count)) this.startRun();
    if (this.#place) return this.#decodeWith(this.#place, [[count, scores]]);
    this.#waiting.push([count, scores]);
    this.#place = this.#findPlace(words, count);
    if (!this.#place) {
      if (this.#waiting.length >= MAX_RUN) this.startRun();
      return null;
    }
    const waiting = this.#waiting;
    this.#waiting = [];
    this.#belief = null;
    return this.#decodeWith(this.#place, waiting);
  }

  /**
   * Weigh all hypotheses with one more frame.
   *
   * @param {Float64Array} words - log-likelihoods of the words that its signature may be
   * @param {number} count
   * @returns {[number, number] | null} the place of the run, once it is sure
   */
  #findPlace(words, count) {
    this.#belief ??= firstBelief();
    const belief = this.#belief;
    const best = addSignature(belief, words, count);
    let others = -1;
    for (let at = 0; at < belief.length; at++) {
      const below = belief[at] - belief[best];
      if (below <= HOPELESS) continue;
      others += Math.exp(below);
      if (others > SURE) return null;
    }
    let frames = 1;
    while (startOf(frames + 1) <= best) frames++;
    return [frames, best - startOf(frames)];
  }

  /**
   * Tell whether the last signatures speak against the place of this run.
   *
   * @param {[number, number]} place
   * @param {Float64Array} words
   * @param {number} count
   */
  #lost([frames, first], words, count) {
    const word = allSignatures()[startOf(frames) + remainder(first + count, frames)];
    const chance = logSumExp(words) - SIGNATURE * Math.LN2;
    this.#trust = [...this.#trust, words[word] - chance].slice(-DOUBT);
    return this.#trust.length > 2 && this.#trust.reduce((sum, one) => sum + one, 0) < 0;
  }

  /**
   * Add frames to the loop, and decode where there is something new to decode.
   *
   * @param {[number, number]} place
   * @param {Counted[]} waiting
   */
  #decodeWith([frames, first], waiting) {
    const known = this.#delivered;
    for (const [count, scores] of waiting) {
      const at = remainder(first + count, frames);
      if (known && known.message.frames === frames && known.isShown(at, scores)) {
        this.#loop = null;
        continue;
      }
      if (this.#loop?.frames !== frames) this.#loop = new LoopScores(frames, this.nBits);
      this.#loop.add(at, scores);
    }
    this.progress = this.#loop === null ? 1 : this.#loop.progress;
    return this.#loop?.worthDecoding() ? this.#try(this.#loop) : null;
  }

  /**
   * Decode what was collected; a message ends the collection, whether it is new or not.
   *
   * @param {LoopScores} loop
   */
  #try(loop) {
    const known = this.#delivered;
    this.attempts += 1;
    loop.tried = this.progress;
    const content = decode(loop.sums, this.nBits);
    if (content === null) return null;
    const { data, signed } = content;
    this.#loop = null;
    if (known?.message.signed === signed && equalBytes(known.message.data, data)) {
      known.doubt = 0;
      return null;
    }
    const agreement = agreementOf(loop.sums, encode(content, this.nBits));
    const changed = known !== null;
    const message = new Message(data, loop.frames, loop.seen, agreement, changed, signed);
    this.#delivered = new DeliveredMessage(message, this.nBits);
    return message;
  }
}

/**
 * Add what the signature of one more frame says to the log-likelihood of each hypothesis.
 *
 * There are half a million of them, so one pass does it, and looks for the likeliest meanwhile.
 *
 * @param {Float32Array} belief - log-likelihoods, in the order of `allSignatures`
 * @param {Float64Array} words - log-likelihoods of the words that the signature may be
 * @param {number} count - number of the frame
 * @returns {number} the likeliest hypothesis; the first of them where several are
 */
function addSignature(belief, words, count) {
  const table = allSignatures();
  let best = 0;
  let most = -Infinity;
  for (let frames = 1, start = 0; frames <= MAX_FRAMES; start += frames, frames++) {
    const turn = remainder(count, frames);
    const end = start + frames;
    const wrap = end - turn; // from this hypothesis on, the loop has begun anew
    for (let at = start; at < wrap; at++) {
      const sum = Math.fround(belief[at] + words[table[at + turn]]);
      belief[at] = sum;
      if (sum > most) {
        most = sum;
        best = at;
      }
    }
    for (let at = wrap; at < end; at++) {
      const sum = Math.fround(belief[at] + words[table[at + turn - frames]]);
      belief[at] = sum;
      if (sum > most) {
        most = sum;
        best = at;
      }
    }
  }
  return best;
}

/** Log-likelihoods of all hypotheses before the first frame: loops of all lengths are as likely. */
function firstBelief() {
  const belief = new Float32Array(startOf(MAX_FRAMES + 1));
  for (let frames = 1; frames <= MAX_FRAMES; frames++) {
    belief.fill(-Math.log(frames), startOf(frames), startOf(frames + 1));
  }
  return belief;
}
