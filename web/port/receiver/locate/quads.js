/**
 * Quadrilaterals in a photograph that may bound a display: from straight lines and from contours.
 *
 * Works on a small gray image. Lines: segments that lie on one straight line count as one, and
 * four lines are a quadrilateral where segments cover enough of each side. Contours: outlines of
 * what is brighter than a threshold, where four corners describe them.
 */

import { receiverLocateQuads } from "../../../generated/constants.js";
import { keptWithImage } from "../../image/copies.js";
import { call } from "../../image/opencv.js";
import { farthest, isNear, sideLengths, signedArea, turns } from "../../link/geometry.js";
import { everyPixel, quantiles } from "../../link/order.js";
import { longestSegments } from "./segments.js";

/**
 * Four corners in pixels, clockwise.
 *
 * @typedef {Point[]} Quad
 */

export const { SLACK, SAME_PX } = receiverLocateQuads;
const {
  BEYOND, MAX_LINES, COLLINEAR_PX, OPPOSED_PX, MIN_AREA, MIN_CROSSING_DEG, MIN_SIDE_COVER,
  MIN_MEAN_COVER, LEAST_SIDE, LEAST_SINE, NESTED, SIZE_BONUS, THRESHOLD_QUANTILES,
  OUTLINE_TOLERANCES,
} = receiverLocateQuads;

/** Smallest sine of the angle between neighbouring sides; at 70 degrees a display still has it. */
const MIN_CROSSING = Math.sin((MIN_CROSSING_DEG * Math.PI) / 180);
/** Largest number of outlines of one threshold. */
const OUTLINES = 1 << 10;
/** Number of quadrilaterals that are looked at for each of those that are chosen. */
const LOOKED_AT = 8;
/** Units of work of the segments, of quadrilaterals, and of one threshold. */
const SEGMENTS_WORK = 15;
const LINES_WORK = 15;
const OUTLINE_WORK = 3;

/**
 * Tell whether a quadrilateral is clockwise, convex, large enough, no sliver, and in the image.
 *
 * @param {Quad} quad
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @param {number} [outside] - distance by which corners may lie outside the image, as a share of
 *   its longer side
 * @returns {boolean}
 */
export function isSound(quad, width, height, outside = SLACK) {
  if (!isNear(quad, width, height, outside)) return false;
  const sides = sideLengths(quad);
  const isBent = turns(quad).every((turn, i) => turn > LEAST_SINE * sides[i] * sides[(i + 1) & 3]);
  return isBent && signedArea(quad) >= MIN_AREA * width * height;
}

/**
 * Rotate the corner order of a quadrilateral to the one nearest to upright.
 *
 * @param {Quad} quad
 * @returns {Quad}
 */
export function upright(quad) {
  let best = quad;
  let most = -Infinity;
  for (let turn = 0; turn < 4; turn++) {
    const turned = rolled(quad, turn);
    const top = [turned[1][0] - turned[0][0], turned[1][1] - turned[0][1]];
    const bottom = [turned[2][0] - turned[3][0], turned[2][1] - turned[3][1]];
    const across =
      top[0] / (Math.hypot(top[0], top[1]) + 1e-9) +
      bottom[0] / (Math.hypot(bottom[0], bottom[1]) + 1e-9);
    if (across > most) {
      most = across;
      best = turned;
    }
  }
  return best;
}

/**
 * Let the corner order of a quadrilateral begin at a later corner.
 *
 * @param {Quad} quad
 * @param {number} turn - number of the corner, from 0 to 3
 * @returns {Quad}
 */
export function rolled(quad, turn) {
  return [...quad.slice(turn), ...quad.slice(0, turn)];
}

/**
 * Tell whether a quadrilateral lies inside another, at most a bezel's width from it.
 *
 * @param {Quad} quad
 * @param {Quad} outer
 * @returns {boolean}
 */
export function isNested(quad, outer) {
  const share = signedArea(quad) / signedArea(outer);
  if (!(share > NESTED[0] && share < NESTED[1])) return false;
  for (let i = 0; i < 4; i++) {
    const [start, end] = [outer[i], outer[(i + 1) & 3]];
    const [x, y] = [end[0] - start[0], end[1] - start[1]];
    const length = Math.hypot(x, y);
    for (const corner of quad) {
      const depth = (x * (corner[1] - start[1]) - y * (corner[0] - start[0])) / length;
      if (!(depth > 1)) return false;
    }
  }
  return true;
}

/**
 * Choose the quadrilaterals of highest rank that differ from one another.
 *
 * Only the first `LOOKED_AT * limit` are looked at.
 *
 * @param {Quad[]} quads
 * @param {ArrayLike<number>} rank - the higher, the better
 * @param {number} limit - largest number chosen
 * @param {number} tolerance - distance, in pixels, of all corners below which two are alike
 * @returns {number[]} indices, the best first
 */
