/**
 * Fit the corners of a display to parts of a pixel, by all of its blocks.
 *
 * Pilots are one block in twenty. The other blocks toggle as well: in each period of the toggling,
 * which shows one frame pair, a block changes as a whole, in one direction or in the other. The bit
 * that decides the direction is not known, and it need not be. Where the grid lies about right, the
 * mean change of a block tells its direction. Then the edges between blocks that change in
 * different directions, and the border of the display, tell where the grid lies exactly. So both
 * are estimated in turn: the change of every block from its pixels, and a small motion of the whole
 * grid from the edges (expectation-maximisation; the motion as Lucas & Kanade 1981 do).
 */

import { receiverPilotsSearchAllBlocks } from "../../../../generated/constants.js";
import { lessMeanAround } from "../../../image/blur.js";
import { call, rowsOf } from "../../../image/opencv.js";
import { areaMeans } from "../../../image/shrink.js";
import { remapped, warped } from "../../../image/warp.js";
import { Lens, homographyFromCorners, transform } from "../../../link/geometry.js";
import { identity, inverse, multiply3, solve } from "../../../link/linear.js";
import {
  GridMaps, MotionEquations, NUMBERS, UNIT_CORNERS, pixelsFromUnit, unitHomography,
} from "../motion.js";
import { pilotSigns } from "../../../link/pilots.js";

export const {
  SPAN, LEAST_NOISE, LEAST_TOGGLING, SURE_RATIO, EXPECTED_BLOCKS, EXPECTED_K, LARGEST_K, K_STEP,
  SETTLED_PX,
} = receiverPilotsSearchAllBlocks;

/** Number of maps of which a step sums up what they tell of the motion. */
const AT_ONCE = 4;
/** From a display from -1 to 1 to a frame of 2 by 2 pixels. */
const FROM_UNIT = pixelsFromUnit(2, 2);

/**
 * Make maps in which a display's corners are fitted by all of its blocks: they hold the display and
 * one block around it, since nothing toggles beyond its border.
 *
 * @param {Layout} layout - of the display, with pilots
 * @returns {GridMaps}
 */
export function blockMaps(layout) {
  const [inner, margin] = layout.blockMaps;
  return new GridMaps(layout, inner, margin);
}

/**
 * Make ready to fit the corners of a display by all of its blocks.
 *
 * @param {GridMaps} maps
 * @param {readonly FloatPlane[]} views - of some frames, rectified to the maps
 * @param {readonly number[]} at - positions of the frames (waves.js)
 * @param {import("../toggling.js").Toggling} toggling - how the display toggles
 * @returns {Steps<BlockFit>}
 */
export function* blockFitSteps(maps, views, at, toggling) {
  const changes = [];
  for (const change of yield* toggling.changeSteps(maps, views, at)) {
    changes.push(maps.smooth(change, SPAN));
    yield maps.work;
  }
  return new BlockFit(maps, changes);
}

/** Moves the grid of a display, step by step, until its blocks change as wholes. */
export class BlockFit {
  /** The motion that the next step tries, of a display from -1 to 1. */
  #HOldFromNew = identity(3);
  /** Coefficient of the lens that the next step tries. */
  #k = 0;
  #best = { HOldFromNew: identity(3), k: 0 };
  #imageSize = [0, 0];
  /** From a display from -1 to 1 to the image, once the lens is free. @type {Homography | null} */
  #HCapturedFromUnit = null;
  /** Correlation of the best motion, -1 before the first. */
  #score = -1;

  /**
   * @param {GridMaps} maps
   * @param {FloatPlane[]} changes - in each frame pair, smooth and without slope
   */
  constructor(maps, changes) {
    this.maps = maps;
    this.changes = changes;
  }

  /** Coefficient of the lens (`Lens`); 0 before `freeLens`. */
  get k() {
    return this.#best.k;
  }

  /**
   * Let the next steps find by how much the lens bends the display, too.
   *
   * The lens moves the places between the corners; the corners stay where they are seen.
   *
   * @param {Point[]} corners - pixels of the image by which the views were rectified
   * @param {number} width - of the image, pixels
   * @param {number} height - of the image, pixels
   */
  freeLens(corners, width, height) {
    this.#HCapturedFromUnit = multiply3(homographyFromCorners(corners, 2, 2), FROM_UNIT);
    this.#imageSize = [width, height];
    this.#score = -1;
    this.#HOldFromNew = this.#best.HOldFromNew;
    this.#k = this.#best.k;
  }

