/** Where numbers lie: their mean and deviation, and those of a certain rank. */

/**
 * Find the mean and the standard deviation.
 *
 * @param {ArrayLike<number>} values - at least one
 * @returns {[number, number]}
 */
export function spreadOf(values) {
  const usual = mean(values);
  return [usual, Math.sqrt(mean(Float64Array.from(values, (value) => (value - usual) ** 2)))];
}

/**
 * Find the mean.
 *
 * @param {ArrayLike<number>} values - at least one
 */
export function mean(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i++) sum += values[i];
  return sum / values.length;
}

/**
 * Find the median.
 *
 * @param {ArrayLike<number>} values - at least one, none of them NaN
 * @returns {number} the mean of the middle two where their number is even
 */
export function median(values) {
  return quantiles(values, [0.5])[0];
}

/**
 * Find the numbers below which shares of the values lie, between two of them if need be.
 *
 * @param {ArrayLike<number>} values - none of them NaN
 * @param {readonly number[]} shares - from 0 to 1
 * @returns {number[]} one for each; NaN where there are no values
 */
export function quantiles(values, shares) {
  const sorted = Float64Array.from(values).sort();
  const last = sorted.length - 1;
  return shares.map((share) => {
    const rank = Math.floor(share * last);
    const [low, high] = [sorted[rank], sorted[Math.min(rank + 1, last)]];
    return low + (high - low) * (share * last - rank);
  });
}

/**
 * Take every so many pixels of an image along each axis.
 *
 * @param {BytePlane} image
 * @param {number} step - from one pixel to the next
 */
export function everyPixel({ width, data }, step) {
  return data.filter((_, at) => (at % width) % step === 0 && Math.floor(at / width) % step === 0);
}