export function distinct(quads, rank, limit, tolerance) {
  const order = Array.from(quads.keys()).sort((one, other) => rank[other] - rank[one]);
  /** @type {number[]} */
  const chosen = [];
  for (const at of order.slice(0, LOOKED_AT * limit)) {
    if (chosen.length >= limit) break;
    if (chosen.every((other) => farthest(quads[at], quads[other]) >= tolerance)) chosen.push(at);
  }
  return chosen;
}

/**
 * The lines on which segments lie: a point and the unit direction of each, and, in `covered` at
 * `line * 2 * half + t`, the length that segments cover up to t - half pixels from the point.
 *
 * @typedef {object} Lines
 * @property {Point[]} point
 * @property {Point[]} axis
 * @property {Float32Array} covered
 * @property {number} half
 */

/**
 * Find the lines that segments lie on, those with most segments first.
 *
 * @param {import("./segments.js").Segment[]} segments
 * @param {number} diagonal - of the image, pixels
 */
function mergeSegments(segments, diagonal) {
  const length = segments.map(([x1, y1, x2, y2]) => Math.hypot(x2 - x1, y2 - y1));
  const free = new Uint8Array(segments.length).fill(1);
  /** @type {{ members: number[], support: number }[]} */
  const groups = [];
  segments.forEach(([x1, y1, x2, y2], i) => {
    if (!free[i]) return;
    const [axisX, axisY] = [(x2 - x1) / length[i], (y2 - y1) / length[i]];
    /** @type {number[]} */
    const members = [];
    let support = 0;
    segments.forEach(([a1, b1, a2, b2], j) => {
      if (!free[j]) return;
      const far = Math.max(
        Math.abs(axisX * (b1 - y1) - axisY * (a1 - x1)),
        Math.abs(axisX * (b2 - y1) - axisY * (a2 - x1)),
      );
      const same = axisX * (a2 - a1) + axisY * (b2 - b1) > 0;
      if (far >= (same ? COLLINEAR_PX : OPPOSED_PX)) return;
      free[j] = 0;
      members.push(j);
      support += length[j];
    });
    groups.push({ members, support });
  });
  groups.sort((one, other) => other.support - one.support);
  const best = groups.slice(0, MAX_LINES);
  const half = Math.trunc(diagonal) + 2;
  const covered = new Float32Array(best.length * 2 * half);
  /** @type {Point[]} */
  const point = [];
  /** @type {Point[]} */
  const axis = [];
  best.forEach(({ members }, row) => {
    let [weight, meanX, meanY] = [0, 0, 0];
    for (const i of members) {
      const [x1, y1, x2, y2] = segments[i];
      weight += 2 * length[i];
      meanX += length[i] * (x1 + x2);
      meanY += length[i] * (y1 + y2);
    }
    meanX /= weight;
    meanY /= weight;
    let [xx, xy, yy] = [0, 0, 0];
    for (const i of members) {
      const [x1, y1, x2, y2] = segments[i];
      xx += length[i] * ((x1 - meanX) ** 2 + (x2 - meanX) ** 2);
      xy += length[i] * ((x1 - meanX) * (y1 - meanY) + (x2 - meanX) * (y2 - meanY));
      yy += length[i] * ((y1 - meanY) ** 2 + (y2 - meanY) ** 2);
    }
    const angle = 0.5 * Math.atan2(2 * xy, xx - yy);
    const [axisX, axisY] = [Math.cos(angle), Math.sin(angle)];
    point.push([meanX, meanY]);
    axis.push([axisX, axisY]);
    const line = covered.subarray(row * 2 * half, (row + 1) * 2 * half);
    for (const i of members) {
      const [x1, y1, x2, y2] = segments[i];
      const a = Math.round((x1 - meanX) * axisX + (y1 - meanY) * axisY) + half;
      const b = Math.round((x2 - meanX) * axisX + (y2 - meanY) * axisY) + half;
      line.fill(1, Math.max(0, Math.min(a, b)), Math.max(0, Math.max(a, b)));
    }
    for (let t = 1; t < 2 * half; t++) line[t] += line[t - 1];
  });
  return { point, axis, covered, half };
}

/**
 * Make quadrilaterals of straight lines.
 *
 * @param {BytePlane} gray - it must stay as it is, as its lines are kept
 * @param {number} limit - largest number returned
 * @param {number} [outside] - distance by which corners may lie outside the image, as a share of
 *   its longer side; where it is more than `SLACK`, only quadrilaterals with a corner outside are
 *   made, and one side, or two that face each other, may be lines outside of which nothing is seen
 *   (`BEYOND`)
 * @returns {Steps<Quad[]>} those first of whose sides most is in view, and of that, lines cover
 *   most
 */
