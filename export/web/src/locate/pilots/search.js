/**
 * Find a display by its pilots, over some frames of a film: nothing visible marks it.
 *
 * The frames of some tenths of a second are held still against the camera's motion (`stabilise.js`). Two sources propose where
 * the display may be: the edges of the first frame, and what toggles (`toggleMap.js`). Corners then
 * move to where the pilots fit the grid (`corners.js`), and the display is believed if its blocks
 * toggle with the pilots' signs beyond doubt (`evidence.js`). That also tells which way up it is
 * and which of several grids it shows.
 *
 * The work is cut into steps, one for each frame, so that no frame takes long. Edges are sought
 * before frames are watched, as no frame may be missed while they are. What a frame shows of a
 * proposal's pilots is kept, not the image of the proposal.
 */

import { roundHalfEven } from "../../image/round.js";
import { transform } from "../../link/geometry.js";
import { identity } from "../../link/linear.js";
import { candidateSteps } from "../candidates.js";
import { rolled } from "../quads.js";
import { climbToPilots } from "./climb.js";
import { COARSE_SIZE, MANY, coarseShift, fineShift, mapSize, movedCorners } from "./corners.js";
import { blockMeans, pilotEvidence, pilotSigns, pilotValues, standingOut } from "./evidence.js";
import { FilmFrame, amplitudes } from "./film.js";
import { Stabiliser } from "./stabilise.js";
import { ToggleMap } from "./toggleMap.js";

/** @typedef {import("../../image/opencv.js").Plane<Uint8Array>} BytePlane */
/** @typedef {import("../../image/opencv.js").Plane<Float32Array>} FloatPlane */
/** @typedef {import("../../link/geometry.js").Homography} Homography */
/** @typedef {import("../../link/geometry.js").Point} Point */
/** @typedef {import("../../link/layout.js").Layout} Layout */
/** @typedef {import("./partMatches.js").Amplitudes} Amplitudes */

/** Number of quadrilaterals made of edges that are watched at once. */
export const CANDIDATES = 6;
/** Units of work (`../steps.js`) of the search for edges that one frame takes. */
export const EDGE_WORK = 30;
/** Time, in seconds, for which a room is watched before what toggles is outlined. */
export const WINDOW_S = 0.4;
/** Smallest number of frames that are watched: quick cameras see more of less light. */
export const LEAST_WINDOW = 24;
/** Largest number of frames that are watched. */
export const MOST_WINDOW = 48;
/**
 * Smallest evidence, after paying for everything that was tried, at which a display is found: the
 * natural logarithm of one false alarm in some ten million searches.
 */
export const SURE = 16.0;
/** Share of the number of pilots that is enough where it is less: few cannot bring so much. */
export const SURE_SHARE = 0.5;
/**
 * Number of quadrilaterals, turns, layouts and rounds that a search may try, for which evidence
 * pays.
 */
export const TRIALS = 500;
/**
 * Number of quadrilaterals that moving corners by the sum over the pilots may try, for which
 * evidence pays, too.
 */
export const CLIMB_TRIALS = 500;
/** Evidence from which on a display is believed at once; with less, later frames must agree. */
export const CERTAIN = 35.0;
/** Share of the number of pilots that is enough to be believed at once, where it is less. */
export const CERTAIN_SHARE = 0.75;
/** Evidence, before it pays for anything, that later frames must bring where they must agree. */
export const CONFIRMED = 9.0;
/**
 * Numbers of states a second at which what toggles is outlined; where edges bound the display, it
 * is found at any rate.
 */
export const STATES_HZ = [15.0, 30.0, 60.0, 120.0];
/** Evidence of a quadrilateral, before it pays, at which its corners are refined at once. */
export const PROMISING = 9.0;
/** Largest number of times that corners are moved by parts of the display. */
export const COARSE_ROUNDS = 5;
/** Largest number of times that corners are moved by the sum over the display's pilots. */
export const CLIMB_ROUNDS = 2;
/** Largest number of times that corners are moved by all of the display. */
export const FINE_ROUNDS = 2;
/** Distance, in layout pixels, below which a coarse move is the last one. */
export const SETTLED_PX = 3.0;
/** Number of frequencies whose power is worked out in one step. */
const POWERS_AT_ONCE = 3;

