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

import { pilotsMotion } from "../generated/constants.js";
import { blurred, lessMeanAround } from "../image/blur.js";
import { drawnBlocks } from "../image/shrink.js";
import { slopesOf } from "../image/slopes.js";
import { STRAIGHT, frameCorners, resizedHomography, transform } from "../link/geometry.js";
import { identity, multiply3 } from "../link/linear.js";

const { MAP_PX, POWERS, MOTIONS } = pilotsMotion;
/** Corners of a display from -1 to 1. */
export const UNIT_CORNERS = /** @type {Point[]} */ (pilotsMotion.UNIT_CORNERS);
/** Numbers of a homography that are found. */
export const NUMBERS = MOTIONS.length;
/** Largest number of pixels that are handled in one unit of work (`../link/code/steps.js`). */
const UNIT_PIXELS = 40_000;

/**
 * Take off the mean around each pixel, over three blocks.
 *
 * @param {FloatPlane} change - by how much the pixels of the rectified display changed
 * @param {ArrayLike<number>} block - width and height of a block, in pixels of `change`
 * @returns {FloatPlane}
 */
export function withoutSlope(change, block) {
  return lessMeanAround(change, Math.floor(3 * block[0]) | 1, Math.floor(3 * block[1]) | 1);
}

/**
 * Give width and height of the maps of what toggles, for a layout.
 *
 * @param {Layout} layout
 * @returns {[number, number]}
 */
export function mapSize(layout) {
  const side = Math.min(layout.width / layout.cols, layout.height / layout.rows);
  const factor = Math.min(4, Math.max(1, Math.floor(side / MAP_PX)));
  return [Math.floor(layout.width / factor), Math.floor(layout.height / factor)];
}

/** Geometry of maps of a display's changes, in which the motion of its grid is seen. */
export class GridMaps {
  /**
   * @param {Layout} layout - of the display
   * @param {number[]} inner - width and height of the display, in pixels of the maps
   * @param {number[]} [margin] - width and height of what lies on each side of the display
   */
  constructor(layout, inner, margin = [0, 0]) {
    const [width, height] = inner;
    this.layout = layout;
    this.inner = inner;
    this.margin = margin;
    /** Width and height of the maps, pixels. */
    this.size = [width + 2 * margin[0], height + 2 * margin[1]];
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
    const [[width, height], [inner, down], [left, top]] = [this.size, this.inner, this.margin];
    const fine = drawnBlocks(Float32Array.from(blocks), rows, cols, inner, down).data;
    const data = new Float32Array(width * height);
    for (let y = 0; y < down; y++) {
      data.set(fine.subarray(y * inner, (y + 1) * inner), (top + y) * width + left);
    }
    return this.smooth({ width, height, data }, span);
  }
}

/** Adds up what maps of a change tell of the eight numbers. */
export class MotionEquations {
  #size;
  #places;
  /** Squared slopes along x, products of both slopes, squared slopes along y. */
  #squares;
  /** Slopes along x, and along y, times the change that is to be explained. */
  #products;

  /** @param {GridMaps} maps */
  constructor(maps) {
    this.#size = maps.inner;
    this.#places = maps.places();
    const empty = () => new Float64Array(this.#places[0].length * this.#places[1].length);
    this.#squares = [empty(), empty(), empty()];
    this.#products = [empty(), empty()];
  }

  /**
   * Take a map of an expected change.
   *
   * @param {FloatPlane} expected
   * @param {number} amplitude - of what is seen, in the expected changes
   * @param {Float32Array | Float64Array} residual - of each pixel, what the expected change leaves
   * @param {Float32Array} [weight] - of each pixel; 1 where absent
   */
  take(expected, amplitude, residual, weight) {
    const [xx, xy, yy] = this.#squares;
    const [x, y] = this.#products;
    const { across, down } = slopesOf(expected);
    const scaleX = (amplitude * this.#size[0]) / 16;
    const scaleY = (amplitude * this.#size[1]) / 16;
    for (let at = 0; at < across.length; at++) {
      const slopeX = scaleX * across[at];
      const slopeY = scaleY * down[at];
      const share = weight ? weight[at] : 1;
      xx[at] += share * slopeX * slopeX;
      xy[at] += share * slopeX * slopeY;
      yy[at] += share * slopeY * slopeY;
      x[at] += share * slopeX * residual[at];
      y[at] += share * slopeY * residual[at];
    }
  }

  /**
   * Write the normal equations of the eight numbers, or of these and of one further motion.
   *
   * @param {Float32Array[] | null} [further] - maps of the further motion along x and along y, of a
   *   display from -1 to 1
   * @returns {{ matrix: Float64Array, right: Float64Array }} (8, 8) and (8,), or (9, 9) and (9,)
   */
  normal(further = null) {
    const squares = this.#squares.map((map) => this.#moments(map));
    const right = this.#right(this.#products);
    const count = further === null ? NUMBERS : NUMBERS + 1;
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
    if (further === null) return { matrix, right };
    const [furtherX, furtherY] = further;
    const [xx, xy, yy] = this.#squares;
    const [x, y] = this.#products;
    const withX = xx.map((value, at) => furtherX[at] * value + furtherY[at] * xy[at]);
    const withY = xy.map((value, at) => furtherX[at] * value + furtherY[at] * yy[at]);
    this.#right([withX, withY]).forEach((value, i) => {
      matrix[i * count + NUMBERS] = matrix[NUMBERS * count + i] = value;
    });
    let [alone, left] = [0, 0];
    for (let at = 0; at < x.length; at++) {
      alone += furtherX[at] * withX[at] + furtherY[at] * withY[at];
      left += furtherX[at] * x[at] + furtherY[at] * y[at];
    }
    matrix[count * count - 1] = alone;
    return { matrix, right: Float64Array.from([...right, left]) };
  }

  /**
   * Sum what maps of slopes along x and along y, times something, tell of each number.
   *
   * @param {Float64Array[]} maps
   * @returns {Float64Array} (8,)
   */
  #right(maps) {
    const products = maps.map((map) => this.#moments(map));
    return Float64Array.from(MOTIONS, (changes) =>
      changes.reduce(
        (sum, [axis, sign, x, y]) => sum + sign * products[axis][y * POWERS + x],
        0,
      ),
    );
  }

  /**
   * Sum a map times powers of y and of x.
   *
   * @param {Float64Array} map
   * @returns {Float64Array} (POWERS, POWERS) powers of y and of x
   */
  #moments(map) {
    const [xs, ys] = this.#places;
    const table = new Float64Array(POWERS * POWERS);
    for (let row = 0, at = 0; row < ys.length; row++) {
      let [one, two, three, four, five] = [0, 0, 0, 0, 0];
      for (let col = 0; col < xs.length; col++, at++) {
        const x = xs[col];
        let weight = map[at];
        one += weight;
        two += weight *= x;
        three += weight *= x;
        four += weight *= x;
        five += weight * x;
      }
      const line = [one, two, three, four, five];
      for (let power = 0, factor = 1; power < POWERS; power++, factor *= ys[row]) {
        for (let k = 0; k < POWERS; k++) table[power * POWERS + k] += factor * line[k];
      }
    }
    return table;
  }
}

/**
 * Find the corners, in the image, of a display that lies elsewhere in its own rectified image.
 *
 * @param {Point[]} corners - pixels of the image, by which the display was rectified
 * @param {Homography} HOldFromNew - in layout pixels
 * @param {Layout} layout - of the display
 * @param {import("../link/geometry.js").Lens} [lens] - through which it was rectified
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
