/**
 * What frames show beyond what has only moved: motion compensation. Each frame is compared with an
 * earlier one whose parts are moved to where they now lie (receiver/pilots/compensate.py).
 */

import { receiverPilotsCompensate } from "../../../generated/constants.js";
import { planeLike } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { remapped, warpedFloats } from "../../image/warp.js";
import { resizedHomography } from "../../link/geometry.js";
import { inverse } from "../../link/linear.js";
import { foundAgain } from "./stabilise.js";

const { SPACING_PX, EARLIER_S, NOTHING, STEPS } = receiverPilotsCompensate;

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

/**
 * Move the parts of an earlier frame to where they lie in a frame of the same size.
 *
 * @param {BytePlane} gray
 * @param {BytePlane} earlier
 */
function movedOnto(gray, earlier) {
  const { width, height } = gray;
  const [cols, rows] = [width, height].map((side) => Math.max(1, roundHalfEven(side / SPACING_PX)));
  const HImageFromGrid = resizedHomography(width / cols, height / rows);
  const [scaleX, , left, , scaleY, top] = HImageFromGrid;
  const points = Float32Array.from({ length: 2 * rows * cols }, (_, i) => {
    const point = i >> 1;
    return i % 2 === 0 ? scaleX * (point % cols) + left : scaleY * Math.floor(point / cols) + top;
  });
  const { moved, found } = foundAgain(gray, earlier, points);
  const places = [0, 1].map((axis) => {
    const motion = Float32Array.from(found, (isFound, i) =>
      isFound ? moved[2 * i + axis] - points[2 * i + axis] : 0,
    );
    const grid = { width: cols, height: rows, data: motion };
    const { data } = warpedFloats(grid, inverse(HImageFromGrid), width, height);
    return data.map((shift, i) => shift + (axis === 0 ? i % width : Math.floor(i / width)));
  });
  return remapped(earlier, places, width, height);
}
