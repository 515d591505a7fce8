/** Points of an image whose surroundings differ from all that lie near (Shi & Tomasi 1994). */

/** @typedef {[number, number]} Point */

/** Finds points as OpenCV's `goodFeaturesToTrack` does; the strengths of an image count once. */
export class Features {
  #strengths;

  /** @param {BytePlane} image */
  constructor(image) {
    this.width = image.width;
    this.height = image.height;
    this.#strengths = strengths(image);
  }

  /**
   * Choose the strongest points.
   *
   * @param {number} count - largest number of points
   * @param {number} quality - smallest strength, as a share of the greatest one in the mask
   * @param {number} apart - smallest distance between two points, pixels
   * @param {Uint8Array | null} [mask] - nonzero for each pixel that may be chosen; all where absent
   * @returns {Point[]} the strongest first
   */
  choose(count, quality, apart, mask = null) {
    const { width, height } = this;
    const strength = this.#strengths;
    let most = 0;
    for (let at = 0; at < strength.length; at++) {
      if (strength[at] > most && (!mask || mask[at])) most = strength[at];
    }
    const least = most * quality;
    /** @type {number[]} */
    const tops = [];
    for (let y = 1; y < height - 1; y++) {
      for (let at = y * width + 1, end = at + width - 2; at < end; at++) {
        const here = strength[at];
        if (here <= least || (mask && !mask[at])) continue;
        if (here < strength[at - 1] || here < strength[at + 1]) continue;
        const above = at - width;
        if (here < strength[above - 1] || here < strength[above]) continue;
        const below = at + width;
        if (here < strength[above + 1] || here < strength[below - 1]) continue;
        if (here < strength[below] || here < strength[below + 1]) continue;
        tops.push(at);
      }
    }
    tops.sort((one, other) => strength[other] - strength[one] || other - one);
    return this.#spread(tops, count, apart);
  }

  /**
   * Take points in order, but none that lies near one that was taken.
   *
   * @param {number[]} tops - places of pixels
   * @param {number} count
   * @param {number} apart
   * @returns {Point[]}
   */
  #spread(tops, count, apart) {
    const cell = Math.max(1, Math.round(apart));
    const cols = Math.ceil(this.width / cell);
    const rows = Math.ceil(this.height / cell);
    /** @type {Point[][]} */
    const taken = Array.from({ length: cols * rows }, () => []);
    /** @type {Point[]} */
    const points = [];
    for (const at of tops) {
      if (points.length >= count) break;
      const x = at % this.width;
      const y = (at - x) / this.width;
      const col = Math.floor(x / cell);
      const row = Math.floor(y / cell);
      let free = true;
      for (let r = Math.max(0, row - 1); free && r <= Math.min(rows - 1, row + 1); r++) {
        for (let c = Math.max(0, col - 1); free && c <= Math.min(cols - 1, col + 1); c++) {
          free = taken[r * cols + c].every(
            ([otherX, otherY]) => (x - otherX) ** 2 + (y - otherY) ** 2 >= apart * apart,
          );
        }
      }
      if (!free) continue;
      taken[row * cols + col].push([x, y]);
      points.push([x, y]);
    }
    return points;
  }
}

/**
 * Find, for each pixel, the smaller eigenvalue of the squared gradients around it; beyond the
 * border the image is mirrored.
 *
 * @param {BytePlane} image
 * @returns {Float32Array}
 */
function strengths({ width, height, data }) {
  const strength = new Float32Array(width * height);
  const mirrored = (/** @type {number} */ row) => {
    const within = row < 0 ? -row : row >= height ? 2 * height - 2 - row : row;
    return Math.min(Math.max(within, 0), height - 1);
  };
  const rows = [0, 1, 2].map(() => new Uint8Array(width + 2));
  // products of the gradients in three rows of pixels
  const products = [0, 1, 2].map(() => [0, 1, 2].map(() => new Int32Array(width + 2)));
  const multiply = (/** @type {number} */ y, /** @type {Int32Array[]} */ [xx, xy, yy]) => {
    rows.forEach((row, i) => {
      const start = mirrored(y + i - 1) * width;
      row.set(data.subarray(start, start + width), 1);
      mirrorEnds(row);
    });
    const [above, here, below] = rows;
    for (let x = 1; x <= width; x++) {
      const rising = below[x + 1] - above[x - 1];
      const falling = above[x + 1] - below[x - 1];
      const slopeX = rising + falling + 2 * (here[x + 1] - here[x - 1]);
      const slopeY = rising - falling + 2 * (below[x] - above[x]);
      xx[x] = slopeX * slopeX;
      xy[x] = slopeX * slopeY;
      yy[x] = slopeY * slopeY;
    }
    for (const line of [xx, xy, yy]) mirrorEnds(line);
  };
  const sums = [0, 1, 2].map(() => new Int32Array(width + 2));
  // Sobel's weights, three by three pixels, and levels of 255
  const unit = 1 / (4 * 3 * 255) ** 2;
  multiply(0, products[0]);
  for (let y = 0, at = 0; y < height; y++) {
    if (y + 1 < height) multiply(y + 1, products[(y + 1) % 3]);
    const [one, two, three] = [y - 1, y, y + 1].map((row) => products[mirrored(row) % 3]);
    for (let kind = 0; kind < 3; kind++) addLines(one[kind], two[kind], three[kind], sums[kind]);
    const [xx, xy, yy] = sums;
    for (let x = 1; x <= width; x++, at++) {
      const a = (xx[x - 1] + xx[x] + xx[x + 1]) / 2;
      const b = xy[x - 1] + xy[x] + xy[x + 1];
      const c = (yy[x - 1] + yy[x] + yy[x + 1]) / 2;
      strength[at] = (a + c - Math.sqrt((a - c) * (a - c) + b * b)) * unit;
    }
  }
  return strength;
}

/**
 * Let the ends of a line stand for the pixels beyond it.
 *
 * @param {Uint8Array | Int32Array} line - with a place more at both ends
 */
function mirrorEnds(line) {
  const last = line.length - 2;
  line[0] = line[Math.min(2, last)];
  line[last + 1] = line[Math.max(last - 1, 1)];
}

/**
 * @param {Int32Array} one
 * @param {Int32Array} two
 * @param {Int32Array} three
 * @param {Int32Array} sum - takes the sums
 */
function addLines(one, two, three, sum) {
  for (let i = 0; i < sum.length; i++) sum[i] = one[i] + two[i] + three[i];
}
