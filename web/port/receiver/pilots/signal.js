/**
 * How strongly blocks at the pilots' places toggle with the pilots' signs.
 *
 * A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
 * state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other
 * way. Whether a quadrilateral of the image is the display, which way up it is, and which grid it
 * shows follows from how well its blocks keep to these signs. Rate and phase need not be known.
 */

import { receiverPilotsSignal, robust } from "../../../generated/constants.js";
import { kept } from "../../image/copies.js";
import { arraysOf, call, floatPlane, rowsOf } from "../../image/opencv.js";
import { complexDot } from "../../link/linear.js";
import { median } from "../../link/order.js";
import { pilotCentres, pilotSigns } from "../../link/pilots.js";
import { MOST_SPAN, rowsOfWaves, spanOf, waves } from "./waves.js";

/** @typedef {import("./waves.js").Wave} Wave */

export const { LEAST_DEVIATION, SLOWEST, NEAR } = receiverPilotsSignal;
const { CLIPPED, LIMIT } = receiverPilotsSignal;
/** Differences of phase from left to right and from top to bottom, in radians, that are tried. */
const PHASE_SLOPES = /** @type {[number, number][]} */ (receiverPilotsSignal.PHASE_SLOPES);

/**
 * Give the pilots' signs, turned back by the phase at their places, which brings all pilots into one
 * phase if their phases slope: (pilots,) for each of `PHASE_SLOPES`.
 *
 * @type {(layout: Layout) => Wave[]}
 */
const signedPhases = kept((layout) => {
  const signs = pilotSigns(layout);
  const centres = pilotCentres(layout);
  return PHASE_SLOPES.map(([across, down]) => {
    const turned = (/** @type {(phase: number) => number} */ wave) =>
      signs.map((sign, p) => {
        return sign * wave(across * (centres[p][0] - 0.5) + down * (centres[p][1] - 0.5));
      });
    return { real: turned(Math.cos), imaginary: turned((phase) => -Math.sin(phase)) };
  });
});

/**
 * Take the mean of `NEAR` frames before each frame, of as many after it and of itself off what it
 * shows.
 *
 * @param {readonly ArrayLike<number>[]} frames - (n,) values of each frame
 * @returns {Float32Array[]} (n,) of each frame
 */
export function apartFromNear(frames) {
  const sums = new Float64Array(frames[0].length);
  const add = (/** @type {number} */ frame, /** @type {number} */ sign) => {
    const values = frames[frame];
    if (!values) return;
    for (let i = 0; i < sums.length; i++) sums[i] += sign * values[i];
  };
  for (let frame = 0; frame < NEAR; frame++) add(frame, 1);
  return frames.map((values, frame) => {
    add(frame + NEAR, 1);
    add(frame - NEAR - 1, -1);
    const count = Math.min(frame + NEAR + 1, frames.length) - Math.max(frame - NEAR, 0);
    const apart = new Float32Array(sums.length);
    for (let i = 0; i < sums.length; i++) apart[i] = values[i] - sums[i] / count;
    return apart;
  });
}

/**
 * Take what changes slowly off values over time, and bound what is left by `CLIPPED`.
 *
 * @param {readonly ArrayLike<number>[]} frames - (P,) gray levels of each frame
 * @returns {{ changes: Float32Array[], usual: Float64Array }} `changes` are (P,) gray levels of each
 *   frame; `usual` is (P,) the usual change of each place, by the median over time, gray levels
 */
export function clippedChanges(frames) {
  const changes = apartFromNear(frames);
  const usual = Float64Array.from(frames[0], (_, p) => {
    const sizes = changes.map((now) => Math.abs(now[p]));
    return robust.MAD_TO_SIGMA * median(sizes) + LEAST_DEVIATION;
  });
  for (const now of changes) {
    now.forEach((value, p) => {
      const most = CLIPPED * usual[p];
      now[p] = Math.min(Math.max(value, -most), most);
    });
  }
  return { changes, usual };
}

/**
 * Bound amplitudes, so that strong ones do not outweigh all others; signs stay.
 *
 * @param {Float64Array} amplitudes - (P,)
 * @returns {Float64Array} (P,) of at most 1
 */
export function limited(amplitudes) {
  const middle = median(amplitudes.map(Math.abs));
  return amplitudes.map((X) => X / Math.sqrt(X * X + (LIMIT * middle) ** 2 + 1e-12));
}

/**
 * Tell how surely values over time toggle with the pilots' signs, at any one frequency.
 *
 * What changes slowly is taken off, and large changes are bounded, as a picture that moves brings
 * them. At each frequency the values have complex amplitudes X_p, bounded, whose phases may slope
 * across the display (`PHASE_SLOPES`); they are turned back first. Without the display, signs and amplitudes
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
  const periods = (/** @type {number} */ from, /** @type {number} */ count) =>
    Array.from({ length: count }, (_, i) => (from + i) / span);
  const seen = waves(places, periods(SLOWEST, frequencies), periods(0, SLOWEST));
  const shares = new Float64Array(frequencies);
  const given = [seen, signedPhases(layout)].map(rowsOfWaves);
  const taken = rowsOf(clippedChanges(values.slice(values.length - frames)).changes);
  call("explainedShares", [taken, LEAST_DEVIATION, LIMIT, ...given], [shares]);
  const share = Math.max(...shares);
  const best = (SLOWEST + shares.indexOf(share)) / span;
  const unexplained = Math.max(1 - share, 1e-12);
  const paid = Math.log(frequencies * PHASE_SLOPES.length);
  const chance = ((pilots - 2) / 2) * Math.log(unexplained) + paid;
  return { evidence: Math.max(0, -chance), frequency: best };
}

/**
 * Find the phase in which the pilots toggle, and by how much it slopes across the display.
 *
 * @param {import("../../link/linear.js").Complex} amplitudes - (pilots,) at one frequency
 * @param {Layout} layout - with pilots
 * @returns {{ slope: [number, number], phase: number }} differences of phase from left to right and
 *   from top to bottom, one of `PHASE_SLOPES`, and the phase of a pilot of bit 1 at the centre of
 *   the display, radians
 */
export function commonPhase(amplitudes, layout) {
  const along = signedPhases(layout).map((phases) => complexDot(amplitudes, phases));
  const powers = along.map(([real, imaginary]) => real * real + imaginary * imaginary);
  const best = powers.indexOf(Math.max(...powers));
  return { slope: PHASE_SLOPES[best], phase: Math.atan2(along[best][1], along[best][0]) };
}

/**
 * Divide what differs from the mean over time by its usual deviation.
 *
 * @param {readonly Float32Array[]} values - (n,) for each of some frames
 * @returns {Float32Array[]} (n,) for each
 */
export function overDeviation(values) {
  const over = floatPlane(values[0].length, values.length);
  call("overDeviation", [rowsOf(values), LEAST_DEVIATION], [over]);
  return arraysOf(over);
}
