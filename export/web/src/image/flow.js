/**
 * Where points of a reference image lie in a later one, by their surroundings.
 *
 * This is Lucas and Kanade's method on a pyramid (Bouguet 2000) in the whole numbers of OpenCV's
 * `calcOpticalFlowPyrLK`. All that concerns the reference alone is worked out once.
 */

/** @typedef {[number, number]} Point */

/** Largest number of steps of a point on each level of the pyramid. */
const STEPS = 30;
/** Length of a step, in pixels, below which a point has arrived. */
const SHORT_STEP_PX = 0.01;
/** Smallest eigenvalue of the gradients around a point, per pixel, at which it can be followed. */
const LEAST_EIGENVALUE = 1e-4;
/** Bits of the whole numbers that stand for the shares of four neighbouring pixels. */
const SHARE_BITS = 14;
/** Bits that intensities between pixels keep behind the point. */
const LEVEL_BITS = 5;
/** Unit of squared gradients, as a factor that brings them to OpenCV's numbers. */
const SQUARED_UNIT = 1 / (1 << 20);

/**
 * An image at one scale, with a border of reflected pixels all around.
 *
 * @typedef {{ width: number, height: number, stride: number, data: Uint8Array }} Level
 */

/**
 * What is known of the surroundings of all points on one level of the reference's pyramid.
 *
 * @typedef {object} Surroundings
 * @property {Uint8Array} usable - 1 for each point that lies in the reference, and whose
 *   surroundings have gradients
 * @property {Int16Array} levels - (points, windowPx squared) intensities
 * @property {Int16Array} gradientX - (points, windowPx squared)
 * @property {Int16Array} gradientY - (points, windowPx squared)
 * @property {Float64Array} inverted - (points, 3) inverse of the matrix of squared gradients
 */

/** Follows points of a reference image. */
export class Flow {
  #windowPx;
  #halvings;
  /** @type {Level[]} */
  #pyramid = [];
  #surroundings;
  /** Left of the window of the last point that `#step` moved. */
  #x = 0;
  /** Top of that window. */
  #y = 0;
  /** Whether that window remained in the image. */
  #inside = true;

