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
/** Number of points that must lie around a picture that moves, for them to say how the camera moves. */
export const ROOM_POINTS = 24;
/** Their least distance from it, in pixels of the copies: motion is seen in 15 pixels. */
export const APART_PX = 8.0;
/** Largest distance, in pixels of the copies, of a point from where the common motion puts it. */
export const SAME_PX = 0.7;
/**
 * Number of parts of the image along each axis from each of which points are taken, where those
 * that lie far apart count.
 */
export const PARTS = 8;

/**
 * Follows the camera's motion since a reference frame, by optical flow and one homography.
 *
 * Most points move with the camera. But if a display shows a video, its picture moves as well, and
 * may have more points than the room. Then points around the picture are followed, or, as long as
 * nobody knows where it is, those points count that lie farther apart.
 */
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
  #farApart = false;
  /** Share of the reference's points that moved as one in the last frame, in [0, 1]. */
  share = 0;

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
   * @param {boolean} [farApart] - whether, of two motions, that of the points counts which lie
   *   farther apart, and not that of the most points
   * @param {Point[] | null} [picture] - corners of a picture that moves by itself; points around it
   *   are followed, if there are `ROOM_POINTS`; else `farApart` holds
   */
  begin(gray, farApart = false, picture = null) {
    const { width, height } = gray;
    const reference = (this.#reference = this.#copyOf(gray));
    this.#size = [width, height];
    const x = width / reference.width;
    const y = height / reference.height;
    this.#HImageFromCopy = [x, 0, (x - 1) / 2, 0, y, (y - 1) / 2, 0, 0, 1];
    const mask = picture && aroundQuad(this.onCopy(picture), reference.width, reference.height);
    const room = mask ? clearPoints(reference, 1, mask) : new Float32Array(0);
    const isSeen = room.length >= 2 * ROOM_POINTS;
    this.#farApart = farApart && !isSeen;
    this.#points = isSeen ? room : clearPoints(reference, farApart ? PARTS : 1);
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
    const motions = motionsOf(reference, small, this.#points, this.#guess, this.#farApart ? 2 : 1);
    if (motions.length === 0) return null;
    const { H, count } = motions.reduce((best, each) => (each.area > best.area ? each : best));
    this.share = (2 * count) / this.#points.length;
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
 * Mark by 255 the pixels that lie `APART_PX` or more outside of a convex quadrilateral.
 *
 * @param {Point[]} quad - clockwise
 * @param {number} width
 * @param {number} height
 * @returns {BytePlane}
 */
function aroundQuad(quad, width, height) {
  const sides = quad.map((start, i) => {
    const end = quad[(i + 1) % quad.length];
    const along = [end[0] - start[0], end[1] - start[1]];
    const length = Math.max(Math.hypot(...along), 1e-9);
    return { start, along: along.map((part) => part / length) };
  });
  const data = new Uint8Array(width * height);
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at++) {
      for (const { start, along } of sides) {
        const outside = along[1] * (x - start[0]) - along[0] * (y - start[1]);
        if (outside >= APART_PX) data[at] = 255;
      }
    }
  }
  return { width, height, data };
}

/**
 * Choose the clearest points of each part of an image.
 *
 * @param {BytePlane} plane
 * @param {number} parts - number of parts along each axis
 * @param {BytePlane | null} [mask] - 0 where no points are taken; null to take them anywhere
 * @returns {Float32Array<ArrayBuffer>} x and y in turn
 */
function clearPoints(plane, parts, mask = null) {
  return withMats((keep) => {
    const image = keep(matOf(plane));
    const free = keep(mask ? matOf(mask) : new cv.Mat());
    const most = Math.floor(POINTS / parts ** 2);
    /** @type {number[]} */
    const all = [];
    for (let row = 0; row < parts; row++) {
      const [top, bottom] = [row, row + 1].map((k) => Math.floor((k * plane.height) / parts));
      for (let col = 0; col < parts; col++) {
        const [left, right] = [col, col + 1].map((k) => Math.floor((k * plane.width) / parts));
        const rect = new cv.Rect(left, top, right - left, bottom - top);
        const part = keep(image.roi(rect));
        const open = mask ? keep(free.roi(rect)) : free;
        const points = keep(new cv.Mat());
        cv.goodFeaturesToTrack(part, points, most, 0.005, 8, open);
        for (let i = 0; i < points.rows; i++) {
          all.push(points.data32F[2 * i] + left, points.data32F[2 * i + 1] + top);
        }
      }
    }
    return Float32Array.from(all);
  });
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
 * @param {BytePlane} reference
 * @param {BytePlane} small
 * @param {Float32Array} points - of the reference
 * @param {Float32Array} guess - where they may be
 * @param {number} most - number of motions that are looked for
 * @returns {SharedMotion[]} each of `MIN_POINTS` points or more
 */
function motionsOf(reference, small, points, guess, most) {
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
    let left = [...Array(count).keys()].filter((i) => status.data[i] === 1);
    const picked = (/** @type {ArrayLike<number>} */ all, /** @type {number[]} */ numbers) =>
      keep(
        cv.matFromArray(
          numbers.length,
          1,
          cv.CV_32FC2,
          numbers.flatMap((i) => [all[2 * i], all[2 * i + 1]]),
        ),
      );
    /** @type {SharedMotion[]} */
    const found = [];
    while (found.length < most && left.length >= MIN_POINTS) {
      const inliers = keep(new cv.Mat());
      const there = picked(moved.data32F, left);
      const H = keep(cv.findHomography(picked(points, left), there, cv.RANSAC, SAME_PX, inliers));
      if (H.rows !== 3 || cv.countNonZero(inliers) < MIN_POINTS) break;
      const same = left.filter((_, k) => inliers.data[k] > 0);
      const hull = keep(new cv.Mat());
      cv.convexHull(picked(points, same), hull);
      found.push({
        H: Float64Array.from(H.data64F),
        count: same.length,
        area: cv.contourArea(hull),
      });
      left = left.filter((_, k) => inliers.data[k] === 0);
    }
    return found;
  });
}

/**
 * @param {Float32Array} flat
 * @returns {Point[]}
 */
function pointsOf(flat) {
  return Array.from({ length: flat.length / 2 }, (_, i) => [flat[2 * i], flat[2 * i + 1]]);
}
