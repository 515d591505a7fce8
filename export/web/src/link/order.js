/** Numbers of a certain rank among others. */

/**
 * Find the median.
 *
 * @param {ArrayLike<number>} values - at least one, none of them NaN
 * @returns {number} the mean of the middle two where their number is even
 */
export function median(values) {
  return quantile(values, 0.5);
}

/**
 * Find the number below which a share of the values lies, between two of them if need be.
 *
 * @param {ArrayLike<number>} values - at least one, none of them NaN
 * @param {number} share - from 0 to 1
 * @returns {number}
 */
export function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  const at = share * (sorted.length - 1);
  const low = sorted[Math.floor(at)];
  return at % 1 ? low + (sorted[Math.ceil(at)] - low) * (at % 1) : low;
}

/**
 * Take the levels of an image's pixels at some distance, of which quantiles are asked for.
 *
 * @param {BytePlane} gray
 * @param {number} step - distance of the pixels that count, on both axes
 * @returns {(share: number) => number} quantile of a share in [0, 1]
 */
export function quantilesOfEvery({ width, height, data }, step) {
  /** @type {number[]} */
  const levels = [];
  for (let y = 0; y < height; y += step) {
    for (let x = 0; x < width; x += step) levels.push(data[y * width + x]);
  }
  return (share) => quantile(levels, share);
}
