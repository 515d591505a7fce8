/** What an image shows along a quadrilateral's sides: evidence for a display, and its edges. */

import { locateEdges } from "../generated/constants.js";
import { median, quantilesOfEvery } from "../link/order.js";
import { MAD_TO_SIGMA, gemanMcclureWeights, reweighted, ridgeSolution } from "../link/robust.js";
import { signedArea } from "./quads.js";

const {
  SAMPLES, SIDE_START, SIDE_SHARE, REACH, FIT_SAMPLES, STEP_LEVELS, NOISE_SLOPE, SATURATION_SLOPE,
  OTHER_SIDE, WHITE_QUANTILE, RIM_PX, CONTENT_SCALES, BEYOND_SCALE, PEAK_STEPS, MIN_EDGE_SHARE,
} = locateEdges;
const AHEAD = Float64Array.from(locateEdges.AHEAD);

/** Number of places along a side where what lies well inside is looked at. */
const CONTENT_SAMPLES = 12;
/** Number of places along a side that vote for its edge where it snaps to one. */
const SNAP_SAMPLES = 40;
/** Number of features of `sideFeatures`. */
export const FEATURES = 9;

/**
 * Spread places evenly along a side, from 0.03 to 0.97 of its length.
 *
 * @param {number} samples
 * @returns {Float64Array}
 */
function sidePlaces(samples) {
  return Float64Array.from(
    { length: samples },
    (_, s) => ((s + 0.5) / samples) * SIDE_SHARE + SIDE_START,
  );
}

const PLACES = sidePlaces(SAMPLES);
const CONTENT_PLACES = sidePlaces(CONTENT_SAMPLES);

/**
 * Find the unit normals that point from the sides into a clockwise quadrilateral.
 *
 * @param {Quad} quad
 * @returns {Point[]}
 */
function inward(quad) {
  return quad.map(([x, y], i) => {
    const [nextX, nextY] = quad[(i + 1) & 3];
    const length = Math.hypot(nextX - x, nextY - y) + 1e-9;
    return [-(nextY - y) / length, (nextX - x) / length];
  });
}

/**
 * Sample an image across the sides of a quadrilateral, bilinearly.
 *
 * @param {BytePlane | FloatPlane} image
 * @param {Quad} quad
 * @param {ArrayLike<number>} places - along a side: 0 is its start and 1 its end
 * @param {ArrayLike<number>} offsets - pixels along the inward normal
 * @returns {Float32Array} (4, places, offsets)
 */
function profiles({ width, height, data }, quad, places, offsets) {
  const taken = new Float32Array(4 * places.length * offsets.length);
  const normals = inward(quad);
  const [right, bottom] = [width - 1, height - 1];
  let to = 0;
  for (let side = 0; side < 4; side++) {
    const [startX, startY] = quad[side];
    const [endX, endY] = quad[(side + 1) & 3];
    const [normalX, normalY] = normals[side];
    for (let s = 0; s < places.length; s++) {
      const baseX = startX + (endX - startX) * places[s];
      const baseY = startY + (endY - startY) * places[s];
      for (let k = 0; k < offsets.length; k++) {
        const x = Math.min(right, Math.max(0, baseX + normalX * offsets[k]));
        const y = Math.min(bottom, Math.max(0, baseY + normalY * offsets[k]));
        const left = x | 0;
        const top = y | 0;
        const at = top * width + left;
        const next = left < right ? at + 1 : at;
        const down = top < bottom ? width : 0;
        const above = data[at] + (data[next] - data[at]) * (x - left);
        const below = data[at + down] + (data[next + down] - data[at + down]) * (x - left);
        taken[to++] = above + (below - above) * (y - top);
      }
    }
  }
  return taken;
}

const ACROSS = Float64Array.from({ length: 2 * REACH + 1 }, (_, k) => k - REACH);
const ON_THE_SIDE = [0];
const ON_THE_RIM = [RIM_PX];
const BOTH_SIDES = [-1.5, 1.5];

/**
 * Find the level that white has in an image, and the step that counts as an edge there.
 *
 * @param {BytePlane} small
 * @returns {{ white: number, unit: number }} gray levels
 */
export function edgeLevels(small) {
  const white = quantilesOfEvery(small, 3)(WHITE_QUANTILE) + 10;
  return { white, unit: STEP_LEVELS * (0.3 + 0.7 * Math.min(1, white / 200)) };
}