  /**
   * Tell whether the lens that the next step tries bends the display by much of a block.
   *
   * @returns {boolean}
   */
  bends() {
    const [bent, straight] = [this.#places(this.#k), this.#places(0)];
    return bent.some((at, axis) => {
      const least = EXPECTED_BLOCKS * this.maps.block[axis];
      return at.some((place, i) => Math.abs(place - straight[axis][i]) > least);
    });
  }

  /**
   * Find where a lens shows the pixels of the maps.
   *
   * @param {number} k - coefficient of the lens
   * @returns {Float32Array[]} x and y in the views, for each pixel
   */
  #places(k) {
    if (this.#HCapturedFromUnit === null) throw new Error("the lens is not free");
    const lens = new Lens(k, this.#imageSize[0], this.#imageSize[1]);
    const fromUnit = this.maps.fromUnit();
    const corners = transform(multiply3(this.#HCapturedFromUnit, this.#HOldFromNew), UNIT_CORNERS);
    const HStraightFromUnit = multiply3(lens.homography(corners, 2, 2), FROM_UNIT);
    const H = multiply3(HStraightFromUnit, inverse(fromUnit));
    const [xs, ys] = lens.seenAt(H, this.maps.size[0], this.maps.size[1]);
    const HMapFromCaptured = multiply3(fromUnit, inverse(this.#HCapturedFromUnit));
    const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = HMapFromCaptured;
    for (let at = 0; at < xs.length; at++) {
      const [x, y] = [xs[at], ys[at]];
      const w = h6 * x + h7 * y + h8;
      xs[at] = (h0 * x + h1 * y + h2) / w;
      ys[at] = (h3 * x + h4 * y + h5) / w;
    }
    return [xs, ys];
  }

  /**
   * Say where points of the display, as it should have been rectified, lie in the views.
   *
   * @returns {Float64Array} HOldFromNew, in layout pixels
   */
  shift() {
    const HLayoutFromUnit = multiply3(this.maps.toLayout(), this.maps.fromUnit());
    const H = multiply3(multiply3(HLayoutFromUnit, this.#best.HOldFromNew), inverse(HLayoutFromUnit));
    return H.map((value) => value / H[8]);
  }

  /**
   * Move the grid once.
   *
   * @returns {Steps<boolean>} whether it has come to rest
   */
  *moveSteps() {
    const { maps } = this;
    // one period does not tell toggling from noise
    if (this.changes.length < 2) return true;
    const seen = [];
    const moved = this.#mover();
    for (const change of this.changes) {
      seen.push(moved(change));
      yield maps.work;
    }
    const expected = [];
    const sums = Float64Array.of(1e-12, 0, 1e-12);
    const now = new Float64Array(3);
    for (const [k, blocks] of this.#expectedBlocks(seen).entries()) {
      expected.push(maps.drawn(blocks, SPAN));
      call("agreement", [seen[k], expected[k]], [now]);
      now.forEach((sum, i) => (sums[i] += sum));
      yield 2 * maps.work;
    }
    const [power, along, total] = sums;
    const score = along / Math.sqrt(power * total);
    // the last step led away
    if (score <= this.#score) return true;
    this.#score = score;
    this.#best = { HOldFromNew: this.#HOldFromNew, k: this.#k };
    const move = yield* this.#fittedMove(seen, expected, along / power);
    const H = multiply3(this.#HOldFromNew, unitHomography(move));
    this.#HOldFromNew = H.map((value) => value / H[8]);
    const k = this.#k + (move[NUMBERS] ?? 0);
    this.#k = Math.min(Math.max(k, -LARGEST_K), LARGEST_K);
    const farthest = Math.max(...move.map(Math.abs));
    if (!((farthest * maps.inner[0]) / 2 < SETTLED_PX)) return false;
    this.#best = { HOldFromNew: this.#HOldFromNew, k: this.#k };
    return true;
  }

  /**
   * Make what shows changes as they would have been seen with the grid where it now is.
   *
   * @returns {(change: FloatPlane) => FloatPlane}
   */
  #mover() {
    const [width, height] = this.maps.size;
    const fromUnit = this.maps.fromUnit();
    if (this.#HCapturedFromUnit !== null) {
      const places = this.#places(this.#k);
      return (change) => remapped(change, places, width, height);
    }
    if (this.#score < 0) return (change) => change;
    const H = multiply3(multiply3(fromUnit, this.#HOldFromNew), inverse(fromUnit));
    return (change) => warped(change, H, width, height);
  }

  /**
   * Tell by how much each block is expected to have changed in each period.
   *
   * @param {FloatPlane[]} seen
   * @returns {Float32Array[]} (rows * cols,) for each period
   */
  #expectedBlocks(seen) {
    const { layout } = this.maps;
    const { rows, cols, pilotBlocks } = layout;
    const count = rows * cols;
    const means = seen.map((change) => areaMeans(this.maps.within(change), cols, rows).data);
    const periods = means.length;
    const squares = new Float32Array(count);
    for (let i = 0; i < count; i++) {
      let sum = 0;
      for (const mean of means) sum += mean[i] * mean[i];
      squares[i] = sum / periods;
    }
    const meanSquare = squares.reduce((sum, square) => sum + square, 0) / count;
    // all pilots change alike in all periods; what differs is noise
    let noise = 0;
    for (const block of pilotBlocks) {
      const mean = means.reduce((sum, now) => sum + now[block], 0) / periods;
      for (const now of means) noise += (now[block] - mean) ** 2;
    }
    noise /= pilotBlocks.length * (periods - 1);
    noise = Math.max(noise, LEAST_NOISE * meanSquare) + 1e-12;
    const plane = { width: cols, height: rows, data: squares };
    const apart = lessMeanAround(plane, 3, 3).data;
    const toggling = squares.map((square, i) =>
      Math.sqrt(Math.max(square - apart[i] - noise, LEAST_TOGGLING * meanSquare)),
    );
    const signs = pilotSigns(layout);
    return means.map((mean) => {
      const blocks = mean.map((value, i) => {
        const ratio = (toggling[i] * value) / noise;
        return toggling[i] * Math.tanh(Math.min(Math.max(ratio, -SURE_RATIO), SURE_RATIO));
      });
      pilotBlocks.forEach((block, i) => (blocks[block] = toggling[block] * signs[i]));
      return blocks;
    });
  }

  /**
   * Find how the pixels of the maps move for each unit of the lens's coefficient.
   *
   * @returns {FloatPlane[]} along x and along y, of a display from -1 to 1
   */
  #bending() {
    const [width, height] = this.maps.size;
    const now = this.#places(this.#k);
    return this.#places(this.#k + K_STEP).map((places, axis) => {
      const unit = K_STEP * (this.maps.inner[axis] / 2);
      return { width, height, data: places.map((place, i) => (place - now[axis][i]) / unit) };
    });
  }

  /**
   * Find the numbers of the homography that explain how the seen changes differ from the expected.
   *
   * Where the lens is free, the change of its coefficient is the ninth.
   *
   * @param {FloatPlane[]} seen
   * @param {FloatPlane[]} expected
   * @param {number} amplitude - of what is seen, in the expected changes
   * @returns {Steps<Float64Array>} (8,) or (9,)
   */
  *#fittedMove(seen, expected, amplitude) {
    const { maps } = this;
    const [width, height] = maps.size;
    const bending = this.#HCapturedFromUnit === null ? null : below(this.#bending());
    const equations = new MotionEquations(maps, bending);
    for (let k = 0; k < seen.length; k += AT_ONCE) {
      const [now, then] = [seen, expected].map((all) => below(all.slice(k, k + AT_ONCE)));
      equations.take(now, then, amplitude);
      yield 2 * AT_ONCE * maps.work;
    }
    // noise is alike over a block
    const [across, down] = maps.block;
    const noise = (equations.power / (width * height * seen.length)) * across * down + 1e-12;
    const { matrix, right } = equations.normal();
    const known = noise / ((2 * EXPECTED_BLOCKS) / maps.layout.cols) ** 2;
    const still = identity(3);
    for (let i = 0; i < NUMBERS; i++) {
      right[i] += known * (this.#HOldFromNew[i] - still[i]);
      matrix[i * right.length + i] += known;
    }
    if (bending !== null) {
      right[NUMBERS] += (noise / EXPECTED_K ** 2) * this.#k;
      matrix[matrix.length - 1] += noise / EXPECTED_K ** 2;
    }
    return solve(matrix, right).map((value) => -value);
  }
}

/**
 * Write planes one below the other.
 *
 * @param {readonly FloatPlane[]} planes - of one size
 * @returns {FloatPlane}
 */
function below(planes) {
  const [{ width, height }] = planes;
  return { width, height: height * planes.length, data: rowsOf(planes.map(({ data }) => data)).data };
}
