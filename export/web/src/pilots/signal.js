/**
 * How strongly blocks at the pilots' places toggle with the pilots' signs.
 *
 * A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
 * state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other
 * way. Whether a quadrilateral of the image is the display, which way up it is, and which grid it
 * shows follows from how well its blocks keep to these signs. Rate and phase need not be known.
 */

import { pilotsSignal } from "../generated/constants.js";
import { lessMeanAround } from "../image/blur.js";
import { areaMeans } from "../image/shrink.js";
import { MOST_SPAN, alongWave, spanOf, waves } from "./waves.js";

/** @typedef {import("../image/opencv.js").Plane<Uint8Array | Float32Array>} AnyPlane */

export const { LEAST_DEVIATION, SLOWEST } = pilotsSignal;

/**
 * Differences of phase across the display, in radians, that are tried: camera and panel go through
 * their rows one after the other, so that one side toggles later than the other.
 */
export const PHASE_STEPS = [-3, -2, -1, 0, 1, 2, 3].map((step) => (step * Math.PI) / 2);
/**
 * Differences of phase from left to right and from top to bottom, in radians.
 *
 * @type {[number, number][]}
 */
export const PHASE_SLOPES = [
  ...PHASE_STEPS.map((step) => /** @type {[number, number]} */ ([0, step])),
  ...PHASE_STEPS.filter(Boolean).map((step) => /** @type {[number, number]} */ ([step, 0])),
];

/**
 * Give the signs with which the pilots toggle.
 *
 * @param {Layout} layout
 * @returns {Float64Array} (pilots,) of 1 and -1
 */
export function pilotSigns(layout) {
  return Float64Array.from(layout.pilotBits, (bit) => 2 * bit - 1);
}

/**
 * Give the centres of the pilots on the display.
 *
 * @param {Layout} layout
 * @returns {Point[]} x and y in [0, 1]
 */
export function pilotCentres({ rows, cols, pilotBlocks }) {
  return Array.from(pilotBlocks, (block) => [
    ((block % cols) + 0.5) / cols,
    (Math.floor(block / cols) + 0.5) / rows,
  ]);
}

/**
 * List the expected changes of the blocks: the pilots' signs, 0 elsewhere.
 *
 * @param {Layout} layout
 * @returns {Float64Array} (rows * cols,)
 */
export function expectedChanges(layout) {
  const blocks = new Float64Array(layout.rows * layout.cols);
  pilotSigns(layout).forEach((sign, i) => (blocks[layout.pilotBlocks[i]] = sign));
  return blocks;
}

/**
 * Measure by how much each pilot is brighter than its neighbourhood of 3 x 3 blocks.
 *
 * @param {AnyPlane} view - the rectified display, of any size
 * @param {Layout} layout - with pilots
 * @returns {Float32Array} (pilots,) gray levels
 */
export function pilotValues(view, layout) {
  const blocks = standingOut(view, layout);
  return Float32Array.from(layout.pilotBlocks, (block) => blocks[block]);
}

/**
 * Measure by how much each block is brighter than its neighbourhood of 3 x 3 blocks.
 *
 * @param {AnyPlane} view - the rectified display, of any size
 * @param {Layout} layout - says how many blocks there are
 * @returns {Float32Array} (rows * cols,) levels
 */
export function standingOut(view, { rows, cols }) {
  return lessMeanAround(areaMeans(view, cols, rows), 3, 3).data;
}

/**
 * Where the pilots of a layout are along one axis, and by how much a slope of phase turns them:
 * cosines and sines of 1, 2, ... 6 times a quarter turn across the display, for each row or column.
 *
 * @typedef {{ of: Int32Array, count: number, cosines: Float64Array[], sines: Float64Array[] }} Axis
 */

/**
 * What brings all pilots into one phase if their phases have a slope of `PHASE_SLOPES`.
 *
 * @typedef {{ signs: Float64Array, down: Axis, across: Axis }} SignedPhases
 */

/** @type {WeakMap<Layout, SignedPhases>} */
const phasesOfLayouts = new WeakMap();

/**
 * Give the pilots' signs, and by how much slopes of phase turn the rows and columns of a layout.
 *
 * @param {Layout} layout - with pilots
 * @returns {SignedPhases}
 */
export function signedPhases(layout) {
  const known = phasesOfLayouts.get(layout);
  if (known) return known;
  const { rows, cols, pilotBlocks } = layout;
  const phases = {
    signs: pilotSigns(layout),
    down: axisOf(Int32Array.from(pilotBlocks, (block) => Math.floor(block / cols)), rows),
    across: axisOf(Int32Array.from(pilotBlocks, (block) => block % cols), cols),
  };
  phasesOfLayouts.set(layout, phases);
  return phases;
}

/**
 * @param {Int32Array} of - row or column of each pilot
 * @param {number} count - of rows or columns
 * @returns {Axis}
 */