export function* lineSteps(gray, limit, outside = SLACK) {
  const lines = linesOf(gray);
  yield SEGMENTS_WORK;
  if (lines === null) return [];
  const quads = crossingLines(lines, gray.width, gray.height, limit, outside);
  yield LINES_WORK;
  return quads;
}

/** Finds the lines of an image; null where it has too few segments. */
const linesOf = keptWithImage((gray) => {
  const segments = longestSegments(gray);
  return segments.length < 2 ? null : mergeSegments(segments, Math.hypot(gray.width, gray.height));
});

/**
 * @param {Lines} lines
 * @param {number} width
 * @param {number} height
 * @param {number} limit
 * @param {number} outside
 */
function crossingLines(lines, width, height, limit, outside) {
  const { covered, half } = lines;
  const seenLines = lines.point.length;
  const beyond = outside > SLACK ? linesBeyond(width, height) : [];
  const point = [...lines.point, ...beyond.map((line) => line.point)];
  const axis = [...lines.axis, ...beyond.map((line) => line.axis)];
  const count = point.length;
  const parts = point.map((place, i) => partInView(place, axis[i], width, height));
  const slack = outside * Math.hypot(width, height);
  // where line j crosses line i: pixels along i, those in view, the covered length, and the place
  const along = new Float64Array(count * count);
  const seen = new Float64Array(count * count);
  const run = new Float64Array(count * count);
  const usable = new Uint8Array(count * count);
  /** @type {Point[]} */
  const corner = new Array(count * count);
  for (let i = 0; i < count; i++) {
    for (let j = 0; j < count; j++) {
      const at = i * count + j;
      const cross = axis[i][0] * axis[j][1] - axis[i][1] * axis[j][0];
      const [x, y] = [point[j][0] - point[i][0], point[j][1] - point[i][1]];
      const t = (x * axis[j][1] - y * axis[j][0]) / (Math.abs(cross) < 1e-6 ? 1e-6 : cross);
      const place = /** @type {Point} */ ([
        point[i][0] + t * axis[i][0],
        point[i][1] + t * axis[i][1],
      ]);
      along[at] = t;
      corner[at] = place;
      usable[at] = Number(
        Math.abs(cross) > MIN_CROSSING &&
          place[0] >= -slack &&
          place[1] >= -slack &&
          place[0] <= width + slack &&
          place[1] <= height + slack,
      );
      seen[at] = Math.min(Math.max(t, parts[i][0]), parts[i][1]);
      if (i >= seenLines) continue;
      const near = Math.round(Math.max(-half, Math.min(half, seen[at]))) + half;
      run[at] = covered[i * 2 * half + Math.max(0, Math.min(2 * half - 1, near))];
    }
  }
  /** @type {[number, number][]} */
  const pairs = [];
  for (let k = 0; k < count; k++) for (let m = k + 1; m < count; m++) pairs.push([k, m]);
  // the share of line i that is covered between the lines of pair p; 0 where they make no side
  const cover = new Float64Array(count * pairs.length);
  /** Pairs that make a side of a line. @type {number[][]} */
  const sides = Array.from({ length: count }, () => []);
  const shortest = LEAST_SIDE * Math.sqrt(width * height);
  for (let i = 0; i < count; i++) {
    pairs.forEach(([k, m], p) => {
      const [one, other] = [i * count + k, i * count + m];
      if (!usable[one] || !usable[other]) return;
      const span = Math.abs(along[one] - along[other]);
      const inView = Math.max(Math.abs(seen[one] - seen[other]), 1);
      const share = i < seenLines ? Math.abs(run[one] - run[other]) / inView : 1;
      if (!(span > shortest && share >= MIN_SIDE_COVER)) return;
      cover[i * pairs.length + p] = share;
      sides[i].push(p);
    });
  }
  /** @type {{ quad: Quad, rank: number }[]} */
  const found = [];
  for (let q = 0; q < pairs.length; q++) {
    const [a, b] = pairs[q];
    const [ofA, ofB] = [a * pairs.length, b * pairs.length];
    for (const p of sides[a]) {
      const one = cover[ofA + p];
      const two = cover[ofB + p];
      if (p <= q || two === 0) continue;
      const [c, d] = pairs[p];
      // one side may be unseen, or two that face each other; the second line of a pair is the later
      if (b >= seenLines && d >= seenLines) continue;
      const three = cover[c * pairs.length + q];
      const four = cover[d * pairs.length + q];
      if (three === 0 || four === 0) continue;
      const mean = (one + two + three + four) / 4;
      if (mean < MIN_MEAN_COVER) continue;
      const quad = clockwise([
        corner[a * count + c],
        corner[a * count + d],
        corner[b * count + d],
        corner[b * count + c],
      ]);
      if (!isSound(quad, width, height, outside)) continue;
      if (outside > SLACK && isSound(quad, width, height)) continue;
      // longer sides are less likely to be covered by chance
      const size = SIZE_BONUS * Math.sqrt(signedArea(quad) / (width * height));
      const whole = Math.max(outline(along, count, a, b, c, d), 1);
      const inView = outline(seen, count, a, b, c, d) / whole;
      found.push({ quad, rank: mean * inView + Math.min(one, two, three, four) + size });
    }
  }
  found.sort((one, other) => other.rank - one.rank);
  const likeliest = found.slice(0, LOOKED_AT * limit);
  const quads = likeliest.map(({ quad }) => upright(quad));
  const ranks = likeliest.map(({ rank }) => rank);
  return distinct(quads, ranks, limit, SAME_PX).map((at) => quads[at]);
}

