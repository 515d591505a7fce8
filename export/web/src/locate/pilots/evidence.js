/**
 * How strongly blocks at the pilots' places toggle with the pilots' signs.
 *
 * A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
 * state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other
 * way. Whether a quadrilateral of the image is the display, which way up it is, and which grid it
 * shows follows from how well its blocks keep to these signs. Rate and phase need not be known.
 */

import { lessMeanAround } from "./around.js";
import { areaMeans } from "./means.js";
import { MOST_SPAN, spanOf, waves } from "./waves.js";

/** @typedef {import("../../link/layout.js").Layout} Layout */
/** @typedef {import("../../image/opencv.js").Plane<Uint8Array | Float32Array>} AnyPlane */

/** Gray levels added to a block's deviation over time before values are divided by it. */
export const LEAST_DEVIATION = 0.3;
/**
 * Number of periods in a window below which a frequency is not looked at: motion and exposure
 * drift slowly, the display does not.
 */
export const SLOWEST = 2;
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
 * Measure by how much each block is brighter than its neighbourhood of 3 x 3 blocks.
 *
 * @param {AnyPlane} gray - the rectified display, of any size
 * @param {Layout} layout - says how many blocks there are
 * @returns {Float32Array} (rows * cols,) in the levels of `gray`
 */
export function standingOut(gray, layout) {
  return lessMeanAround(areaMeans(gray, layout.cols, layout.rows), 3, 3).data;
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
 * Factors of all pilots for each of `PHASE_SLOPES`, one slope after the other: real and imaginary
 * part, and those of their squares.
 *
 * @typedef {{ real: Float64Array, imaginary: Float64Array, squareReal: Float64Array,
 *   squareImaginary: Float64Array }} SignedPhases
 */

/** @type {WeakMap<Layout, SignedPhases>} */
const phasesOfLayouts = new WeakMap();

/**
 * Give factors that bring all pilots into one phase if their phases have a slope of
 * `PHASE_SLOPES`: the pilots' signs, turned back by the phase at their places.
 *
 * @param {Layout} layout - with pilots
 * @returns {SignedPhases}
 */
export function signedPhases(layout) {
  const known = phasesOfLayouts.get(layout);
  if (known) return known;
  const { rows, cols, pilotBlocks } = layout;
  const signs = pilotSigns(layout);
  const count = PHASE_SLOPES.length * signs.length;
  const phases = {
    real: new Float64Array(count),
    imaginary: new Float64Array(count),
    squareReal: new Float64Array(count),
    squareImaginary: new Float64Array(count),
  };
  PHASE_SLOPES.forEach(([across, down], slope) => {
    pilotBlocks.forEach((block, p) => {
      const x = ((block % cols) + 0.5) / cols - 0.5;
      const y = (Math.floor(block / cols) + 0.5) / rows - 0.5;
      const phase = -(across * x + down * y);
      const at = slope * signs.length + p;
      phases.real[at] = signs[p] * Math.cos(phase);
      phases.imaginary[at] = signs[p] * Math.sin(phase);
      phases.squareReal[at] = Math.cos(2 * phase);
      phases.squareImaginary[at] = Math.sin(2 * phase);
    });
  });
  phasesOfLayouts.set(layout, phases);
  return phases;
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
  const pilots = real.length;
  return PHASE_SLOPES.map((_, slope) => {
    let [across, up] = [0, 0];
    for (let p = 0, at = slope * pilots; p < pilots; p++, at++) {
      across += phases.real[at] * real[p] - phases.imaginary[at] * imaginary[p];
      up += phases.real[at] * imaginary[p] + phases.imaginary[at] * real[p];
    }
    return [across, up];
  });
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
 * @param {readonly ArrayLike<number>[]} values - (pilots,) for each of some frames
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
  const series = standardised(values.slice(values.length - frames), pilots);
  const periods = (/** @type {number} */ from, /** @type {number} */ count) =>
    Array.from({ length: count }, (_, i) => (from + i) / span);
  const seen = waves(places, periods(SLOWEST, frequencies), periods(0, SLOWEST));
  const real = new Float64Array(pilots);
  const imaginary = new Float64Array(pilots);
  let share = -1;
  let best = 0;
  for (let i = 0; i < frequencies; i++) {
    real.fill(0);
    imaginary.fill(0);
    for (let frame = 0; frame < frames; frame++) {
      const cosine = seen[i].real[frame];
      const sine = seen[i].imaginary[frame];
      const now = series[frame];
      for (let p = 0; p < pilots; p++) {
        real[p] += cosine * now[p];
        imaginary[p] += sine * now[p];
      }
    }
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
 * Turn the amplitudes of a display's pixels into one phase, and give them the pilots' signs.
 *
 * @param {import("./partMatches.js").Amplitudes} change - at one frequency of the rectified display
 * @param {Layout} layout - with pilots
 * @returns {import("../../image/opencv.js").Plane<Float32Array>} parts of the amplitudes that
 *   toggle as the pilots do, positive where a pilot of bit 1 lies
 */
export function inOnePhase({ width, height, real, imaginary }, layout) {
  const ofPilots = (/** @type {Float32Array} */ data) => {
    const blocks = areaMeans({ width, height, data }, layout.cols, layout.rows).data;
    return Float64Array.from(layout.pilotBlocks, (block) => blocks[block]);
  };
  const along = sumsAlong(ofPilots(real), ofPilots(imaginary), signedPhases(layout));
  const powers = along.map(([a, b]) => a * a + b * b);
  const best = powers.indexOf(Math.max(...powers));
  const [across, down] = PHASE_SLOPES[best];
  const start = Math.atan2(along[best][1], along[best][0]);
  const data = new Float32Array(width * height);
  for (let y = 0, at = 0; y < height; y++) {
    const line = start + down * ((y + 0.5) / height - 0.5);
    for (let x = 0; x < width; x++, at++) {
      const phase = line + across * ((x + 0.5) / width - 0.5);
      data[at] = real[at] * Math.cos(phase) + imaginary[at] * Math.sin(phase);
    }
  }
  return { width, height, data };
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
  let most = -1;
  along.forEach(([a, b], slope) => {
    // sums of the turned amplitudes' squares
    let [across, up] = [0, 0];
    for (let p = 0, at = slope * pilots; p < pilots; p++, at++) {
      const [turnReal, turnImaginary] = [phases.squareReal[at], phases.squareImaginary[at]];
      across += turnReal * squareReal[p] - turnImaginary * squareImaginary[p];
      up += turnReal * squareImaginary[p] + turnImaginary * squareReal[p];
    }
    const rr = (power + across) / 2;
    const ii = (power - across) / 2;
    const ri = up / 2;
    const apart = Math.max(rr * ii - ri * ri, 1e-10 * power * power);
    most = Math.max(most, (a * a * ii - 2 * a * b * ri + b * b * rr) / apart / pilots);
  });
  return most;
}

/**
 * Take off each pilot's mean over time, and divide by its deviation.
 *
 * @param {readonly ArrayLike<number>[]} values
 * @param {number} pilots
 * @returns {Float64Array[]}
 */
function standardised(values, pilots) {
  const mean = new Float64Array(pilots);
  const scale = new Float64Array(pilots);
  for (const now of values) for (let p = 0; p < pilots; p++) mean[p] += now[p];
  for (let p = 0; p < pilots; p++) mean[p] /= values.length;
  for (const now of values) for (let p = 0; p < pilots; p++) scale[p] += (now[p] - mean[p]) ** 2;
  for (let p = 0; p < pilots; p++) {
    scale[p] = 1 / (Math.sqrt(scale[p] / values.length) + LEAST_DEVIATION);
  }
  return values.map((now) => {
    const series = new Float64Array(pilots);
    for (let p = 0; p < pilots; p++) series[p] = (now[p] - mean[p]) * scale[p];
    return series;
  });
}
