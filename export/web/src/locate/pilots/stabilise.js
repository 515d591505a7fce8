/** Hold the frames of a film still: where each point of a reference frame lies in a later one. */

import { cv, matOf, withMats } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { warped } from "../../image/warp.js";
import { transform } from "../../link/geometry.js";
import { identity, inverse, multiply3 } from "../../link/linear.js";

/** @typedef {import("../../image/opencv.js").Plane<Uint8Array>} BytePlane */
/** @typedef {import("../../link/geometry.js").Homography} Homography */
/** @typedef {import("../../link/geometry.js").Point} Point */

/** Largest width, in pixels, of the copies on which motion is followed. */
export const WIDTH = 640;
/** Largest number of points that are followed. */
export const POINTS = 400;
/** Smallest number of points that are followed. */
export const MIN_POINTS = 12;
/** Largest distance, in pixels of the copies, of a point from where the common motion puts it. */
export const SAME_PX = 0.7;

/** Follows the camera's motion since a reference frame, by optical flow and one homography. */
export class Stabiliser {
  /** @type {BytePlane | null} */
  #reference = null;
  /** Width and height of the frames. @type {[number, number]} */
  #size = [0, 0];
  /** Points of the reference, and where they may be in the next frame: x and y in turn. */
  #points = new Float32Array(0);
  #guess = new Float32Array(0);
  /** @type {Homography} */
  #HImageFromCopy = identity(3);
  /** The frame that was followed last, and its copy. @type {[BytePlane, BytePlane] | null} */
  #last = null;

  /** Width of the copies, pixels; 0 without a reference. */
  get width() {
    return this.#reference?.width ?? 0;
  }

  /** Height of the copies, pixels; 0 without a reference. */
  get height() {
    return this.#reference?.height ?? 0;
  }

  /** Give up the reference. */
  forget() {
    this.#reference = null;
    this.#last = null;
  }

  /**
   * Take a frame as the reference.
   *
   * @param {BytePlane} gray
   */
  begin(gray) {
    const { width, height } = gray;
    const reference = (this.#reference = this.#copyOf(gray));
    this.#size = [width, height];
    const x = width / reference.width;
    const y = height / reference.height;
    this.#HImageFromCopy = [x, 0, (x - 1) / 2, 0, y, (y - 1) / 2, 0, 0, 1];
    this.#points = withMats((keep) => {
      const points = keep(new cv.Mat());
      cv.goodFeaturesToTrack(keep(matOf(reference)), points, POINTS, 0.005, 8);
      return points.rows ? Float32Array.from(points.data32F) : new Float32Array(0);
    });
    this.#guess = this.#points.slice();
  }

  /**
   * Find the homography from pixels of the reference to pixels of a later frame.
   *
   * @param {BytePlane} gray
   * @returns {Float64Array | null} nine numbers; null where there is no reference, or its points
   *   are lost
   */
  follow(gray) {
    const reference = this.#reference;
    if (reference === null || this.#points.length < 2 * MIN_POINTS) return null;
    if (gray.width !== this.#size[0] || gray.height !== this.#size[1]) return null;
    this.#last = null;
    const small = this.#copyOf(gray);
    const H = followed(reference, small, this.#points, this.#guess);
    if (H === null) return null;
    this.#guess = Float32Array.from(transform(H, pointsOf(this.#points)).flat());
    const grow = this.#HImageFromCopy;
    return multiply3(multiply3(grow, H), inverse(grow));
  }

  /**
   * Shrink a frame and move it onto the reference's copy.
   *
   * @param {BytePlane} gray
   * @param {Homography} HImageFromReference
   * @returns {BytePlane}
   */
  still(gray, HImageFromReference) {
    const grow = this.#HImageFromCopy;
    const H = multiply3(multiply3(inverse(grow), HImageFromReference), grow);
    const small = this.#copyOf(gray);
    return warped(small, H, small.width, small.height);
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
   * @returns {BytePlane}
   */
  #copyOf(gray) {
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
 * Find the common motion of points.
 *
 * @param {BytePlane} reference
 * @param {BytePlane} small
 * @param {Float32Array} points - of the reference
 * @param {Float32Array} guess - where they may be
 * @returns {Float64Array | null}
 */
function followed(reference, small, points, guess) {
  return withMats((keep) => {
    const count = points.length / 2;
    const from = keep(cv.matFromArray(count, 1, cv.CV_32FC2, points));
    const moved = keep(cv.matFromArray(count, 1, cv.CV_32FC2, guess));
    const status = keep(new cv.Mat());
    const error = keep(new cv.Mat());
    cv.calcOpticalFlowPyrLK(
      keep(matOf(reference)),
      keep(matOf(small)),
      from,
      moved,
      status,
      error,
      new cv.Size(15, 15),
      2,
      new cv.TermCriteria(cv.TermCriteria_COUNT + cv.TermCriteria_EPS, 30, 0.01),
      cv.OPTFLOW_USE_INITIAL_FLOW,
    );
    const good = [...Array(count).keys()].filter((i) => status.data[i] === 1);
    if (good.length < MIN_POINTS) return null;
    const picked = (/** @type {ArrayLike<number>} */ all) =>
      keep(
        cv.matFromArray(
          good.length,
          1,
          cv.CV_32FC2,
          good.flatMap((i) => [all[2 * i], all[2 * i + 1]]),
        ),
      );
    const inliers = keep(new cv.Mat());
    const there = picked(moved.data32F);
    const H = keep(cv.findHomography(picked(points), there, cv.RANSAC, SAME_PX, inliers));
    if (H.rows !== 3 || cv.countNonZero(inliers) < MIN_POINTS) return null;
    return Float64Array.from(H.data64F);
  });
}

/**
 * @param {Float32Array} flat
 * @returns {Point[]}
 */
function pointsOf(flat) {
  return Array.from({ length: flat.length / 2 }, (_, i) => [flat[2 * i], flat[2 * i + 1]]);
}
