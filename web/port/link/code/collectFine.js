/**
 * The collector of fine grids turns scores of frames, as they come, into their loop's message.
 *
 * Each frame tells its number and a part of the loop's terms by words (`fine.js`). The numbers of
 * the frames are followed from frame to frame by Bayes' rule: a number usually moves on as the
 * display's count does, and sometimes jumps, because count was lost or the loop began again. A
 * frame whose number is not sure yet waits; so does one that comes before the terms are known. The
 * terms are summed up over frames. Frames that contradict them are not used, and several mean that
 * the message has changed (link/code/collect_fine.py).
 */

import { codeCollectFine, codeFine } from "../../../generated/constants.js";
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
import { likelyTerms } from "./likelyTerms.js";
import { Message } from "./message.js";
import { agreementOf, cutScores, informationOf, remainder } from "./scores.js";
import { NUMBERS, largestAt, logSumExp } from "./words.js";

/** @import { Content } from "./message.js" */

const {
  UNSURE, JUMP, LOOP_ENDS, MAX_WAITING, TERMS_MEMORY, CONTRADICTS, DOUBTFUL, SCORES_MEMORY, FIRST_TRY,
  NEXT_TRY, LATE, LATE_TRY,
} = codeCollectFine;
const { USUAL_FRAMES } = codeFine;

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
 * A frame that cannot be used yet: its scores, its count, and what it says once its number is known.
 *
 * @typedef {{ scores: Float32Array, count: number, read: ReadFrame | null }} WaitingFrame
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

  /**
   * Logarithm of the probability of each number for the last frame, by the number.
   * @type {Float64Array | null}
   */
  #belief = null;
  /** Count of the last frame. */
  #count = 0;
  /** @type {WaitingFrame[]} */
  #waiting = [];
  /** Terms of the loop, once they are known. @type {Terms | null} */
  #terms = null;
  /** Log-likelihoods of each number that a word of the terms may tell, by the word. */
  #evidence = noEvidence();
  /** Evidence of the last frames against the terms: a log-likelihood over chance, at most 0. */
  #support = 0;

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
   * Add one frame, or let it wait; one of which nothing was read says nothing.
   *
   * @param {ArrayLike<number>} received
   * @param {number} count
   */
  #take(received, count) {
    const scores = cutScores(received, new Float32Array(this.nBits));
    if (!scores.some(Boolean)) return;
    this.#waiting.push({ scores, count, read: null });
    if (this.#waiting.length > MAX_WAITING) this.#waiting.shift();
    const number = this.#follow(numberLikelihoods(scores), count);
    if (number === null) return;
    for (const read of this.#numberWaiting(number, count)) this.#learnTerms(read);
    if (this.#terms === null) return;
    this.#numberWaiting(number, count);
    for (const { read } of this.#waiting) if (read !== null) this.#put(read, this.#terms);
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
      const moved = this.#movedOn(this.#belief, count - this.#count);
      for (let number = 0; number < NUMBERS; number++) {
        belief[number] += Math.log(moved[number] * (1 - JUMP) + JUMP / NUMBERS);
      }
    } else {
      const usual = Math.log(1 + NUMBERS / USUAL_FRAMES);
      for (let number = 0; number < USUAL_FRAMES; number++) belief[number] += usual;
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
   * Work out how likely each number is where the display moved on as its count says.
   *
   * @param {Float64Array} belief - logarithms of the probabilities before
   * @param {number} steps - by how many frames the display moved on
   */
  #movedOn(belief, steps) {
    const moved = new Float64Array(NUMBERS);
    if (this.#terms !== null) {
      const { frames } = this.#terms;
      for (let number = 0; number < frames; number++) {
        moved[number] = Math.exp(belief[remainder(number - steps, frames)]);
      }
      return moved;
    }
    const step = Math.min(Math.max(steps, 0), NUMBERS);
    for (let number = step; number < NUMBERS; number++) {
      moved[number] = Math.exp(belief[number - step]);
    }
    moved.fill(-Math.expm1(step * Math.log1p(-LOOP_ENDS)) / step, 0, step);
    // a loop of the usual length is over
    for (let number = 0; number < Math.min(step, USUAL_FRAMES); number++) {
      moved[number] += Math.exp(belief[remainder(number - step, USUAL_FRAMES)]);
    }
    return moved;
  }

  /**
   * Number the frames that wait by one whose number is sure; drop what misfits. Those from before
   * the loop began again go on waiting until its length is known.
   *
   * @param {number} sure - number of the frame that is sure
   * @param {number} count - of that frame
   * @returns {ReadFrame[]} what the frames that are numbered now say
   */
  #numberWaiting(sure, count) {
    /** @type {ReadFrame[]} */
    const numbered = [];
    this.#waiting = this.#waiting.filter((frame) => {
      if (frame.read !== null) return true;
      let number = sure - (count - frame.count);
      if (this.#terms !== null) number = remainder(number, this.#terms.frames);
      if (number < 0) return true;
      // a number that no word tells fits no better than one that the frame's word contradicts
      if (!(numberLikelihoods(frame.scores)[number] >= CONTRADICTS)) return false;
      frame.read = new ReadFrame(frame.scores, number);
      numbered.push(frame.read);
      return true;
    });
    return numbered;
  }

  /**
   * Add what a frame says about the terms, or hold it against them once they are known.
   *
   * @param {ReadFrame} frame
   */
  #learnTerms(frame) {
    if (this.#terms !== null) {
      const support = Math.max(frame.supports(this.#terms), CONTRADICTS);
      this.#support = Math.min(0, this.#support + support);
      if (this.#support > DOUBTFUL) return;
      this.#terms = null; // they are learned from the next frames
      this.#evidence = noEvidence();
      this.#support = 0;
    }
    frame.pieces.forEach((piece, shown) => {
      const evidence = this.#evidence[piece];
      const more = frame.likelihoods[shown];
      for (let at = 0; at < NUMBERS; at++) evidence[at] = TERMS_MEMORY * evidence[at] + more[at];
    });
    this.#terms =
      readTerms(this.#evidence.map(largestAt), this.nBits) ??
      likelyTerms(this.#evidence, this.nBits);
  }

  /**
   * Add a frame to the loop, and note whether decoding is due.
   *
   * @param {ReadFrame} frame
   * @param {Terms} terms
   */
  #put(frame, terms) {
    if (frame.number >= terms.frames || frame.supports(terms) < CONTRADICTS) return;
    if (terms.equals(this.#delivered)) {
      this.#forgetLoop();
      return;
    }
    if (!this.#loop || !this.#loop.terms.equals(terms)) {
      this.#loop = new CodedScores(terms, this.nBits);
      this.#due = false;
    }
    this.#loop.add(frame.number, frame.coded);
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

/** Make the log-likelihoods of all numbers, by the word of the terms, before any frame was seen. */
function noEvidence() {
  return Array.from({ length: PIECES }, () => new Float64Array(NUMBERS));
}
