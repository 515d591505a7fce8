/**
 * Say where the display lies in its rectified image, as its decoded blocks tell.
 *
 * Once frame pairs are decoded, it is known how each block changed from frame to frame, and so where
 * the grid must lie for the changes that were seen. Each frame tells little where the message is
 * faint, so they add up: the eight numbers of a homography are followed by a Kalman filter, whose
 * measurement is the change of every pixel, linear in small motions of what should be there (Lucas &
 * Kanade 1981). A picture that moves changes, too; where it does, pixels weigh less.
 */

import { receiverTrackingCorners } from "../../../generated/constants.js";
import { lessMeanAround } from "../../image/blur.js";
import { resizeArea } from "../../image/shrink.js";
import { transform } from "../../link/geometry.js";
import { identity, inverse, multiply3, solve } from "../../link/linear.js";
import {
  GridMaps, MotionEquations, NUMBERS, UNIT_CORNERS, pixelsFromUnit, unitHomography,
  slopeSpan, withoutSlope,
} from "../pilots/motion.js";

const { FIRST_BLOCKS, KEPT, SPAN, LEAST_VARIANCE, LEAST_TOGGLING, FAR_BLOCKS } =
  receiverTrackingCorners;

/** Compares the changes of decoded blocks with what was seen. */
export class CornerShift {
  /** Sum (8,) of all moves so far, numbers of a homography of a display from -1 to 1. */
  total = new Float64Array(NUMBERS);
  /** @type {Float64Array | null} */
  #shift = null;
  #maps;
  #information;

  /** @param {Layout} layout - of the display, with pilots */
  constructor(layout) {
    this.layout = layout;
    this.#maps = new GridMaps(layout, layout.mapSize);
    const block = 2 * Math.max(1 / layout.cols, 1 / layout.rows);
    this.#information = identity(NUMBERS).map((value) => value / (FIRST_BLOCKS * block) ** 2);
  }

  /**
   * Take successive frames and the changes of their blocks.
   *
   * @param {BytePlane[]} images - two or more, rectified; each of them but the first is compared with
   *   the mean of the one before and the one after it, or with one if that is all
   * @param {Float32Array[]} expected - (rows cols,) by how much each image should show each block
   *   changed, in shares of the message's strength
   * @param {Float64Array[]} totals - (8,) value of `total` when each image was rectified; what they
   *   show to be amiss may have been put right since
   */
  take(images, expected, totals) {
    const { layout } = this;
    const { seen, right } = this.#equations(images, expected);
    if (!seen.some(Boolean)) return;
    const later = totals.slice(1);
    const before = this.total.map((_, j) => later.reduce((sum, total) => sum + total[j], 0));
    const asked = right.slice();
    for (let i = 0; i < NUMBERS; i++) {
      for (let j = 0; j < NUMBERS; j++) {
        const at = i * NUMBERS + j;
        this.#information[at] = KEPT * this.#information[at] + seen[at];
        asked[i] += seen[at] * (this.total[j] - before[j] / later.length);
      }
    }
    const move = solve(this.#information, asked).map((value) => -value);
    const fromUnit = pixelsFromUnit(layout.width, layout.height);
    const shift = multiply3(multiply3(fromUnit, unitHomography(move)), inverse(fromUnit));
    const moved = transform(unitHomography(move), UNIT_CORNERS);
    const near = moved.every(
      ([x, y], i) =>
        Math.abs(x - UNIT_CORNERS[i][0]) < (2 * FAR_BLOCKS) / layout.cols &&
        Math.abs(y - UNIT_CORNERS[i][1]) < (2 * FAR_BLOCKS) / layout.rows,
    );
    if (!near) return;
    this.#shift = this.#shift === null ? shift : multiply3(this.#shift, shift);
    this.total = this.total.map((value, i) => value + move[i]);
  }

  /**
   * Return, once, the homography `HOldFromNew` in layout pixels that is known anew.
   *
   * @returns {Float64Array | null}
   */
  shift() {
    const shift = this.#shift;
    this.#shift = null;
    return shift;
  }

  /**
   * Write the normal equations of the eight numbers.
   *
   * @param {BytePlane[]} images
   * @param {Float32Array[]} expected
   * @returns {{ seen: Float64Array, right: Float64Array }} (8, 8) and (8,), 0 without evidence
   */
  #equations(images, expected) {
    const [width, height] = this.#maps.size;
    const block = this.#maps.block[0] * this.#maps.block[1];
    const grays = images.map((image) => resizeArea(image, width, height).data);
    const own = fromNeighbours(expected).map((blocks) => this.#maps.drawn(blocks, SPAN));
    const frames = fromNeighbours(grays).map((data, at) => {
      const change = withoutSlope({ width, height, data }, this.#maps.block);
      return { own: own[at], change, weight: this.#weights(change) };
    });
    let [power, along] = [0, 0];
    for (const { own, change, weight } of frames) {
      for (let at = 0; at < weight.data.length; at++) {
        const share = weight.data[at] * own.data[at];
        power += share * own.data[at];
        along += share * change.data[at];
      }
    }
    const amplitude = along / Math.max(power, 1e-9);
    const equations = new MotionEquations(this.#maps);
    // noise is alike over a block, which so counts once
    if (amplitude ** 2 * power >= LEAST_TOGGLING ** 2 * block && power !== 0) {
      for (const { own, change, weight } of frames) equations.take(change, own, amplitude, weight);
    }
    const { matrix, right } = equations.normal();
    return {
      seen: matrix.map((value) => value / block),
      right: right.map((value) => value / block),
    };
  }

  /**
   * Weigh pixels by the changes around them.
   *
   * @param {FloatPlane} change
   * @returns {FloatPlane}
   */
  #weights(change) {
    const squared = { ...change, data: change.data.map((level) => level * level) };
    const apart = lessMeanAround(squared, ...slopeSpan(this.#maps.block)).data;
    const variance = squared.data.map((square, at) => square - apart[at]);
    const mean = variance.reduce((sum, value) => sum + value, 0) / variance.length;
    const least = LEAST_VARIANCE * mean + 1e-6;
    return { ...change, data: variance.map((value) => 1 / (value + least)) };
  }
}

/**
 * Take from each frame but the first the mean of the frames before and after it.
 *
 * @param {ArrayLike<number>[]} frames
 * @returns {Float32Array[]}
 */
function fromNeighbours(frames) {
  return frames.slice(1).map((frame, before) => {
    const after = frames[before + 2] ?? frames[before];
    return Float32Array.from(frame, (level, at) => level - (frames[before][at] + after[at]) / 2);
  });
}
