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
 * The matches of one part, for shifts from -reach to reach along y and, faster, along x: real and
 * imaginary part in turn.
 *
 * @typedef {Float64Array} Matches
 */

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
  const [reachX, reachY] = reach;
  const wide = 2 * reachX + 1;
  const high = 2 * reachY + 1;
  const parts = (ys.length - 1) * (xs.length - 1);
  const matches = Array.from({ length: parts }, () => new Float64Array(2 * wide * high));
  const boxes = new BoxSums(change, reach);
  const across = boundaries(cols, change.width);
  const down = boundaries(rows, change.height);
  for (let row = 0; row < rows; row++) {
    for (let col = 0; col < cols; col++) {
      const value = blocks[row * cols + col];
      if (!value) continue;
      for (const [part, top, bottom] of cut(down[row], down[row + 1], ys)) {
        for (const [side, left, right] of cut(across[col], across[col + 1], xs)) {
          const match = matches[part * (xs.length - 1) + side];
          const { sums, stride } = boxes.of(right - left, bottom - top);
          for (let y = 0, to = 0; y < high; y++) {
            let at = 2 * ((top + y) * stride + left);
            for (const end = to + 2 * wide; to < end; to++, at++) match[to] += value * sums[at];
          }
        }
      }
    }
  }
  return matches;
}

/**
 * Draw the expected changes of the blocks (`cv2.resize` with INTER_NEAREST).
 *
 * @param {ArrayLike<number>} blocks - (rows * cols,)
 * @param {number} rows
 * @param {number} cols
 * @param {number} width - of the map, pixels
 * @param {number} height - of the map, pixels
 * @returns {import("../../image/opencv.js").Plane<Float32Array>}
 */
export function drawnBlocks(blocks, rows, cols, width, height) {
  const data = new Float32Array(width * height);
  const across = boundaries(cols, width);
  const down = boundaries(rows, height);
  for (let row = 0; row < rows; row++) {
    for (let y = down[row]; y < down[row + 1]; y++) {
      for (let col = 0; col < cols; col++) {
        data.fill(blocks[row * cols + col], y * width + across[col], y * width + across[col + 1]);
      }
    }
  }
  return { width, height, data };
}

/**
 * Find the pixels at which blocks begin, where each pixel shows the block that holds its start.
 *
 * @param {number} count - of blocks
 * @param {number} length - of the map, pixels
 * @returns {Int32Array} (count + 1,)
 */
function boundaries(count, length) {
  return Int32Array.from({ length: count + 1 }, (_, block) => Math.ceil((block * length) / count));
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

/** Sums over rectangles of amplitudes, with a border of 0 as wide as the reach. */
class BoxSums {
  /** @type {Map<string, Float32Array>} */
  #known = new Map();

  /**
   * @param {Amplitudes} change
   * @param {[number, number]} reach
   */
  constructor(change, [reachX, reachY]) {
    this.width = change.width + 2 * reachX;
    this.height = change.height + 2 * reachY;
    /** Sums of all that lies above and to the left, real and imaginary part in turn. */
    this.total = new Float64Array(2 * (this.width + 1) * (this.height + 1));
    const { total } = this;
    const stride = 2 * (this.width + 1);
    for (let y = 0; y < this.height; y++) {
      const from = y - reachY;
      const within = from >= 0 && from < change.height;
      let real = 0;
      let imaginary = 0;
      for (let x = 0, to = (y + 1) * stride + 2; x < this.width; x++, to += 2) {
        const at = x - reachX;
        if (within && at >= 0 && at < change.width) {
          real += change.real[from * change.width + at];
          imaginary += change.imaginary[from * change.width + at];
        }
        total[to] = total[to - stride] + real;
        total[to + 1] = total[to + 1 - stride] + imaginary;
      }
    }
  }

  /**
   * Sum up a rectangle of a size from every pixel on.
   *
   * @param {number} width
   * @param {number} height
   * @returns {{ sums: Float32Array, stride: number }} real and imaginary part in turn, and the
   *   number of such pairs in a row
   */
  of(width, height) {
    const stride = this.width + 1 - width;
    const key = `${width} ${height}`;
    let sums = this.#known.get(key);
    if (!sums) {
      const rows = this.height + 1 - height;
      sums = new Float32Array(2 * stride * rows);
      const { total } = this;
      const line = 2 * (this.width + 1);
      for (let y = 0, to = 0; y < rows; y++) {
        const top = y * line;
        const bottom = (y + height) * line;
        for (let x = 0; x < 2 * stride; x++, to++) {
          const right = x + 2 * width;
          sums[to] = total[bottom + right] - total[bottom + x] - total[top + right] + total[top + x];
        }
      }
      this.#known.set(key, sums);
    }
    return { sums, stride };
  }
}