function axisOf(of, count) {
  const tables = (/** @type {(phase: number) => number} */ wave) =>
    [1, 2, 3, 4, 5, 6].map((times) =>
      Float64Array.from({ length: count }, (_, i) =>
        wave((times * Math.PI * ((i + 0.5) / count - 0.5)) / 2),
      ),
    );
  return { of, count, cosines: tables(Math.cos), sines: tables(Math.sin) };
}

/**
 * Add up amplitudes of all pilots, turned back by each of `PHASE_SLOPES` and with their signs.
 *
 * @param {ArrayLike<number>} real - (pilots,)
 * @param {ArrayLike<number>} imaginary - (pilots,)
 * @param {SignedPhases} phases
 * @returns {[number, number][]} real and imaginary part of the sum for each slope
 */
export function sumsAlong(real, imaginary, phases) {
  return slopedSums(real, imaginary, phases.signs, phases, 1);
}

/**
 * Add up numbers of all pilots, turned back by each of `PHASE_SLOPES`.
 *
 * Pilots of one row, or of one column, are turned alike, so that they are added up first; and a
 * slope and its opposite share their products.
 *
 * @param {ArrayLike<number>} real - (pilots,)
 * @param {ArrayLike<number>} imaginary - (pilots,)
 * @param {Float64Array | null} signs - (pilots,) with which the numbers are multiplied, if any
 * @param {SignedPhases} phases
 * @param {1 | 2} times - how often they are turned back: squares twice
 * @returns {[number, number][]} real and imaginary part of the sum for each slope
 */
function slopedSums(real, imaginary, signs, { down, across }, times) {
  const [plain, ...downwards] = axisSums(real, imaginary, signs, down, times);
  const sideways = axisSums(real, imaginary, signs, across, times).slice(1);
  const [down1, up1, down2, up2, down3, up3] = downwards;
  const [right1, left1, right2, left2, right3, left3] = sideways;
  // in the order of PHASE_SLOPES
  return [
    ...[up3, up2, up1, plain, down1, down2, down3],
    ...[left3, left2, left1, right1, right2, right3],
  ];
}

/**
 * Add up numbers along one axis, turned back by no slope, and by each and its opposite in turn.
 *
 * @param {ArrayLike<number>} real
 * @param {ArrayLike<number>} imaginary
 * @param {Float64Array | null} signs
 * @param {Axis} axis
 * @param {1 | 2} times
 * @returns {[number, number][]} seven sums
 */
function axisSums(real, imaginary, signs, { of, count, cosines, sines }, times) {
  const rowsReal = new Float64Array(count);
  const rowsImaginary = new Float64Array(count);
  for (let p = 0; p < of.length; p++) {
    const sign = signs === null ? 1 : signs[p];
    rowsReal[of[p]] += sign * real[p];
    rowsImaginary[of[p]] += sign * imaginary[p];
  }
  let [allReal, allImaginary] = [0, 0];
  for (let i = 0; i < count; i++) {
    allReal += rowsReal[i];
    allImaginary += rowsImaginary[i];
  }
  /** @type {[number, number][]} */
  const sums = [[allReal, allImaginary]];
  for (let step = 1; step <= 3; step++) {
    const cosine = cosines[step * times - 1];
    const sine = sines[step * times - 1];
    let [cosReal, cosImaginary, sinReal, sinImaginary] = [0, 0, 0, 0];
    for (let i = 0; i < count; i++) {
      cosReal += cosine[i] * rowsReal[i];
      cosImaginary += cosine[i] * rowsImaginary[i];
      sinReal += sine[i] * rowsReal[i];
      sinImaginary += sine[i] * rowsImaginary[i];
    }
    sums.push([cosReal + sinImaginary, cosImaginary - sinReal]);
    sums.push([cosReal - sinImaginary, cosImaginary + sinReal]);
  }
  return sums;
}

/**
 * Tell how surely values over time toggle with the pilots' signs, at any one frequency.
 *
 * At each frequency the values have complex amplitudes X_p, whose phases may slope across the
 * display (`PHASE_SLOPES`); they are turned back first. Without the display, signs and amplitudes
 * have nothing to do with each other, whatever moves or flickers in the image, in one phase or in
 * many. So the signs s_p are regressed on the real and the imaginary parts of X_p: by chance these
 * explain the share R2 of the signs' power, or more, with probability (1 - R2)^((P - 2) / 2), for P
 * pilots. The largest share over all frequencies and slopes is taken, and their number is paid for.
 * That holds whenever the frames were taken: chance is in the pilots' signs, not in time. The
 * frequencies are those of whole periods in the time that the frames cover, up to the fastest that
 * the camera can see, so that more are paid for where frames are missing in between.
 *
 * @param {readonly Float32Array[]} values - (pilots,) for each of some frames
 * @param {Layout} layout - with these pilots
 * @param {readonly number[]} at - positions of the frames (waves.js), rising
 * @returns {{ evidence: number, frequency: number }} `evidence` is the natural logarithm of the
 *   probability that chance does as well, with the sign turned, so that more is surer, 0 at least;
 *   `frequency` is where it was found, in periods for each nominal frame
 */