  /**
   * @param {BytePlane} reference
   * @param {Point[]} points - pixels of the reference
   * @param {number} windowPx - width and height of the surroundings, an odd number of pixels
   * @param {number} halvings - number of times that the images are halved
   */
  constructor(reference, points, windowPx, halvings) {
    /** Points that are followed. */
    this.points = points;
    this.#windowPx = windowPx;
    this.#halvings = halvings;
    this.#surroundings = this.#filled(reference).map((level, halved) =>
      this.#surroundingsOn(level, halved),
    );
  }

  /**
   * Find the points in an image.
   *
   * @param {BytePlane} image - of the size of the reference
   * @param {Point[]} [guess] - where each point is expected; where it was, where absent
   * @returns {{ moved: Point[], found: Uint8Array }} where each point lies, and 1 for each point
   *   that was followed to there
   */
  follow(image, guess = this.points) {
    const pyramid = this.#filled(image);
    const half = (this.#windowPx - 1) / 2;
    const found = new Uint8Array(this.points.length).fill(1);
    /** @type {Point[]} */
    const moved = new Array(this.points.length);
    for (let point = 0; point < this.points.length; point++) {
      const scale = 1 << (pyramid.length - 1);
      let x = guess[point][0] / scale;
      let y = guess[point][1] / scale;
      for (let halved = pyramid.length - 1; halved >= 0; halved--) {
        const { usable } = this.#surroundings[halved];
        if (usable[point]) {
          this.#step(pyramid[halved], halved, point, x - half, y - half);
          x = this.#x + half;
          y = this.#y + half;
        }
        if (halved > 0) {
          x *= 2;
          y *= 2;
        } else if (!usable[point] || !this.#inside) {
          found[point] = 0;
        }
      }
      moved[point] = [Math.fround(x), Math.fround(y)];
    }
    return { moved, found };
  }

  /**
   * Move a point's window on one level until it fits.
   *
   * @param {Level} level
   * @param {number} halved - number of the level
   * @param {number} point - number of the point
   * @param {number} x - left of the window
   * @param {number} y - top of the window
   */
  #step({ width, height, stride, data }, halved, point, x, y) {
    const side = this.#windowPx;
    const around = this.#surroundings[halved];
    const { levels, gradientX, gradientY } = around;
    const [inverse11, inverse12, inverse22] = around.inverted.subarray(3 * point, 3 * point + 3);
    const start = point * side * side;
    const rounding = 1 << (SHARE_BITS - LEVEL_BITS - 1);
    let beforeX = 0;
    let beforeY = 0;
    this.#inside = true;
    for (let step = 0; step < STEPS; step++) {
      const left = Math.floor(x);
      const top = Math.floor(y);
      if (!(left >= -side && left < width && top >= -side && top < height)) {
        this.#inside = false;
        break;
      }
      const [share00, share01, share10, share11] = sharesOf(x - left, y - top);
      let sumX = 0;
      let sumY = 0;
      let at = start;
      let line = (top + side) * stride + left + side;
      for (let row = 0; row < side; row++, line += stride) {
        let above = data[line];
        let below = data[line + stride];
        for (let col = 1; col <= side; col++, at++) {
          const nextAbove = data[line + col];
          const nextBelow = data[line + stride + col];
          const level =
            (above * share00 +
              nextAbove * share01 +
              below * share10 +
              nextBelow * share11 +
              rounding) >>
            (SHARE_BITS - LEVEL_BITS);
          const difference = level - levels[at];
          sumX += difference * gradientX[at];
          sumY += difference * gradientY[at];
          above = nextAbove;
          below = nextBelow;
        }
      }
      sumX *= SQUARED_UNIT;
      sumY *= SQUARED_UNIT;
      const stepX = -inverse11 * sumX - inverse12 * sumY;
      const stepY = -inverse12 * sumX - inverse22 * sumY;
      x += stepX;
      y += stepY;
      if (stepX * stepX + stepY * stepY <= SHORT_STEP_PX * SHORT_STEP_PX) break;
      // back and forth
      if (
        step > 0 &&
        Math.abs(stepX + beforeX) < SHORT_STEP_PX &&
        Math.abs(stepY + beforeY) < SHORT_STEP_PX
      ) {
        x -= stepX / 2;
        y -= stepY / 2;
        break;
      }
      beforeX = stepX;
      beforeY = stepY;
    }
    if (halved === 0 && this.#inside) {
      const left = Math.floor(x);
      const top = Math.floor(y);
      this.#inside = left >= -side && left < width && top >= -side && top < height;
    }
    this.#x = x;
    this.#y = y;
  }

  /**
   * Look at the surroundings of all points on one level of the reference.
   *
   * @param {Level} level
   * @param {number} halved - number of the level
   * @returns {Surroundings}
   */
  #surroundingsOn({ width, height, stride, data }, halved) {
    const side = this.#windowPx;
    const area = side * side;
    const count = this.points.length;
    const around = {
      usable: new Uint8Array(count),
      levels: new Int16Array(count * area),
      gradientX: new Int16Array(count * area),
      gradientY: new Int16Array(count * area),
      inverted: new Float64Array(3 * count),
    };
    const wide = side + 1;
    const slopesX = new Int32Array(wide * wide);
    const slopesY = new Int32Array(wide * wide);
    for (let point = 0; point < count; point++) {
      const x = this.points[point][0] / (1 << halved) - (side - 1) / 2;
      const y = this.points[point][1] / (1 << halved) - (side - 1) / 2;
      const left = Math.floor(x);
      const top = Math.floor(y);
      if (!(left >= -side && left < width && top >= -side && top < height)) continue;
      for (let row = 0, at = 0; row < wide; row++) {
        for (let col = 0; col < wide; col++, at++) {
          const inX = left + col >= 0 && left + col < width;
          const inY = top + row >= 0 && top + row < height;
          slopesX[at] = slopesY[at] = 0;
          if (!inX || !inY) continue;
          const here = (top + row + side) * stride + left + col + side;
          const [above, below] = [here - stride, here + stride];
          slopesX[at] =
            3 * (data[above + 1] - data[above - 1] + data[below + 1] - data[below - 1]) +
            10 * (data[here + 1] - data[here - 1]);
          slopesY[at] =
            3 * (data[below - 1] - data[above - 1] + data[below + 1] - data[above + 1]) +
            10 * (data[below] - data[above]);
        }
      }
      const [share00, share01, share10, share11] = sharesOf(x - left, y - top);
      let sumXX = 0;
      let sumXY = 0;
      let sumYY = 0;
      for (let row = 0, at = point * area; row < side; row++) {
        let here = (top + row + side) * stride + left + side;
        let slope = row * wide;
        for (let col = 0; col < side; col++, at++, here++, slope++) {
          const drop = SHARE_BITS - LEVEL_BITS;
          around.levels[at] =
            (data[here] * share00 +
              data[here + 1] * share01 +
              data[here + stride] * share10 +
              data[here + stride + 1] * share11 +
              (1 << (drop - 1))) >>
            drop;
          const slopeX = mixed(slopesX, slope, wide, share00, share01, share10, share11);
          const slopeY = mixed(slopesY, slope, wide, share00, share01, share10, share11);
          around.gradientX[at] = slopeX;
          around.gradientY[at] = slopeY;
          sumXX += slopeX * slopeX;
          sumXY += slopeX * slopeY;
          sumYY += slopeY * slopeY;
        }
      }
      const [a, b, c] = [sumXX * SQUARED_UNIT, sumXY * SQUARED_UNIT, sumYY * SQUARED_UNIT];
      const squared = a * c - b * b;
      const least = (a + c - Math.sqrt((a - c) ** 2 + 4 * b * b)) / (2 * area);
      if (least < LEAST_EIGENVALUE || squared < 2 ** -23) continue;
      around.usable[point] = 1;
      around.inverted.set([c / squared, -b / squared, a / squared], 3 * point);
    }
    return around;
  }

  /**
   * Build the pyramid of an image, in memory that the next image overwrites.
   *
   * @param {BytePlane} image
   * @returns {Level[]}
   */
  #filled(image) {
    const pad = this.#windowPx;
    for (let halved = 0; halved <= this.#halvings; halved++) {
      const last = this.#pyramid[halved - 1];
      const width = last ? (last.width + 1) >> 1 : image.width;
      const height = last ? (last.height + 1) >> 1 : image.height;
      if (last && (width <= pad || height <= pad)) break;
      const stride = width + 2 * pad;
      const level = (this.#pyramid[halved] ??= {
        ...{ width, height, stride },
        data: new Uint8Array(stride * (height + 2 * pad)),
      });
      if (last) halve(last, level, pad);
      else {
        for (let row = 0; row < height; row++) {
          const line = image.data.subarray(row * width, (row + 1) * width);
          level.data.set(line, (row + pad) * stride + pad);
        }
      }
      reflectBorder(level, pad);
    }
    return this.#pyramid;
  }
}

