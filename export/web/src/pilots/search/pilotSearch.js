/**
 * Find a display by its pilots, over some frames of a film: nothing visible marks it.
 *
 * The frames of some tenths of a second are held still against the camera's motion
 * (`../stabilise.js`). Edges and what toggles (`toggleMap.js`) propose where the display may be.
 * Corners then move to where the pilots fit the grid (`parts.js`, `climb.js`), and the display is
 * believed if its blocks toggle with the pilots' signs beyond doubt (`../signal.js`). That also
 * tells which way up it is and which of several grids it shows.
 *
 * Where something toggled like a display and none was sure, the next search takes the picture for
 * one that moves, as a video does, and holds the room still alone. Before a camera that does not wait,
 * the first searches are given up early: perhaps the display came into view, or began to play, only
 * after the frames that they look at.
 *
 * The work is cut into steps finer than Python's (`link/code/steps.js`): no frame takes long.
 */

import { pilotsSearchPilotSearch } from "../../generated/constants.js";
import { candidateSteps, leavingSteps } from "../../locate/candidates.js";
import { rolled } from "../../locate/quads.js";
import {
  CANDIDATES, CLEAREST, FRAME_SHARE, GLANCE_WORK, LEAVING, NEXT_FRAME, PROMISING, Proposer, STRONGEST,
  inset, weighSteps,
} from "./proposals.js";
import { HINT, settleSteps } from "./settle.js";
import { Watch } from "./watch.js";

/** @typedef {import("./film.js").HeldFrame} HeldFrame */
/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./settle.js").Settled} Settled */

const { ANY_TURN } = pilotsSearchPilotSearch;

/**
 * Time after the last frame that was watched, in seconds, after which the first two searches are given
 * up, and number of times that it doubles, each time for the next two: where a camera does not wait,
 * frames pass meanwhile that may show more.
 */
const [PATIENCE_S, MOST_DOUBLED] = [2, 3];

/**
 * Units of work (`steps.js`) from which on a frame from a file has had its share: while the display is
 * looked for, and while a proposal is being settled.
 */
export const [FRAME_WORK, SETTLING_WORK] = [30, 88];
/**
 * Time, in milliseconds, after which a frame of a camera that does not wait has had its share.
 */
export const FRAME_MS = 200;
/**
 * Share of the time from one frame to the next in which all work on a frame of such a camera is to
 * be done while others are still to be watched, and nothing is being settled: what is missed then
 * cannot be watched any more.
 */
const SPARE = 0.8;

/**
 * A display that its pilots have given away: the layout that it shows, one of those that were
 * looked for; its corners in the newest frame, from the top left of the displayed picture on; the
 * natural logarithm of the odds against chance, after paying for everything that was tried; its
 * corners in the frame with which the search began; the coefficient of the lens; when it shows which
 * state, where its code tells; and the frames before the newest one, from the oldest on, of those
 * that are kept.
 *
 * @typedef {{
 *   layout: Layout,
 *   corners: Point[],
 *   evidence: number,
 *   firstCorners: Point[],
 *   k: number,
 *   clock: DisplayClock | null,
 *   held: HeldFrame[],
 * }} PilotDisplay
 */

/** Looks for a display that shows one of several layouts with pilots. */
export class PilotSearch {
  /** Whether displays are looked for whose picture moves (`doubtPicture`). */
  pictureMoves = false;
  /** Number of searches in vain since a display was found. */
  #failed = 0;
  /** Largest evidence of a quadrilateral in this search, before it pays. */
  #surestSeen = 0;
  /** Whether a proposal is being settled; until that is done, no search is given up. */
  #isSettling = false;
  /** What is looked at; null before the first frame. @type {Watch | null} */
  #watch = null;
  /** @type {Steps<Settled | null> | null} */
  #work = null;

