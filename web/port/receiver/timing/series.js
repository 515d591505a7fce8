/**
 * Series of toggles: one value per place and frame, stored as (P, n), place by place.
 *
 * Series are *whitened*: each sample less what the one before it predicts, as a multiple of the
 * standard deviation that is left.
 */

import { receiverTimingFit } from "../../../generated/constants.js";
import { dot } from "../../link/linear.js";
import { quantile } from "../../link/order.js";

export const { OUTLIER, SPREAD_QUANTILES } = receiverTimingFit;

/**
 * Weights of a sample and of the one before it, each (P, n), in what is whitened.
 *
 * @typedef {{ now: Float64Array, back: Float64Array }} Factors
 */

/**
 * Work out by what a sample and the one before it are multiplied to whiten a series.
 *
 * @param {Uint8Array} seen - (P, n) 1 where a toggle is known
 * @param {Float64Array} deviation - (P,) of what the frame before does not predict
 * @param {Float64Array} correlation - (P,) from one frame to the next
 * @returns {Factors}
 */
export function whiteningFactors(seen, deviation, correlation) {
  const now = new Float64Array(seen.length);
  const back = new Float64Array(seen.length);
  const count = seen.length / deviation.length;
  for (let place = 0; place < deviation.length; place++) {
    const whole = 1 / deviation[place];
    const alone = Math.sqrt(1 - correlation[place] ** 2) / deviation[place];
    const before = correlation[place] / deviation[place];
    for (let k = 0, at = place * count; k < count; k++, at++) {
      if (!seen[at]) continue;
      const follows = k > 0 && seen[at - 1];
      now[at] = follows ? whole : alone;
      back[at] = follows ? before : 0;
    }
  }
  return { now, back };
}

/**
 * Weigh each sample and take off what the one before it predicts.
 *
 * @param {Float64Array} series - (P, n); it may be `whitened` itself
 * @param {Factors} factors
 * @param {Float64Array} [whitened] - (P, n), where the result is written
 */
export function whiten(series, { now, back }, whitened = new Float64Array(series.length)) {
  // from the end: a sample is whitened before the one that it predicts from; `back` is 0 at the
  // first sample of a place
  for (let at = series.length - 1; at > 0; at--) {
    whitened[at] = series[at] * now[at] - series[at - 1] * back[at];
  }
  whitened[0] = series[0] * now[0];
  return whitened;
}

/**
 * Find, for each place, an orthonormal basis of what drifts become when they are whitened.
 *
 * @param {Float64Array[]} drifts - q series (n,)
 * @param {Factors} factors - of (P, n)
 * @returns {Float64Array[]} q series (P, n), which are orthonormal at each place, or 0
 */
export function driftBasis(drifts, factors) {
  const count = drifts[0].length;
  const places = factors.now.length / count;
  const basis = drifts.map((drift) => {
    const repeated = new Float64Array(factors.now.length);
    for (let place = 0; place < places; place++) repeated.set(drift, place * count);
    return whiten(repeated, factors, repeated);
  });
  for (let place = 0; place < places; place++) {
    const [from, to] = [place * count, (place + 1) * count];
    basis.forEach((vector, which) => {
      const before = squares(vector, from, to);
      // twice, because once leaves errors where drifts are nearly alike
      for (let pass = 0; pass < 2; pass++) {
        for (let other = 0; other < which; other++) {
          takeOff(vector, basis[other], dot(vector, basis[other], from, to), from, to);
        }
      }
      const left = squares(vector, from, to);
      const scale = left > 1e-24 * before ? 1 / Math.sqrt(left) : 0;
      for (let at = from; at < to; at++) vector[at] *= scale;
    });
  }
  return basis;
}

/**
 * Take off, in place, the part of a series that lies in the span of a basis at each place.
 *
 * @param {Float64Array} series - (P, n)
 * @param {Float64Array[]} basis - q series (P, n), as of `driftBasis`
 * @param {number} places - P
 */
export function takeOffBasis(series, basis, places) {
  const count = series.length / places;
  for (let from = 0; from < series.length; from += count) {
    const to = from + count;
    const parts = basis.map((vector) => dot(series, vector, from, to));
    basis.forEach((vector, which) => takeOff(series, vector, parts[which], from, to));
  }
  return series;
}

/**
 * Tell which toggles are seen, and no farther from the rest than toggles are.
 *
 * @param {Float64Array} values - (P, n) toggles; NaN where a place is unseen
 * @param {number} places - P
 * @returns {Uint8Array} (P, n)
 */
export function withoutOutliers(values, places) {
  const count = values.length / places;
  const seen = new Uint8Array(values.length);
  for (let from = 0; from < values.length; from += count) {
    const known = values.slice(from, from + count).filter(Number.isFinite);
    if (known.length === 0) continue;
    const [low, high] = SPREAD_QUANTILES.map((share) => quantile(known, share));
    const reach = (OUTLIER * (high - low)) / 2 + 1e-9;
    for (let at = from; at < from + count; at++) {
      seen[at] = Number(Math.abs(values[at] - (low + high) / 2) <= reach);
    }
  }
  return seen;
}

/**
 * @param {Float64Array} series
 * @param {number} [from] - first index
 * @param {number} [to] - index after the last
 */
export function squares(series, from, to) {
  return dot(series, series, from, to);
}

/**
 * @param {Float64Array} series - changed in place
 * @param {Float64Array} other
 * @param {number} factor - multiple of `other` that is taken off
 * @param {number} [from] - first index
 * @param {number} [to] - index after the last
 */
export function takeOff(series, other, factor, from = 0, to = series.length) {
  for (let at = from; at < to; at++) series[at] -= factor * other[at];
  return series;
}
