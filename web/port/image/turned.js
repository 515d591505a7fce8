/** Images that are turned by right angles. */

/**
 * Turn a frame the way in which it is to be seen, as films that were taken upright say it.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {import("./opencv.js").Plane<Samples>} plane
 * @param {number} degrees - clockwise: 0, 90, 180 or 270
 * @returns {import("./opencv.js").Plane<Samples>} the same plane where nothing is to be done
 */
export function turned(plane, degrees) {
  if (degrees === 0) return plane;
  const { width, height, data } = plane;
  const last = data.length - 1;
  const levels = /** @type {Samples} */ (data.slice());
  if (degrees === 180) {
    for (let i = 0; i <= last; i++) levels[i] = data[last - i];
    return { width, height, data: levels };
  }
  for (let row = 0, i = 0; row < height; row++) {
    for (let col = 0; col < width; col++, i++) {
      const to = col * height + height - 1 - row; // of a quarter turn clockwise
      levels[degrees === 90 ? to : last - to] = data[i];
    }
  }
  return { width: height, height: width, data: levels };
}
