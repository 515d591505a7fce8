/** Move the corners of a proposal to where its pilots fit the grid, and say whether that is sure. */

import { receiverPilotsSearchSettle } from "../../../../generated/constants.js";
import { distance } from "../../../link/geometry.js";
import { movedCorners } from "../motion.js";
import { expectedChanges } from "../../../link/pilots.js";
import { overDeviation } from "../signal.js";
import { blockFitSteps, blockMaps } from "./allBlocks.js";
import { COARSE_SIZE, MANY, coarseShift } from "./parts.js";
import { NEXT_FRAME, VIEW_WORK, positions, weighSteps } from "./proposals.js";

/** @typedef {import("../toggling.js").Amplitudes} Amplitudes */
/** @typedef {import("./allBlocks.js").BlockFit} BlockFit */
/** @typedef {import("./film.js").HeldFrame} HeldFrame */
/** @typedef {import("./proposals.js").Proposal} Proposal */
/** @typedef {import("./watch.js").Watch} Watch */

export const {
  SURE, SURE_SHARE, TRIALS, CERTAIN, CERTAIN_SHARE, CONFIRMED, LOOKS, EARLY, NEARLY,
  HINT, COARSE_ROUNDS, BLOCK_ROUNDS, LENS_ROUNDS, SETTLED_PX,
} = receiverPilotsSearchSettle;

/** Units of work of measuring how a display toggles, and of a move of its corners. */
const MEASURE_WORK = 4;
const MOVE_WORK = 6;

/**
 * A display that is sure: where it is in the reference frame, and the coefficient of the lens, 0
 * where nothing speaks for another.
 *
 * @typedef {{ proposal: Proposal, k: number }} Detection
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
 * @param {Watch} watch - the film, of which there may be more after each step
 * @returns {Steps<Detection | null>} null where it is not sure
 */
export function* verifySteps(proposal, first, watch) {
  const frames = [...watch.frames];
  const pilots = proposal.layout.pilotBlocks.length;
  const needed = Math.min(SURE, SURE_SHARE * pilots);
  const certain = Math.min(CERTAIN, CERTAIN_SHARE * pilots);
  const price = Math.log(TRIALS);
  let best = proposal;
  let evidence = first;
  const there = { ...best, corners: yield* byParts(best, frames) };
  let weighed = yield* weighSteps(there, frames, watch.fps);
  if (weighed.evidence > evidence) {
    best = there;
    ({ evidence } = weighed);
  }
  if (evidence < HINT) return null;
  evidence -= price;
  const start = best;
  const used = watch.frames.length;
  const fit = yield* byBlocks(start, watch.frames.slice(0, used));
  const fitted = fit === null ? start : moved(start, fit);
  /** Values of the pilots, where corners are now. @type {Map<HeldFrame, Float32Array>} */
  let known = new Map();
  weighed = yield* weighSteps(fitted, frames, watch.fps, known);
  const now = weighed.evidence - price;
  evidence = Math.max(evidence, now);
  if (evidence < NEARLY * needed) return null;
  if (now >= NEARLY * needed) best = fitted;
  else known = new Map();
  let agrees = evidence >= certain;
  // corners were fitted to these frames; later ones must agree
  for (let look = 0; look < LOOKS.length && !agrees; look++) {
    while (watch.all.length - used < LOOKS[look] * watch.confirming) yield NEXT_FRAME;
    const later = watch.all.slice(used);
    const agreed = yield* weighSteps(best, later, watch.fps, known);
    if (agreed.evidence < CONFIRMED + (LOOKS[look] < 1 ? EARLY : 0)) continue;
    if (evidence < needed) {
      // all frames say more, unless some were worse than the later ones
      weighed = yield* weighSteps(best, [...frames, ...later], watch.fps, known);
      if (agreed.evidence >= weighed.evidence) weighed = agreed;
      evidence = Math.max(evidence, weighed.evidence - price - Math.log(2));
    }
    agrees = evidence >= needed;
  }
  if (!agrees) return null;
  const isFitted = best === fitted && fit !== null;
  const k = isFitted ? yield* throughLens(fit, start, frames[0]) : 0;
  if (isFitted && k !== 0) {
    best = moved(start, fit);
    known = new Map();
  }
  while (!weighed.toggling.clear && watch.seen - watch.frames.length < watch.confirming) {
    yield NEXT_FRAME; // each frame that comes tells more of the clock
    weighed = yield* weighSteps(best, watch.all, watch.fps, known);
  }
  return { proposal: { ...best, toggling: weighed.toggling }, k };
}

