/**
 * How strongly blocks at the pilots' places toggle with the pilots' signs.
 *
 * A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
 * state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other
 * way. Whether a quadrilateral of the image is the display, which way up it is, and which grid it
 * shows follows from how well its blocks keep to these signs. Rate and phase need not be known.
 */

import { resizeArea } from "../../image/shrink.js";
import { lessMeanAround } from "./around.js";

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
  return lessMeanAround(blockMeans(gray, layout), 3, 3).data;
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
 * Tell how surely values over time toggle with the signs, at any one frequency.
 *
 * At each frequency the values have complex amplitudes X_p. Without the display, signs and
 * amplitudes have nothing to do with each other, whatever moves or flickers in the image, in one
 * phase or in many. So the signs s_p are regressed on the real and the imaginary parts of X_p: by
 * chance these explain the share R2 of the signs' power, or more, with probability
 * (1 - R2)^((P - 2) / 2), for P pilots. The largest share over all frequencies is taken, and the
 * number of them is paid for.
 *
 * @param {readonly ArrayLike<number>[]} values - (pilots,) for each of some evenly spaced frames
 * @param {ArrayLike<number>} signs - (pilots,) of 1 and -1
 * @returns {{ evidence: number, frequency: number }} `evidence` is the natural logarithm of the
 *   probability that chance does as well, with the sign turned, so that more is surer, 0 at least;
 *   `frequency` is where it was found, in periods for each frame
 */
export function pilotEvidence(values, signs) {
  const frames = values.length;
  const pilots = signs.length;
  const frequencies = Math.floor(frames / 2) + 1 - SLOWEST;
  if (frequencies < 1) return { evidence: 0, frequency: 0 };
  const series = standardised(values, pilots);
  const real = new Float64Array(pilots);
  const imaginary = new Float64Array(pilots);
  let share = -1;
  let best = 0;
  for (let number = SLOWEST; number < SLOWEST + frequencies; number++) {
    real.fill(0);
    imaginary.fill(0);
    for (let frame = 0; frame < frames; frame++) {
      const turn = (2 * Math.PI * ((number * frame) % frames)) / frames;
      const cosine = Math.cos(turn);
      const sine = -Math.sin(turn);
      const now = series[frame];
      for (let p = 0; p < pilots; p++) {
        real[p] += cosine * now[p];
        imaginary[p] += sine * now[p];
      }
    }
    const found = explainedShare(real, imaginary, signs);
    if (found > share) {
      share = found;
      best = number;
    }
  }
  const unexplained = Math.max(1 - share, 1e-12);
  const chance = ((pilots - 2) / 2) * Math.log(unexplained) + Math.log(frequencies);
  return { evidence: Math.max(0, -chance), frequency: best / frames };
}

/**
 * Find the share of the signs' power that amplitudes explain, as their real and imaginary parts.
 *
 * @param {Float64Array} real - (pilots,)
 * @param {Float64Array} imaginary - (pilots,)
 * @param {ArrayLike<number>} signs - (pilots,)
 * @returns {number} in [0, 1]
 */
function explainedShare(real, imaginary, signs) {
  let [a, b, rr, ii, ri] = [0, 0, 0, 0, 0];
  for (let p = 0; p < real.length; p++) {
    a += real[p] * signs[p];
    b += imaginary[p] * signs[p];
    rr += real[p] * real[p];
    ii += imaginary[p] * imaginary[p];
    ri += real[p] * imaginary[p];
  }
  const little = 1e-9 * (rr + ii) + 1e-12;
  rr += little;
  ii += little;
  return (a * a * ii - 2 * a * b * ri + b * b * rr) / (rr * ii - ri * ri) / real.length;
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

/**
 * Average over each block.
 *
 * @param {AnyPlane} gray
 * @param {Layout} layout
 * @returns {import("../../image/opencv.js").Plane<Float32Array>} a pixel for each block
 */
export function blockMeans(gray, { rows, cols }) {
  const across = gray.width / cols;
  const down = gray.height / rows;
  if (!Number.isInteger(across) || !Number.isInteger(down)) {
    const { width, height, data } = gray;
    return resizeArea({ width, height, data: Float32Array.from(data) }, cols, rows);
  }
  const { data: source } = gray;
  const data = new Float32Array(rows * cols);
  const share = 1 / (across * down);
  const sums = new Float64Array(cols);
  for (let row = 0, at = 0; row < rows; row++) {
    sums.fill(0);
    for (let y = 0; y < down; y++) {
      for (let col = 0; col < cols; col++) {
        let sum = 0;
        for (let x = 0; x < across; x++) sum += source[at++];
        sums[col] += sum;
      }
    }
    for (let col = 0; col < cols; col++) data[row * cols + col] = sums[col] * share;
  }
  return { width: cols, height: rows, data };
}
