/**
 * Say where the display lies in its rectified image, as its decoded blocks tell.
 *
 * Once a frame pair is decoded, the change of many blocks is known, and so where the grid must lie
 * for the change that was seen. Each frame pair tells little where the message is faint, so they
 * add up: the eight numbers of a homography are followed by a Kalman filter, whose measurement is
 * the change of every pixel, linear in small motions of what should be there (Lucas & Kanade 1981).
 */

import { receiverTrackingCorners } from "../../../generated/constants.js";
import { resizeArea } from "../../image/shrink.js";
import { slopesOf } from "../../image/slopes.js";
import { transform } from "../../link/geometry.js";
import { identity, inverse, multiply3, solve } from "../../link/linear.js";
import { expectedChanges } from "../../link/pilots.js";
import {
  GridMaps, MotionEquations, NUMBERS, UNIT_CORNERS, mapSize, pixelsFromUnit, unitHomography,
  withoutSlope,
} from "../pilots/motion.js";

const { FIRST_BLOCKS, KEPT, SPAN, STEEP, LEAST_TOGGLING, FAR_BLOCKS } = receiverTrackingCorners;

/** Compares decoded frame pairs with what was seen. */
export class CornerShift {
  /** Sum (8,) of all moves so far, numbers of a homography of a display from -1 to 1. */
  total = new Float64Array(NUMBERS);
  /** @type {Float64Array | null} */
  #shift = null;
  #maps;
  #information;

  /** @param {Layout} layout - of the display; without pilots it is never moved */
  constructor(layout) {
    this.layout = layout;
    this.#maps = new GridMaps(layout, mapSize(layout));
    const block = 2 * Math.max(1 / layout.cols, 1 / layout.rows);
    this.#information = identity(NUMBERS).map((value) => value / (FIRST_BLOCKS * block) ** 2);
  }

  /**
   * Take a frame pair and its scores.
   *
   * @param {BytePlane} original - rectified
   * @param {BytePlane} embedded - rectified, of the size of `original`
   * @param {ArrayLike<number>} scores - (nBits,) log-likelihood ratios
   * @param {Float64Array} total - (8,) value of `total` when the frames were rectified; what they
   *   show to be amiss may have been put right since
   */
  take(original, embedded, scores, total) {
    const { layout } = this;
    const { block, size } = this.#maps;
    const [width, height] = size;
    if (layout.pilotBlocks.length === 0) return;
    const [first, second] = [original, embedded].map(
      (image) => resizeArea(image, width, height).data,
    );
    const expected = this.#expected(scores);
    const pixels = width * height;
    const difference = new Float32Array(pixels);
    const mean = new Float32Array(pixels);
    for (let at = 0; at < pixels; at++) {
      difference[at] = second[at] - first[at];
      mean[at] = (first[at] + second[at]) / 2;
    }
    const change = withoutSlope({ width, height, data: difference }, block);
    const weight = evenness({ width, height, data: mean });
    let [power, along, all] = [0, 0, 0];
    for (let at = 0; at < pixels; at++) {
      const share = weight.data[at] * expected.data[at];
      power += share * expected.data[at];
      along += share * change.data[at];
      all += weight.data[at];
    }
    const amplitude = along / Math.max(power, 1e-9);
    const equations = new MotionEquations(this.#maps);
    equations.take(change, expected, amplitude, weight);
    // noise is alike over a block, which so counts once
    const variance = (equations.power / all) * block[0] * block[1];
    if (amplitude ** 2 * power < LEAST_TOGGLING ** 2 * variance || power === 0) return;
    const { matrix, right } = equations.normal();
    const sure = 1 / Math.max(variance, 1e-6);
    const asked = right.map((value) => sure * value);
    for (let i = 0; i < NUMBERS; i++) {
      for (let j = 0; j < NUMBERS; j++) {
        const at = i * NUMBERS + j;
        this.#information[at] = KEPT * this.#information[at] + sure * matrix[at];
        asked[i] += sure * matrix[at] * (this.total[j] - total[j]);
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
   * Draw the expected change of every block, from -1 to 1, smooth and without slope.
   *
   * @param {ArrayLike<number>} scores - (nBits,) log-likelihood ratios
   */
  #expected(scores) {
    const blocks = expectedChanges(this.layout);
    this.layout.messageBlocks.forEach((block, bit) => {
      blocks[block] = Math.tanh(Math.min(Math.max(scores[bit], -20), 20) / 2);
    });
    return this.#maps.drawn(blocks, SPAN);
  }
}

/**
 * Give pixels a weight that falls with the gradient of the picture.
 *
 * @param {FloatPlane} image
 * @returns {FloatPlane} in (0, 1]
 */
function evenness(image) {
  const { across, down } = slopesOf(image);
  const unit = (8 * STEEP) ** 2;
  return { ...image, data: across.map((slope, at) => 1 / (1 + (slope ** 2 + down[at] ** 2) / unit)) };
}
