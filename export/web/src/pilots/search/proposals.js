/** Where a display may be, what it may show, and how surely its pilots toggle there. */

import { areaMeans } from "../../image/shrink.js";
import { rolled } from "../../locate/quads.js";
import { pilotEvidence, pilotValues, pilotsOfBlocks } from "../signal.js";

/** @typedef {import("../../link/code/steps.js").Steps<any>} AnySteps */
/** @typedef {import("./film.js").FilmFrame} FilmFrame */

/** Units of work (`../steps.js`) of one frame's view of a display. */
export const VIEW_WORK = 0.6;

/**
 * Where a display may be: corners in the reference frame, the displayed picture's top left first;
 * what it may show; and the frequency at which it may toggle, in periods for each nominal frame.
 *
 * @typedef {{ corners: Point[], layout: Layout, frequency: number }} Proposal
 */

/** A quadrilateral, and how pilots toggle where it is a display. */
export class Watched {
  /**
   * @param {Point[]} corners - in the reference frame
   * @param {readonly Layout[]} layouts - those that it may show
   */
  constructor(corners, layouts) {
    this.corners = corners;
    /** Positions of the frames. @type {number[]} */
    this.at = [];
    /** For each layout, upright and upside down, the pilots' values in each frame. */
    this.guesses = layouts.flatMap((layout) =>
      [0, 2].map((turn) => ({ layout, turn, values: /** @type {Float32Array[]} */ ([]) })),
    );
  }

  /**
   * Take what the quadrilateral shows in the next frame.
   *
   * @param {FloatPlane | null} view - of it, rectified to any size; null where it is not sound
   * @param {number} at - position of the frame (waves.js)
   */
  take(view, at) {
    this.at.push(at);
    /** @type {Layout | null} */
    let last = null;
    /** @type {Float32Array} */
    let blocks = new Float32Array(0);
    for (const { layout, turn, values } of this.guesses) {
      if (view === null) {
        values.push(new Float32Array(layout.pilotBlocks.length));
        continue;
      }
      if (layout !== last) blocks = areaMeans(view, layout.cols, layout.rows).data;
      last = layout;
      values.push(pilotsOfBlocks(blocks, layout, turn !== 0));
    }
  }

  /**
   * Choose the layout, upright or upside down, whose pilots toggle most surely.
   *
   * @returns {{ evidence: number, proposal: Proposal }} the evidence, before it pays for what was
   *   tried, and what it speaks for
   */
  surest() {
    const found = this.guesses.map(({ layout, turn, values }) => {
      const { evidence, frequency } = pilotEvidence(values, layout, this.at);
      const proposal = { corners: rolled(this.corners, turn), layout, frequency };
      return { evidence, proposal };
    });
    return found.reduce((best, each) => (each.evidence > best.evidence ? each : best));
  }
}

/**
 * Rectify all frames to maps of a size, step by step.
 *
 * @param {Point[]} corners - in the reference frame
 * @param {Layout} layout
 * @param {readonly FilmFrame[]} frames
 * @param {[number, number]} size - width and height
 * @returns {import("../../link/code/steps.js").Steps<FloatPlane[] | null>} null where corners are not sound
 */
export function* viewSteps(corners, layout, frames, [width, height]) {
  const views = [];
  for (const frame of frames) {
    const view = frame.view(corners, layout, width, height);
    if (view === null) return null;
    views.push(view);
    yield VIEW_WORK;
  }
  return views;
}

/**
 * Find the evidence of a proposal, before it pays for what was tried, step by step.
 *
 * @param {Proposal} proposal
 * @param {readonly FilmFrame[]} frames
 * @returns {import("../../link/code/steps.js").Steps<number>} 0 where its corners are not sound
 */
export function* evidenceSteps(proposal, frames) {
  const values = yield* valueSteps(proposal, frames);
  if (values === null) return 0;
  return pilotEvidence(values, proposal.layout, positions(frames)).evidence;
}

/**
 * Find by how much the pilots of a proposal stand out in each frame, step by step.
 *
 * @param {Proposal} proposal
 * @param {readonly FilmFrame[]} frames
 * @returns {import("../../link/code/steps.js").Steps<Float32Array[] | null>} null where its corners are not sound
 */
export function* valueSteps(proposal, frames) {
  const values = [];
  for (const frame of frames) {
    const now = valuesOf(proposal, frame);
    if (now === null) return null;
    values.push(now);
    yield VIEW_WORK;
  }
  return values;
}

/**
 * List the positions of frames.
 *
 * @param {readonly FilmFrame[]} frames
 * @returns {number[]}
 */
export function positions(frames) {
  return frames.map(({ at }) => at);
}

/**
 * Find by how much the pilots of a proposal stand out in a frame.
 *
 * @param {Proposal} proposal
 * @param {FilmFrame} frame
 * @returns {Float32Array | null} null where its corners are not sound
 */
export function valuesOf({ corners, layout }, frame) {
  const view = frame.view(corners, layout, layout.width >> 1, layout.height >> 1);
  return view && pilotValues(view, layout);
}
