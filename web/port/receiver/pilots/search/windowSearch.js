/**
 * Look for a display in one window of a film: the frames that follow a reference frame.
 *
 * Edges propose where the display may be, and what a map of toggling outlines. Corners then move to
 * where the pilots fit the grid, and the display is believed if its blocks toggle with the pilots' signs
 * beyond doubt (`settle.js`). That also tells which way up it is and which of several grids it shows.
 */

import {
  receiverPilotsSearchRegions, receiverPilotsSearchWindowSearch,
} from "../../../../generated/constants.js";
import {
  COARSE_WORK, LEAVING, NEXT_FRAME, PROMISING, Proposer, STRONGEST, weighSteps,
} from "./proposals.js";
import { aboutMiddle, panelsOf, picturesIn, reachingBeyond, waysUp } from "./regions.js";
import { HINT, verifySteps } from "./settle.js";

/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./proposals.js").RegionMapper} RegionMapper */
/** @typedef {import("./settle.js").Detection} Detection */
/** @typedef {import("./watch.js").Watch} Watch */

const { WITH_BARS } = receiverPilotsSearchRegions;
const {
  SURROUNDED, LEAVING_AT_ONCE, LEAVING_LATER, HINTS, BARRED,
} = receiverPilotsSearchWindowSearch;
/** Units of work of beginning to follow what surrounds quadrilaterals. */
const SURROUND_WORK = 10;

/** Looks for a display in the frames that follow a reference frame. */
export class WindowSearch {
  #proposer;
  /** What may bound a display partly in view, by what toggles, the likeliest first. @type {Point[][]} */
  #leaving = [];
  /**
   * Quadrilaterals of evidence that is less than promising: it, and the likeliest corners.
   *
   * @type {Map<Point[], { evidence: number, corners: Point[] }>}
   */
  #hints = new Map();
  /** Whether edges have been weighed coarsely at all. */
  hasLooked = false;
  /** Whether edges have been weighed coarsely in all frames that are watched. */
  isLate = false;
  /** Whether a proposal is being verified. */
  isSettling = false;
  /** Proposals being verified that have waited for a frame, or wait. @type {Steps<Detection | null>[]} */
  #waiting = [];

  /**
   * @param {Watch} watch - the film, of which the reference frame has come
   * @param {readonly Layout[]} layouts - those that may be shown
   * @param {RegionMapper} mapper - maps where displays toggle
   */
  constructor(watch, layouts, mapper) {
    this.watch = watch;
    this.#proposer = new Proposer(watch, layouts, mapper);
    /** Steps of the search, each with the frames that have come so far. */
    this.steps = this.#allSteps();
  }

  /** Whether a proposal that is being verified has waited for a frame, or waits for one. */
  get isWaiting() {
    return this.#waiting.length > 0;
  }

