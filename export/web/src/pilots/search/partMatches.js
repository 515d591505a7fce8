/**
 * How well each part of a display matches what should toggle there, wherever it is shifted to.
 *
 * What should toggle is drawn in rectangles, of which few are not 0. So a match is a sum over
 * rectangles, and each rectangle's sum comes from sums over all pixels above and to the left.
 * Python's `cv2.matchTemplate` finds the same; here that would take ten times as long.
 */

/**
 * Amplitudes at one frequency: real and imaginary part of each pixel of a map.
 *
 * @typedef {{ width: number, height: number, real: Float32Array, imaginary: Float32Array }}
 *   Amplitudes
 */

/**
 * Matches of one part for shifts from -reach to reach along y and, faster, along x: of the real
 * part of amplitudes, and of the imaginary part.
 *
 * @typedef {{ real: Float64Array, imaginary: Float64Array }} Matches
 */

import { boundaries } from "../motion.js";

/** Number of rectangles whose sums are added in one pass over the shifts. */
const AT_ONCE = 4;

/**
 * Match each part of a map.
 *
 * @param {Amplitudes} change
 * @param {ArrayLike<number>} blocks - (rows * cols,) what is expected of each block
 * @param {number} rows
 * @param {number} cols
 * @param {number[]} ys - the rows of the map at which parts begin and end
 * @param {number[]} xs - the columns of the map at which parts begin and end
 * @param {[number, number]} reach - largest shift along x and along y, pixels
 * @returns {Matches[]} of each part, from the top left on, row by row
 */
export function matchParts(change, blocks, rows, cols, ys, xs, reach) {
  const wide = 2 * reach[0] + 1;
  const high = 2 * reach[1] + 1;
  const { width, height } = change;
  const real = new BoxSums(change.real, width, height, reach);
  const imaginary = change.imaginary.some((value) => value !== 0)
    ? new BoxSums(change.imaginary, width, height, reach)
    : null;
  return rectanglesOfParts(blocks, rows, cols, width, height, ys, xs).map((rectangles) => {
    const matches = {
      real: new Float64Array(wide * high),
      imaginary: new Float64Array(wide * high),
    };
    for (const alike of rectangles.values()) {
      addMatches(matches.real, wide, real.of(alike.width, alike.height), alike.places);
      if (imaginary === null) continue;
      addMatches(matches.imaginary, wide, imaginary.of(alike.width, alike.height), alike.places);
    }
    return matches;
  });
}

/**
 * Rectangles of one size: value, left and top of each.
 *
 * @typedef {{ width: number, height: number, places: [number, number, number][] }} Rectangles
 */

/**
 * List the rectangles in which blocks are drawn that are not 0, cut where parts meet.
 *
 * @param {ArrayLike<number>} blocks
 * @param {number} rows
 * @param {number} cols
 * @param {number} width - of the map
 * @param {number} height - of the map
 * @param {number[]} ys
 * @param {number[]} xs
 * @returns {Map<string, Rectangles>[]} by size, for each part
 */
function rectanglesOfParts(blocks, rows, cols, width, height, ys, xs) {
  const count = (ys.length - 1) * (xs.length - 1);
  /** @type {Map<string, Rectangles>[]} */
  const parts = Array.from({ length: count }, () => new Map());
  const across = boundaries(cols, width);
  const down = boundaries(rows, height);
  for (let block = 0; block < rows * cols; block++) {
    if (!blocks[block]) continue;
    const row = Math.floor(block / cols);
    const col = block % cols;
    for (const [part, top, bottom] of cut(down[row], down[row + 1], ys)) {
      for (const [side, left, right] of cut(across[col], across[col + 1], xs)) {
        const rectangles = parts[part * (xs.length - 1) + side];
        const size = `${right - left} ${bottom - top}`;
        const alike = rectangles.get(size) ?? {
          width: right - left,
          height: bottom - top,
          places: [],
        };
        rectangles.set(size, alike);
        alike.places.push([blocks[block], left, top]);
      }
    }
  }
  return parts;
}

