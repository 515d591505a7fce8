/**
 * Straight segments of an image: a plain form of LSD (Grompone von Gioi et al. 2010).
 *
 * OpenCV for JavaScript lacks `createLineSegmentDetector`, which Python uses. Its HoughLinesP finds
 * about as much, but takes half a second where an image is noisy, and cannot be cut into steps. So
 * the detector is written out here. It leaves out what Python's does beside: the image is not
 * scaled to 0.8, and a region that bends is cut short around its seed at once.
 */

import { locateQuads } from "../generated/constants.js";
import { blurred } from "../image/blur.js";

/**
 * A segment from (x1, y1) to (x2, y2), pixels; which side is bright follows from its direction.
 *
 * @typedef {[number, number, number, number]} Segment
 */

const { MIN_SEGMENT_PX, MAX_SEGMENTS } = locateQuads;

/** Standard deviation, in pixels, of the blur before gradients are taken. */
const BLUR_PX = 0.7;
/** Largest difference, in degrees, of a pixel's direction from that of its segment. */
const TOLERANCE_DEG = 22.5;
/** Smallest gradient, in levels per pixel: rounding to whole levels turns a smaller one too far. */
const MIN_GRADIENT = 2 / Math.sin((TOLERANCE_DEG * Math.PI) / 180);
/** Smallest number of pixels of a segment. */
const MIN_PIXELS = 16;
/** Smallest share of a segment's rectangle that its pixels fill. */
const MIN_DENSITY = 0.7;
/** Factor by which a region's radius shrinks until it is dense. */
const SHRINK = 0.75;
/** Number of steps into which gradients are sorted. */
const BINS = 256;
/** Number of pixels that are looked at in one step of the search. */
const STEP_PIXELS = 40000;
/** Units of work of the gradients, and of one step. */
const GRADIENT_WORK = 15;
const STEP_WORK = 6;

/**
 * Find the longest straight segments of an image; the work since the last step is not yielded.
 *
 * @param {BytePlane} gray
 * @returns {import("../link/code/steps.js").Steps<Segment[]>}
 */
export function* segmentSteps(gray) {
  const { width, height } = gray;
  const field = levelLines(gray);
  const order = steepestFirst(field.slope);
  yield GRADIENT_WORK;
  const used = new Uint8Array(width * height);
  const region = new Int32Array(width * height);
  const tolerance = Math.cos((TOLERANCE_DEG * Math.PI) / 180);
  /** @type {{ segment: Segment, length: number }[]} */
  const found = [];
  let looked = 0;
  for (const seed of order) {
    if (used[seed]) continue;
    let count = grow(field, width, seed, tolerance, used, region);
    looked += count + 1;
    if (count >= MIN_PIXELS) {
      const segment = fitted(field, width, region, count, seed, used);
      if (segment) {
        const length = Math.hypot(segment[2] - segment[0], segment[3] - segment[1]);
        if (length >= MIN_SEGMENT_PX) found.push({ segment, length });
      }
    }
    if (looked >= STEP_PIXELS) {
      looked = 0;
      yield STEP_WORK;
    }
  }
  found.sort((one, other) => other.length - one.length);
  return found.slice(0, MAX_SEGMENTS).map(({ segment }) => segment);
}

/**
 * The gradient's size at each pixel, 0 where it is too small, and the unit direction of the line
 * of equal levels there, with the bright side always on the same hand. A pixel stands for the
 * middle between itself and its neighbours to the right and below.
 *
 * @typedef {{ slope: Float32Array, alongX: Float32Array, alongY: Float32Array }} Field
 */

/**
 * @param {BytePlane} gray
 * @returns {Field}
 */
function levelLines(gray) {
  const { width, height } = gray;
  const { data } = blurred(gray, BLUR_PX);
  const slope = new Float32Array(width * height);
  const alongX = new Float32Array(width * height);
  const alongY = new Float32Array(width * height);
  // a border of one pixel has no slope, so that no region leaves the image
  for (let y = 1; y < height - 2; y++) {
    for (let x = 1, at = y * width + 1; x < width - 2; x++, at++) {
      const falling = data[at + width + 1] - data[at];
      const rising = data[at + 1] - data[at + width];
      const gx = falling + rising;
      const gy = falling - rising;
      const size = Math.sqrt(gx * gx + gy * gy);
      if (size < 2 * MIN_GRADIENT) continue;
      slope[at] = size / 2;
      alongX[at] = -gy / size;
      alongY[at] = gx / size;
    }
  }
  return { slope, alongX, alongY };
}

/**
 * List the pixels with a slope, the steepest first, as a sort by counting finds them.
 *
 * @param {Float32Array} slope
 * @returns {Int32Array}
 */