/**
 * Measure what speaks for a quadrilateral being a lit display.
 *
 * @param {BytePlane} small
 * @param {Quad} quad - in its pixels
 * @param {{ white: number, unit: number }} levels - `edgeLevels` of the image
 * @returns {number[]} (FEATURES,) the share of places along the sides that are brighter inside, and
 *   that of the second weakest side; the share that is darker; picture against the darkest of the
 *   rim outside; evenness of the rim; picture against what lies beyond; root of the share of the
 *   image; steps beside the sides, and on their continuation beyond the corners, where a display
 *   ends
 */
export function sideFeatures(small, quad, { white, unit }) {
  const v = profiles(small, quad, PLACES, ACROSS);
  const falls = [0, 0, 0, 0];
  let [inside, rimLevel, rises, beside] = [0, 0, 0, 0];
  for (let place = 0, at = 0; place < 4 * SAMPLES; place++, at += 2 * REACH + 1) {
    const edge = at + REACH;
    inside += v[edge + 1] + v[edge + 2] + v[edge + 3];
    rimLevel += Math.min(v[edge - 4], v[edge - 3], v[edge - 2], v[edge - 1]);
    const near = v[edge + 1] - v[edge - 1];
    const wide = v[edge + 2] - v[edge - 2];
    const step = Math.abs(wide) > Math.abs(near) ? wide : near;
    if (step > unit) falls[Math.floor(place / SAMPLES)]++;
    if (step < -unit) rises++;
    for (const k of [0, 1, 2 * REACH - 3, 2 * REACH - 2]) {
      if (Math.abs(v[at + k + 2] - v[at + k]) > unit) beside++;
    }
  }
  const count = 4 * SAMPLES;
  inside /= 3 * count;
  rimLevel /= count;
  falls.sort((one, other) => one - other);
  const ahead = profiles(small, quad, AHEAD, BOTH_SIDES);
  let goesOn = 0;
  for (let i = 0; i < ahead.length; i += 2) {
    if (Math.abs(ahead[i + 1] - ahead[i]) > unit) goesOn++;
  }
  const rim = profiles(small, quad, PLACES, ON_THE_RIM);
  const middle = median(rim);
  const uneven = mean(rim.map((level) => Math.abs(level - middle)));
  const beyond = mean(profiles(small, grown(quad, BEYOND_SCALE), PLACES, ON_THE_SIDE));
  let content = 0;
  for (const scale of CONTENT_SCALES) {
    content += mean(profiles(small, grown(quad, scale), CONTENT_PLACES, ON_THE_SIDE)) / 3;
  }
  return [
    mean(falls) / SAMPLES,
    falls[1] / SAMPLES,
    rises / count,
    (inside - rimLevel) / (inside + rimLevel + 10),
    -Math.log(uneven / white + 0.02),
    (content - beyond) / (content + beyond + 10),
    Math.sqrt(Math.abs(signedArea(quad)) / (small.width * small.height)),
    beside / (4 * count),
    goesOn / (ahead.length / 2),
  ];
}

/** @param {ArrayLike<number>} values */
function mean(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i++) sum += values[i];
  return sum / values.length;
}

/**
 * Scale a quadrilateral about the mean of its corners.
 *
 * @param {Quad} quad
 * @param {number} factor
 * @returns {Quad}
 */
function grown(quad, factor) {
  const centreX = mean(quad.map(([x]) => x));
  const centreY = mean(quad.map(([, y]) => y));
  return quad.map(([x, y]) => [
    centreX + factor * (x - centreX),
    centreY + factor * (y - centreY),
  ]);
}

/**
 * Move each side of a quadrilateral to the straight edge that most of it shows, in steps of a
 * pixel.
 *
 * Every pair of offsets at a side's two ends is tried; the votes of places along the side are
 * saturated, so that glare, or a hand before part of it, moves nothing. Only edges that are bright
 * inside count.
 *
 * @param {FloatPlane} image
 * @param {Quad} quad
 * @param {number} reach - pixels that a side may move at either end
 * @returns {Quad} a side without any edge stays
 */
export function snapToEdges(image, quad, reach) {
  const trial = trialOf(reach, 1, SNAP_SAMPLES);
  const { offsets } = trial;
  const slopes = slopesAcross(image, quad, trial);
  const first = [0, 0, 0, 0];
  const last = [0, 0, 0, 0];
  for (let side = 0; side < 4; side++) {
    const best = elected(slopes, side, trial, 1);
    if (best.votes < 0.1 * SNAP_SAMPLES) continue;
    first[side] = offsets[best.first];
    last[side] = offsets[best.last];
  }
  return moved(quad, first, last, reach);
}

/**
 * The offsets and places that are tried for an edge, and which offset a line from one offset at a
 * side's start to another at its end has at each place: (offsets, offsets, places).
 *
 * @typedef {object} Trial
 * @property {number} spacing
 * @property {Float64Array} offsets
 * @property {Float64Array} places
 * @property {Int16Array} hit
 */