/**
 * Add, for each shift, the sums over rectangles to the matches.
 *
 * @param {Float64Array} match
 * @param {number} wide - number of shifts along x
 * @param {{ sums: Float32Array, stride: number }} boxes - sums over rectangles of this size
 * @param {[number, number, number][]} places - value, left and top of each rectangle
 */
function addMatches(match, wide, { sums, stride }, places) {
  for (let first = 0; first < places.length; first += AT_ONCE) {
    const [one, two, three, four] = [0, 1, 2, 3].map((k) => places[first + k] ?? [0, 0, 0]);
    const [v1, v2, v3, v4] = [one[0], two[0], three[0], four[0]];
    let [a1, a2, a3, a4] = [one, two, three, four].map(([, left, top]) => top * stride + left);
    for (let to = 0; to < match.length; ) {
      for (let x = 0; x < wide; x++, to++) {
        match[to] += v1 * sums[a1 + x] + v2 * sums[a2 + x] + v3 * sums[a3 + x] + v4 * sums[a4 + x];
      }
      a1 += stride;
      a2 += stride;
      a3 += stride;
      a4 += stride;
    }
  }
}

/**
 * Cut a stretch where parts meet.
 *
 * @param {number} start
 * @param {number} stop
 * @param {number[]} meeting - where parts begin and end
 * @returns {[number, number, number][]} number of each part that it lies in, with start and stop
 */
function cut(start, stop, meeting) {
  /** @type {[number, number, number][]} */
  const pieces = [];
  for (let part = 0; part + 1 < meeting.length; part++) {
    const from = Math.max(start, meeting[part]);
    const to = Math.min(stop, meeting[part + 1]);
    if (from < to) pieces.push([part, from, to]);
  }
  return pieces;
}

/** Sums over rectangles of a map, with a border of 0 as wide as the reach. */
class BoxSums {
  /** @type {Map<string, { sums: Float32Array, stride: number }>} */
  #known = new Map();

  /**
   * @param {Float32Array} map
   * @param {number} width - of the map
   * @param {number} height - of the map
   * @param {[number, number]} reach
   */
  constructor(map, width, height, [reachX, reachY]) {
    this.width = width + 2 * reachX;
    this.height = height + 2 * reachY;
    const stride = this.width + 1;
    /** Sums of all that lies above and to the left. */
    this.total = new Float64Array(stride * (this.height + 1));
    const { total } = this;
    for (let y = 0; y < this.height; y++) {
      const from = (y - reachY) * width;
      const within = y >= reachY && y < reachY + height;
      let sum = 0;
      for (let x = 0, to = (y + 1) * stride + 1; x < this.width; x++, to++) {
        if (within && x >= reachX && x < reachX + width) sum += map[from + x - reachX];
        total[to] = total[to - stride] + sum;
      }
    }
  }

  /**
   * Sum up a rectangle of a size from every pixel on.
   *
   * @param {number} width
   * @param {number} height
   * @returns {{ sums: Float32Array, stride: number }} sums, and the number of them in a row
   */
  of(width, height) {
    const size = `${width} ${height}`;
    const known = this.#known.get(size);
    if (known) return known;
    const stride = this.width + 1 - width;
    const rows = this.height + 1 - height;
    const sums = new Float32Array(stride * rows);
    const { total } = this;
    for (let y = 0, to = 0; y < rows; y++) {
      const top = y * (this.width + 1);
      const bottom = top + height * (this.width + 1);
      for (let x = 0; x < stride; x++, to++) {
        const right = x + width;
        sums[to] = total[bottom + right] - total[bottom + x] - total[top + right] + total[top + x];
      }
    }
    const boxes = { sums, stride };
    this.#known.set(size, boxes);
    return boxes;
  }
}
