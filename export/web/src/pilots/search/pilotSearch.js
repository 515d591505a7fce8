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
 * one that moves, as a video does, and holds the room still alone. The first searches are given up
 * early: perhaps the display came into view, or began to play, only after the frames that they look
 * at.
 *
 * The work is cut into steps (`../steps.js`), so that no frame takes long; Python's steps are one
 * for each frame, these are finer.
 */

import { pilotsSearchPilotSearch } from "../../generated/constants.js";
import { cv, bytePlane, matOf, withMats } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { inImage, transform } from "../../link/geometry.js";
import { identity } from "../../link/linear.js";
import { candidateSteps } from "../../locate/candidates.js";
import { rolled } from "../../locate/quads.js";
import { movedCorners } from "../motion.js";
import { expectedChanges } from "../signal.js";
import { Stabiliser } from "../stabilise.js";
import { position } from "../waves.js";
import { FilmFrame, amplitudes } from "./film.js";
import { COARSE_SIZE, coarseShift } from "./parts.js";
import { VIEW_WORK, Watched, evidenceSteps, positions } from "./proposals.js";
import { HINT, NEXT_FRAME, settleSteps } from "./settle.js";
import { ToggleMap } from "./toggleMap.js";

/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./settle.js").Settled} Settled */

export const {
  CANDIDATES, FAINT_CANDIDATES, WINDOW_S, LEAST_WINDOW, MOST_WINDOW, STATES_HZ, PATIENCE_S,
  MOST_DOUBLED, IN_VIEW, HELD_S, LEAST_HELD, PROMISING,
} = pilotsSearchPilotSearch;

/** Number of places along each side of the reference frame that are looked for in the newest one. */
const CHECKED = 8;
/** Units of work (`../steps.js`) from which on a frame has had its share. */
export const FRAME_WORK = 36;
/**
 * Time, in milliseconds, after which a frame of a camera that does not wait has had its share, too:
 * the first frames take many times as long, as code is compiled while it runs.
 */
export const FRAME_MS = 60;
/** Share of this time after which a frame that is only watched is done, so that none is missed. */
const SPARE_SHARE = 0.35;
/** Number of nominal frames from one frame to the next above which a frame is missing. */
export const MISSING = 1.5;
/** Units of work of the power at one frequency, and of an outline. */
const POWER_WORK = 10;
const OUTLINE_WORK = 20;
/** Units of work of a layout's fit, and of weighing the evidence of a quadrilateral. */
const FIT_WORK = 4;
const SURE_WORK = 1;
const WEIGH_WORK = 6;
/** Units of work of a glance at a quadrilateral. */
const GLANCE_WORK = 10;

/**
 * A display that its pilots have given away: the layout that it shows, one of those that were
 * looked for; its corners in the newest frame, from the top left of the displayed picture on; the
 * natural logarithm of the odds against chance, after paying for everything that was tried; its
 * corners in the frame with which the search began; the coefficient of the lens; and the frames
 * before the newest one, from the oldest on, of those that are kept.
 *
 * @typedef {{
 *   layout: Layout,
 *   corners: Point[],
 *   evidence: number,
 *   firstCorners: Point[],
 *   k: number,
 *   held: FilmFrame[],
 * }} PilotDisplay
 */