function steepestFirst(slope) {
  let steepest = 0;
  for (let at = 0; at < slope.length; at++) if (slope[at] > steepest) steepest = slope[at];
  const unit = (BINS - 1) / (steepest + 1e-9);
  const starts = new Int32Array(BINS + 1);
  for (let at = 0; at < slope.length; at++) {
    if (slope[at] > 0) starts[BINS - ((slope[at] * unit) | 0)]++;
  }
  for (let bin = 1; bin <= BINS; bin++) starts[bin] += starts[bin - 1];
  const order = new Int32Array(starts[BINS]);
  for (let at = 0; at < slope.length; at++) {
    if (slope[at] > 0) order[starts[BINS - 1 - ((slope[at] * unit) | 0)]++] = at;
  }
  return order;
}

/**
 * Collect the pixels around a seed whose lines run along one another, and mark them as used.
 *
 * @param {Field} field
 * @param {number} width
 * @param {number} seed
 * @param {number} tolerance - smallest cosine of a pixel's direction with that of the region
 * @param {Uint8Array} used
 * @param {Int32Array} region - takes the pixels
 * @returns {number} how many there are
 */
function grow({ slope, alongX, alongY }, width, seed, tolerance, used, region) {
  let count = 1;
  region[0] = seed;
  used[seed] = 1;
  let [sumX, sumY] = [alongX[seed], alongY[seed]];
  let limit = tolerance;
  for (let next = 0; next < count; next++) {
    const centre = region[next];
    for (let row = centre - width; row <= centre + width; row += width) {
      for (let at = row - 1; at <= row + 1; at++) {
        if (used[at] || slope[at] === 0) continue;
        if (alongX[at] * sumX + alongY[at] * sumY < limit) continue;
        used[at] = 1;
        region[count++] = at;
        sumX += alongX[at];
        sumY += alongY[at];
        limit = tolerance * Math.sqrt(sumX * sumX + sumY * sumY);
      }
    }
  }
  return count;
}

/**
 * Fit a segment through a region; the region is cut short around its seed until it fills its
 * rectangle, and what is cut off is free again.
 *
 * @param {Field} field
 * @param {number} width
 * @param {Int32Array} region
 * @param {number} count - number of pixels in the region
 * @param {number} seed
 * @param {Uint8Array} used
 * @returns {Segment | null} null where too little is left
 */
function fitted({ slope, alongX, alongY }, width, region, count, seed, used) {
  const seedX = seed % width;
  const seedY = (seed - seedX) / width;
  let reach = 0;
  while (count >= MIN_PIXELS) {
    let [weight, meanX, meanY, sumX, sumY] = [0, 0, 0, 0, 0];
    for (let i = 0; i < count; i++) {
      const at = region[i];
      const x = at % width;
      weight += slope[at];
      meanX += slope[at] * x;
      meanY += (slope[at] * (at - x)) / width;
      sumX += alongX[at];
      sumY += alongY[at];
    }
    meanX /= weight;
    meanY /= weight;
    let [xx, xy, yy] = [0, 0, 0];
    for (let i = 0; i < count; i++) {
      const at = region[i];
      const x = at % width;
      const dx = x - meanX;
      const dy = (at - x) / width - meanY;
      xx += slope[at] * dx * dx;
      xy += slope[at] * dx * dy;
      yy += slope[at] * dy * dy;
    }
    const angle = 0.5 * Math.atan2(2 * xy, xx - yy);
    let [axisX, axisY] = [Math.cos(angle), Math.sin(angle)];
    if (axisX * sumX + axisY * sumY < 0) [axisX, axisY] = [-axisX, -axisY];
    let [first, last, low, high, far] = [0, 0, 0, 0, 0];
    for (let i = 0; i < count; i++) {
      const x = region[i] % width;
      const y = (region[i] - x) / width;
      const along = (x - meanX) * axisX + (y - meanY) * axisY;
      const aside = (y - meanY) * axisX - (x - meanX) * axisY;
      if (along < first) first = along;
      if (along > last) last = along;
      if (aside < low) low = aside;
      if (aside > high) high = aside;
      far = Math.max(far, (x - seedX) ** 2 + (y - seedY) ** 2);
    }
    if (count >= MIN_DENSITY * (last - first) * Math.max(1, high - low)) {
      const [x, y] = [meanX + 0.5, meanY + 0.5];
      return [x + first * axisX, y + first * axisY, x + last * axisX, y + last * axisY];
    }
    reach = (reach || far) * SHRINK * SHRINK;
    let kept = 0;
    for (let i = 0; i < count; i++) {
      const at = region[i];
      const x = at % width;
      if ((x - seedX) ** 2 + ((at - x) / width - seedY) ** 2 <= reach) region[kept++] = at;
      else used[at] = 0;
    }
    count = kept;
  }
  return null;
}
