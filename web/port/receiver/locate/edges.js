/** What an image shows along a quadrilateral's sides: evidence for a display, and its edges. */

import { receiverLocateEdges } from "../../../generated/constants.js";
import { remembered } from "../../link/code/remembered.js";
import { signedArea } from "../../link/geometry.js";
import { everyPixel, mean, median, quantiles } from "../../link/order.js";

const {
  SAMPLES, REACH, STEP_LEVELS, NOISE_SLOPE, SATURATION_SLOPE, WHITE_QUANTILE, RIM_PX, CONTENT_SCALES,
  BEYOND_SCALE, SNAP_SAMPLES, AHEAD, PLACES, CONTENT_PLACES, SNAP_PLACES,
} = receiverLocateEdges;

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
export function profiles({ width, height, data }, quad, places, offsets) {
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
  const white = quantiles(everyPixel(small, 3), [WHITE_QUANTILE])[0] + 10;
  return { white, unit: STEP_LEVELS * (0.3 + 0.7 * Math.min(1, white / 200)) };
}

/**
 * Measure what speaks for a quadrilateral being a lit display.
 *
 * @param {BytePlane} small
 * @param {Quad} quad - in its pixels
 * @param {{ white: number, unit: number }} levels - `edgeLevels` of the image
 * @returns {number[]} (9,) the share of places along the sides that are brighter inside, and
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
 * @param {number} reach - whole number of pixels that a side may move at either end
 * @returns {Quad} a side without any edge stays
 */
export function snapToEdges(image, quad, reach) {
  const slopes = slopesAcross(image, quad, reach);
  const size = slopes.length / 4;
  const first = [0, 0, 0, 0];
  const last = [0, 0, 0, 0];
  for (let side = 0; side < 4; side++) {
    const best = elected(slopes.subarray(side * size, (side + 1) * size), reach);
    if (best.votes < 0.1 * SNAP_SAMPLES) continue;
    first[side] = best.first;
    last[side] = best.last;
  }
  return moved(quad, first, last, reach);
}

/**
 * Lists for each offset at a side's start and each at its end which offset the line from one to the
 * other has at each place, (offsets, offsets, places). Offsets are numbered from -reach on.
 */
const offsetsHit = remembered((/** @type {number} */ reach) => {
  const count = 2 * reach + 1;
  const hit = new Int16Array(count ** 2 * SNAP_SAMPLES);
  let to = 0;
  for (let first = 0; first < count; first++) {
    for (let last = 0; last < count; last++) {
      for (const share of SNAP_PLACES) hit[to++] = Math.round(first * (1 - share) + last * share);
    }
  }
  return hit;
});

/**
 * Find the image's gradient along the inward normals.
 *
 * @param {FloatPlane} image
 * @param {Quad} quad
 * @param {number} reach - largest offset from a side, pixels
 * @returns {Float32Array} (4, places, offsets) levels per pixel
 */
function slopesAcross(image, quad, reach) {
  const count = 2 * reach + 1;
  const wider = Float64Array.from({ length: count + 2 }, (_, k) => k - reach - 1);
  const taken = profiles(image, quad, SNAP_PLACES, wider);
  const slopes = new Float32Array(4 * SNAP_SAMPLES * count);
  for (let at = 0, to = 0; at < taken.length; at += wider.length) {
    for (let k = 0; k < count; k++) slopes[to++] = (taken[at + k + 2] - taken[at + k]) / 2;
  }
  return slopes;
}

/**
 * Find the line along a side that has most votes.
 *
 * @param {Float32Array} slopes - (places, offsets) of `slopesAcross`
 * @param {number} reach - largest offset, pixels
 * @returns {{ first: number, last: number, votes: number }} offsets at both ends
 */
function elected(slopes, reach) {
  const count = 2 * reach + 1;
  const hit = offsetsHit(reach);
  const votes = slopes.map((slope) => {
    const vote = Math.max(0, slope - NOISE_SLOPE);
    return vote / (vote + SATURATION_SLOPE);
  });
  const best = { first: 0, last: 0, votes: -Infinity };
  let at = 0;
  for (let first = -reach; first <= reach; first++) {
    for (let last = -reach; last <= reach; last++) {
      // ties go to the line that moves least
      let total = -1e-3 * (Math.abs(first) + Math.abs(last));
      for (let row = 0; row < votes.length; row += count) total += votes[row + hit[at++]];
      if (total > best.votes) Object.assign(best, { first, last, votes: total });
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