/** Looks for a display that shows one of several layouts with pilots. */
export class PilotSearch {
  /** Whether displays are looked for whose picture moves (`doubtPicture`). */
  pictureMoves = false;
  #stabiliser = new Stabiliser();
  /** Whether frames were missing, as happens where a camera does not wait for the search. */
  #isLate = false;
  /** Time of the newest frame, seconds. */
  #last = NaN;
  /** Time of the frame from which the search began, seconds. */
  #start = 0;
  /** From which the search began. @type {BytePlane} */
  #reference = { width: 0, height: 0, data: new Uint8Array(0) };
  /** Number of searches in vain since a display was found. */
  #failed = 0;
  /** Number of frames seen since the reference. */
  #seen = 0;
  /** Largest evidence of a quadrilateral in this search, before it pays. */
  #surestSeen = 0;
  /** Until when the newest frame has time for what need not be now, milliseconds. */
  #spareUntil = Infinity;
  /** The newest frame, while `push` runs. @type {FilmFrame | null} */
  #newest = null;
  /** Quadrilaterals of edges, watched in each frame; none before they were sought. @type {Watched[]} */
  #watched = [];
  /** The same, a quarter turn on, watched where there is time, else later. @type {Watched[]} */
  #turned = [];
  /** What toggles; null until frames are watched. @type {ToggleMap | null} */
  #map = null;
  /** @type {FilmFrame[]} */
  #frames = [];
  /** The newest frames, which a display that is found is read in, too. @type {FilmFrame[]} */
  #held = [];
  /** @type {Steps<Settled | null> | null} */
  #work = null;

  /**
   * @param {readonly Layout[]} layouts - those that are looked for, at least one, each with pilots
   * @param {number} [fps] - nominal number of frames of the camera in a second; some may be missing
   * @param {number} [frameMs] - time after which no step is begun with a frame, milliseconds, such
   *   as `FRAME_MS`; of films, which wait, it counts only until quadrilaterals are watched
   */
  constructor(layouts, fps = 30, frameMs = Infinity) {
    if (layouts.length === 0 || layouts.some((layout) => layout.pilotBlocks.length === 0)) {
      throw new Error("layouts: need at least one, each with pilots");
    }
    this.layouts = [...layouts];
    this.fps = fps;
    this.frameMs = frameMs;
    this.largest = layouts.reduce((most, layout) =>
      layout.width * layout.height > most.width * most.height ? layout : most,
    );
    this.finest = layouts.reduce((most, layout) =>
      layout.rows * layout.cols > most.rows * most.cols ? layout : most,
    );
    /** Number of frames that are watched. */
    this.window = Math.min(MOST_WINDOW, Math.max(LEAST_WINDOW, roundHalfEven(WINDOW_S * fps)));
    /** Number of frames from one weighing of the evidence to the next. */
    this.checkEvery = Math.floor(this.window / 4);
    /** Number of later frames that must agree with what is not certain. */
    this.confirming = Math.floor((2 * this.window) / 3);
    /** Number of frames that are kept. */
    this.most = Math.max(LEAST_HELD, roundHalfEven(HELD_S * fps));
    const periods = STATES_HZ.map((rate) => (rate / 2 / fps) % 1);
    const folded = periods.map((period) => Math.min(period, 1 - period));
    /** Frequencies at which displays may toggle, in periods for each nominal frame. */
    this.frequencies = [...new Set(folded)].filter((period) => period > 0).sort((a, b) => a - b);
  }

