/**
 * Small motions of a display, as the eight numbers of a homography of a display from -1 to 1.
 *
 * Where a display that changes lies a little off, each pixel is off by the motion there times the
 * slope of the change (Lucas & Kanade 1981). Each of the eight numbers moves a point by powers of
 * its place. So the least squares that find them need only moments: sums of a few maps times powers
 * of x and y.
 *
 * All motions of a display are homographies `HOldFromNew`: where a point of the display, as it
 * should have been rectified, lies in the image as it was.
 */

import { receiverPilotsMotion } from "../../../generated/constants.js";
import { blurred, lessMeanAround } from "../../image/blur.js";
import { call, floatPlane } from "../../image/opencv.js";
import { STRAIGHT, frameCorners, resizedHomography, transform } from "../../link/geometry.js";
import { identity, multiply3 } from "../../link/linear.js";

const { POWERS, MOTIONS } = receiverPilotsMotion;
/** Corners of a display from -1 to 1. */
export const UNIT_CORNERS = /** @type {Point[]} */ (receiverPilotsMotion.UNIT_CORNERS);
/** Numbers of a homography that are found. */
export const NUMBERS = MOTIONS.length;
/** Rows of sums that tell of motions (`motionSums` of opencv.cpp). */
const SUMS = 8;
/** Largest number of pixels that are handled in one unit of work (`types.d.ts`). */
const UNIT_PIXELS = 40_000;

/**
 * Take off the mean around each pixel, over three blocks.
 *
 * @param {FloatPlane} change - by how much the pixels of the rectified display changed
 * @param {ArrayLike<number>} block - width and height of a block, in pixels of `change`
 * @returns {FloatPlane}
 */
export function withoutSlope(change, block) {
  return lessMeanAround(change, ...slopeSpan(block));
}

/**
 * Say over how many pixels `withoutSlope` takes the mean.
 *
 * @param {ArrayLike<number>} block - width and height of a block, pixels
 * @returns {[number, number]} along x and along y, odd
 */
export function slopeSpan(block) {
  return [Math.floor(3 * block[0]) | 1, Math.floor(3 * block[1]) | 1];
}

/** Geometry of maps of a display and of what lies around it. */
export class UnitMaps {
  /**
   * @param {[number, number]} inner - width and height of the display, in pixels of the maps
   * @param {number[]} [margin] - width and height of what lies on each side of the display
   */
  constructor(inner, margin = [0, 0]) {
    this.inner = inner;
    this.margin = margin;
    /** Width and height of the maps, pixels. @type {[number, number]} */
    this.size = [inner[0] + 2 * margin[0], inner[1] + 2 * margin[1]];
  }

  /**
   * Find the homography to pixels of the maps from a display from -1 to 1.
   *
   * @returns {Float64Array}
   */
  fromUnit() {
    const [width, height] = this.inner;
    const [left, top] = this.margin;
    return multiply3([1, 0, left, 0, 1, top, 0, 0, 1], pixelsFromUnit(width, height));
  }

  /**
   * Find where the columns and the rows of a map lie.
   *
   * @returns {Float64Array[]} x of each column and y of each row, of a display from -1 to 1
   */
  places() {
    return [0, 1].map((axis) =>
      Float64Array.from(
        { length: this.size[axis] },
        (_, at) => ((at - this.margin[axis] + 0.5) / this.inner[axis]) * 2 - 1,
      ),
    );
  }

  /**
   * Cut the display out of a map.
   *
   * @param {FloatPlane} map
   * @returns {FloatPlane}
   */
  within(map) {
    const [width, height] = this.inner;
    const [left, top] = this.margin;
    const data = new Float32Array(width * height);
    for (let y = 0; y < height; y++) {
      const start = (top + y) * map.width + left;
      data.set(map.data.subarray(start, start + width), y * width);
    }
    return { width, height, data };
  }
}

/** Geometry of maps of a display's changes, in which the motion of its grid is seen. */
export class GridMaps extends UnitMaps {
  /**
   * @param {Layout} layout - of the display
   * @param {[number, number]} inner - as of `UnitMaps`
   * @param {number[]} [margin]
   */
  constructor(layout, inner, margin) {
    super(inner, margin);
    const [width, height] = inner;
    this.layout = layout;
    /** Width and height of a block, in pixels of the maps. */
    this.block = [width / layout.cols, height / layout.rows];
    /** Units of work of one pass over a map. */
    this.work = (this.size[0] * this.size[1]) / UNIT_PIXELS;
  }

  /**
   * Find the homography from pixels of the maps to pixels of the layout.
   *
   * @returns {Float64Array}
   */
  toLayout() {
    const { layout, inner, margin } = this;
    const H = resizedHomography(layout.width / inner[0], layout.height / inner[1]);
    return multiply3(H, [1, 0, -margin[0], 0, 1, -margin[1], 0, 0, 1]);
  }

  /**
   * Smooth a map, and take off the mean around each pixel.
   *
   * @param {FloatPlane} change
   * @param {number} span - standard deviation over which it is smoothed, blocks
   * @returns {FloatPlane}
   */
  smooth(change, span) {
    return withoutSlope(blurred(change, span * Math.min(...this.block)), this.block);
  }

