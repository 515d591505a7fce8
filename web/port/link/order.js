/** Where numbers lie: their mean and deviation, and those of a certain rank. */

/**
 * Find the mean and the standard deviation.
 *
 * @param {ArrayLike<number>} values - at least one
 * @returns {[number, number]}
 */
export function spreadOf(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i++) sum += values[i];
  const mean = sum / values.length;
  let squares = 0;
  for (let i = 0; i < values.length; i++) squares += (values[i] - mean) ** 2;
  return [mean, Math.sqrt(squares / values.length)];
}

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
 */
export function quantile(values, share) {
  const parted = Float64Array.from(values);
  const at = share * (parted.length - 1);
  const rank = Math.floor(at);
  part(parted, rank);
  const low = parted[rank];
  if (at === rank) return low;
  let high = Infinity;
  for (let i = rank + 1; i < parted.length; i++) high = Math.min(high, parted[i]);
  return low + (high - low) * (at - rank);
}

/**
 * Move values, in place, until none before a rank is larger than the one there, and none after it
 * smaller (Hoare's quickselect).
 *
 * @param {Float64Array} values
 * @param {number} rank - an index
 */
function part(values, rank) {
  let [first, last] = [0, values.length - 1];
  while (first < last) {
    const pivot = values[(first + last) >> 1];
    let [up, down] = [first, last];
    while (up <= down) {
      while (values[up] < pivot) up++;
      while (values[down] > pivot) down--;
      if (up > down) break;
      [values[up], values[down]] = [values[down], values[up]];
      up++;
      down--;
    }
    if (rank <= down) last = down;
    else if (rank >= up) first = up;
    else return;
  }
}

/**
 * Take the levels of an image's pixels at some distance, of which quantiles are asked for.
 *
 * @param {BytePlane} gray
 * @param {number} step - distance of the pixels that count, on both axes
 * @returns {(share: number) => number} quantile of a share in [0, 1]
 */
export function quantilesOfEvery({ width, height, data }, step) {
  const counts = new Uint32Array(256);
  for (let y = 0; y < height; y += step) {
    for (let x = 0; x < width; x += step) counts[data[y * width + x]]++;
  }
  const count = Math.ceil(height / step) * Math.ceil(width / step);
  const ranked = (/** @type {number} */ rank) => {
    let level = 0;
    for (let seen = counts[0]; seen <= rank; seen += counts[level]) level++;
    return level;
  };
  return (share) => {
    const at = share * (count - 1);
    const rank = Math.floor(at);
    const low = ranked(rank);
    return at === rank ? low : low + (ranked(rank + 1) - low) * (at - rank);
  };
}
