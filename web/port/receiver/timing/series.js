/**
 * The toggles of one place of the display: a series with a value for each frame.
 *
 * Series are *whitened*: each sample less what the one before it predicts, as a multiple of the
 * standard deviation that is left. What drifts explain is taken off.
 */

import { receiverTimingFit } from "../../../generated/constants.js";
import { dot, orthonormal, takeOffBasis } from "../../link/linear.js";
import { quantiles } from "../../link/order.js";

const { MIN_SEEN, MAX_CORRELATION, OUTLIER, SPREAD_QUANTILES } = receiverTimingFit;

/**
 * What the toggles of a place hold beside the wave and its drift: the standard deviation, in gray
 * levels, of what the frame before does not predict, and the correlation from one frame to the
 * next, in [0, `MAX_CORRELATION`].
 *
 * @typedef {{ deviation: number, correlation: number }} PlaceNoise
 */

/**
 * Weights of a sample and of the one before it, each (n,), in what is whitened.
 *
 * @typedef {{ now: Float64Array, back: Float64Array }} Factors
 */

/** The toggles of a place, made ready for fits of clocks. */
export class PlaceToggles {
  #drifts;
  #free;
  #leftWithout;
  #factors;
  /** Orthonormal bases of the drifts, as they are and whitened. */
  #plain;
  #basis;
  /** Noise by which series are whitened. @type {PlaceNoise} */
  noise = { deviation: 1, correlation: 0 };
  /** (n,) whitened toggles without drift. @type {Float64Array} */
  x = new Float64Array(0);

  /**
   * @param {Float64Array} values - (n,) toggles, gray levels; NaN where the place is unseen
   * @param {Float64Array[]} drifts - (n,) each, which may lie in them
   */
  constructor(values, drifts) {
    this.#drifts = drifts;
    const near = withoutOutliers(values);
    const count = near.reduce((sum, one) => sum + one, 0);
    /** (n,) 1 where a toggle counts, 0 everywhere if too few are seen; and the number of these. */
    this.seen = count < MIN_SEEN ? near.fill(0) : near;
    this.count = count < MIN_SEEN ? 0 : count;
    this.#free = Math.max(this.count - drifts.length - 1, 1);
    /** (n,) toggles without their mean; 0 where they do not count. */
    this.values = this.centred(values);
    /** Standard deviation of the toggles, gray levels. */
    this.deviation = Math.sqrt(dot(this.values, this.values) / Math.max(this.count, 1));
    this.#factors = whiteningFactors(this.seen, this.noise);
    this.#plain = this.#basis = driftBasis(drifts, this.#factors);
    /** Noise of the place if there is no clock. */
    this.without = this.noiseOf(this.values);
    this.setNoise(this.without);
    this.#leftWithout = dot(this.x, this.x) * this.noise.deviation ** 2;
  }

  /**
   * Weigh the evidence of a clock if the place's noise is its own.
   *
   * @param {number} left - squares that the clock leaves of the whitened toggles
   */
  evidence(left) {
    if (this.count === 0) return 0;
    const ratio = this.#leftWithout / Math.max(left * this.noise.deviation ** 2, 1e-12);
    return this.#free * Math.log(ratio);
  }

  /**
   * Take the mean off a series; it becomes 0 where the place is unseen.
   *
   * @param {Float64Array} series - (n,)
   */
  centred(series) {
    const known = series.map((value, k) => (this.seen[k] ? value : 0));
    const mean = known.reduce((sum, value) => sum + value, 0) / Math.max(this.count, 1);
    return known.map((value, k) => (value - mean) * this.seen[k]);
  }

  /**
   * Estimate the noise of the place from what is left of its toggles.
   *
   * @param {Float64Array} series - (n,) 0 where the place is unseen
   * @returns {PlaceNoise}
   */
  noiseOf(series) {
    const left = takeOffBasis(series.slice(), this.#plain).map((value, k) => value * this.seen[k]);
    let lag = dot(left.subarray(1), left) / Math.max(dot(left, left), 1e-12);
    lag += (1 + 3 * lag) / Math.max(this.count, 1); // its bias in short windows
    const correlation = Math.min(Math.max(lag, 0), MAX_CORRELATION);
    const fresh = whiten(left, whiteningFactors(this.seen, { deviation: 1, correlation }));
    const variance = dot(fresh, fresh) / this.#free;
    return { deviation: Math.sqrt(Math.max(variance, 1e-8)), correlation };
  }

  /**
   * Whiten by this noise from now on.
   *
   * @param {PlaceNoise} noise
   */
  setNoise(noise) {
    this.noise = noise;
    this.#factors = whiteningFactors(this.seen, noise);
    this.#basis = driftBasis(this.#drifts, this.#factors);
    this.x = this.whitened(this.values.slice());
  }

  /**
   * Whiten a series, in place, and take off what drifts explain.
   *
   * @param {Float64Array} series - (n,)
   */
  whitened(series) {
    return takeOffBasis(whiten(series, this.#factors), this.#basis);
  }

  /**
   * Find the series (n,) whose product with a wave is that of the whitened toggles with the whitened
   * wave, and the largest weight of a sample in the one after it, as a share of that one's own.
   */
  adjoint() {
    const { now, back } = this.#factors;
    const series = this.x.map((value, k) => value * now[k] - (this.x[k + 1] ?? 0) * (back[k + 1] ?? 0));
    return { series, correlation: Math.max(...back) * this.noise.deviation };
  }
}

/**
 * Work out by what a sample and the one before it are multiplied to whiten a series.
 *
 * @param {Uint8Array} seen - (n,) 1 where a toggle is known
 * @param {PlaceNoise} noise
 * @returns {Factors}
 */
function whiteningFactors(seen, { deviation, correlation }) {
  const alone = Math.sqrt(1 - correlation ** 2);
  return {
    now: Float64Array.from(seen, (one, k) => (one * (seen[k - 1] ? 1 : alone)) / deviation),
    back: Float64Array.from(seen, (one, k) => (one * (seen[k - 1] ? correlation : 0)) / deviation),
  };
}

/**
 * Weigh each sample of a series (n,), in place, and take off what the one before it predicts.
 *
 * @param {Float64Array} series
 * @param {Factors} factors
 */
function whiten(series, { now, back }) {
  // from the end: a sample is whitened before the one that it is predicted from
  for (let k = series.length - 1; k > 0; k--) series[k] = series[k] * now[k] - series[k - 1] * back[k];
  series[0] *= now[0];
  return series;
}

/**
 * Find an orthonormal basis of what drifts become when they are whitened.
 *
 * @param {Float64Array[]} drifts - (n,) each
 * @param {Factors} factors
 * @returns {Float64Array[]} (n,) each, orthonormal; what the others explain is left out
 */
function driftBasis(drifts, factors) {
  return orthonormal(drifts.map((drift) => whiten(drift.slice(), factors)));
}

/**
 * Tell which toggles (n,) are seen, and no farther from the rest than toggles are.
 *
 * @param {Float64Array} values - NaN where the place is unseen
 */
function withoutOutliers(values) {
  const [low, high] = quantiles(values.filter(Number.isFinite), SPREAD_QUANTILES);
  const reach = (OUTLIER * (high - low)) / 2 + 1e-9;
  return Uint8Array.from(values, (value) => Number(Math.abs(value - (low + high) / 2) <= reach));
}