  /**
   * @param {readonly Layout[]} layouts - those that are looked for, at least one, each with pilots
   * @param {number} [fps] - nominal number of frames of the camera in a second; some may be missing
   * @param {number} [frameMs] - time after which no step is begun with a frame of a camera that does
   *   not wait, milliseconds, such as `FRAME_MS`
   */
  constructor(layouts, fps = 30, frameMs = Infinity) {
    if (layouts.length === 0 || layouts.some((layout) => layout.pilotBlocks.length === 0)) {
      throw new Error("layouts: need at least one, each with pilots");
    }
    this.layouts = [...layouts];
    this.fps = fps;
    this.frameMs = frameMs;
  }

  /** Whether frames come from a camera, which does not wait for the search. */
  get #isLive() {
    return this.frameMs < Infinity;
  }

  /** Units of work from which on a frame has had its share; where frames do not wait, time ends it. */
  get #share() {
    if (this.#isLive) return Infinity;
    return this.#isSettling ? SETTLING_WORK : FRAME_WORK;
  }

  /** Whether no search has begun. */
  get isIdle() {
    return this.#watch === null;
  }

  /**
   * Take the next frame.
   *
   * @param {BytePlane} gray - it may be kept, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @param {number} [begun] - when the work on the frame began, milliseconds of `performance.now`
   * @returns {PilotDisplay | null} the display once it is sure
   */
  push(gray, time, begun = performance.now()) {
    const watch = this.#watch;
    let isFollowed = watch !== null && watch.take(gray, time);
    if (watch !== null && isFollowed && !watch.isInView()) {
      this.#giveUp();
      isFollowed = false;
    }
    if (watch === null || !isFollowed) {
      const longer = this.#failed > 0 && this.layouts.some(({ code }) => !code.isPlain) ? 2 : 1;
      this.#watch = new Watch(gray, time, this.fps, this.pictureMoves, longer);
      this.#isSettling = false;
      this.#work = null;
      this.#surestSeen = 0;
      return null;
    }
    if (watch.frames.length === 0) watch.add(watch.held[0]);
    const isWatching = watch.frames.length < watch.window;
    if (isWatching) watch.add(watch.newest);
    this.#work ??= this.#search(watch);
    const isSpare = this.#isLive && isWatching && !this.#isSettling;
    const until = begun + (isSpare ? (SPARE * 1000) / this.fps : this.frameMs);
    let work = 0;
    do {
      const step = this.#work.next();
      if (!step.done) {
        work += step.value;
        continue;
      }
      if (step.value === null) return this.#fail();
      this.#watch = null;
      this.#failed = 0;
      const { proposal, evidence, k } = step.value;
      const { layout, corners, toggling } = proposal;
      const newest = watch.newest.corners(corners);
      const clock = toggling.clockInSeconds(this.fps, watch.start);
      const held = watch.held.slice(0, -1);
      return { layout, corners: newest, evidence, firstCorners: corners, k, clock, held };
    } while (work < this.#share && performance.now() < until);
    const patience = PATIENCE_S * 2 ** Math.min(Math.floor(this.#failed / 2), MOST_DOUBLED);
    const isOver = this.#isLive && time - watch.frames[watch.frames.length - 1].time > patience;
    return isOver && !this.#isSettling ? this.#fail() : null;
  }

  /** Choose how the next search begins after one in vain. */
  #giveUp() {
    this.pictureMoves = !this.pictureMoves && this.#surestSeen > PROMISING;
  }

  /** End a search in vain. */
  #fail() {
    this.#giveUp();
    this.#failed++;
    this.#watch = null;
    return null;
  }

  /** Take the picture for one that moves, or no longer for one, from the next search on. */
  doubtPicture() {
    this.pictureMoves = !this.pictureMoves;
  }

  /**
   * Look for the display in the film that follows the reference.
   *
   * @param {Watch} watch
   */
  *#search(watch) {
    const within = yield* candidateSteps(watch.reference, CANDIDATES);
    const leaving = yield* leavingSteps(watch.reference, LEAVING);
    const edges = [...within.map((edge) => edge.corners), ...leaving];
    const proposer = new Proposer(watch, this.layouts);
    const quarter = Math.floor(watch.window / 4);
    /** @type {Point[][]} */
    let faint = [];
    for (let count = 2 * quarter, seen = 0; seen < watch.window; count = seen + quarter) {
      while (watch.frames.length < Math.min(count, watch.window)) {
        for (const quad of edges) watch.places(quad, watch.frames.length); // each frame its share
        yield NEXT_FRAME;
      }
      seen = watch.frames.length;
      const found = yield* this.#glance(edges, proposer, watch, seen);
      if (found !== null) return found;
      // a camera that does not wait shows the rest while faint edges are looked at
      if (!this.#isLive && seen < watch.window) continue;
      faint = [];
      for (const even of proposer.evenMeans()) {
        const edgesOf = yield* candidateSteps(even, CANDIDATES);
        const quads = edgesOf.map(({ corners }) => watch.onImage(corners));
        faint.push(...quads);
        const soon = yield* this.#glance(quads, proposer, watch);
        if (soon !== null) return soon;
      }
    }
    const strongest = [...edges.slice(0, STRONGEST), ...faint.slice(0, 1)];
    const fitted = yield* this.#fit(strongest, proposer, watch);
    if (fitted !== null) return fitted;
    const outlines = yield* proposer.outlines();
    const framed = [...edges, ...faint.slice(0, CANDIDATES)].map((quad) => inset(quad, FRAME_SHARE));
    const later = yield* this.#glance([...outlines, ...framed], proposer, watch);
    if (later !== null) return later;
    const glances = proposer.glances();
    for (const [, { proposal }] of glances.filter(([, { evidence }]) => evidence > HINT)) {
      const found = yield* this.#weighAndSettle(proposal, watch);
      if (found !== null) return found;
    }
    const untried = glances.map(([quad]) => quad).filter((quad) => !strongest.includes(quad));
    return yield* this.#fit([...untried.slice(0, CLEAREST), ...outlines], proposer, watch);
  }

  /** Turns of quadrilaterals that are proposed late: fewer in searches after one in vain. */
  get #turns() {
    return this.#failed === 0 ? ANY_TURN : [ANY_TURN[(this.#failed - 1) % 2]];
  }

  /**
   * Glance at quadrilaterals, and settle each that is promising.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {Proposer} proposer
   * @param {Watch} watch
   * @param {number | null} [count] - as `Watch.places` takes it; null for those that are proposed late
   */
  *#glance(quads, proposer, watch, count = null) {
    const turns = count === null ? this.#turns : ANY_TURN;
    for (const quad of quads) {
      const { evidence, proposal } = yield* proposer.glanceSteps(quad, turns, count);
      if (!(evidence > PROMISING)) continue;
      const found = yield* this.#weighAndSettle(proposal, watch);
      if (found !== null) return found;
    }
    return null;
  }

  /**
   * Fit the pilots to quadrilaterals, and settle each fit that is a hint.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {Proposer} proposer
   * @param {Watch} watch
   */
  *#fit(quads, proposer, watch) {
    for (const quad of quads) {
      for (const turn of this.#turns) {
        const fit = yield* proposer.firstFit(rolled(quad, turn));
        if (fit === null) continue;
        const { evidence } = proposer.surestIn(fit.corners, fit.layout);
        yield GLANCE_WORK;
        if (!(evidence > HINT)) continue;
        const found = yield* this.#settle(fit, evidence, watch);
        if (found !== null) return found;
      }
    }
    return null;
  }

  /**
   * Weigh a proposal by all frames so far, and settle it.
   *
   * @param {Proposal} proposal
   * @param {Watch} watch
   */
  *#weighAndSettle(proposal, watch) {
    const { evidence } = yield* weighSteps(proposal, watch.frames, watch.fps);
    return yield* this.#settle(proposal, evidence, watch);
  }

  /**
   * Settle a proposal with this evidence in all frames so far, before it pays.
   *
   * @param {Proposal} proposal
   * @param {number} evidence
   * @param {Watch} watch
   */
  *#settle(proposal, evidence, watch) {
    this.#surestSeen = Math.max(this.#surestSeen, evidence);
    this.#isSettling = true;
    const found = yield* settleSteps(proposal, evidence, watch);
    this.#isSettling = false;
    return found;
  }
}
