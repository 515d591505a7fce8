/** Hold the frames of a film still: where each point of a reference frame lies in a later one. */

import { receiverPilotsStabilise } from "../../../generated/constants.js";
import {
  chooseFeatures, chosen, fitMotion, follow, hullArea, pointsOf,
} from "../../image/points.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { warped } from "../../image/warp.js";
import { contourArea, resizedHomography, transform } from "../../link/geometry.js";
import { inverse, multiply3 } from "../../link/linear.js";

const {
  WIDTH, POINTS, MIN_POINTS, CLEAR, FAINT, APART_PX, FLOW_PX, FLOW_ENDS, HALVINGS, SAME_PX,
  PARTS, AGREEING, SPREAD, TRIES, TRIES_WITHIN,
} = receiverPilotsStabilise;

/** Number of clear points of which some are chosen. */
const MOST_POINTS = 1 << 14;

/** Points of a reference frame that were found again in a later one. */
export class Tracks {
  /**
   * @param {Float32Array} before - pixels of the reference, x and y in turn
   * @param {Float32Array} after - pixels of the later frame
   * @param {number} samePx - `SAME_PX` in pixels of the frames
   */
  constructor(before, after, samePx) {
    this.before = before;
    this.after = after;
    this.samePx = samePx;
  }

  /**
   * Find how what lies within a convex quadrilateral has moved.
   *
   * @param {Point[]} quad - pixels of the reference, clockwise
   * @returns {Float64Array | null} the homography from the reference to the later frame; null where
   *   too few points lie within, or too close together, or do not agree
   */
  motionWithin(quad) {
    const { before, after } = this;
    const isInside = (/** @type {number} */ i) => isWithin(quad, before[2 * i], before[2 * i + 1]);
    const within = chosen(before, isInside);
    const [motion] = motionsOf(within, chosen(after, isInside), 1, this.samePx, TRIES_WITHIN);
    if (motion === undefined || 2 * motion.count < AGREEING * within.length) return null;
    return motion.area >= SPREAD * contourArea(quad) ? motion.H : null;
  }
}

/**
 * Follows the camera's motion since a reference frame, by optical flow and one homography.
 *
 * Most points move with the camera. But if a display shows a video, its picture moves as well, and
 * may have more points than the room. Then those points count that lie farther apart.
 */
export class Stabiliser {
  /** Points of the reference, and where they may be in the next frame: x and y in turn. */
  #points;
  #guess;
  /** @type {Homography} */
  #HImageFromCopy;
  /** The frame that was followed last, and its copy. @type {[BytePlane, BytePlane] | null} */
  #last = null;
  #farApart;
  /**
   * Points found again in the last frame; null where pictures in it may move.
   *
   * @type {Tracks | null}
   */
  tracks = null;

  /**
   * @param {BytePlane} gray - the reference frame
   * @param {boolean} [farApart] - whether, of two motions, that of the points counts which lie
   *   farther apart, and not that of the most points
   */
  constructor(gray, farApart = false) {
    const { width, height } = gray;
    const reference = this.copyOf(gray);
    /** Copy of the reference. */
    this.reference = reference;
    this.#HImageFromCopy = resizedHomography(width / reference.width, height / reference.height);
    this.#farApart = farApart;
    this.#points = clearPoints(reference, farApart ? FAINT : CLEAR);
    this.#guess = this.#points.slice();
  }

