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
import { dot, orthonormal, takeOffBasis } from "../../link/linear.js";
import { median } from "../../link/order.js";

export const { FINE_STEP, FAINT_SINE, MOST_SPAN, SPARE } = receiverPilotsWaves;

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
  const slow = orthonormal(
    slower.flatMap((frequency) => Object.values(waveAt(at, frequency))),
  );
  return frequencies.map((frequency) => {
    const { real, imaginary } = waveAt(at, frequency);
    for (const part of [real, imaginary]) takeOffBasis(takeOffBasis(part, slow), slow);
    if (dot(imaginary, imaginary) < FAINT_SINE * dot(real, real)) imaginary.fill(0);
    return { real, imaginary };
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
 * Add up the values of frames times a wave.
 *
 * @param {readonly ArrayLike<number>[]} values - (n,) of each frame, at least one
 * @param {Wave} wave
 * @returns {Wave} (n,)
 */
export function alongWave(values, wave) {
  const real = new Float64Array(values[0].length);
  const imaginary = new Float64Array(real.length);
  values.forEach((shown, t) => {
    const [cosine, sine] = [wave.real[t], wave.imaginary[t]];
    for (let i = 0; i < real.length; i++) {
      real[i] += cosine * shown[i];
      imaginary[i] += sine * shown[i];
    }
  });
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
