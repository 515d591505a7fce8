/**
 * Follow a display by what lies around it, whatever it shows.
 *
 * A display may show a film, whose points move by themselves. What surrounds it does not: the bezel
 * lies in the display's plane, and letterbox bars, desk and wall keep their edges. So a ring around
 * the display is compared, pixel by pixel, with the same ring in a reference frame, and the eight
 * numbers of a homography follow by least squares (Lucas & Kanade 1981), with less weight for pixels
 * that changed in another way (as behind a display that is nearer than the wall, when the hand
 * moves).
 */

import { receiverPilotsOutline } from "../../../generated/constants.js";
import { blurred } from "../../image/blur.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { slopesOf } from "../../image/slopes.js";
import { warped } from "../../image/warp.js";
import {
  homographyFromCorners, isConvex, resizedHomography, sideLengths, transform,
} from "../../link/geometry.js";
import { dot, inverse, multiply3, solve } from "../../link/linear.js";
import { median, spreadOf } from "../../link/order.js";
import { NUMBERS, UNIT_CORNERS, pixelsFromUnit, unitHomography } from "./motion.js";

const {
  WIDTH, RING, BORDER_PX, SUPERSAMPLED, BLUR_PX, ROUNDS, SETTLED, LEAST_DEVIATION, OUTLIER, DAMPING,
  ALIKE, CLEAR_PX, CORRELATED_PX,
} = receiverPilotsOutline;

/** Smallest distance, in pixels, from the border of an image to a pixel that counts as seen. */
const INSIDE_PX = 3;
/** Ratio of the standard deviation of normal noise to the median of its absolute values. */
const DEVIATIONS_IN_MEDIAN = 1.4826;

/** Follows what surrounds a display, from a reference frame on. */
export class Outline {
  /** Width and height of the display, in pixels of its view. @type {[number, number]} */
  #inner;
  /** Width and height of the view. @type {[number, number]} */
  #size;
  #margin;
  #viewFromUnit;
  /** Corners of the display in its view. */
  #first;
  /** Pixels that the corners are expected to move, x and y in turn. */
  #motion = new Float64Array(8);
  /** Numbers of the ring's pixels in the view. @type {Int32Array} */
  #picked;
  /** Gray levels of the ring in the reference, and their mean and standard deviation. */
  #reference;
  #mean;
  #deviation;
  /** What each of the eight numbers adds to each pixel of the ring: a row for each number. */
  #slopes;
  /** Differences of the ring in the newest frame from that of the reference, at equal exposure. */
  #apart;
  /** Weight of each difference, in [0, 1]. */
  #weight;

