/**
 * Interpolate between known values, as `np.interp` does.
 *
 * @param {number} at
 * @param {number[]} places - at which values are known, rising
 * @param {number[]} values
 * @returns {number}
 */
export function interpolated(at, places, values) {
  const last = places.length - 1;
  if (at >= places[last]) return values[last];
  const after = Math.max(1, places.findIndex((known) => known >= at));
  const slope = (values[after] - values[after - 1]) / (places[after] - places[after - 1]);
  return values[after - 1] + slope * (at - places[after - 1]);
}