/**
 * A display that its pilots have given away: the layout that it shows, one of those that were
 * looked for; its corners in the newest frame, from the top left of the displayed picture on; and
 * the natural logarithm of the odds against chance, after paying for everything that was tried.
 *
 * @typedef {{ layout: Layout, corners: Point[], evidence: number }} PilotDisplay
 */

/**
 * Where a display may be: corners in the reference frame, the displayed picture's top left first;
 * what it may show; and the frequency at which it may toggle, in periods for each frame.
 *
 * @typedef {{ corners: Point[], layout: Layout, frequency: number }} Proposal
 */

/** @typedef {{ proposal: Proposal, evidence: number }} Found */

/** Work in steps: each gives null, or at last what is found. @typedef {Generator<Found | null>} Work */

/**
 * A layout and what is known of it: the pilots' signs, the expected changes of all blocks, and
 * these for a display that is upside down.
 *
 * @typedef {{ layout: Layout, signs: Float64Array, blocks: Float64Array, turned: Float64Array }}
 *   Known
 */

/** Looks for a display that shows one of several layouts with pilots. */
export class PilotSearch {
  #stabiliser = new Stabiliser();
  /** @type {BytePlane | null} */
  #reference = null;
  /** @type {import("../steps.js").Steps<{ corners: Point[] }[]> | null} */
  #edges = null;
  /** Quadrilaterals that are watched; null while edges are sought. @type {Watched[] | null} */
  #watched = null;
  /** @type {FilmFrame[]} */
  #frames = [];
  /** @type {FilmFrame | null} */
  #newest = null;
  #map = new ToggleMap(0, 0, 0);
  /** @type {Proposal[]} */
  #proposed = [];
  /** @type {Work | null} */
  #work = null;

  /**
   * @param {readonly Layout[]} layouts - those that are looked for, at least one, each with pilots
   * @param {number} [fps] - frames of the camera in a second
   */
  constructor(layouts, fps = 30) {
    if (layouts.length === 0 || layouts.some((layout) => layout.pilotBlocks.length === 0)) {
      throw new Error("layouts: need at least one, each with pilots");
    }
    this.layouts = [...layouts];
    /** @type {Known[]} */
    this.known = layouts.map((layout) => {
      const signs = pilotSigns(layout);
      const blocks = expectedChanges(layout);
      return { layout, signs, blocks, turned: blocks.slice().reverse() };
    });
    this.largest = layouts.reduce((most, layout) =>
      layout.width * layout.height > most.width * most.height ? layout : most,
    );
    /** Number of frames that are watched. */
    this.window = Math.min(MOST_WINDOW, Math.max(LEAST_WINDOW, roundHalfEven(WINDOW_S * fps)));
    /** Number of frames from one weighing of the evidence to the next. */
    this.checkEvery = Math.floor(this.window / 4);
    /** Number of later frames that must agree. */
    this.confirming = Math.floor((2 * this.window) / 3);
    const periods = STATES_HZ.map((rate) => (rate / 2 / fps) % 1);
    const folded = periods.map((period) => Math.min(period, 1 - period));
    /** Frequencies at which displays may toggle, in periods for each frame. */
    this.frequencies = [...new Set(folded)].filter((period) => period > 0).sort((a, b) => a - b);
  }

