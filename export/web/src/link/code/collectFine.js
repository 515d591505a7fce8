/**
 * The collector of fine grids turns scores of frames, as they come, into their loop's message.
 *
 * Each frame tells its number and a part of the loop's terms by words (`fine.js`). The numbers of
 * the frames are followed from frame to frame by Bayes' rule: a number usually moves on as the
 * display's count does, and sometimes jumps, because count was lost or the loop began again. A
 * frame whose number is not sure yet waits; so does one that comes before the terms are known. The
 * terms are summed up over frames. Frames that contradict them are not used, and several in a row
 * mean that the message has changed (link/code/collect_fine.py).
 */

import { codeCollectFine } from "../../generated/constants.js";
import {
  PIECES,
  ReadFrame,
  Shape,
  Terms,
  codedBits,
  codedDecodingSteps,
  numberLikelihoods,
  readTerms,
} from "./fine.js";
import { Message } from "./message.js";
import { agreementOf, cutScores, informationOf, remainder } from "./scores.js";
import { NUMBERS, largestAt, logSumExp } from "./words.js";

/** @import { Content } from "./message.js" */

const {
  UNSURE, JUMP, MAX_WAITING, TERMS_MEMORY, CONTRADICTIONS, SCORES_MEMORY, FIRST_TRY, NEXT_TRY, LATE,
  LATE_TRY,
} = codeCollectFine;

/** Scores of a loop's coded bits, summed over all times that each frame was seen. */
class CodedScores {
  #body;
  #information;

