/**
 * Small motions of a display, as the eight numbers of a homography of a display from -1 to 1.
 *
 * Where a display that changes lies a little off, each pixel is off by the motion there times the
 * slope of the change (Lucas & Kanade 1981). Each of the eight numbers moves a point by powers of
 * its place. So the least squares that find them need only moments: sums of a few maps times powers
 * of x and y (export/locate/pilots/motion.py).
 */

import { locatePilotsMotion } from "../../generated/constants.js";
import { slopesOf } from "../../image/slopes.js";
import { identity } from "../../link/linear.js";

const { POWERS, MOTIONS } = locatePilotsMotion;
/** Corners of a display from -1 to 1. */
export const UNIT_CORNERS = /** @type {Point[]} */ (locatePilotsMotion.UNIT_CORNERS);
/** Numbers of a homography that are found. */
export const NUMBERS = MOTIONS.length;

/** Adds up what maps of a change tell of the eight numbers. */
export class MotionEquations {
  #size;
  #places;
  /** Squared slopes along x, products of both slopes, squared slopes along y. */
  #squares;
  /** Slopes along x, and along y, times the change that is to be explained. */
  #products;

  /**
   * @param {number[]} size - width and height of the display, in pixels of the maps
   * @param {Float64Array[]} places - x of each column and y of each row of the maps, of a display
   *   from -1 to 1
   */
  constructor(size, places) {
    this.#size = size;
    this.#places = places;
    const empty = () => new Float64Array(places[0].length * places[1].length);
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
