/**
 * Look for a display in one window of a film: the frames that follow a reference frame.
 *
 * Edges and what toggles (`toggleMap.js`) propose where the display may be. Corners then move to where
 * the pilots fit the grid, and the display is believed if its blocks toggle with the pilots' signs
 * beyond doubt (`settle.js`). That also tells which way up it is and which of several grids it shows.
 */

import { receiverPilotsSearchWindowSearch } from "../../../../generated/constants.js";
import { candidateSteps } from "../../locate/candidates.js";
import { rolled } from "../../locate/quads.js";
import {
  CANDIDATES, CLEAREST, FRAME_SHARE, GLANCE_WORK, NEXT_FRAME, PROMISING, Proposer, STRONGEST,
  UPRIGHT_OR_NOT, inset, weighSteps,
} from "./proposals.js";
import { HINT, settleSteps } from "./settle.js";

/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./settle.js").Settled} Settled */
/** @typedef {import("./watch.js").Watch} Watch */

export const { ANY_TURN } = receiverPilotsSearchWindowSearch;
const { SURROUNDED } = receiverPilotsSearchWindowSearch;
/** Units of work of beginning to follow what surrounds quadrilaterals. */
const SURROUND_WORK = 10;

/** Looks for a display in the frames that follow a reference frame. */
export class WindowSearch {
  #proposer;
  #isEager;
  #turns;
  /** Largest evidence of a quadrilateral so far, before it pays. */
  #surestSeen = 0;
  /** Whether all edges have been glanced at, in all frames that are watched. */
  isLate = false;
  /** Whether a proposal is being settled. */
  isSettling = false;
  /** Proposals being settled that have waited for a frame, or wait. @type {Steps<Settled | null>[]} */
  #waiting = [];

  /**
   * @param {Watch} watch - the film, of which the reference frame has come
   * @param {readonly Layout[]} layouts - those that may be shown
   * @param {readonly number[]} turns - quarter turns after which quadrilaterals are tried that are
   *   proposed late
   * @param {boolean} isEager - whether faint edges are looked at after each quarter of the window
   *   and not at its end alone, where there is nothing else to do before a camera that does not wait
   */
  constructor(watch, layouts, turns, isEager) {
    this.watch = watch;
    this.#proposer = new Proposer(watch, layouts);
    this.#turns = turns;
    this.#isEager = isEager;
    /** Steps of the search, each with the frames that have come so far. */
    this.steps = this.#allSteps();
  }

  /** Whether a proposal that is being settled has waited for a frame, or waits for one. */
  get isWaiting() {
    return this.#waiting.length > 0;
  }

  /** Whether something toggles like a display, unless its picture moves, too. */
  get isDoubtful() {
    return this.#surestSeen > PROMISING && !this.watch.pictureMoves;
  }

  /**
   * Search, and go on first with what waited for a frame once the frame has come.
   *
   * @returns {Steps<Settled | null>}
   */
  *#allSteps() {
    const search = this.#search();
    let newest = this.watch.newest;
    for (let isOver = false; !isOver || this.isWaiting; ) {
      if (this.watch.newest !== newest) {
        newest = this.watch.newest;
        for (const settling of [...this.#waiting]) {
          const found = yield* this.#goOn(settling);
          if (found !== null) return found;
        }
      }
      if (isOver) yield NEXT_FRAME;
      else {
        const step = search.next();
        if (!step.done) yield step.value;
        else if (step.value !== null) return step.value;
        else isOver = true;
      }
    }
    return null;
  }

