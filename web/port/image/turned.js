/** Images that are turned by right angles. */

/**
 * Turn an image the way in which it is to be seen, as films that were taken upright say it.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {import("./opencv.js").Plane<Samples>} image - one sample a pixel, or several
 * @param {number} degrees - clockwise: 0, 90, 180 or 270
 * @returns {import("./opencv.js").Plane<Samples>} the same image where nothing is to be done
 */
export function turned(image, degrees) {
  if (degrees === 0) return image;
  const { width, height, data } = image;
  const size = data.length / (width * height);
  const levels = /** @type {Samples} */ (data.slice());
  for (let y = 0, to = 0; y < width; y++) {
    for (let x = 0; x < height; x++) {
      const from = size * ((height - 1 - x) * width + y);
      for (let sample = 0; sample < size; sample++) levels[to++] = data[from + sample];
    }
  }
  return turned({ width: height, height: width, data: levels }, degrees - 90);
}
