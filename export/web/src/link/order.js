/** Numbers of a certain rank among others, found without sorting them all. */

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
  const among = new Float64Array(values);
  const at = share * (among.length - 1);
  const rank = Math.floor(at);
  const low = ranked(among, rank);
  if (at === rank) return low;
  // what lies behind the rank is no smaller now
  let high = Infinity;
  for (let i = rank + 1; i < among.length; i++) if (among[i] < high) high = among[i];
  return low + (high - low) * (at - rank);
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

/**
 * Find the value of a rank, and move smaller values before it and larger ones behind (Hoare 1961).
 *
 * @param {Float64Array} values - are moved
 * @param {number} rank - from 0
 * @returns {number}
 */
function ranked(values, rank) {
  let left = 0;
  let right = values.length - 1;
  while (left < right) {
    const pivot = values[(left + right) >> 1];
    let i = left;
    let j = right;
    while (i <= j) {
      while (values[i] < pivot) i++;
      while (values[j] > pivot) j--;
      if (i <= j) {
        const kept = values[i];
        values[i++] = values[j];
        values[j--] = kept;
      }
    }
    if (rank <= j) right = j;
    else if (rank >= i) left = i;
    else break;
  }
  return values[rank];
}