  /**
   * Look for the display in the film that follows the reference.
   *
   * While frames are awaited, the pilots are fitted to quadrilaterals that may bound a display of
   * which a part is in view.
   *
   * @returns {Steps<Settled | null>}
   */
  *#search() {
    const { watch } = this;
    const proposer = this.#proposer;
    const edges = yield* proposer.edges();
    watch.surround(edges.slice(0, SURROUNDED));
    yield SURROUND_WORK;
    const quarter = Math.floor(watch.window / 4);
    /** @type {Point[][]} */
    let faint = [];
    const partlySeen = [...proposer.partlySeen];
    const upright = UPRIGHT_OR_NOT.slice(0, 1);
    for (let count = watch.soon, seen = 0; seen < watch.window; count = seen + quarter) {
      while (watch.frames.length < Math.min(count, watch.window)) {
        for (const quad of edges) watch.places(quad, watch.frames.length); // each frame its share
        const leaving = seen > 0 ? partlySeen.splice(0, 1) : [];
        const found = yield* this.#fit(leaving, this.#turns.slice(0, 1), upright);
        if (found !== null) return found;
        if (leaving.length === 0) yield NEXT_FRAME;
      }
      seen = watch.frames.length;
      const found = yield* this.#glance(edges, seen);
      if (found !== null) return found;
      if (!this.#isEager && seen < watch.window) continue;
      faint = [];
      for (const even of proposer.evenMeans()) {
        const edgesOf = yield* candidateSteps(even, CANDIDATES);
        const quads = edgesOf.map((edge) => watch.onImage(edge));
        faint.push(...quads);
        const soon = yield* this.#glance(quads);
        if (soon !== null) return soon;
      }
    }
    this.isLate = true;
    const leaving = yield* this.#fit(partlySeen, this.#turns.slice(0, 1), upright);
    if (leaving !== null) return leaving;
    const strongest = [...edges.slice(0, STRONGEST), ...faint.slice(0, 1)];
    const fitted = yield* this.#fit(strongest, this.#turns, UPRIGHT_OR_NOT);
    if (fitted !== null) return fitted;
    const outlines = yield* proposer.outlines();
    const framed = [...edges, ...faint.slice(0, CANDIDATES)].map((quad) => inset(quad, FRAME_SHARE));
    const later = yield* this.#glance([...outlines, ...framed]);
    if (later !== null) return later;
    const glances = proposer.glances();
    for (const [, { evidence, proposal }] of glances) {
      if (!(evidence > HINT && evidence <= PROMISING)) continue; // more promising ones are settled
      const found = yield* this.#weighAndSettle(proposal);
      if (found !== null) return found;
    }
    const untried = glances.map(([quad]) => quad).filter((quad) => !strongest.includes(quad));
    const late = [...untried.slice(0, CLEAREST), ...outlines];
    return yield* this.#fit(late, this.#turns, UPRIGHT_OR_NOT);
  }

  /**
   * Glance at quadrilaterals, and settle each that is promising.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {number | null} [count] - as `Watch.places` takes it; null for those that are proposed late
   */
  *#glance(quads, count = null) {
    const turns = count === null ? this.#turns : ANY_TURN;
    for (const quad of quads) {
      const { evidence, proposal } = yield* this.#proposer.glanceSteps(quad, turns, count);
      if (!(evidence > PROMISING)) continue;
      const found = yield* this.#weighAndSettle(proposal);
      if (found !== null) return found;
    }
    return null;
  }

  /**
   * Fit the pilots to quadrilaterals, and settle each fit that is a hint.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {readonly number[]} turns - quarter turns after which each is tried
   * @param {readonly number[]} ways - more turns: as it is then seen, and maybe upside down
   */
  *#fit(quads, turns, ways) {
    for (const quad of quads) {
      for (const turn of turns) {
        const fit = yield* this.#proposer.firstFit(rolled(quad, turn), ways);
        if (fit === null) continue;
        const { evidence } = this.#proposer.surestIn(fit.corners, fit.layout);
        yield GLANCE_WORK;
        if (!(evidence > HINT)) continue;
        const found = yield* this.#settle(fit, evidence);
        if (found !== null) return found;
      }
    }
    return null;
  }

  /**
   * Weigh a proposal by all frames so far, and settle it.
   *
   * @param {Proposal} proposal
   */
  *#weighAndSettle(proposal) {
    const { evidence } = yield* weighSteps(proposal, this.watch.frames, this.watch.fps);
    return yield* this.#settle(proposal, evidence);
  }

  /**
   * Settle a proposal with this evidence in all frames so far, before it pays.
   *
   * @param {Proposal} proposal
   * @param {number} evidence
   */
  *#settle(proposal, evidence) {
    this.#surestSeen = Math.max(this.#surestSeen, evidence);
    return yield* this.#goOn(settleSteps(proposal, evidence, this.watch));
  }

  /**
   * Settle a proposal until it needs a frame that has yet to come; then it waits.
   *
   * @param {Steps<Settled | null>} settling
   * @returns {Steps<Settled | null>}
   */
  *#goOn(settling) {
    for (;;) {
      this.isSettling = true;
      const step = settling.next();
      this.isSettling = !step.done && step.value !== NEXT_FRAME;
      if (step.done) {
        this.#waiting = this.#waiting.filter((each) => each !== settling);
        return step.value;
      }
      if (!this.isSettling) {
        if (!this.#waiting.includes(settling)) this.#waiting.push(settling);
        return null;
      }
      yield step.value;
    }
  }
}
