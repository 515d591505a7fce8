/** Points of an image whose surroundings differ from all that lie near (Shi & Tomasi 1994). */

/** @typedef {import("./opencv.js").Plane<Uint8Array>} BytePlane */
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
 * Find, for each pixel, the smaller eigenvalue of the squared gradients around it.
 *
 * @param {BytePlane} image
 * @returns {Float32Array}
 */
function strengths({ width, height, data }) {
  const size = width * height;
  const [xx, xy, yy] = [new Int32Array(size), new Int32Array(size), new Int32Array(size)];
  const reflected = (/** @type {number} */ at, /** @type {number} */ length) => {
    if (length === 1) return 0;
    return at < 0 ? -at : at >= length ? 2 * length - 2 - at : at;
  };
  for (let y = 0; y < height; y++) {
    const above = reflected(y - 1, height) * width;
    const here = y * width;
    const below = reflected(y + 1, height) * width;
    for (let x = 0; x < width; x++) {
      const left = x > 0 ? x - 1 : reflected(-1, width);
      const right = x < width - 1 ? x + 1 : reflected(width, width);
      const slopeX =
        data[above + right] -
        data[above + left] +
        2 * (data[here + right] - data[here + left]) +
        data[below + right] -
        data[below + left];
      const slopeY =
        data[below + left] -
        data[above + left] +
        2 * (data[below + x] - data[above + x]) +
        data[below + right] -
        data[above + right];
      xx[here + x] = slopeX * slopeX;
      xy[here + x] = slopeX * slopeY;
      yy[here + x] = slopeY * slopeY;
    }
  }
  const strength = new Float32Array(size);
  const [lineXX, lineXY, lineYY] = [0, 1, 2].map(() => new Int32Array(width));
  // Sobel's weights, three by three pixels, and levels of 255
  const unit = 1 / (4 * 3 * 255) ** 2;
  for (let y = 0; y < height; y++) {
    const above = reflected(y - 1, height) * width;
    const here = y * width;
    const below = reflected(y + 1, height) * width;
    for (let x = 0; x < width; x++) {
      lineXX[x] = xx[above + x] + xx[here + x] + xx[below + x];
      lineXY[x] = xy[above + x] + xy[here + x] + xy[below + x];
      lineYY[x] = yy[above + x] + yy[here + x] + yy[below + x];
    }
    for (let x = 0; x < width; x++) {
      const left = x > 0 ? x - 1 : reflected(-1, width);
      const right = x < width - 1 ? x + 1 : reflected(width, width);
      const a = (lineXX[left] + lineXX[x] + lineXX[right]) / 2;
      const b = lineXY[left] + lineXY[x] + lineXY[right];
      const c = (lineYY[left] + lineYY[x] + lineYY[right]) / 2;
      strength[here + x] = (a + c - Math.sqrt((a - c) ** 2 + b * b)) * unit;
    }
  }
  return strength;
}