  /**
   * Take the next frame.
   *
   * @param {BytePlane} gray - a copy is kept where it is needed
   * @returns {PilotDisplay | null} the display once it is sure
   */
  push(gray) {
    const H = this.#stabiliser.follow(gray);
    if (H === null) {
      this.#begin(gray);
      return null;
    }
    if (this.#watched === null) {
      this.#watched = this.#proposeEdges();
      if (this.#watched === null) return null;
    }
    this.#newest = new FilmFrame(gray, H);
    if (this.#frames.length < this.window) this.#watch(gray, H, this.#watched);
    if (this.#work === null) return null;
    const step = this.#work.next();
    this.#newest = null;
    if (step.done) {
      this.#stabiliser.forget();
      return null;
    }
    if (step.value === null) return null;
    const { proposal, evidence } = step.value;
    this.#stabiliser.forget();
    return { layout: proposal.layout, corners: transform(H, proposal.corners), evidence };
  }

  /** @param {BytePlane} gray - from which the search begins anew */
  #begin(gray) {
    this.#stabiliser.begin(gray);
    this.#reference = copyOf(gray);
    this.#edges = null;
    this.#watched = null;
    this.#frames = [];
    this.#proposed = [];
    this.#work = null;
  }

  /**
   * Go on to seek quadrilaterals of edges in the reference, now that the film can be held still.
   *
   * @returns {Watched[] | null} those that are watched from now on; null where it takes longer
   */
  #proposeEdges() {
    if (this.#reference === null) return null;
    this.#edges ??= candidateSteps(this.#reference, CANDIDATES);
    for (let work = 0; work < EDGE_WORK; ) {
      const step = this.#edges.next();
      if (!step.done) {
        work += step.value;
        continue;
      }
      this.#edges = null;
      this.#reference = null;
      const { width, height } = this.#stabiliser;
      this.#map = new ToggleMap(width, height, this.window);
      const quads = step.value.flatMap(({ corners }) => [corners, rolled(corners, 1)]);
      return quads.map((corners) => new Watched(corners, this.known, this.largest));
    }
    return null;
  }

  /**
   * Record what this frame shows, and propose what looks promising after some frames.
   *
   * @param {BytePlane} gray
   * @param {Homography} H - to the frame from the reference
   * @param {Watched[]} watched
   */
  #watch(gray, H, watched) {
    const frame = new FilmFrame(copyOf(gray), H);
    this.#frames.push(frame);
    this.#map.add(this.#stabiliser.still(gray, H));
    for (const quad of watched) quad.take(frame);
    const count = this.#frames.length;
    const every = this.checkEvery;
    if (this.#work === null && count >= 2 * every && count % every === 0) {
      this.#proposeWatched(watched);
    }
    if (this.#work === null && (this.#proposed.length || count === this.window)) {
      this.#work = this.#settleAll(watched);
    }
  }

  /**
   * Propose the quadrilateral of edges that toggles most surely, where any is promising.
   *
   * @param {Watched[]} watched
   */
  #proposeWatched(watched) {
    let most = PROMISING;
    let best = null;
    for (const quad of watched) {
      for (const { proposal, evidence } of quad.proposals()) {
        if (!(evidence > most)) continue;
        most = evidence;
        best = proposal;
      }
    }
    if (best !== null) this.#proposed.push(best);
  }

