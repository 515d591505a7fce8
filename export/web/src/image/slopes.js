/** How steeply an image rises at each pixel. */

/**
 * Differences of an image along its rows and its columns, eight times as large (Sobel).
 *
 * @param {import("./opencv.js").Plane<Float32Array>} image
 * @returns {{ across: Float32Array, down: Float32Array }}
 */
export function slopesOf({ width, height, data }) {
  const across = new Float32Array(width * height);
  const down = new Float32Array(width * height);
  for (let row = 0, at = 0; row < height; row++) {
    const above = reflected(row - 1, height) * width;
    const here = row * width;
    const below = reflected(row + 1, height) * width;
    for (let col = 0; col < width; col++, at++) {
      const left = reflected(col - 1, width);
      const next = reflected(col + 1, width);
      const ahead = data[above + next] + 2 * data[here + next] + data[below + next];
      const behind = data[above + left] + 2 * data[here + left] + data[below + left];
      const under = data[below + left] + 2 * data[below + col] + data[below + next];
      const over = data[above + left] + 2 * data[above + col] + data[above + next];
      across[at] = ahead - behind;
      down[at] = under - over;
    }
  }
  return { across, down };
}

/**
 * Find the pixel that stands for one beyond the border: the image is mirrored.
 *
 * @param {number} at
 * @param {number} length
 * @returns {number}
 */
function reflected(at, length) {
  if (at >= 0 && at < length) return at;
  return length === 1 ? 0 : at < 0 ? -at : 2 * length - 2 - at;
}
