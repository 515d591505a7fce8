/** Quantiles of an image's levels, as numpy interpolates them. */

/**
 * Find quantiles of an image's levels from a part of its pixels.
 *
 * @param {BytePlane} gray
 * @param {number} step - distance of the pixels that count, on both axes
 * @returns {(share: number) => number} quantile of a share in [0, 1]
 */
export function quantilesOfEvery(gray, step) {
  const counts = new Int32Array(256);
  let total = 0;
  for (let y = 0; y < gray.height; y += step) {
    for (let x = 0; x < gray.width; x += step, total++) counts[gray.data[y * gray.width + x]]++;
  }
  const ranked = (/** @type {number} */ rank) => {
    let level = 0;
    for (let below = counts[0]; below <= rank; below += counts[level]) level++;
    return level;
  };
  return (share) => {
    const place = share * (total - 1);
    const low = Math.floor(place);
    const [one, other] = [ranked(low), ranked(Math.min(low + 1, total - 1))];
    return one + (other - one) * (place - low);
  };
}