/**
 * @param {Int32Array} values
 * @param {number} at
 * @param {number} stride
 * @param {number} share00
 * @param {number} share01
 * @param {number} share10
 * @param {number} share11
 */
function mixed(values, at, stride, share00, share01, share10, share11) {
  const sum =
    values[at] * share00 +
    values[at + 1] * share01 +
    values[at + stride] * share10 +
    values[at + stride + 1] * share11;
  return (sum + (1 << (SHARE_BITS - 1))) >> SHARE_BITS;
}

/**
 * Smooth a level by the weights 1, 4, 6, 4 and 1 along both axes, and take every other pixel.
 *
 * @param {Level} from
 * @param {Level} to
 * @param {number} pad - width of the border of both
 */
function halve(from, to, pad) {
  const { stride, data } = from;
  const lines = [0, 1, 2, 3, 4].map(() => new Int32Array(to.width));
  const smooth = (/** @type {number} */ row) => {
    const line = lines[(row + 5) % 5];
    let at = (row + pad) * stride + pad;
    for (let x = 0; x < to.width; x++, at += 2) {
      line[x] =
        data[at - 2] + data[at + 2] + 4 * (data[at - 1] + data[at + 1]) + 6 * data[at];
    }
  };
  for (let row = -2; row <= 0; row++) smooth(row);
  for (let y = 0; y < to.height; y++) {
    smooth(2 * y + 1);
    smooth(2 * y + 2);
    const [one, two, three, four, five] = [-2, -1, 0, 1, 2].map((k) => lines[(2 * y + k + 5) % 5]);
    let at = (y + pad) * to.stride + pad;
    for (let x = 0; x < to.width; x++, at++) {
      to.data[at] = (one[x] + five[x] + 4 * (two[x] + four[x]) + 6 * three[x] + 128) >> 8;
    }
  }
}

/**
 * Fill the border around a level with the pixels that lie as far within it.
 *
 * @param {Level} level - at least as wide and tall as its border, and one pixel more
 * @param {number} pad - width of the border
 */
function reflectBorder({ width, height, stride, data }, pad) {
  for (let row = pad; row < pad + height; row++) {
    const left = row * stride + pad;
    const right = left + width - 1;
    for (let k = 1; k <= pad; k++) {
      data[left - k] = data[left + k];
      data[right + k] = data[right - k];
    }
  }
  const bottom = pad + height - 1;
  for (let k = 1; k <= pad; k++) {
    const above = (pad + k) * stride;
    const below = (bottom - k) * stride;
    data.copyWithin((pad - k) * stride, above, above + stride);
    data.copyWithin((bottom + k) * stride, below, below + stride);
  }
}

/**
 * Shares of four neighbouring pixels in a point between them, as whole numbers that add up to
 * 2 ** `SHARE_BITS`.
 *
 * @param {number} x - from the left pixels to the right ones, in [0, 1]
 * @param {number} y - from the upper pixels to the lower ones, in [0, 1]
 * @returns {[number, number, number, number]} upper left, upper right, lower left, lower right
 */
function sharesOf(x, y) {
  const unit = 1 << SHARE_BITS;
  const share00 = Math.round((1 - x) * (1 - y) * unit);
  const share01 = Math.round(x * (1 - y) * unit);
  const share10 = Math.round((1 - x) * y * unit);
  return [share00, share01, share10, unit - share00 - share01 - share10];
}