  /**
   * @param {BytePlane} gray - the reference frame
   * @param {Point[]} corners - of the display in it
   * @param {number} [width] - of the display, pixels of its view; fewer cost less
   */
  constructor(gray, corners, width = WIDTH) {
    const [top, right, bottom, left] = sideLengths(corners);
    const height = Math.max(8, roundHalfEven((width * (left + right)) / Math.max(top + bottom, 1)));
    const margin = roundHalfEven(RING * width);
    this.#inner = [width, height];
    this.#margin = margin;
    this.#size = [width + 2 * margin, height + 2 * margin];
    this.#viewFromUnit = multiply3([1, 0, margin, 0, 1, margin, 0, 0, 1], pixelsFromUnit(width, height));
    this.#first = transform(this.#viewFromUnit, UNIT_CORNERS);
    /** Pixels of the display in the newest frame. */
    this.corners = corners;
    const H = this.#homography(corners);
    const seen = this.#seenIn(H, gray);
    this.#picked = this.#ring().filter((at) => seen(at));
    const reference = this.#view(gray, H);
    const count = this.#picked.length;
    this.#reference = Float32Array.from(this.#picked, (at) => reference.data[at]);
    [this.#mean, this.#deviation] = spreadOf(this.#reference);
    this.#slopes = this.#slopesOf(reference);
    this.#apart = new Float32Array(count);
    this.#weight = new Float32Array(count);
    /** Whether the ring tells where the display is; a plain wall does not. */
    this.isClear = this.#isClear();
  }

  /**
   * Find the display in the next frame.
   *
   * @param {BytePlane} gray - of the reference's size
   * @param {Point[] | null} [guess] - corners from which to begin; null for where the display was,
   *   moved on
   * @returns {Point[] | null} pixels, or null where the ring is not found
   */
  follow(gray, guess = null) {
    const [before, motion] = [this.corners, this.#motion];
    let H = this.#homography(
      guess ?? before.map(([x, y], i) => [x + motion[2 * i], y + motion[2 * i + 1]]),
    );
    const unitFromView = inverse(this.#viewFromUnit);
    this.#compare(gray, H);
    for (let round = 0; round < ROUNDS; round++) {
      const { matrix, right } = this.#equations();
      const step = solve(matrix, right);
      const moved = multiply3(inverse(unitHomography(step)), unitFromView);
      H = multiply3(multiply3(H, this.#viewFromUnit), moved);
      this.#compare(gray, H);
      if (step.every((number) => Math.abs(number) < SETTLED)) break;
    }
    if (!(this.#correlation() >= ALIKE)) return null;
    const corners = transform(H, this.#first);
    if (!isConvex(corners)) return null;
    this.#motion = Float64Array.from(corners.flat(), (place, i) => {
      return 0.5 * (place - before[i >> 1][i & 1]);
    });
    this.corners = corners;
    return corners;
  }

  /**
   * Find the homography from pixels of the view to the frame in which the display has corners.
   *
   * @param {Point[]} corners
   */
  #homography(corners) {
    const margin = this.#margin;
    const HCapturedFromInner = homographyFromCorners(corners, ...this.#inner);
    return multiply3(HCapturedFromInner, [1, 0, -margin, 0, 1, -margin, 0, 0, 1]);
  }

  /** List the numbers of the view's pixels that lie around the display, and not at its border. */
  #ring() {
    const [width, height] = this.#size;
    const beyond = this.#size.map((size) =>
      Float64Array.from({ length: size }, (_, at) =>
        Math.max(this.#margin - at, at - (size - this.#margin - 1)),
      ),
    );
    const ring = new Int32Array(width * height);
    let count = 0;
    for (let row = 0, at = 0; row < height; row++) {
      for (let col = 0; col < width; col++, at++) {
        if (Math.max(beyond[0][col], beyond[1][row]) >= BORDER_PX) ring[count++] = at;
      }
    }
    return ring.slice(0, count);
  }

  /**
   * Make a function that tells whether a pixel of the view, by its number, lies within a frame.
   *
   * @param {Float64Array} H - from the view to the frame
   * @param {BytePlane} gray - the frame
   * @returns {(at: number) => boolean}
   */
  #seenIn(H, gray) {
    const [width] = this.#size;
    const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = H;
    const [right, bottom] = [gray.width - 1 - INSIDE_PX, gray.height - 1 - INSIDE_PX];
    return (at) => {
      const col = at % width;
      const row = (at - col) / width;
      const w = h6 * col + h7 * row + h8;
      const x = (h0 * col + h1 * row + h2) / w;
      const y = (h3 * col + h4 * row + h5) / w;
      return x > INSIDE_PX && y > INSIDE_PX && x < right && y < bottom;
    };
  }

  /**
   * Show the display with its ring, smoothed.
   *
   * @param {BytePlane} gray
   * @param {Float64Array} H - from pixels of the view to pixels of the frame
   */
  #view(gray, H) {
    const [width, height] = this.#size;
    const finer = multiply3(H, resizedHomography(1 / SUPERSAMPLED, 1 / SUPERSAMPLED));
    const view = warped(gray, finer, SUPERSAMPLED * width, SUPERSAMPLED * height);
    return blurred(resizeArea(view, width, height), BLUR_PX);
  }

  /**
   * Find the slopes of the ring's pixels along the eight numbers of a motion.
   *
   * @param {FloatPlane} view
   * @returns {Float32Array[]} a list for each number
   */
  #slopesOf(view) {
    const { across, down } = slopesOf(view);
    const [width, height] = this.#inner;
    const slopes = Array.from({ length: NUMBERS }, () => new Float32Array(this.#picked.length));
    const [toX, byY, shift, toXDown, byYDown, shiftDown, awayX, awayY] = slopes;
    this.#picked.forEach((at, i) => {
      const col = at % view.width;
      const row = (at - col) / view.width;
      const x = ((col - this.#margin + 0.5) / width) * 2 - 1;
      const y = ((row - this.#margin + 0.5) / height) * 2 - 1;
      const gx = (across[at] * width) / 16;
      const gy = (down[at] * height) / 16;
      const away = x * gx + y * gy;
      [toX[i], byY[i], shift[i]] = [x * gx, y * gx, gx];
      [toXDown[i], byYDown[i], shiftDown[i]] = [x * gy, y * gy, gy];
      [awayX[i], awayY[i]] = [-x * away, -y * away];
    });
    return slopes;
  }

  /**
   * Compare the ring in a frame with that of the reference: finds differences at equal exposure, and
   * weights, which are 0 for pixels that do not lie within the frame.
   *
   * @param {BytePlane} gray
   * @param {Float64Array} H - from pixels of the view to pixels of the frame
   */
  #compare(gray, H) {
    const { data } = this.#view(gray, H);
    const [apart, weight, picked, reference] = [
      this.#apart, this.#weight, this.#picked, this.#reference,
    ];
    for (let i = 0; i < apart.length; i++) apart[i] = data[picked[i]];
    const [mean, deviation] = spreadOf(apart);
    const gain = this.#deviation / Math.max(deviation, 1e-3);
    for (let i = 0; i < apart.length; i++) {
      apart[i] = gain * (apart[i] - mean) - (reference[i] - this.#mean);
      weight[i] = Math.abs(apart[i]);
    }
    const far = OUTLIER * (DEVIATIONS_IN_MEDIAN * median(weight) + LEAST_DEVIATION);
    const seen = this.#seenIn(H, gray);
    for (let i = 0; i < apart.length; i++) {
      weight[i] = seen(picked[i]) ? 1 / (1 + (apart[i] / far) ** 2) : 0;
    }
  }

  /** Write the normal equations of the motion, (8, 8) and (8,), by differences and weights. */
  #equations() {
    const [slopes, apart, weight] = [this.#slopes, this.#apart, this.#weight];
    const matrix = new Float64Array(NUMBERS * NUMBERS);
    const right = new Float64Array(NUMBERS);
    const weighed = new Float32Array(apart.length);
    for (let row = 0; row < NUMBERS; row++) {
      const slope = slopes[row];
      for (let i = 0; i < weighed.length; i++) weighed[i] = weight[i] * slope[i];
      right[row] = dot(weighed, apart);
      for (let col = row; col < NUMBERS; col++) {
        matrix[row * NUMBERS + col] = matrix[col * NUMBERS + row] = dot(weighed, slopes[col]);
      }
      matrix[row * NUMBERS + row] += DAMPING * apart.length;
    }
    return { matrix, right };
  }

  /** Correlate the ring in the newest frame with that of the reference, by weights, in [-1, 1]. */
  #correlation() {
    const [apart, reference, weight] = [this.#apart, this.#reference, this.#weight];
    let [total, sum, other] = [1e-9, 0, 0];
    for (let i = 0; i < apart.length; i++) {
      total += weight[i];
      sum += weight[i] * (apart[i] + reference[i]);
      other += weight[i] * reference[i];
    }
    let [ab, aa, bb] = [0, 0, 0];
    for (let i = 0; i < apart.length; i++) {
      const a = apart[i] + reference[i] - sum / total;
      const b = reference[i] - other / total;
      ab += weight[i] * a * b;
      aa += weight[i] * a * a;
      bb += weight[i] * b * b;
    }
    return ab / Math.sqrt(aa * bb + 1e-9);
  }

  /** Tell whether noise alone would move no corner by much. */
  #isClear() {
    if (this.#picked.length < NUMBERS) return false;
    this.#weight.fill(1);
    const noise = CORRELATED_PX * (LEAST_DEVIATION * 2) ** 2;
    const covariance = inverse(this.#equations().matrix).map((value) => value * noise);
    const errors = UNIT_CORNERS.flatMap(([x, y]) =>
      this.#inner.map((side, axis) => {
        const along = new Float64Array(NUMBERS);
        along.set([x, y, 1], 3 * axis);
        along.set([-[x, y][axis] * x, -[x, y][axis] * y], 6);
        let variance = 0;
        for (let i = 0; i < NUMBERS; i++) {
          variance += along[i] * dot(covariance.subarray(i * NUMBERS, (i + 1) * NUMBERS), along);
        }
        return (side / 2) * Math.sqrt(variance);
      }),
    );
    return Math.max(...errors) <= CLEAR_PX;
  }
}