/**
 * Make four lines that stand for a side of which nothing is seen, along the image's borders.
 *
 * @param {number} width
 * @param {number} height
 * @returns {{ point: Point, axis: Point }[]}
 */
function linesBeyond(width, height) {
  const [x, y, out] = [width / 2, height / 2, BEYOND * Math.max(width, height)];
  return [
    { point: [x, -out], axis: [1, 0] },
    { point: [x, height + out], axis: [1, 0] },
    { point: [-out, y], axis: [0, 1] },
    { point: [width + out, y], axis: [0, 1] },
  ];
}

/**
 * Find where a line enters and leaves the image, in pixels from its point.
 *
 * @param {Point} point
 * @param {Point} axis
 * @param {number} width
 * @param {number} height
 * @returns {[number, number]}
 */
function partInView(point, axis, width, height) {
  let [enter, leave] = [-Infinity, Infinity];
  for (const [k, side] of [width, height].entries()) {
    const along = Math.abs(axis[k]) < 1e-9 ? 1e-9 : axis[k];
    const [one, other] = [(-0.5 - point[k]) / along, (side - 0.5 - point[k]) / along];
    enter = Math.max(enter, Math.min(one, other));
    leave = Math.min(leave, Math.max(one, other));
  }
  return [enter, Math.max(enter, leave)];
}

/**
 * Measure the outline of a quadrilateral, in pixels.
 *
 * @param {Float64Array} along - (lines, lines) where the second line crosses the first, in pixels
 * @param {number} count - of lines
 * @param {number} a - one line, and another
 * @param {number} b
 * @param {number} c - a line that crosses both, and another
 * @param {number} d
 */
function outline(along, count, a, b, c, d) {
  const side = (/** @type {number} */ i, /** @type {number} */ j, /** @type {number} */ k) =>
    Math.abs(along[i * count + j] - along[i * count + k]);
  return side(a, c, d) + side(b, c, d) + side(c, a, b) + side(d, a, b);
}

/** @param {Quad} quad */
function clockwise(quad) {
  return signedArea(quad) < 0 ? [...quad].reverse() : quad;
}

/**
 * Make quadrilaterals of the outlines of what is brighter than some thresholds.
 *
 * @param {BytePlane} gray
 * @returns {Steps<Quad[]>}
 */
export function* outlineSteps(gray) {
  const { width, height } = gray;
  /** @type {Quad[]} */
  const found = [];
  for (const level of thresholds(gray)) {
    found.push(...outlinesAbove(gray, level).map(clockwise));
    yield OUTLINE_WORK;
  }
  // an outline that runs along the image's border bounds the image, not a display
  return found.filter((quad) => {
    const atBorder = quad.filter(
      ([x, y]) => x <= 1 || y <= 1 || x >= width - 2 || y >= height - 2,
    ).length;
    return atBorder < 2 && isSound(quad, width, height);
  });
}

/**
 * Choose levels, in increasing order: quantiles of every other pixel on each axis, and Otsu's.
 *
 * @param {BytePlane} gray
 */
function thresholds(gray) {
  const levels = quantiles(everyPixel(gray, 2), THRESHOLD_QUANTILES);
  return [...new Set([...levels, call("otsu", [gray])])].sort((one, other) => one - other);
}

/**
 * @param {BytePlane} gray
 * @param {number} level
 */
function outlinesAbove(gray, level) {
  const area = MIN_AREA * gray.width * gray.height;
  const tolerances = Float64Array.from(OUTLINE_TOLERANCES);
  const quads = new Float64Array(8 * OUTLINES);
  const count = call("brightQuads", [gray, level, area, tolerances], [quads]);
  return Array.from({ length: count }, (_, i) => quadOf(quads.subarray(8 * i)));
}

/**
 * @param {ArrayLike<number>} numbers - x and y of four corners, and maybe more
 * @returns {Quad}
 */
export function quadOf(numbers) {
  return [0, 2, 4, 6].map((i) => [numbers[i], numbers[i + 1]]);
}