  /**
   * @param {Terms} terms - terms of the loop
   * @param {number} nBits - message blocks of a frame
   */
  constructor(terms, nBits) {
    this.terms = terms;
    this.#body = Shape.of(nBits).body;
    /** (frames * body) log-likelihood ratios. */
    this.sums = new Float32Array(terms.frames * this.#body);
    /** Number of received frames that were added. */
    this.seen = 0;
    /** Value of `progress` when decoding was last tried. */
    this.tried = 0;
    this.#information = new Float64Array(terms.frames);
  }

  /**
   * Add the scores of a frame's coded bits; what it brought before fades a little.
   *
   * @param {number} number - of the frame
   * @param {Float32Array} coded - (body)
   */
  add(number, coded) {
    const sums = this.sums.subarray(number * this.#body, (number + 1) * this.#body);
    for (let at = 0; at < sums.length; at++) sums[at] = SCORES_MEMORY * sums[at] + coded[at];
    this.#information[number] = informationOf(sums);
    this.seen += 1;
  }

  /** Information received, as a share of what was sent: about 1.1 when it can be decoded. */
  get progress() {
    return this.#information.reduce((sum, one) => sum + one, 0) / this.terms.information;
  }

  /** Whether there is enough that is new since decoding was last tried. */
  worthDecoding() {
    const factor = this.tried < LATE ? NEXT_TRY : LATE_TRY;
    const enough = this.progress >= Math.max(FIRST_TRY, factor * this.tried);
    const turn = Math.max(2, Math.floor(this.terms.frames / 4));
    return enough || (2 * this.seen >= this.terms.frames && this.seen % turn === 0);
  }
}

/**
 * A frame that cannot be used yet: its scores, its count, and its number once that is known.
 *
 * @typedef {{ scores: Float32Array, count: number, number: number | null }} WaitingFrame
 */

/**
 * Decoding that is under way: what was collected, which may have grown since, and the steps.
 *
 * @typedef {{ loop: CodedScores, steps: Steps<Content | null> }} Attempt
 */

/** Collects frames of a fine grid (`Collector` of collect.js). */
export class FineCollector {
  /** @type {Terms | null} */
  #delivered = null;
  /** @type {CodedScores | null} */
  #loop = null;

  /** Decoding that is under way, of what a loop had brought when it began. @type {Attempt | null} */
  #attempt = null;
  /** Whether enough is new for decoding to begin. */
  #due = false;

  /** By number the logarithm of its probability for the last frame. @type {Float64Array | null} */
  #belief = null;
  /** Count of the last frame. */
  #count = 0;
  /** @type {WaitingFrame[]} */
  #waiting = [];
  /** Terms of the loop, once they are known. @type {Terms | null} */
  #terms = null;
  /** By word of the terms the log-likelihood of each number that it may tell. */
  #evidence = noEvidence();
  /** Whether each word of the terms was seen. */
  #heard = new Array(PIECES).fill(false);
  /** Number of the last frames in a row that contradict the terms. */
  #contradicted = 0;

  /** @param {number} nBits - message blocks of a frame */
  constructor(nBits) {
    this.nBits = nBits;
    /** Information received, as a share of what is needed. */
    this.progress = 0;
    /** Number of times that decoding was tried. */
    this.attempts = 0;
  }

  /** Whether decoding is under way, which `goOn` goes on with. */
  get decoding() {
    return this.#attempt !== null;
  }

  /** Say that the next frame's distance to the earlier ones is not known. */
  startRun() {
    this.#belief = null;
    this.#count = 0;
    this.#waiting = [];
  }

  /**
   * Add one frame, and try to decode.
   *
   * @param {ArrayLike<number>} received - (nBits) log-likelihood ratios, positive for 1
   * @param {number} count - number of the frame on the display, from any start
   * @param {number} [work] - units of work after which decoding is left to `goOn`
   * @returns {Message | null}
   */
  add(received, count, work = Infinity) {
    this.#take(received, count);
    return this.goOn(work);
  }

  /**
   * Add one frame, or let it wait.
   *
   * @param {ArrayLike<number>} received
   * @param {number} count
   */
  #take(received, count) {
    const scores = cutScores(received, new Float32Array(this.nBits));
    /** @type {WaitingFrame} */
    const frame = { scores, count, number: null };
    this.#waiting.push(frame);
    if (this.#waiting.length > MAX_WAITING) this.#waiting.shift();
    const number = this.#follow(numberLikelihoods(scores), count);
    if (number === null) return;
    frame.number = number;
    this.#numberWaiting(number, count);
    this.#learnTerms(new ReadFrame(scores, number));
    if (this.#terms === null) return;
    for (const waiting of this.#waiting) this.#put(waiting, this.#terms);
    this.#waiting = [];
  }

  /**
   * Weigh the numbers that the next frame may have.
   *
   * @param {Float64Array} likelihoods - (4096) what the frame's own word tells; it is changed
   * @param {number} count
   * @returns {number | null} the number, once it is sure
   */
  #follow(likelihoods, count) {
    const belief = likelihoods;
    if (this.#belief !== null) {
      const steps = count - this.#count;
      for (let number = 0; number < NUMBERS; number++) {
        const before = this.#numberBefore(number, steps);
        const moved = before < 0 ? 0 : Math.exp(this.#belief[before]) * (1 - JUMP);
        belief[number] += Math.log(moved + JUMP / NUMBERS);
      }
    }
    this.#count = count;
    const sum = logSumExp(belief);
    for (let number = 0; number < NUMBERS; number++) belief[number] -= sum;
    this.#belief = belief;
    const best = largestAt(belief);
    let others = 0;
    for (let number = 0; number < NUMBERS; number++) {
      if (number !== best) others += Math.exp(belief[number]);
    }
    return others < UNSURE ? best : null;
  }

  /**
   * Find which number moves on to another one; below 0 where there is none.
   *
   * @param {number} number - number of a frame
   * @param {number} steps - by how many frames the display moved on since the one before
   */
  #numberBefore(number, steps) {
    if (this.#terms === null) return number - Math.max(steps, 0);
    const { frames } = this.#terms;
    return number < frames ? remainder(number - steps, frames) : -1;
  }

  /**
   * Number the frames that waited, back from one that is sure; drop what misfits.
   *
   * @param {number} sure - number of the frame that is sure
   * @param {number} count - of that frame
   */
  #numberWaiting(sure, count) {
    this.#waiting = this.#waiting.filter((frame) => {
      if (frame.number !== null) return true;
      let number = sure - (count - frame.count);
      if (this.#terms !== null) number = remainder(number, this.#terms.frames);
      // a number that no word tells fits no better than one that the frame's word contradicts
      if (number < 0 || !(numberLikelihoods(frame.scores)[number] >= 0)) return false;
      frame.number = number;
      return true;
    });
  }

  /** Learn the terms from the next frames. */
  #forgetTerms() {
    this.#terms = null;
    this.#evidence = noEvidence();
    this.#heard.fill(false);
    this.#contradicted = 0;
  }

  /**
   * Add what a frame says about the terms.
   *
   * @param {ReadFrame} frame
   */
  #learnTerms(frame) {
    if (this.#terms !== null) {
      const contradicts = frame.supports(this.#terms) < 0;
      this.#contradicted = contradicts ? this.#contradicted + 1 : 0;
      if (this.#contradicted === CONTRADICTIONS) this.#forgetTerms();
    }
    frame.pieces.forEach((piece, shown) => {
      const evidence = this.#evidence[piece];
      const more = frame.likelihoods[shown];
      for (let at = 0; at < NUMBERS; at++) evidence[at] = TERMS_MEMORY * evidence[at] + more[at];
      this.#heard[piece] = true;
    });
    if (this.#terms === null && this.#heard.every(Boolean)) {
      this.#terms = readTerms(this.#evidence.map(largestAt), this.nBits);
    }
  }

  /**
   * Add a frame to the loop, and note whether decoding is due.
   *
   * @param {WaitingFrame} waiting - its number is known
   * @param {Terms} terms
   */
  #put(waiting, terms) {
    const number = /** @type {number} */ (waiting.number);
    if (number >= terms.frames) return;
    const frame = new ReadFrame(waiting.scores, number);
    if (frame.supports(terms) < 0) return;
    if (terms.equals(this.#delivered)) {
      this.#forgetLoop();
      return;
    }
    if (!this.#loop || !this.#loop.terms.equals(terms)) {
      this.#loop = new CodedScores(terms, this.nBits);
      this.#due = false;
    }
    this.#loop.add(number, frame.coded);
    this.progress = this.#loop.progress;
    this.#due ||= this.#loop.worthDecoding();
  }

  /** Drop a loop whose message was returned. */
  #forgetLoop() {
    this.#loop = null;
    this.#due = false;
    this.progress = 1;
  }

  /**
   * Go on with decoding that is under way, of what was collected when it began.
   *
   * @param {number} [work] - units of work (`GRAPH_WORK` says which) after which no further step is
   *   taken
   * @returns {Message | null}
   */
  goOn(work = Infinity) {
    for (let spent = 0; ; ) {
      if (this.#attempt === null) {
        if (this.#loop === null || !this.#due) return null;
        this.attempts += 1;
        this.#due = false;
        this.#loop.tried = this.#loop.progress;
        const steps = codedDecodingSteps(this.#loop.sums, this.#loop.terms);
        this.#attempt = { loop: this.#loop, steps };
      }
      const { loop, steps } = this.#attempt;
      if (spent >= work) return null;
      const step = steps.next();
      if (!step.done) {
        spent += step.value;
        continue;
      }
      this.#attempt = null;
      if (step.value !== null) return this.#deliver(loop, step.value);
    }
  }

  /**
   * Make the message that was decoded of a loop; it ends the collection.
   *
   * @param {CodedScores} loop
   * @param {Content} content
   */
  #deliver(loop, content) {
    const { data, signed } = content;
    const agreement = agreementOf(loop.sums, codedBits(content, loop.terms, this.nBits));
    const changed = this.#delivered !== null;
    if (this.#loop?.terms.equals(loop.terms)) this.#forgetLoop();
    this.#delivered = loop.terms;
    return new Message(data, loop.terms.frames, loop.seen, agreement, changed, signed);
  }
}

/** By word of the terms, log-likelihoods of numbers before anything was seen. */
function noEvidence() {
  return Array.from({ length: PIECES }, () => new Float64Array(NUMBERS));
}