/** @type {Map<string, Trial>} */
const trials = new Map();

/**
 * @param {number} reach
 * @param {number} spacing
 * @param {number} samples
 * @returns {Trial}
 */
function trialOf(reach, spacing, samples) {
  const count = Math.max(1, Math.round(reach / spacing));
  const offsets = Float64Array.from({ length: 2 * count + 1 }, (_, k) => (k - count) * spacing);
  const places = sidePlaces(samples);
  const key = `${count} ${samples}`;
  const known = trials.get(key);
  if (known) return { ...known, spacing, offsets };
  const hit = new Int16Array(offsets.length ** 2 * samples);
  let to = 0;
  for (let first = 0; first < offsets.length; first++) {
    for (let last = 0; last < offsets.length; last++) {
      for (const share of places) hit[to++] = Math.round(first * (1 - share) + last * share);
    }
  }
  const trial = { spacing, offsets, places, hit };
  trials.set(key, trial);
  return trial;
}

/**
 * Find the image's gradient along the inward normals.
 *
 * @param {FloatPlane} image
 * @param {Quad} quad
 * @param {Trial} trial
 * @returns {Float32Array} (4, places, offsets) levels per pixel
 */
function slopesAcross(image, quad, { spacing, offsets, places }) {
  const wider = Float64Array.from(
    { length: offsets.length + 2 },
    (_, k) => offsets[0] + (k - 1) * spacing,
  );
  const taken = profiles(image, quad, places, wider);
  const slopes = new Float32Array(4 * places.length * offsets.length);
  for (let at = 0, to = 0; at < taken.length; at += wider.length) {
    for (let k = 0; k < offsets.length; k++) {
      slopes[to++] = (taken[at + k + 2] - taken[at + k]) / (2 * spacing);
    }
  }
  return slopes;
}

/**
 * Find the line along a side that has most votes.
 *
 * @param {Float32Array} slopes - `slopesAcross`
 * @param {number} side
 * @param {Trial} trial
 * @param {1 | -1} sign - 1 for edges that are bright inside, -1 for those that are dark inside
 * @returns {{ first: number, last: number, votes: number }} numbers of the offsets at both ends
 */
function elected(slopes, side, { offsets, places, hit }, sign) {
  const count = offsets.length;
  const size = places.length * count;
  const votes = new Float32Array(size);
  for (let at = 0; at < size; at++) {
    const vote = Math.max(0, sign * slopes[side * size + at] - NOISE_SLOPE);
    votes[at] = vote / (vote + SATURATION_SLOPE);
  }
  const best = { first: 0, last: 0, votes: -Infinity };
  for (let first = 0, at = 0; first < count; first++) {
    for (let last = 0; last < count; last++) {
      // ties go to the line that moves least
      let total = -1e-3 * (Math.abs(offsets[first]) + Math.abs(offsets[last]));
      for (let row = 0; row < size; row += count) total += votes[row + hit[at++]];
      if (total > best.votes) {
        best.first = first;
        best.last = last;
        best.votes = total;
      }
    }
  }
  return best;
}

/**
 * Move the sides of a quadrilateral inwards.
 *
 * @param {Quad} quad
 * @param {number[]} first - pixels at each side's start
 * @param {number[]} last - pixels at each side's end
 * @param {number} reach - pixels that a side may move; where a corner moves much farther, all stay
 * @returns {Quad}
 */
function moved(quad, first, last, reach) {
  const normals = inward(quad);
  const lines = quad.map(([x, y], side) => {
    const [nextX, nextY] = quad[(side + 1) & 3];
    const [normalX, normalY] = normals[side];
    const [px, py] = [x + normalX * first[side], y + normalY * first[side]];
    const [qx, qy] = [nextX + normalX * last[side], nextY + normalY * last[side]];
    return [py - qy, qx - px, px * qy - py * qx];
  });
  /** @type {Quad} */
  const there = quad.map((corner, side) => {
    const [a, b, c] = lines[(side + 3) & 3];
    const [d, e, f] = lines[side];
    const w = a * e - b * d;
    return Math.abs(w) > 1e-9 ? [(b * f - c * e) / w, (c * d - a * f) / w] : corner;
  });
  const wild = there.some(
    ([x, y], i) => Math.max(Math.abs(x - quad[i][0]), Math.abs(y - quad[i][1])) > 4 * reach + 1,
  );
  return wild ? quad : there;
}

