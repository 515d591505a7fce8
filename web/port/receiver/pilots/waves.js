/**
 * Waves at the times of a camera's frames, with which amplitudes are measured.
 *
 * Cameras drop frames, and a receiver that is too slow does, too. So the frames of a window need
 * not be evenly spaced: each has a position, its time in nominal frames of the camera. An amplitude
 * is the sum of the frames' values times a wave at these positions. Where the frames are evenly
 * spaced, waves of whole periods do not see anything slower than themselves; where they are not,
 * they would. So what is slow, as motion and exposure are, is taken out of the waves themselves.
 */

import { receiverPilotsWaves } from "../../../generated/constants.js";
import { rowsOf } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { median } from "../../link/order.js";

export const { FINE_STEP, FAINT_SINE, MOST_SPAN, SPARE } = receiverPilotsWaves;

/** Share of a slow wave that must be new for it to be taken out, beside those before. */
const NEW_SHARE = 1e-6;
/** Number of frames that are summed up in one pass over their values. */
const AT_ONCE = 4;
/** Real and imaginary part of what a frame that is not there adds. */
const NOTHING = [0, 0];

/**
 * A wave at the positions of frames: by these numbers, the frames' values are multiplied, and then
 * added up. Or such sums.
 *
 * @typedef {{ real: Float64Array, imaginary: Float64Array }} Wave
 */

/**
 * Tell the position of a frame from its time.
 *
 * @param {number} seconds - since the window's first frame
 * @param {number} fps - nominal number of frames of the camera in a second
 * @returns {number} nominal frames, rounded to `FINE_STEP`
 */
export function position(seconds, fps) {
  return roundHalfEven((seconds * fps) / FINE_STEP) * FINE_STEP;
}

/**
 * Tell how much time a window covers.
 *
 * @param {readonly number[]} at - positions of its frames, rising
 * @returns {{ span: number, fastest: number }} the number of nominal frames that it covers, which
 *   is that of the frames where none is missing; and the number of periods in it of the fastest
 *   wave that the camera can tell from a slower one when it misses no frame
 */
export function spanOf(at) {
  if (at.length < 2) return { span: at.length, fastest: 0 };
  const steps = at.slice(1).map((place, i) => place - at[i]);
  const step = Math.min(1, Math.max(FINE_STEP, median(steps)));
  const span = at[at.length - 1] - at[0] + step;
  return { span, fastest: Math.floor(span / step / 2 + SPARE) };
}

/**
 * Make waves at the positions of frames that see nothing of slower waves.
 *
 * @param {readonly number[]} at - positions, at least one
 * @param {readonly number[]} frequencies - of the waves, in periods for each nominal frame
 * @param {readonly number[]} slower - frequencies of slower waves, 0 among them, which are taken
 *   out
 * @returns {Wave[]}
 */
export function waves(at, frequencies, slower) {
  /** @type {Float64Array[]} orthogonal to each other, of length 1 */
  const slow = [];
  for (const frequency of slower) {
    for (const part of Object.values(waveAt(at, frequency))) {
      const before = lengthOf(part);
      const left = lengthOf(takeOut(part, slow));
      if (left <= NEW_SHARE * before) continue;
      slow.push(part.map((value) => value / left));
    }
  }
  return frequencies.map((frequency) => {
    const wave = waveAt(at, frequency);
    takeOut(wave.real, slow);
    takeOut(wave.imaginary, slow);
    if (lengthOf(wave.imaginary) ** 2 < FAINT_SINE * lengthOf(wave.real) ** 2) {
      wave.imaginary.fill(0);
    }
    return wave;
  });
}

/**
 * @param {readonly number[]} at
 * @param {number} frequency
 * @returns {Wave} that runs backwards, as Fourier's sums do
 */
function waveAt(at, frequency) {
  const turns = Float64Array.from(at, (place) => {
    const periods = frequency * (place - at[0]);
    return 2 * Math.PI * (periods - Math.floor(periods));
  });
  return { real: turns.map(Math.cos), imaginary: turns.map((turn) => -Math.sin(turn)) };
}

/**
 * Find the square root of the sum of squares.
 *
 * @param {Float64Array} wave
 * @returns {number}
 */
export function lengthOf(wave) {
  let sum = 0;
  for (const value of wave) sum += value * value;
  return Math.sqrt(sum);
}

/**
 * Take out of a wave what lies along others; twice, as rounding leaves some the first time.
 *
 * @param {Float64Array} wave - is changed
 * @param {Float64Array[]} others - orthogonal to each other, of length 1
 * @returns {Float64Array} the wave
 */
function takeOut(wave, others) {
  for (let round = 0; round < 2; round++) {
    for (const other of others) {
      let along = 0;
      for (let t = 0; t < wave.length; t++) along += wave[t] * other[t];
      for (let t = 0; t < wave.length; t++) wave[t] -= along * other[t];
    }
  }
  return wave;
}

/**
 * Add up the values of frames times a wave.
 *
 * @param {readonly ArrayLike<number>[]} values - (n,) of each frame, at least one
 * @param {Wave} wave
 * @returns {Wave} (n,)
 */
export function alongWave(values, wave) {
  const real = new Float64Array(values[0].length);
  const imaginary = new Float64Array(real.length);
  const last = values.length - 1;
  for (let t = 0; t <= last; t += AT_ONCE) {
    const [t1, t2, t3] = [t + 1, t + 2, t + 3];
    const a = values[t];
    const b = values[Math.min(t1, last)];
    const c = values[Math.min(t2, last)];
    const d = values[Math.min(t3, last)];
    const [a0, a1] = [wave.real[t], wave.imaginary[t]];
    const [b0, b1] = t1 > last ? NOTHING : [wave.real[t1], wave.imaginary[t1]];
    const [c0, c1] = t2 > last ? NOTHING : [wave.real[t2], wave.imaginary[t2]];
    const [d0, d1] = t3 > last ? NOTHING : [wave.real[t3], wave.imaginary[t3]];
    for (let i = 0; i < real.length; i++) {
      real[i] += a0 * a[i] + b0 * b[i] + c0 * c[i] + d0 * d[i];
      imaginary[i] += a1 * a[i] + b1 * b[i] + c1 * c[i] + d1 * d[i];
    }
  }
  return { real, imaginary };
}

/**
 * Write waves one below the other.
 *
 * @param {readonly Wave[]} waves - of one length
 * @returns {Plane<Float64Array>} a row for each real and each imaginary part
 */
export function rowsOfWaves(waves) {
  return rowsOf(waves.flatMap(({ real, imaginary }) => [real, imaginary]), Float64Array);
}
