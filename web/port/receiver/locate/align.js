/** Align corners to the ratex patches, to sub-pixels, by least squares on the image itself. */

import { receiverLocateAlign } from "../../../generated/constants.js";
import { blurred } from "../../image/blur.js";
import { BEYOND, BY } from "../../image/opencv.js";
import { between } from "../../image/warp.js";
import {
  contourArea,
  frameCorners,
  homographyFromPoints,
  inImage,
  sideLengths,
  transform,
} from "../../link/geometry.js";
import { solve } from "../../link/linear.js";
import { TILES } from "../../link/ratex.js";
import { MAD_TO_SIGMA, reweighted } from "../../link/robust.js";
import { pointsByCorners } from "./cornerMotion.js";
import { atLevel, levelFor } from "./patches.js";
import { median } from "../../link/order.js";

/** @typedef {import("./patches.js").Pyramid} Pyramid */

const {
  PHASES, MARGIN_PX, BLUR, DRAWN_BLUR, HALF_RANGE, MIN_STEP_PX, CORNER_SPREAD, RESIDUAL_LEVELS,
  LEAST_BLUR_PX, LEVEL_RIDGE,
} = receiverLocateAlign;

/** Samples along each axis of a tile, in all phases. */
const FINE = Number(PHASES[0][0]);
/** Samples at each end of a patch that are left out, because its surroundings reach them. */
const RIM = 2;

/** Units of work of a phase. */
const PHASE_WORK = 7;

/**
 * Move corners, to sub-pixels, so that the image shows the patches as they are drawn.
 *
 * Gauss-Newton on the corners, residuals weighted robustly, with a ridge on the corners' motion.
 * First each patch is a quadratic of the levels displayed, fitted anew in every step. Then each
 * tile has a level of its own: where blur meets the camera's response, an edge lies elsewhere than
 * a quadratic puts it.
 *
 * @param {Pyramid} pyramid - `imagePyramid` of the image
 * @param {Quad} corners - pixels of the image, within half a tile
 * @param {Layout} layout - with patches
 * @param {number} [spread] - expected error of the corners, as a share of the display's side
 * @param {ArrayLike<number> | null} [used] - (patches,) which patches are looked at, where they
 *   are in view; null for all
 * @returns {Steps<Quad>} pixels of the image
 */
export function* alignSteps(pyramid, corners, layout, spread = CORNER_SPREAD, used = null) {
  for (const [, steps, free] of PHASES) {
    corners = alignPhase(pyramid, corners, layout, spread, used, Number(steps), Boolean(free));
    yield PHASE_WORK;
  }
  return corners;
}

/**
 * Go through one of the `PHASES`.
 *
 * @param {Pyramid} pyramid
 * @param {Quad} corners
 * @param {Layout} layout
 * @param {number} spread
 * @param {ArrayLike<number> | null} used
 * @param {number} steps
 * @param {boolean} free
 * @returns {Quad}
 */
function alignPhase(pyramid, corners, layout, spread, used, steps, free) {
  const width = layout.cols * TILES * FINE;
  const height = layout.rows * TILES * FINE;
  const level = levelFor(corners, width, height, pyramid.length);
  const scale = 2 ** level;
  const there = atLevel(corners, level);
  const part = cutOut(pyramid[level], there);
  if (!part) return corners; // they lie beyond the image
  const { left, top } = part;
  /** @type {Quad} */
  let c = there.map(([x, y]) => [x - left, y - top]);
  // as blurred as the drawn tiles: between samples no edge must go unseen
  const spacing = sideLengths(c).reduce(
    (sum, length, side) => sum + length / (side % 2 ? height : width) / 4,
    0,
  );
  const image = blurred(part.image, Math.max(LEAST_BLUR_PX, BLUR * spacing));
  const start = c;
  const unit = frameCorners(width, height);
  const { points, patches, basis } = samplesInView(layout, free, used, c, unit, image);
  const count = patches.length;
  if (!count) return corners;
  const side = Math.sqrt(contourArea(c)) + 1e-9;
  const ridge = (RESIDUAL_LEVELS / (Math.max(spread, 1e-6) * side)) ** 2;
  const limit = 0.02 * side + 0.5;
  const terms = basis.length / count;
  const slopes = new Float64Array(count * 8);
  /** @type {Float64Array<ArrayBufferLike>} */
  let weights = new Float64Array(count).fill(1);
  for (let step = 0; step < steps; step++) {
    const { at, byCorners } = pointsByCorners(unit, c, points);
    const { taken, alongX, alongY } = sampled(image, at);
    for (let n = 0; n < count; n++) {
      for (let k = 0; k < 8; k++) {
        const moves = n * 16 + k;
        slopes[n * 8 + k] = -alongX[n] * byCorners[moves] - alongY[n] * byCorners[moves + 8];
      }
    }
    const pull = c.flatMap(([x, y], i) => [ridge * (start[i][0] - x), ridge * (start[i][1] - y)]);
    const system = { patches, basis, terms, slopes, taken, size: layout.ratex.length * terms };
    const { solution, weights: next } = reweighted({
      solve: (robust) => leastSquares(system, robust, ridge, pull),
      residualsOf: (x) => misfit(system, x),
      scaleOf: (residuals) => 2 * MAD_TO_SIGMA * median(residuals) + 1e-3,
      rounds: step === 0 ? 2 : 1,
      weights,
    });
    weights = next;
    const move = Array.from(solution.subarray(system.size), (value) =>
      Math.min(Math.max(value, -limit), limit),
    );
    c = c.map(([x, y], i) => [x + move[2 * i], y + move[2 * i + 1]]);
    if (Math.max(...move.map(Math.abs)) * scale < MIN_STEP_PX && step > 1) break;
  }
  return c.map(([x, y]) => [(x + left + 0.5) * scale - 0.5, (y + top + 0.5) * scale - 0.5]);
}