  /**
   * Draw the changes of blocks, with nothing around them, and smooth them.
   *
   * @param {ArrayLike<number>} blocks - (rows * cols,)
   * @param {number} span - as of `smooth`
   * @returns {FloatPlane}
   */
  drawn(blocks, span) {
    const { rows, cols } = this.layout;
    const drawn = floatPlane(this.size[0], this.size[1]);
    const plane = { width: cols, height: rows, data: Float32Array.from(blocks) };
    const [left, top] = this.margin;
    call("drawnBlocks", [plane, left, top], [drawn]);
    return this.smooth(drawn, span);
  }
}

/** Adds up what maps of a change tell of the eight numbers, or of these and of one further motion. */
export class MotionEquations {
  #size;
  #places;
  #bending;
  #sums = new Float64Array(SUMS * POWERS * POWERS);
  /** Power, weighed, of what expected changes leave. */
  power = 0;

  /**
   * @param {UnitMaps} maps
   * @param {FloatPlane | null} [bending] - maps of the further motion along x and, below, along y, of
   *   a display from -1 to 1
   */
  constructor(maps, bending = null) {
    this.#size = maps.inner;
    this.#places = maps.places();
    this.#bending = bending;
  }

  /**
   * Take maps of a change, one below the other.
   *
   * @param {FloatPlane} seen
   * @param {FloatPlane} expected
   * @param {number} amplitude - of what is seen, in the expected changes
   * @param {FloatPlane | null} [weight] - of each pixel of a map; 1 where absent
   */
  take(seen, expected, amplitude, weight = null) {
    const [x, y] = this.#places;
    const [width, height] = this.#size;
    const more = new Float64Array(this.#sums.length);
    const sums = { width: POWERS * POWERS, height: SUMS, data: more };
    this.power += call(
      "motionSums",
      [seen, expected, amplitude, weight, x, y, width / 16, height / 16, this.#bending],
      [sums],
    );
    more.forEach((sum, at) => (this.#sums[at] += sum));
  }

  /**
   * Write the normal equations.
   *
   * @returns {{ matrix: Float64Array, right: Float64Array }} (8, 8) and (8,), or (9, 9) and (9,)
   */
  normal() {
    const [xx, xy, yy, leftX, leftY, withX, withY, own] = Array.from({ length: SUMS }, (_, row) =>
      this.#sums.subarray(row * POWERS * POWERS, (row + 1) * POWERS * POWERS),
    );
    const squares = [xx, xy, yy];
    const right = rightOf([leftX, leftY]);
    const count = this.#bending === null ? NUMBERS : NUMBERS + 1;
    const matrix = new Float64Array(count * count);
    for (const [i, changes] of MOTIONS.entries()) {
      for (const [axis, sign, x, y] of changes) {
        for (const [j, others] of MOTIONS.entries()) {
          for (const [other, otherSign, moreX, moreY] of others) {
            const both = squares[axis + other][(y + moreY) * POWERS + x + moreX];
            matrix[i * count + j] += sign * otherSign * both;
          }
        }
      }
    }
    if (this.#bending === null) return { matrix, right };
    rightOf([withX, withY]).forEach((value, i) => {
      matrix[i * count + NUMBERS] = matrix[NUMBERS * count + i] = value;
    });
    matrix[count * count - 1] = own[0];
    return { matrix, right: Float64Array.from([...right, own[1]]) };
  }
}

/**
 * Sum what maps of slopes along x and along y, times something, tell of each number.
 *
 * @param {Float64Array[]} moments - (POWERS * POWERS,) of each map
 * @returns {Float64Array} (8,)
 */
function rightOf(moments) {
  return Float64Array.from(MOTIONS, (changes) =>
    changes.reduce((sum, [axis, sign, x, y]) => sum + sign * moments[axis][y * POWERS + x], 0),
  );
}

/**
 * Find the corners, in the image, of a display that lies elsewhere in its own rectified image.
 *
 * @param {Point[]} corners - pixels of the image, by which the display was rectified
 * @param {Homography} HOldFromNew - in layout pixels
 * @param {Layout} layout - of the display
 * @param {import("../../link/geometry.js").Lens} [lens] - through which it was rectified
 * @returns {Point[]}
 */
export function movedCorners(corners, HOldFromNew, { width, height }, lens = STRAIGHT) {
  const H = multiply3(lens.homography(corners, width, height), HOldFromNew);
  return lens.distort(transform(H, frameCorners(width, height)));
}

/**
 * Make the homography that moves each point by the eight numbers.
 *
 * @param {Float64Array} numbers
 * @returns {Float64Array}
 */
export function unitHomography(numbers) {
  return identity(3).map((value, i) => value + (i < NUMBERS ? numbers[i] : 0));
}

/**
 * Find the homography from a display from -1 to 1 to its pixels, whole at centres.
 *
 * @param {number} width
 * @param {number} height
 * @returns {number[]}
 */
export function pixelsFromUnit(width, height) {
  const [x, y] = [width / 2, height / 2];
  return [x, 0, x - 0.5, 0, y, y - 0.5, 0, 0, 1];
}