  /**
   * Take the next frame.
   *
   * @param {BytePlane} gray - it may be kept, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {PilotDisplay | null} the display once it is sure
   */
  push(gray, time) {
    const now = performance.now();
    const until = now + this.frameMs;
    if ((time - this.#last) * this.fps > MISSING) this.#isLate = true;
    this.#spareUntil = this.#isLate ? now + SPARE_SHARE * this.frameMs : Infinity;
    this.#last = time;
    let H = this.#stabiliser.follow(gray);
    if (H !== null && !isInView(H, gray)) {
      this.#giveUp();
      H = null;
    }
    if (H === null) {
      this.#stabiliser.begin(gray, this.pictureMoves);
      this.#reference = gray;
      this.#start = time;
      this.#forget();
      this.#held = [new FilmFrame(gray, identity(3), 0, time)];
      return null;
    }
    const at = position(time - this.#start, this.fps);
    const newest = new FilmFrame(gray, H, at, time, this.#stabiliser.tracks);
    this.#newest = newest;
    this.#held.push(newest);
    if (this.#held.length > this.most) this.#held.shift();
    this.#seen++;
    if (this.#map !== null && this.#frames.length < this.window) this.#watch(this.#map);
    this.#work ??= this.#search();
    let work = 0;
    while (work < FRAME_WORK) {
      const step = this.#work.next();
      if (!step.done) {
        work += step.value;
        if ((this.#isLate || this.#map === null) && performance.now() >= until) break;
        continue;
      }
      if (step.value === null) return this.#fail();
      this.#stabiliser.forget();
      this.#forget();
      this.#failed = 0;
      const { proposal, evidence, k } = step.value;
      const { layout, corners } = proposal;
      const held = this.#held.slice(0, -1);
      this.#held = [];
      return { layout, corners: newest.corners(corners), evidence, firstCorners: corners, k, held };
    }
    this.#newest = null;
    const patience = PATIENCE_S * 2 ** Math.min(Math.floor(this.#failed / 2), MOST_DOUBLED);
    return this.#seen > patience * this.fps ? this.#fail() : null;
  }

  /** Choose how the next search begins after one in vain. */
  #giveUp() {
    this.pictureMoves = !this.pictureMoves && this.#surestSeen > PROMISING;
  }

  /** End a search in vain. */
  #fail() {
    this.#giveUp();
    this.#failed++;
    this.#stabiliser.forget();
    this.#forget();
    return null;
  }

  /** Take the picture for one that moves, or no longer for one, from the next search on. */
  doubtPicture() {
    this.pictureMoves = !this.pictureMoves;
  }

  /** Give up what is known of the frames so far. */
  #forget() {
    this.#newest = null;
    this.#watched = [];
    this.#turned = [];
    this.#map = null;
    this.#frames = [];
    this.#work = null;
    this.#seen = 0;
    this.#surestSeen = 0;
  }

  /**
   * Record what the newest frame shows, and propose what looks promising after some frames.
   *
   * @param {ToggleMap} map
   */
  #watch(map) {
    const frame = this.#given();
    const { gray, HFrameFromReference: H, at } = frame;
    this.#frames.push(frame);
    map.add(this.#stabiliser.still(gray, H), at);
    for (const quad of this.#watched) this.#showNext(quad);
  }

  /**
   * Let a quadrilateral take what it shows in the first frame that it was not shown yet.
   *
   * @param {Watched} quad
   * @returns {boolean} false where it has been shown all frames
   */
  #showNext(quad) {
    const frame = this.#frames.at(quad.at.length);
    if (frame === undefined) return false;
    const { width, height } = this.largest;
    quad.take(frame.view(quad.corners, this.largest, width >> 1, height >> 1), frame.at);
    return true;
  }

  /**
   * Look for the display in the film that follows the reference.
   *
   * @returns {Steps<Settled | null>}
   */
  *#search() {
    const edges = yield* candidateSteps(this.#reference, CANDIDATES);
    const ways = [0, 1].map((turn) =>
      edges.map(({ corners }) => new Watched(rolled(corners, turn), this.layouts)),
    );
    [this.#watched, this.#turned] = ways;
    const map = new ToggleMap(this.#stabiliser.width, this.#stabiliser.height);
    yield WEIGH_WORK;
    this.#map = map;
    this.#watch(map);
    const proposal = yield* this.#promising();
    if (proposal !== null) {
      const evidence = yield* evidenceSteps(proposal, this.#frames);
      const found = yield* this.#settle(proposal, evidence);
      if (found !== null) return found;
    }
    while (this.#frames.length < this.window) yield NEXT_FRAME;
    const faint = yield* this.#faintEdges(map);
    const others = [];
    for (const frequency of this.frequencies) {
      for (const _ of map.prepare(frequency)) yield POWER_WORK;
      const outline = map.outline(frequency);
      yield OUTLINE_WORK;
      if (outline !== null) others.push(this.#stabiliser.onImage(outline));
    }
    others.push(...edges.map(({ corners }) => corners));
    const usual = [...faint.slice(0, CANDIDATES), ...others];
    const quads = [...usual, ...faint.slice(CANDIDATES)];
    const glances = [];
    for (const quad of quads) {
      glances.push(this.#glance(map, quad));
      yield GLANCE_WORK;
    }
    const hints = glances.filter(({ evidence }) => evidence > HINT);
    for (const { proposal: hint } of hints.sort((one, other) => other.evidence - one.evidence)) {
      const evidence = yield* evidenceSteps(hint, this.#frames);
      const found = yield* this.#settle(hint, evidence);
      if (found !== null) return found;
    }
    const evidences = glances.map(({ evidence }) => evidence);
    const doubtful = [];
    for (const number of this.#ranked(map, quads, evidences, usual.length)) {
      for (const turn of [0, 1]) {
        const fit = yield* this.#firstFit(map, rolled(quads[number], turn));
        if (fit === null) continue;
        const { evidence } = this.#surestIn(map, fit.corners, [fit.layout]);
        yield GLANCE_WORK;
        if (!(evidence > HINT)) {
          doubtful.push({ fit, evidence });
          continue;
        }
        const found = yield* this.#settle(fit, evidence);
        if (found !== null) return found;
      }
    }
    for (const { fit, evidence } of doubtful.sort((one, other) => other.evidence - one.evidence)) {
      const found = yield* this.#settle(fit, evidence);
      if (found !== null) return found;
    }
    return null;
  }

  /**
   * Weigh a quadrilateral, any side up, by small views of what toggles in it.
   *
   * @param {ToggleMap} map
   * @param {Point[]} quad
   * @returns {{ evidence: number, proposal: Proposal }} the evidence, before it pays, and what it
   *   speaks for
   */
  #glance(map, quad) {
    const ways = [0, 1].map((turn) => this.#surestIn(map, rolled(quad, turn), this.layouts));
    return ways[0].evidence >= ways[1].evidence ? ways[0] : ways[1];
  }

  /**
   * Choose the layout, upright or upside down, whose pilots toggle most surely in small views.
   *
   * @param {ToggleMap} map
   * @param {Point[]} corners - in the reference frame
   * @param {readonly Layout[]} layouts - those that may be shown
   */
  #surestIn(map, corners, layouts) {
    const { rows, cols } = this.finest;
    const watched = new Watched(corners, layouts);
    const views = map.views(this.#stabiliser.onCopy(corners), cols, rows);
    const at = positions(this.#frames);
    views.forEach((view, i) => watched.take(view, at[i]));
    return watched.surest();
  }

  /**
   * Choose the quadrilaterals to which the pilots are fitted, and their order.
   *
   * Those for which a first glance speaks most come by turns with those that best bound what
   * toggles.
   *
   * @param {ToggleMap} map
   * @param {Point[][]} quads
   * @param {number[]} evidences - of each at a first glance
   * @param {number} usual - number of quadrilaterals, from the first on, that are tried in any case
   * @returns {number[]} numbers of quadrilaterals
   */
  #ranked(map, quads, evidences, usual) {
    const worths = map.worths(quads.map((quad) => this.#stabiliser.onCopy(quad)));
    const most = (/** @type {number[]} */ values) =>
      [...quads.keys()].sort((i, k) => values[k] - values[i]).slice(0, CANDIDATES);
    const bounding = most(worths).filter((i) => worths[i] > 0);
    const byTurns = most(evidences).flatMap((i, turn) =>
      turn < bounding.length ? [i, bounding[turn]] : [i],
    );
    return [...new Set([...byTurns, ...Array(usual).keys()])];
  }

  /**
   * Wait until a quadrilateral of edges toggles promisingly, or the window is full.
   *
   * @returns {Steps<Proposal | null>} the one that toggles most surely
   */
  *#promising() {
    for (;;) {
      const count = this.#frames.length;
      if (count >= 2 * this.checkEvery && count % this.checkEvery === 0) {
        for (const quads of [this.#watched, this.#turned]) {
          const best = yield* this.#surest(quads);
          if (best !== null) return best;
        }
      }
      if (count >= this.window) return null;
      for (const quad of this.#turned) {
        while (performance.now() < this.#spareUntil && this.#showNext(quad)) yield VIEW_WORK;
      }
      yield NEXT_FRAME;
    }
  }

  /**
   * Choose the quadrilateral that toggles most surely over the frames so far.
   *
   * @param {readonly Watched[]} quads - those that have not been shown all frames are shown the rest
   * @returns {Steps<Proposal | null>} null where none is promising
   */
  *#surest(quads) {
    let most = PROMISING;
    let best = null;
    for (const quad of quads) {
      while (this.#showNext(quad)) yield VIEW_WORK;
      const { evidence, proposal } = quad.surest();
      yield SURE_WORK;
      if (!(evidence > most)) continue;
      most = evidence;
      best = proposal;
    }
    return best;
  }

  /**
   * Propose quadrilaterals in the mean of all frames, its levels spread over the whole range.
   *
   * The mean has less noise than a frame, and its histogram, made even, shows the edges of a dark
   * picture in a dark frame.
   *
   * @param {ToggleMap} map
   * @returns {Steps<Point[][]>}
   */
  *#faintEdges(map) {
    const even = withMats((keep) => {
      const mean = keep(matOf(map.mean()));
      cv.equalizeHist(mean, mean);
      return bytePlane(mean);
    });
    const found = yield* candidateSteps(even, FAINT_CANDIDATES);
    return found.map(({ corners }) => this.#stabiliser.onImage(corners));
  }

  /**
   * Fit every layout, upright and upside down, to a quadrilateral that may be far off.
   *
   * @param {ToggleMap} map
   * @param {Point[]} quad
   * @returns {Steps<Proposal | null>} what fits best after a shift, or null where nothing does
   */
  *#firstFit(map, quad) {
    const views = map.views(this.#stabiliser.onCopy(quad), ...COARSE_SIZE);
    yield GLANCE_WORK;
    const lines = amplitudes(views, positions(this.#frames), this.frequencies);
    yield WEIGH_WORK;
    let most = 0;
    let best = null;
    for (const [i, frequency] of this.frequencies.entries()) {
      for (const layout of this.layouts) {
        const blocks = expectedChanges(layout);
        for (const turn of [0, 2]) {
          const shown = turn ? blocks.slice().reverse() : blocks;
          const fit = coarseShift(lines[i], shown, layout, true);
          yield FIT_WORK;
          if (fit === null || fit.parts <= most) continue;
          most = fit.parts;
          const corners = rolled(movedCorners(quad, fit.HOldFromNew, layout), turn);
          best = { corners, layout, frequency };
        }
      }
    }
    return best;
  }

  /**
   * @param {Proposal} proposal
   * @param {number} evidence - of it in all frames so far
   * @returns {Steps<Settled | null>}
   */
  #settle(proposal, evidence) {
    this.#surestSeen = Math.max(this.#surestSeen, evidence);
    return settleSteps(proposal, evidence, this.#frames, this.confirming, () => this.#given());
  }

  /** The newest frame, which is there while `push` runs. */
  #given() {
    if (this.#newest === null) throw new Error("a step was taken outside of push");
    return this.#newest;
  }
}

/**
 * Tell whether enough of the reference frame is still in view.
 *
 * @param {ArrayLike<number>} HFrameFromReference
 * @param {BytePlane} frame - of the reference's size
 */
function isInView(HFrameFromReference, { width, height }) {
  const steps = [...Array(CHECKED).keys()].map((k) => (k + 0.5) / CHECKED);
  const places = steps.flatMap((y) =>
    steps.map((x) => /** @type {Point} */ ([x * width - 0.5, y * height - 0.5])),
  );
  const seen = inImage(transform(HFrameFromReference, places), width, height);
  return seen.filter(Boolean).length >= IN_VIEW * places.length;
}