/**
 * Cut a quadrilateral and a margin out of an image.
 *
 * @param {BytePlane} plane
 * @param {Quad} quad
 * @returns {{ image: BytePlane, left: number, top: number } | null} null where nothing is left
 */
function cutOut(plane, quad) {
  const xs = quad.map(([x]) => x);
  const ys = quad.map(([, y]) => y);
  const left = Math.max(0, Math.floor(Math.min(...xs)) - MARGIN_PX);
  const top = Math.max(0, Math.floor(Math.min(...ys)) - MARGIN_PX);
  const width = Math.min(plane.width, Math.ceil(Math.max(...xs)) + MARGIN_PX) - left;
  const height = Math.min(plane.height, Math.ceil(Math.max(...ys)) + MARGIN_PX) - top;
  if (!(width > 0 && height > 0)) return null;
  const data = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) {
    const from = (top + y) * plane.width + left;
    data.set(plane.data.subarray(from, from + width), y * width);
  }
  return { image: { width, height, data }, left, top };
}

/**
 * The samples of patches: points (N, 2) of the fine grid, the number of each one's patch, and what
 * may be seen there, (N, terms), of which each patch has coefficients of its own.
 *
 * @typedef {{ points: Float64Array, patches: Int32Array, basis: Float64Array }} Samples
 */

/**
 * List the samples that lie in the image.
 *
 * @param {Layout} layout
 * @param {boolean} free
 * @param {ArrayLike<number> | null} used
 * @param {Quad} corners
 * @param {Quad} unit - corners of the fine grid
 * @param {FloatPlane} image
 * @returns {Samples}
 */
function samplesInView(layout, free, used, corners, unit, image) {
  const { inner, each } = drawnTiles();
  const H = homographyFromPoints(unit, corners);
  const terms = free ? TILES * TILES : 3;
  const most = layout.ratex.length * inner.length;
  const points = new Float64Array(most * 2);
  const patches = new Int32Array(most);
  const basis = new Float64Array(most * terms);
  let count = 0;
  layout.ratex.forEach(([row, col], patch) => {
    if (used && !used[patch]) return;
    const shown = layout.tileLevelsToggled[patch].map((level) => level / HALF_RANGE - 1);
    /** @type {Point[]} */
    const there = inner.map(([x, y]) => [
      x + col * TILES * FINE,
      y + row * TILES * FINE,
    ]);
    const seen = inImage(transform(H, there), image.width, image.height);
    there.forEach((point, n) => {
      if (!seen[n]) return;
      points.set(point, count * 2);
      patches[count] = patch;
      const tiles = each[n];
      if (free) basis.set(tiles, count * terms);
      else {
        const level = shown.reduce((sum, value, tile) => sum + value * tiles[tile], 0);
        basis.set([1, level, level * level], count * terms);
      }
      count++;
    });
  });
  return {
    points: points.subarray(0, count * 2),
    patches: patches.subarray(0, count),
    basis: basis.subarray(0, count * terms),
  };
}

/** @type {{ inner: Point[], each: Float64Array[] } | null} */
let drawn = null;

/**
 * Draw the tiles of a patch, blurred about as much as a camera does.
 *
 * @returns {{ inner: Point[], each: Float64Array[] }} the samples that are looked at, and at each
 *   the share of every tile
 */
