/**
 * Find the lit display in a photograph: candidates first, then the ratex patches decide.
 *
 * They tell which candidate is the display, which way up it is, and where its corners are to
 * sub-pixels. Displays without patches, which Python finds in a single image, too, are found by
 * their pilots (pilots/search).
 */

import { receiverLocateFind } from "../../../generated/constants.js";
import { distance } from "../../link/geometry.js";
import { candidateSteps, leavingSteps, onFullImage, smallCopy } from "./candidates.js";
import { imagePyramid, searchPatches } from "./patches.js";
import { isSound, rolled } from "./quads.js";
import { cornersOnPatchesSteps, neededCorrelation } from "./refine.js";
import { MAX_OUTSIDE, cornerCells, partialSteps, spotSteps, wholeSteps } from "./spots.js";

/** @typedef {import("./candidates.js").Located} Located */
/** @typedef {import("./patches.js").Pyramid} Pyramid */

const {
  LIKELY, SPOT_QUADS, PARTIAL_QUADS, ALL_TURNS, SURE_CORRELATION, PROMISING, LEAVING_QUADS,
  PROMISING_PARTLY, SAME_PLACE, MAX_ASPECT,
} = receiverLocateFind;

/** Largest number of turns of one quadrilateral that are aligned. */
const ALIGNED_TURNS = 2;

/**
 * Find the lit display in an image step by step; a part of it may be out of view, or covered.
 *
 * @param {BytePlane} image - it must stay as it is until the end
 * @param {Layout} layout - of what is displayed, with patches
 * @param {Point[][]} [avoid] - pixels of displays with patches that are not to be found
 * @returns {Steps<Located | null>} null where nothing shows the patches
 */
export function* searchSteps(image, layout, avoid = []) {
  const { width, height } = image;
  if (Math.max(width, height) > MAX_ASPECT * Math.min(width, height)) return null;
  const candidates = yield* candidateSteps(image);
  const seek = new PatchSearch(image, layout, avoid);
  const corners = candidates.map((candidate) => candidate.corners);
  let found = yield* seek.best(corners.slice(0, LIKELY), ALL_TURNS);
  if (found) return found;
  const { copy, scale } = smallCopy(image);
  if (cornerCells(layout).length) {
    const spots = yield* spotSteps(copy, layout);
    const whole = yield* wholeSteps(spots, layout, copy, SPOT_QUADS);
    found = yield* seek.best(whole.map((quad) => onFullImage(quad, scale)), [0]);
    if (found) return found;
    const bent = yield* partialSteps(spots, layout, copy, PARTIAL_QUADS);
    found = yield* seek.bestPartial(
      bent.map((guesses) => guesses.map((quad) => onFullImage(quad, scale))),
    );
    if (found) return found;
  }
  found = yield* seek.best(corners.slice(LIKELY), ALL_TURNS);
  if (found) return found;
  const leaving = yield* leavingSteps(image, LEAVING_QUADS);
  return yield* seek.best(leaving, ALL_TURNS);
}

/**
 * Tell whether a display is at about one of some places, the same way up.
 *
 * @param {Point[]} corners
 * @param {Point[][]} places
 * @returns {boolean}
 */
export function isAt(corners, places) {
  const near = SAME_PLACE * corners.length * distance(corners[0], corners[2]);
  return places.some(
    (place) => corners.reduce((sum, corner, i) => sum + distance(corner, place[i]), 0) < near,
  );
}

/** Looks for the patches of a layout at quadrilaterals of one image. */
class PatchSearch {
  /** @type {BytePlane} */
  #image;
  /** @type {Pyramid} */
  #pyramid;
  /** @type {Layout} */
  #layout;
  #avoid;

  /**
   * @param {BytePlane} image
   * @param {Layout} layout
   * @param {Point[][]} avoid - places that are not to be found
   */
  constructor(image, layout, avoid) {
    this.#avoid = avoid;
    this.#image = image;
    this.#pyramid = imagePyramid(image);
    this.#layout = layout;
  }

  /**
   * Find where the patches are seen best, or the first place where they surely are.
   *
   * @param {Quad[]} quads
   * @param {number[]} turns - quarter turns that are tried
   * @returns {Steps<Located | null>}
   */
  *best(quads, turns) {
    /** @type {Located | null} */
    let best = null;
    for (const quad of quads) {
      const tried = turns.map((turn) => this.#promising(rolled(quad, turn)));
      yield turns.length;
      tried.sort((one, other) => other.promise - one.promise);
      for (const { corners, promise } of tried.slice(0, ALIGNED_TURNS)) {
        if (promise >= PROMISING) best = yield* this.#better(corners, best);
      }
      if (best && best.score >= SURE_CORRELATION) break;
    }
    return best;
  }

  /**
   * Find where the patches of a display that is partly in view are seen.
   *
   * @param {Quad[][]} bent - guesses of the perspective of each of some quadrilaterals, whose
   *   corners need not be finite
   * @returns {Steps<Located | null>}
   */
  *bestPartial(bent) {
    const { width, height } = this.#image;
    for (const guesses of bent) {
      const tried = guesses
        .filter((quad) => isSound(quad, width, height, MAX_OUTSIDE))
        .map((quad) => this.#promising(quad));
      yield tried.length;
      tried.sort((one, other) => other.promise - one.promise);
      if (!tried.length || tried[0].promise < PROMISING_PARTLY) continue;
      const found = yield* this.#better(tried[0].corners, null);
      if (found) return found;
    }
    return null;
  }

  /** @param {Quad} corners */
  #promising(corners) {
    return { corners, promise: searchPatches(this.#pyramid, corners, this.#layout).promise };
  }

  /**
   * Align corners, and take them if the patches are seen, and better than before.
   *
   * @param {Quad} corners
   * @param {Located | null} best
   */
  *#better(corners, best) {
    const aligned = yield* cornersOnPatchesSteps(this.#image, this.#pyramid, corners, this.#layout);
    if (aligned.seen < neededCorrelation(this.#layout)) return best;
    if (best && aligned.seen <= best.score) return best;
    if (isAt(aligned.corners, this.#avoid)) return best;
    return { corners: aligned.corners, score: Math.min(1, aligned.seen) };
  }
}