export function pilotEvidence(values, layout, at) {
  const first = at.findIndex((place) => place > at[at.length - 1] - MOST_SPAN);
  const places = at.slice(Math.max(0, first));
  const frames = places.length;
  const pilots = layout.pilotBlocks.length;
  const { span, fastest } = spanOf(places);
  const frequencies = fastest + 1 - SLOWEST;
  if (frequencies < 1) return { evidence: 0, frequency: 0 };
  const phases = signedPhases(layout);
  const taken = values.slice(values.length - frames);
  const series = overDeviation(taken);
  const periods = (/** @type {number} */ from, /** @type {number} */ count) =>
    Array.from({ length: count }, (_, i) => (from + i) / span);
  const seen = waves(places, periods(SLOWEST, frequencies), periods(0, SLOWEST));
  let share = -1;
  let best = 0;
  for (let i = 0; i < frequencies; i++) {
    const { real, imaginary } = alongWave(series, seen[i]);
    const found = explainedShare(real, imaginary, phases);
    if (found > share) {
      share = found;
      best = (SLOWEST + i) / span;
    }
  }
  const unexplained = Math.max(1 - share, 1e-12);
  const paid = Math.log(frequencies * PHASE_SLOPES.length);
  const chance = ((pilots - 2) / 2) * Math.log(unexplained) + paid;
  return { evidence: Math.max(0, -chance), frequency: best };
}

/**
 * Find the phase in which the pilots toggle, and by how much it slopes across the display.
 *
 * @param {ArrayLike<number>} real - (pilots,) amplitudes at one frequency
 * @param {ArrayLike<number>} imaginary - (pilots,)
 * @param {Layout} layout - with pilots
 * @returns {{ slope: [number, number], phase: number }} differences of phase from left to right and
 *   from top to bottom, one of `PHASE_SLOPES`, and the phase of a pilot of bit 1 at the centre of
 *   the display, radians
 */
export function commonPhase(real, imaginary, layout) {
  const along = sumsAlong(real, imaginary, signedPhases(layout));
  const powers = along.map(([a, b]) => a * a + b * b);
  const best = powers.indexOf(Math.max(...powers));
  return { slope: PHASE_SLOPES[best], phase: Math.atan2(along[best][1], along[best][0]) };
}

/**
 * Find the largest share of the signs' power that amplitudes explain, over all phase slopes.
 *
 * @param {Float64Array} real - (pilots,)
 * @param {Float64Array} imaginary - (pilots,)
 * @param {SignedPhases} phases
 * @returns {number} in [0, 1]
 */
function explainedShare(real, imaginary, phases) {
  const pilots = real.length;
  const along = sumsAlong(real, imaginary, phases);
  const squareReal = new Float64Array(pilots);
  const squareImaginary = new Float64Array(pilots);
  let power = 0;
  for (let p = 0; p < pilots; p++) {
    squareReal[p] = real[p] * real[p] - imaginary[p] * imaginary[p];
    squareImaginary[p] = 2 * real[p] * imaginary[p];
    power += real[p] * real[p] + imaginary[p] * imaginary[p];
  }
  power = power * (1 + 1e-9) + 1e-12;
  // sums of the turned amplitudes' squares
  const squares = slopedSums(squareReal, squareImaginary, null, phases, 2);
  let most = -1;
  along.forEach(([a, b], slope) => {
    const [across, up] = squares[slope];
    const rr = (power + across) / 2;
    const ii = (power - across) / 2;
    const ri = up / 2;
    const apart = Math.max(rr * ii - ri * ri, 1e-10 * power * power);
    most = Math.max(most, (a * a * ii - 2 * a * b * ri + b * b * rr) / apart / pilots);
  });
  return most;
}

/**
 * Divide what differs from the mean over time by its usual deviation.
 *
 * @param {readonly Float32Array[]} values - (n,) for each of some frames
 * @returns {Float32Array[]} (n,) for each
 */
export function overDeviation(values) {
  const mean = new Float64Array(values[0].length);
  const scale = new Float64Array(mean.length);
  for (const now of values) for (let i = 0; i < mean.length; i++) mean[i] += now[i];
  for (let i = 0; i < mean.length; i++) mean[i] /= values.length;
  for (const now of values) {
    for (let i = 0; i < mean.length; i++) scale[i] += (now[i] - mean[i]) ** 2;
  }
  for (let i = 0; i < mean.length; i++) {
    scale[i] = 1 / (Math.sqrt(scale[i] / values.length) + LEAST_DEVIATION);
  }
  return values.map((now) => now.map((value, i) => (value - mean[i]) * scale[i]));
}