/**
 * Move corners by parts of the display.
 *
 * @param {Proposal} proposal
 * @param {readonly HeldFrame[]} frames
 * @returns {Steps<Point[]>} in the reference frame
 */
function* byParts({ corners, layout, toggling }, frames) {
  const blocks = expectedChanges(layout);
  for (let round = 0; round < COARSE_ROUNDS; round++) {
    const line = yield* amplitudeSteps({ corners, layout, toggling }, frames, COARSE_SIZE);
    if (line === null) break;
    const fit = coarseShift(line, blocks, layout);
    yield MOVE_WORK;
    if (fit === null) break;
    const there = movedCorners(corners, fit.HOldFromNew, layout);
    const far = Math.max(...corners.map((corner, i) => distance(there[i], corner)));
    corners = there;
    if (fit.parts >= MANY && far < SETTLED_PX) break;
  }
  return corners;
}

/**
 * Measure how each place of a proposal toggles.
 *
 * @param {Proposal} proposal
 * @param {readonly HeldFrame[]} frames
 * @param {[number, number]} size - width and height of the map
 * @returns {Steps<Amplitudes | null>} null where corners are not sound
 */
function* amplitudeSteps({ corners, toggling }, frames, size) {
  const views = [];
  for (const frame of frames) {
    const view = frame.view(corners, ...size);
    if (view === null) return null;
    views.push(view.data);
    yield VIEW_WORK;
  }
  const series = overDeviation(views);
  const line = toggling.amplitudes(series, positions(frames), size);
  yield MEASURE_WORK;
  return line;
}

/**
 * Move corners by all blocks at once, to parts of a pixel.
 *
 * @param {Proposal} proposal
 * @param {readonly HeldFrame[]} frames
 * @returns {Steps<BlockFit | null>} null where the corners are not sound
 */
function* byBlocks({ corners, layout, toggling }, frames) {
  const maps = blockMaps(layout);
  const views = [];
  for (const frame of frames) {
    const view = frame.blockView(corners, maps);
    if (view === null) return null;
    views.push(view);
    yield VIEW_WORK;
  }
  const fit = yield* blockFitSteps(maps, views, positions(frames), toggling);
  for (let round = 0; round < BLOCK_ROUNDS; round++) {
    if (yield* fit.moveSteps()) break;
  }
  return fit;
}

/**
 * Go on with a fit by all blocks, and find how the lens bends the display.
 *
 * @param {BlockFit} fit - one that began with the corners of `start`
 * @param {Proposal} start - whose corners the fit moves
 * @param {HeldFrame} reference - the reference frame
 * @returns {Steps<number>} the coefficient of the lens; 0 where the lens bends the display by too
 *   little to tell
 */
function* throughLens(fit, start, { gray }) {
  fit.freeLens(start.corners, gray.width, gray.height);
  for (let round = 0; round < LENS_ROUNDS; round++) {
    const hasEnded = yield* fit.moveSteps();
    if (!fit.bends()) return 0;
    if (hasEnded) break;
  }
  return fit.k;
}

/**
 * Move the corners of a proposal to where a fit by all blocks puts them.
 *
 * @param {Proposal} proposal
 * @param {BlockFit} fit
 */
function moved(proposal, fit) {
  return { ...proposal, corners: movedCorners(proposal.corners, fit.shift(), proposal.layout) };
}