  /**
   * Find the homography from pixels of the reference to pixels of a later frame.
   *
   * @param {BytePlane} gray - of the reference's size
   * @returns {Float64Array | null} nine numbers; null where the reference's points are lost
   */
  follow(gray) {
    if (this.#points.length < 2 * MIN_POINTS) return null;
    this.#last = null;
    const small = this.copyOf(gray);
    const { moved, found } = foundAgain(this.reference, small, this.#points, this.#guess);
    const isFound = (/** @type {number} */ i) => found[i];
    const [before, after] = [this.#points, moved].map((points) => chosen(points, isFound));
    const motions = motionsOf(before, after, this.#farApart ? 2 : 1, SAME_PX);
    if (motions.length === 0) return null;
    const { H } = motions.reduce((best, each) => (each.area > best.area ? each : best));
    this.#guess = Float32Array.from(transform(H, pointsOf(this.#points)).flat());
    const grow = this.#HImageFromCopy;
    this.tracks = this.#farApart ? null : tracksOf(before, after, grow);
    return multiply3(multiply3(grow, H), inverse(grow));
  }

  /**
   * Move the copy of a frame onto the reference's.
   *
   * @param {BytePlane} copy
   * @param {Homography} HImageFromReference
   * @returns {BytePlane}
   */
  still(copy, HImageFromReference) {
    const grow = this.#HImageFromCopy;
    const H = multiply3(multiply3(inverse(grow), HImageFromReference), grow);
    return warped(copy, H, copy.width, copy.height);
  }

  /**
   * Move points from the image to the copy.
   *
   * @param {Point[]} points
   * @returns {Point[]}
   */
  onCopy(points) {
    return transform(inverse(this.#HImageFromCopy), points);
  }

  /**
   * Move points from the copy to the image.
   *
   * @param {Point[]} points
   * @returns {Point[]}
   */
  onImage(points) {
    return transform(this.#HImageFromCopy, points);
  }

  /**
   * Shrink a frame, unless that was done just now.
   *
   * @param {BytePlane} gray
   */
  copyOf(gray) {
    if (this.#last === null || this.#last[0] !== gray) {
      const factor = Math.max(1, gray.width / WIDTH);
      const width = roundHalfEven(gray.width / factor);
      const height = Math.max(1, roundHalfEven(gray.height / factor));
      this.#last = [gray, resizeArea(gray, width, height)];
    }
    return this.#last[1];
  }
}

/**
 * Move points of both copies to the images.
 *
 * @param {Float32Array} before - x and y in turn
 * @param {Float32Array} after
 * @param {Homography} HImageFromCopy
 */
function tracksOf(before, after, HImageFromCopy) {
  const [one, other] = [before, after].map((points) =>
    Float32Array.from(transform(HImageFromCopy, pointsOf(points)).flat()),
  );
  return new Tracks(one, other, SAME_PX * HImageFromCopy[0]);
}

/**
 * Choose the clearest points of an image, but only so many in each of its parts.
 *
 * @param {BytePlane} plane
 * @param {number} least - smallest share of how clear the clearest point is
 * @returns {Float32Array<ArrayBuffer>} x and y in turn
 */
function clearPoints(plane, least) {
  const points = chooseFeatures(plane, MOST_POINTS, least, APART_PX);
  const room = new Array(PARTS ** 2).fill(Math.floor(POINTS / PARTS ** 2));
  // the clearest comes first
  return chosen(points, (i) => {
    const col = Math.floor((PARTS * points[2 * i]) / plane.width);
    const row = Math.floor((PARTS * points[2 * i + 1]) / plane.height);
    return room[row * PARTS + col]-- > 0;
  });
}

/**
 * Find points of one copy in another by optical flow.
 *
 * @param {BytePlane} reference
 * @param {BytePlane} copy
 * @param {Float32Array} points - of the reference, x and y in turn
 * @param {Float32Array | null} [guess] - where they may be; where they were, where absent
 */
export function foundAgain(reference, copy, points, guess = null) {
  return follow(reference, copy, points, FLOW_PX, HALVINGS, guess, FLOW_ENDS.slice(1));
}

/**
 * A motion that points share: the homography, the number of points, and the area, in square pixels,
 * of the smallest convex region that holds them.
 *
 * @typedef {{ H: Float64Array, count: number, area: number }} SharedMotion
 */

/**
 * Find motions that points share, that of the most points first.
 *
 * @param {Float32Array} before - points of the reference, x and y in turn
 * @param {Float32Array} after - where they are found
 * @param {number} most - number of motions that are looked for
 * @param {number} samePx - largest distance, in pixels, of a point from where its motion puts it
 * @param {number} [tries] - largest number of motions that are tried for each one found
 * @returns {SharedMotion[]} each of `MIN_POINTS` points or more
 */
function motionsOf(before, after, most, samePx, tries = TRIES) {
  /** @type {SharedMotion[]} */
  const found = [];
  while (found.length < most && before.length >= 2 * MIN_POINTS) {
    const fit = fitMotion(before, after, samePx, false, tries);
    if (fit === null || fit.count < MIN_POINTS) break;
    const { H, same, count } = fit;
    found.push({ H, count, area: hullArea(chosen(before, (i) => same[i])) });
    after = chosen(after, (i) => !same[i]);
    before = chosen(before, (i) => !same[i]);
  }
  return found;
}

/**
 * Tell whether a point lies in a convex polygon.
 *
 * @param {Point[]} corners - clockwise
 * @param {number} x
 * @param {number} y
 */
function isWithin(corners, x, y) {
  return corners.every(([startX, startY], i) => {
    const [endX, endY] = corners[(i + 1) % corners.length];
    return (endX - startX) * (y - startY) >= (endY - startY) * (x - startX);
  });
}
