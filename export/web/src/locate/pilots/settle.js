/** Move the corners of a proposal to where its pilots fit the grid, and say whether that is sure. */

import { BlockFit, BlockMaps, periodChangeSteps } from "./allBlocks.js";
import { climbToPilots } from "./climb.js";
import {
  COARSE_SIZE,
  MANY,
  coarseShift,
  expectedChanges,
  mapSize,
  movedCorners,
} from "./corners.js";
import { pilotEvidence } from "./evidence.js";
import { amplitudes } from "./film.js";
import { VIEW_WORK, evidenceSteps, positions, valueSteps, valuesOf, viewSteps } from "./proposals.js";

/** @typedef {import("../../link/geometry.js").Point} Point */
/** @typedef {import("./film.js").FilmFrame} FilmFrame */
/** @typedef {import("./proposals.js").Proposal} Proposal */

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
export const TRIALS = 1000;
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
/** Share of the evidence needed from which on later frames are waited for, to be weighed too. */
export const NEARLY = 0.5;
/** Evidence of a quadrilateral at which its corners are refined once all frames were seen. */
export const HINT = 6.0;
/** Evidence of a quadrilateral at which the sum over its pilots can lead its corners on. */
export const CLIMBABLE = 3.0;
/** Largest number of times that corners are moved by parts of the display. */
export const COARSE_ROUNDS = 5;
/** Largest number of times that corners are moved by the sum over the display's pilots. */
export const CLIMB_ROUNDS = 2;
/** Largest number of times that corners are moved by all blocks of the display. */
export const BLOCK_ROUNDS = 5;
/** Distance, in layout pixels, below which a coarse move is the last one. */
export const SETTLED_PX = 3.0;
/** More work (`../steps.js`) than a frame has room for: the next step needs the next frame. */
export const NEXT_FRAME = Infinity;
/** Units of work of measuring how a display toggles, and of a move of its corners. */
const MEASURE_WORK = 4;
const MOVE_WORK = 6;

/**
 * A display that is sure: where it is in the reference frame, and the natural logarithm of the odds
 * against chance, after paying for everything that was tried.
 *
 * @typedef {{ proposal: Proposal, evidence: number }} Settled
 */

/**
 * A way to move the corners of a proposal, in the reference frame, step by step.
 *
 * @typedef {(
 *   proposal: Proposal,
 *   frames: readonly FilmFrame[],
 * ) => import("../steps.js").Steps<Point[]>} Move
 */

/**
 * Move the corners of a proposal to where its pilots fit the grid, step by step.
 *
 * A move by the pilots is kept only if they then toggle more surely: in a dark picture, parts may
 * have been matched amiss. What all blocks say of the corners is kept where the display is sure
 * there, too.
 *
 * @param {Proposal} proposal
 * @param {number} first - evidence of it in all frames so far, before it pays for anything
 * @param {readonly FilmFrame[]} watched - frames, of which there may be more after each step
 * @param {number} confirming - number of later frames that must agree with what is not certain
 * @param {() => FilmFrame} newest - gives the newest frame, another one after each `NEXT_FRAME`
 * @returns {import("../steps.js").Steps<Settled | null>} null where it is not sure
 */