  /**
   * Search, and go on first with what waited for a frame once the frame has come.
   *
   * @returns {Steps<Detection | null>}
   */
  *#allSteps() {
    const search = this.#search();
    let newest = this.watch.newest;
    for (let isOver = false; !isOver || this.isWaiting; ) {
      if (this.watch.newest !== newest) {
        newest = this.watch.newest;
        for (const verification of [...this.#waiting]) {
          const found = yield* this.#goOn(verification);
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
   * After edges have first been weighed coarsely, and once the window is late, other proposals are
   * tried. Last, the pilots are fitted to more quadrilaterals that may bound a display of which a part
   * is in view, and to the strongest edges in every way up.
   *
   * @returns {Steps<Detection | null>}
   */
  *#search() {
    const { watch } = this;
    const proposer = this.#proposer;
    const edges = yield* proposer.edges();
    watch.surround(edges.slice(0, SURROUNDED));
    yield SURROUND_WORK;
    const quarter = Math.floor(watch.window / 4);
    for (let count = watch.soon, seen = 0; seen < watch.window; count = seen + quarter) {
      while (watch.frames.length < Math.min(count, watch.window)) {
        for (const quad of edges) watch.places(quad, watch.frames.length); // each frame its share
        yield NEXT_FRAME;
      }
      const isFirst = seen === 0;
      seen = watch.frames.length;
      const weighed = yield* this.#weighCoarsely(edges, seen);
      this.hasLooked = true;
      const found = weighed ?? (isFirst ? yield* this.#others(edges) : null);
      if (found !== null) return found;
    }
    this.isLate = true;
    const found = yield* this.#others(edges);
    if (found !== null) return found;
    const notFitted = this.#leaving.slice(LEAVING_AT_ONCE);
    const partlySeen = notFitted.length > 0 ? notFitted : proposer.partlySeen;
    const strongest = edges.slice(0, STRONGEST);
    return yield* this.#fit([
      ...waysUp(partlySeen.slice(0, LEAVING_LATER)),
      ...waysUp(strongest.slice(1)),
      ...waysUp(strongest, false),
    ]);
  }

  /**
   * Weigh faint edges coarsely, and fit the pilots to outlines of what toggles and of panels. What costs
   * least and what is likeliest comes first.
   *
   * @param {Point[][]} edges - quadrilaterals of edges, the strongest first
   * @returns {Steps<Detection | null>}
   */
  *#others(edges) {
    const [faint, ...withoutDetails] = this.#proposer.faintEdges();
    const first = yield* faint;
    const early = yield* this.#weighCoarsely(first);
    if (early !== null) return early;
    const { outlines: regions, leaving, portraits } =
      yield* this.#proposer.regions([...edges, ...first]);
    this.#leaving = leaving;
    const snapped = regions.length > 0 ? yield* this.#proposer.snapped(regions[0]) : [];
    const between = picturesIn([...panelsOf(edges), ...panelsOf(first)]);
    const partly = picturesIn(leaving.length > 0 ? this.#proposer.partlySeen.slice(0, LEAVING) : []);
    const { width, height } = this.watch.reference;
    const beyond = portraits.slice(0, 1).flatMap((part) => reachingBeyond(part, width, height));
    const proposed = [...snapped, ...regions, ...portraits, ...partly, ...between];
    const bounded =
      (yield* this.#weighCoarsely(proposed)) ??
      (yield* this.#fit([
        ...partly.slice(0, BARRED),
        ...waysUp(beyond),
        ...waysUp(leaving.slice(0, LEAVING_AT_ONCE)),
        ...this.#bestHints(),
        ...waysUp([...regions.slice(0, 1), ...edges.slice(0, 1)]),
      ]));
    if (bounded !== null) return bounded;
    for (const edges of withoutDetails) {
      const found = yield* this.#weighCoarsely(yield* edges);
      if (found !== null) return found;
    }
    const films = regions.slice(0, 1).map((region) => aboutMiddle(region, 1, WITH_BARS));
    const barred = [...between.slice(0, BARRED), ...films];
    return yield* this.#fit([
      ...barred,
      ...waysUp(regions.slice(1)),
      ...waysUp(regions.slice(0, 1), false),
    ]);
  }

  /**
   * Weigh quadrilaterals coarsely, and verify each that is promising.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {number | null} [count] - as `Watch.places` takes it; null for those that are proposed late
   */
  *#weighCoarsely(quads, count = null) {
    for (const quad of quads) {
      const { evidence, proposal } = yield* this.#proposer.weighCoarselySteps(quad, count);
      if (evidence > PROMISING) {
        const found = yield* this.#weighAndVerify(proposal);
        if (found !== null) return found;
      } else if (evidence > HINT) this.#hints.set(quad, { evidence, corners: proposal.corners });
    }
    return null;
  }

  /**
   * Fit the pilots to quadrilaterals, and verify each fit that is a hint.
   *
   * @param {Iterable<Point[]>} ways - the displayed picture's top left first; the likeliest first
   */
  *#fit(ways) {
    for (const corners of ways) {
      const fitted = yield* this.#proposer.firstFit(corners);
      if (fitted === null) continue;
      const { evidence, proposal } = this.#proposer.surestIn(fitted);
      yield COARSE_WORK;
      if (!(evidence > HINT)) continue;
      const found = yield* this.#verify(proposal, evidence);
      if (found !== null) return found;
    }
    return null;
  }

  /** Take what was weighed coarsely and is likeliest of what is less than promising. */
  #bestHints() {
    const hints = [...this.#hints.values()].sort((one, other) => other.evidence - one.evidence);
    this.#hints.clear();
    return hints.slice(0, HINTS).map(({ corners }) => corners);
  }

  /**
   * Weigh a proposal by all frames so far, and verify it.
   *
   * @param {Proposal} proposal
   */
  *#weighAndVerify(proposal) {
    const { evidence } = yield* weighSteps(proposal, this.watch.frames, this.watch.fps);
    return yield* this.#verify(proposal, evidence);
  }

  /**
   * Verify a proposal with this evidence in all frames so far, before it pays.
   *
   * @param {Proposal} proposal
   * @param {number} evidence
   */
  *#verify(proposal, evidence) {
    return yield* this.#goOn(verifySteps(proposal, evidence, this.watch));
  }

  /**
   * Verify a proposal until it needs a frame that has yet to come; then it waits.
   *
   * @param {Steps<Detection | null>} verification
   * @returns {Steps<Detection | null>}
   */
  *#goOn(verification) {
    for (;;) {
      const step = verification.next();
      this.isSettling = !step.done && step.value !== NEXT_FRAME;
      if (step.done) {
        this.#waiting = this.#waiting.filter((each) => each !== verification);
        return step.value;
      }
      if (!this.isSettling) {
        if (!this.#waiting.includes(verification)) this.#waiting.push(verification);
        return null;
      }
      yield step.value;
    }
  }
}