function drawnTiles() {
  if (drawn) return drawn;
  const size = TILES * FINE;
  const maps = Array.from({ length: TILES * TILES }, (_, tile) => {
    const data = Float32Array.from({ length: size * size }, (_, at) => {
      const row = Math.floor(at / size / FINE);
      const col = Math.floor((at % size) / FINE);
      return Number(row * TILES + col === tile);
    });
    return blurred({ width: size, height: size, data }, DRAWN_BLUR * BLUR, BEYOND.replicate).data;
  });
  /** @type {Point[]} */
  const inner = [];
  for (let y = RIM; y < size - RIM; y++) for (let x = RIM; x < size - RIM; x++) inner.push([x, y]);
  const each = inner.map(([x, y]) => Float64Array.from(maps, (map) => map[y * size + x]));
  drawn = { inner, each };
  return drawn;
}

/**
 * Rows of linear equations for the coefficients of all patches and, last, the corners' motion: a
 * row has the `terms` of its own patch, and eight slopes.
 *
 * @typedef {object} System
 * @property {Int32Array} patches - (N,)
 * @property {Float64Array} basis - (N, terms)
 * @property {number} terms
 * @property {Float64Array} slopes - (N, 8)
 * @property {Float64Array} taken - (N,)
 * @property {number} size - number of coefficients of all patches
 */

/**
 * Solve the equations by least squares, as `ridgeSolution` does, without its products with 0.
 *
 * @param {System} system
 * @param {Float64Array} weights
 * @param {number} ridge - on the corners' motion
 * @param {number[]} pull - towards an expected motion
 * @returns {Float64Array} (size + 8,)
 */
function leastSquares({ patches, basis, terms, slopes, taken, size }, weights, ridge, pull) {
  const total = size + 8;
  const normal = new Float64Array(total * total);
  const right = new Float64Array(total);
  for (let i = 0; i < total; i++) normal[i * total + i] = i < size ? LEVEL_RIDGE : ridge;
  right.set(pull, size);
  const row = new Float64Array(terms + 8);
  for (let n = 0; n < patches.length; n++) {
    const first = patches[n] * terms;
    for (let i = 0; i < terms; i++) row[i] = basis[n * terms + i];
    for (let k = 0; k < 8; k++) row[terms + k] = slopes[n * 8 + k];
    for (let i = 0; i < terms + 8; i++) {
      const weighed = weights[n] * row[i];
      if (weighed === 0) continue;
      const at = i < terms ? first + i : size + i - terms;
      right[at] += weighed * taken[n];
      const line = at * total;
      for (let j = i; j < terms; j++) normal[line + first + j] += weighed * row[j];
      const shift = line + size - terms;
      for (let j = Math.max(i, terms); j < terms + 8; j++) normal[shift + j] += weighed * row[j];
    }
  }
  for (let i = 0; i < total; i++) {
    for (let j = 0; j < i; j++) normal[i * total + j] = normal[j * total + i];
  }
  return solve(normal, right);
}

/**
 * @param {System} system
 * @param {Float64Array} solution
 * @returns {Float64Array} (N,) absolute residuals
 */
function misfit({ patches, basis, terms, slopes, taken, size }, solution) {
  return taken.map((level, n) => {
    let told = 0;
    const first = patches[n] * terms;
    for (let i = 0; i < terms; i++) told += basis[n * terms + i] * solution[first + i];
    for (let k = 0; k < 8; k++) told += slopes[n * 8 + k] * solution[size + k];
    return Math.abs(level - told);
  });
}

/**
 * Sample the image and its two derivatives at points, (N,) each.
 *
 * @param {FloatPlane} image
 * @param {Float64Array} at - (N, 2)
 */
function sampled(image, at) {
  const count = at.length / 2;
  const [xs, ys] = [0, 1].map(() => new Float32Array(5 * count));
  for (let n = 0; n < count; n++) {
    // there, to the right, to the left, below, and above
    for (let i = 0; i < 5; i++) {
      xs[i * count + n] = at[2 * n] + (i === 1 ? 0.5 : i === 2 ? -0.5 : 0);
      ys[i * count + n] = at[2 * n + 1] + (i === 3 ? 0.5 : i === 4 ? -0.5 : 0);
    }
  }
  const levels = Float64Array.from(between(image, [xs, ys], BY.cubic, BEYOND.replicate));
  const [taken, right, left, below, above] = [0, 1, 2, 3, 4].map((i) =>
    levels.subarray(i * count, (i + 1) * count),
  );
  const alongX = right.map((level, n) => level - left[n]);
  const alongY = below.map((level, n) => level - above[n]);
  return { taken, alongX, alongY };
}