/**
 * Move each side of a quadrilateral to a straight edge, to sub-pixels.
 *
 * The edge that most of the side shows gets a line through the peaks of the image's gradient.
 * Edges that are dark inside count where they are much clearer: a light bezel, or a white page.
 *
 * @param {FloatPlane} image
 * @param {Quad} corners - clockwise
 * @param {number} reach - pixels that a side may move at either end
 * @returns {Quad} a side without edge stays where it was
 */
export function fitEdges(image, corners, reach) {
  const trial = trialOf(reach, Math.max(0.5, reach / 10), FIT_SAMPLES);
  const { offsets, places, spacing } = trial;
  const slopes = slopesAcross(image, corners, trial);
  const size = places.length * offsets.length;
  const first = [0, 0, 0, 0];
  const last = [0, 0, 0, 0];
  for (let side = 0; side < 4; side++) {
    const falls = elected(slopes, side, trial, 1);
    const rises = elected(slopes, side, trial, -1);
    // a light bezel, or a white page around the picture
    const other = rises.votes > OTHER_SIDE * falls.votes;
    const best = other ? rises : falls;
    const slope = slopes.slice(side * size, (side + 1) * size);
    if (other) for (let at = 0; at < size; at++) slope[at] = -slope[at];
    const guess = places.map(
      (share) => offsets[best.first] * (1 - share) + offsets[best.last] * share,
    );
    const line = fitLine(places, peaks(slope, offsets, guess, spacing));
    if (line.used >= MIN_EDGE_SHARE) {
      first[side] = line.first;
      last[side] = line.last;
    }
  }
  return moved(corners, first, last, reach);
}

/**
 * Find the gradient's peaks nearest to a guess, to sub-pixels.
 *
 * @param {Float32Array} slope - (places, offsets)
 * @param {Float64Array} offsets
 * @param {Float64Array} guess - (places,) offsets
 * @param {number} spacing
 * @returns {{ peak: Float64Array, height: Float64Array }} (places,) offsets, and heights, 0 where
 *   there is no peak
 */
function peaks(slope, offsets, guess, spacing) {
  const count = offsets.length;
  const peak = new Float64Array(guess.length);
  const height = new Float64Array(guess.length);
  for (let s = 0; s < guess.length; s++) {
    const row = s * count;
    let k = 0;
    let most = -Infinity;
    for (let at = 0; at < count; at++) {
      if (Math.abs(offsets[at] - guess[s]) > PEAK_STEPS * spacing) continue;
      if (slope[row + at] <= most) continue;
      most = slope[row + at];
      k = at;
    }
    k = Math.min(Math.max(k, 1), count - 2);
    const [low, mid, high] = [slope[row + k - 1], slope[row + k], slope[row + k + 1]];
    const bend = low - 2 * mid + high;
    peak[s] = offsets[k];
    if (mid >= low && mid >= high && mid > 1 && bend < 0) {
      peak[s] += ((low - high) / (2 * bend)) * spacing;
      height[s] = mid;
    }
  }
  return { peak, height };
}

/**
 * Fit a line through peaks, robustly.
 *
 * @param {Float64Array} places
 * @param {{ peak: Float64Array, height: Float64Array }} peaks
 * @returns {{ first: number, last: number, used: number }} offsets at both ends of the side, and
 *   the share of peaks that lie on the line; zeros where there is no peak
 */
function fitLine(places, { peak, height }) {
  const weight = height.map((value) => value / (value + SATURATION_SLOPE));
  if (weight.reduce((sum, value) => sum + value, 0) < 1e-6) return { first: 0, last: 0, used: 0 };
  const A = new Float64Array(2 * places.length);
  places.forEach((share, s) => A.set([1 - share, share], 2 * s));
  const residualsOf = (/** @type {Float64Array} */ line) =>
    peak.map((offset, s) => Math.abs(offset - line[0] * A[2 * s] - line[1] * A[2 * s + 1]));
  const spread = (/** @type {Float64Array} */ residuals) =>
    Math.max(0.1, MAD_TO_SIGMA * median(residuals.filter((_, s) => height[s] > 0)));
  const { solution } = reweighted({
    solve: (robust) =>
      ridgeSolution(A, peak, robust.map((value, s) => value * weight[s]), [1e-6, 0, 0, 1e-6]),
    residualsOf,
    scaleOf: (residuals) => 1.5 * spread(residuals),
    rounds: 6,
    weights: new Float64Array(places.length).fill(1),
    weigh: gemanMcclureWeights,
  });
  const residuals = residualsOf(solution);
  const limit = 3 * spread(residuals);
  const on = residuals.filter((residual, s) => residual < limit && height[s] > 0).length;
  return { first: solution[0], last: solution[1], used: on / places.length };
}
