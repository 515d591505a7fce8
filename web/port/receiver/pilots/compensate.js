/**
 * What frames show beyond what has only moved: motion compensation. Each frame is compared with an
 * earlier one whose parts are moved to where they now lie (receiver/pilots/compensate.py).
 */

import { receiverPilotsCompensate } from "../../../generated/constants.js";
import { lessMeanAround } from "../../image/blur.js";
import { bytePlane, floatPlane, planeLike } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { areaMeans } from "../../image/shrink.js";
import { remapped, warpedFloats } from "../../image/warp.js";
import { resizedHomography } from "../../link/geometry.js";
import { inverse } from "../../link/linear.js";
import { foundAgain } from "./stabilise.js";

const { SPACING_PX, EARLIER_S, NOTHING, STEPS } = receiverPilotsCompensate;
const { AROUND_PX, MOST_LEFT, NEWEST, MOST_APART } = receiverPilotsCompensate;

/** Compares frames with earlier ones whose parts are moved to where they now lie. */
export class Compensator {
  #count;
  /** The frames before, no more than are needed. @type {BytePlane[]} */
  #earlier = [];

  /** @param {number} fps - number of frames in a second */
  constructor(fps) {
    this.#count = Math.max(1, roundHalfEven(EARLIER_S * fps));
  }

  /**
   * Take the next frame, and show what is left of it.
   *
   * @param {BytePlane} gray - of the size of those before; is kept
   * @returns {BytePlane} `NOTHING`, plus `STEPS` for each gray level by which a pixel is brighter than
   *   it was; the first frame, which nothing comes before, shows nothing
   */
  take(gray) {
    const moved = this.#earlier.length > 0 ? movedOnto(gray, this.#earlier[0]) : gray;
    this.#earlier.push(gray);
    if (this.#earlier.length > this.#count) this.#earlier.shift();
    const changes = planeLike(gray, gray.width, gray.height);
    gray.data.forEach((level, i) => {
      const shown = NOTHING + STEPS * (level - moved.data[i]);
      changes.data[i] = Math.min(Math.max(shown, 0), 255);
    });
    return changes;
  }
}

/** Tells how much of what changes in a display has only moved: the motion of its picture. */
export class MovingPicture {
  /** The frame before, and the picture as it was there. @type {[FloatPlane, BytePlane] | null} */
  #last = null;

  /**
   * Take the next frame, and tell by how much motion has changed it since the one before.
   *
   * @param {FloatPlane} frame - gray levels in [0, 255], of the size of those before; is kept
   * @returns {Float32Array} gray levels; 0 where motion does not explain most of the change, and
   *   everywhere in the first frame
   */
  take(frame) {
    const { width, height, data } = frame;
    const gray = bytePlane(width, height);
    data.forEach((level, i) => (gray.data[i] = rounded(level)));
    const motion = floatPlane(width, height);
    if (this.#last) {
      const [before, picture] = this.#last;
      const moved = movedOnto(gray, picture, pointsApart(gray, picture));
      const [changed, left, explained] = [0, 1, 2].map(() => floatPlane(width, height));
      data.forEach((level, i) => {
        motion.data[i] = moved.data[i] - picture.data[i];
        changed.data[i] = (level - before.data[i]) ** 2;
        left.data[i] = (level - before.data[i] - motion.data[i]) ** 2;
        const apart = (1 - NEWEST) * (moved.data[i] - level);
        gray.data[i] = rounded(level + Math.min(Math.max(apart, -MOST_APART), MOST_APART));
      });
      const [all, rest] = [changed, left].map(meanAround);
      explained.data.forEach((_, i) => (explained.data[i] = Number(rest[i] < MOST_LEFT * all[i])));
      meanAround(explained).forEach((share, i) => (motion.data[i] *= share));
    }
    this.#last = [frame, gray];
    return motion.data;
  }
}

/** @param {number} level */
function rounded(level) {
  return Math.min(Math.max(roundHalfEven(level), 0), 255);
}

/**
 * Average `AROUND_PX` by `AROUND_PX` pixels around each one.
 *
 * @param {FloatPlane} plane
 */
function meanAround(plane) {
  const apart = lessMeanAround(plane, AROUND_PX, AROUND_PX).data;
  return plane.data.map((value, i) => value - apart[i]);
}

/**
 * Count the columns and rows of the grid of points in a frame.
 *
 * @param {BytePlane} gray
 */
function gridOf({ width, height }) {
  const count = (/** @type {number} */ side) => Math.max(1, roundHalfEven(side / SPACING_PX));
  return /** @type {const} */ ([count(width), count(height)]);
}

/**
 * Choose the grid's points around which frames differ by `MOST_APART` or more.
 *
 * @param {BytePlane} gray
 * @param {BytePlane} earlier
 */
function pointsApart(gray, earlier) {
  const { width, height } = gray;
  const squared = Float32Array.from(gray.data, (level, i) => (level - earlier.data[i]) ** 2);
  const apart = areaMeans({ width, height, data: squared }, ...gridOf(gray)).data;
  return [...apart.keys()].filter((i) => apart[i] >= MOST_APART ** 2);
}

/**
 * Move the parts of an earlier frame to where they lie in a frame of the same size.
 *
 * @param {BytePlane} gray
 * @param {BytePlane} earlier
 * @param {number[] | null} [points] - of the grid, those that are followed, as the others stand still;
 *   null to follow all
 */
function movedOnto(gray, earlier, points = null) {
  const { width, height } = gray;
  const [cols, rows] = gridOf(gray);
  const followed = points ?? [...Array(rows * cols).keys()];
  if (followed.length === 0) return earlier;
  const HImageFromGrid = resizedHomography(width / cols, height / rows);
  const [scaleX, , left, , scaleY, top] = HImageFromGrid;
  const places = Float32Array.from(
    followed.flatMap((i) => [scaleX * (i % cols) + left, scaleY * Math.floor(i / cols) + top]),
  );
  const { moved, found } = foundAgain(gray, earlier, places);
  const shown = [0, 1].map((axis) => {
    const motion = new Float32Array(rows * cols);
    followed.forEach((at, i) => {
      if (found[i]) motion[at] = moved[2 * i + axis] - places[2 * i + axis];
    });
    const grid = { width: cols, height: rows, data: motion };
    const { data } = warpedFloats(grid, inverse(HImageFromGrid), width, height);
    return data.map((shift, i) => shift + (axis === 0 ? i % width : Math.floor(i / width)));
  });
  return remapped(earlier, shown, width, height);
}
