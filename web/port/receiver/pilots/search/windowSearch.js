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
  ANY_TURN, COARSE_WORK, LEAVING, NEXT_FRAME, PROMISING, Proposer, STRONGEST, weighSteps,
} from "./proposals.js";
import {
  aboutMiddle, likelyTurns, panelsOf, picturesIn, portraitBeyond, reachingBeyond, waysUp,
} from "./regions.js";
import { HINT, verifySteps } from "./settle.js";

/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./proposals.js").RegionMapper} RegionMapper */
/** @typedef {import("./settle.js").Detection} Detection */
/** @typedef {import("./watch.js").Watch} Watch */

const { PANEL_SHAPES, WITH_BARS } = receiverPilotsSearchRegions;
const {
  SURROUNDED, BOUNDING, PROPOSED, BEFORE_LEAVING, BARRED, COMPLETED, PLACED,
} = receiverPilotsSearchWindowSearch;
/** Units of work of beginning to follow what surrounds quadrilaterals. */
const SURROUND_WORK = 10;

/** Looks for a display in the frames that follow a reference frame. */
export class WindowSearch {
  #proposer;
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
   * After edges have first been weighed coarsely, and once the window is late, others are weighed, too.
   *
   * @returns {Steps<Detection | null>}
   */
  *#search() {
    const { watch } = this;
    const proposer = this.#proposer;
    const edges = yield* proposer.edges();
    watch.surround(edges.slice(0, SURROUNDED));
    yield SURROUND_WORK;
    const strongest = [...edges.slice(0, STRONGEST), ...proposer.partlySeen.slice(0, LEAVING)];
    const quarter = Math.floor(watch.window / 4);
    for (let count = watch.soon, seen = 0; seen < watch.window; count = seen + quarter) {
      while (watch.frames.length < Math.min(count, watch.window)) {
        for (const quad of strongest) watch.places(quad, watch.frames.length); // each frame its share
        yield NEXT_FRAME;
      }
      const isFirst = seen === 0;
      seen = watch.frames.length;
      const weighed = yield* this.#weighCoarsely(strongest, seen);
      this.hasLooked = true;
      const found = weighed ?? (isFirst ? yield* this.#others(edges) : null);
      if (found !== null) return found;
    }
    this.isLate = true;
    return yield* this.#others(edges);
  }

  /**
   * Weigh faint edges, and what is likeliest by a map of what toggles, and fit the pilots to the best of
   * it, first to what may leave the image. What costs least and what is likeliest comes first.
   *
   * @param {Point[][]} edges - quadrilaterals of edges, the strongest first
   * @returns {Steps<Detection | null>}
   */
  *#others(edges) {
    const proposer = this.#proposer;
    const [faint, ...withoutDetails] = proposer.faintEdges();
    const first = yield* faint;
    const strongest = [edges, first].map((quads) => quads.slice(0, STRONGEST));
    const early = yield* this.#weighCoarsely(strongest[1]);
    if (early !== null) return early;
    const { outlines: regions, leaving, portraits } = yield* proposer.regions(strongest.flat());
    const snapped = regions.length > 0 ? yield* proposer.snapped(regions[0]) : [];
    const bounding = proposer.likeliest([...edges, ...first], BOUNDING);
    const isLeaving = leaving.length > 0;
    const partly = picturesIn(isLeaving ? proposer.partlySeen.slice(0, LEAVING) : []);
    const between = picturesIn([...bounding.slice(0, 1), ...strongest.flatMap(panelsOf)]);
    const proposed = [...bounding, ...snapped, ...regions, ...between];
    const most = isLeaving ? BEFORE_LEAVING : PROPOSED;
    const { width, height } = this.watch.reference;
    const beyond = portraits.slice(0, 1).flatMap((part) => portraitBeyond(part, width, height));
    const bounded =
      (yield* this.#weighCoarsely(proposer.likeliest(proposed, most))) ??
      (yield* this.#fit(partly.slice(0, BARRED))) ??
      (yield* this.#weighCoarsely(portraits)) ??
      (yield* this.#fit([
        ...waysUp(beyond),
        ...waysUp([...leaving, ...regions.slice(0, 1), ...bounding.slice(0, 1)]),
      ]));
    if (bounded !== null) return bounded;
    const panels = isLeaving ? proposer.partlySeen.slice(0, COMPLETED) : [];
    const placed = panels.flatMap((each) => reachingBeyond(each, PANEL_SHAPES, width, height));
    const panel = yield* this.#fit(waysUp(proposer.likeliest(placed, PLACED, true)));
    if (panel !== null) return panel;
    for (const steps of withoutDetails) {
      const quads = yield* steps;
      const others = [...quads.slice(0, STRONGEST), ...proposer.likeliest(quads, BOUNDING)];
      const found = yield* this.#weighCoarsely(others);
      if (found !== null) return found;
    }
    return yield* this.#fit([
      ...between.slice(0, BARRED),
      ...regions.slice(0, 1).map((region) => aboutMiddle(region, 1, WITH_BARS)),
      ...waysUp(edges.slice(0, 1)),
      ...waysUp(regions.slice(0, 1), false),
    ]);
  }

  /**
   * Weigh quadrilaterals coarsely, and verify each that is promising. Quarter turns that are not likely
   * for a quadrilateral's shape come last.
   *
   * @param {Point[][]} quads - the likeliest first
   * @param {number | null} [count] - as `Watch.places` takes it; null for those that are proposed late
   */
  *#weighCoarsely(quads, count = null) {
    const ways = quads.flatMap((quad) => ANY_TURN.map((turn) => ({ quad, turn })));
    const isUnlikely = (/** @type {typeof ways[0]} */ { quad, turn }) =>
      !likelyTurns(quad).some((likely) => likely % 2 === turn);
    ways.sort((one, other) => Number(isUnlikely(one)) - Number(isUnlikely(other))); // a stable order
    for (const { quad, turn } of ways) {
      const { evidence, proposal } = this.#proposer.weighCoarsely(quad, turn, count);
      yield COARSE_WORK / 2;
      if (evidence > PROMISING) {
        const found = yield* this.#weighAndVerify(proposal);
        if (found !== null) return found;
      }
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