export function* settleSteps(proposal, first, watched, confirming, newest) {
  const frames = [...watched];
  const { layout } = proposal;
  const pilots = layout.pilotBlocks.length;
  const needed = Math.min(SURE, SURE_SHARE * pilots);
  const certain = Math.min(CERTAIN, CERTAIN_SHARE * pilots);
  let best = proposal;
  let tried = TRIALS;
  let evidence = first - Math.log(tried);
  for (const { move, tries } of MOVES) {
    // it need not pay for so many trials, or it is hopeless
    const climbable = evidence >= CLIMBABLE - Math.log(tried) && evidence < certain;
    if (move === byClimbing && !climbable) continue;
    const moved = { ...best, corners: yield* move(best, frames) };
    const now = (yield* evidenceSteps(moved, frames)) - Math.log(tried * tries);
    if (!(now > evidence)) continue;
    best = moved;
    evidence = now;
    tried *= tries;
  }
  if (evidence < HINT - Math.log(tried)) return null;
  const fitted = { ...best, corners: yield* byBlocks(best, [...watched]) };
  const now = (yield* evidenceSteps(fitted, frames)) - Math.log(tried);
  evidence = Math.max(evidence, now);
  if (evidence < NEARLY * needed) return null;
  if (now >= NEARLY * needed) best = fitted;
  if (evidence < certain) {
    // corners were fitted to these frames; later ones must agree
    const later = [];
    const at = [];
    while (later.length < confirming) {
      yield NEXT_FRAME;
      const frame = newest();
      const values = valuesOf(best, frame);
      if (values === null) return null;
      later.push(values);
      at.push(frame.at);
    }
    if (pilotEvidence(later, layout, at).evidence < CONFIRMED) return null;
    if (evidence < needed) {
      const before = yield* valueSteps(best, frames);
      if (before === null) return null;
      const values = [...before, ...later];
      evidence = pilotEvidence(values, layout, [...positions(frames), ...at]).evidence;
      evidence -= Math.log(tried);
    }
  }
  return evidence < needed ? null : { proposal: best, evidence };
}

/**
 * Move corners by parts of the display.
 *
 * @type {Move}
 */
function* byParts({ corners, layout, frequency }, frames) {
  const blocks = expectedChanges(layout);
  for (let round = 0; round < COARSE_ROUNDS; round++) {
    const views = yield* viewSteps(corners, layout, frames, COARSE_SIZE);
    if (views === null) break;
    const [line] = amplitudes(views, positions(frames), [frequency]);
    yield MEASURE_WORK;
    const fit = coarseShift(line, blocks, layout);
    yield MOVE_WORK;
    if (fit === null) break;
    const moved = movedCorners(corners, fit.HOldFromNew, layout);
    const far = farthestMove(corners, moved);
    corners = moved;
    if (fit.parts >= MANY && far < SETTLED_PX) break;
  }
  return corners;
}

/**
 * Move corners while the sum over all pilots grows.
 *
 * @type {Move}
 */
function* byClimbing({ corners, layout, frequency }, frames) {
  for (let round = 0; round < CLIMB_ROUNDS; round++) {
    const views = yield* viewSteps(corners, layout, frames, mapSize(layout));
    if (views === null) break;
    const [line] = amplitudes(views, positions(frames), [frequency]);
    yield MEASURE_WORK;
    const HOldFromNew = climbToPilots(line, layout);
    yield MOVE_WORK;
    corners = movedCorners(corners, HOldFromNew, layout);
  }
  return corners;
}

/**
 * Move corners by all blocks at once, to parts of a pixel.
 *
 * @type {Move}
 */
function* byBlocks({ corners, layout, frequency }, frames) {
  const maps = new BlockMaps(layout);
  const views = [];
  for (const frame of frames) {
    const view = frame.blockView(corners, maps);
    if (view === null) return corners;
    views.push(view);
    yield VIEW_WORK;
  }
  const changes = yield* periodChangeSteps(maps, views, positions(frames), frequency);
  const fit = new BlockFit(maps, changes);
  for (let round = 0; round < BLOCK_ROUNDS; round++) {
    if (yield* fit.moveSteps()) break;
  }
  return movedCorners(corners, fit.shift(), layout);
}

/** Ways to move corners by the pilots, one after the other, and how many places each tries. */
const MOVES = [
  { move: byParts, tries: 1 },
  { move: byClimbing, tries: CLIMB_TRIALS },
];

/**
 * @param {Point[]} from
 * @param {Point[]} to
 * @returns {number} the largest distance of two points, pixels
 */
function farthestMove(from, to) {
  return Math.max(...from.map(([x, y], i) => Math.hypot(to[i][0] - x, to[i][1] - y)));
}