  /**
   * Settle one proposal after another.
   *
   * @param {Watched[]} watched
   * @returns {Work}
   */
  *#settleAll(watched) {
    for (let proposal; (proposal = this.#proposed.shift()); ) yield* this.#settle(proposal);
    while (this.#frames.length < this.window) yield null;
    const quads = [];
    for (const frequency of this.frequencies) {
      let powers = 0;
      for (const _ of this.#map.prepare(frequency)) if (++powers % POWERS_AT_ONCE === 0) yield null;
      const outline = this.#map.outline(frequency);
      yield null;
      if (outline !== null) quads.push(this.#stabiliser.onImage(outline));
    }
    quads.push(...watched.filter((_, i) => i % 2 === 0).map(({ corners }) => corners));
    for (const turn of [0, 1]) {
      for (const quad of quads) {
        const proposal = yield* this.#firstFit(rolled(quad, turn));
        yield null;
        if (proposal !== null) yield* this.#settle(proposal);
      }
    }
  }

  /**
   * Fit every layout, upright and upside down, to a quadrilateral.
   *
   * @param {Point[]} quad
   * @returns {Generator<null, Proposal | null>} the best, if any fits
   */
  *#firstFit(quad) {
    const views = viewsOf(quad, this.largest, this.#frames, COARSE_SIZE);
    if (views === null) return null;
    let most = 0;
    let best = null;
    const lines = amplitudes(views, this.frequencies);
    for (const [i, frequency] of this.frequencies.entries()) {
      if (i > 0) yield null;
      for (const { layout, blocks, turned } of this.known) {
        for (const turn of [0, 2]) {
          const fit = coarseShift(lines[i], turn ? turned : blocks, layout, true);
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
   * Move corners to where the pilots fit the grid.
   *
   * @param {Proposal} proposal
   * @returns {Work}
   */
  *#settle(proposal) {
    const { layout, frequency } = proposal;
    const frames = [...this.#frames];
    const blocks = expectedChanges(layout);
    const signs = pilotSigns(layout);
    let corners = proposal.corners;
    let clear = 0;
    for (let round = 0; round < COARSE_ROUNDS; round++) {
      const views = viewsOf(corners, layout, frames, COARSE_SIZE);
      const fit = views && coarseShift(amplitudes(views, [frequency])[0], blocks, layout);
      yield null;
      clear = fit === null ? 0 : fit.parts;
      if (fit === null) break;
      const moved = movedCorners(corners, fit.HOldFromNew, layout);
      const far = farthestMove(corners, moved);
      corners = moved;
      if (clear >= MANY && far < SETTLED_PX) break;
    }
    let tried = TRIALS;
    // the whole may be clearer than its parts
    for (let round = clear < MANY ? 0 : CLIMB_ROUNDS; round < CLIMB_ROUNDS; round++) {
      const views = viewsOf(corners, layout, frames, mapSize(layout));
      if (views === null) break;
      const climbed = climbToPilots(amplitudes(views, [frequency])[0], layout);
      yield null;
      corners = movedCorners(corners, climbed, layout);
      tried = TRIALS * CLIMB_TRIALS;
    }
    for (let round = 0; round < FINE_ROUNDS; round++) {
      const views = viewsOf(corners, layout, frames, mapSize(layout));
      if (views === null) break;
      const change = inPhase(amplitudes(views, [frequency])[0], layout, signs);
      const shift = fineShift(change, blocks, layout);
      yield null;
      if (shift === null) break;
      corners = movedCorners(corners, shift, layout);
    }
    // in a dark picture parts may have been matched amiss
    let settled = proposal;
    let evidence = -Infinity;
    for (const move of [proposal, { ...proposal, corners }]) {
      const found = evidenceOf(move, frames) - Math.log(tried);
      if (!(found > evidence)) continue;
      evidence = found;
      settled = move;
    }
    if (evidence < Math.min(SURE, SURE_SHARE * signs.length)) {
      yield null;
      return;
    }
    if (evidence < Math.min(CERTAIN, CERTAIN_SHARE * signs.length)) {
      // corners were fitted to these frames; later ones must agree
      const later = [];
      while (later.length < this.confirming) {
        yield null;
        const values = this.#newest && valuesOf(settled, this.#newest);
        if (values === null) return;
        later.push(values);
      }
      if (pilotEvidence(later, signs).evidence < CONFIRMED) return;
    }
    yield { proposal: settled, evidence };
  }
}

/** A quadrilateral, and how its pilots toggle where it is the display. */
class Watched {
  /**
   * @param {Point[]} corners - in the reference frame
   * @param {Known[]} known - layouts that it may show
   * @param {Layout} largest - of these
   */
  constructor(corners, known, largest) {
    this.corners = corners;
    this.largest = largest;
    /** For each layout and turn, the pilots' values in each frame. */
    this.guesses = known.flatMap(({ layout, signs }) =>
      [0, 2].map((turn) => ({ layout, signs, turn, values: /** @type {Float32Array[]} */ ([]) })),
    );
  }

  /**
   * Take the next frame.
   *
   * @param {FilmFrame} frame
   */
  take(frame) {
    const { corners, largest, guesses } = this;
    const view = frame.view(corners, largest, largest.width >> 1, largest.height >> 1);
    /** @type {Layout | null} */
    let last = null;
    /** @type {Float32Array} */
    let blocks = new Float32Array(0);
    for (const { layout, turn, values } of guesses) {
      if (layout !== last) blocks = view ? standingOut(view, layout) : new Float32Array(0);
      last = layout;
      const end = turn ? layout.rows * layout.cols - 1 : 0;
      values.push(
        Float32Array.from(layout.pilotBlocks, (block) => blocks[Math.abs(end - block)] ?? 0),
      );
    }
  }

  /**
   * Say for each layout and turn how surely it is what the display shows.
   *
   * @returns {{ proposal: Proposal, evidence: number }[]}
   */
  proposals() {
    return this.guesses.map(({ layout, signs, turn, values }) => {
      const { evidence, frequency } = pilotEvidence(values, signs);
      return { proposal: { corners: rolled(this.corners, turn), layout, frequency }, evidence };
    });
  }
}

/**
 * List the expected changes of the blocks: the pilots' signs, 0 elsewhere.
 *
 * @param {Layout} layout
 * @returns {Float64Array} (rows * cols,)
 */
function expectedChanges(layout) {
  const blocks = new Float64Array(layout.rows * layout.cols);
  const signs = pilotSigns(layout);
  layout.pilotBlocks.forEach((block, i) => (blocks[block] = signs[i]));
  return blocks;
}

/**
 * Rectify all frames to maps of a size.
 *
 * @param {Point[]} corners - in the reference frame
 * @param {Layout} layout
 * @param {readonly FilmFrame[]} frames
 * @param {[number, number]} size - width and height
 * @returns {FloatPlane[] | null} null where corners are not sound
 */
function viewsOf(corners, layout, frames, [width, height]) {
  const views = [];
  for (const frame of frames) {
    const view = frame.view(corners, layout, width, height);
    if (view === null) return null;
    views.push(view);
  }
  return views;
}

/**
 * Turn amplitudes so that the pilots' own are real, with the pilots' signs.
 *
 * @param {Amplitudes} line
 * @param {Layout} layout
 * @param {Float64Array} signs
 * @returns {FloatPlane} the real part
 */
function inPhase({ width, height, real, imaginary }, layout, signs) {
  const across = signedSum({ width, height, data: real }, layout, signs);
  const up = signedSum({ width, height, data: imaginary }, layout, signs);
  const turn = Math.atan2(up, across);
  const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
  const data = real.map((value, i) => value * cosine + imaginary[i] * sine);
  return { width, height, data };
}

/**
 * @param {FloatPlane} map
 * @param {Layout} layout
 * @param {Float64Array} signs
 * @returns {number} the sum of the pilots' means, with their signs
 */
function signedSum(map, layout, signs) {
  const blocks = blockMeans(map, layout).data;
  return layout.pilotBlocks.reduce((sum, block, i) => sum + signs[i] * blocks[block], 0);
}

/**
 * Find the evidence of a proposal, before it pays for what was tried.
 *
 * @param {Proposal} proposal
 * @param {readonly FilmFrame[]} frames
 * @returns {number} 0 where its corners are not sound
 */
function evidenceOf(proposal, frames) {
  const values = [];
  for (const frame of frames) {
    const now = valuesOf(proposal, frame);
    if (now === null) return 0;
    values.push(now);
  }
  return pilotEvidence(values, pilotSigns(proposal.layout)).evidence;
}

/**
 * Find by how much the pilots of a proposal stand out in a frame.
 *
 * @param {Proposal} proposal
 * @param {FilmFrame} frame
 * @returns {Float32Array | null} null where its corners are not sound
 */
function valuesOf({ corners, layout }, frame) {
  const view = frame.view(corners, layout, layout.width >> 1, layout.height >> 1);
  return view && pilotValues(view, layout);
}

/**
 * @param {Point[]} from
 * @param {Point[]} to
 * @returns {number} the largest distance of two points, pixels
 */
function farthestMove(from, to) {
  return Math.max(...from.map(([x, y], i) => Math.hypot(to[i][0] - x, to[i][1] - y)));
}

/**
 * @param {BytePlane} plane
 * @returns {BytePlane}
 */
function copyOf({ width, height, data }) {
  return { width, height, data: data.slice() };
}
