/** Images seen through a homography or a lens, sampled between pixels. */

/**
 * Sample a plane where a homography leads, bilinearly; beyond the border its last pixel counts.
 *
 * The result is that of `cv2.warpPerspective` with INTER_LINEAR, WARP_INVERSE_MAP and
 * BORDER_REPLICATE.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {import("./opencv.js").Plane<Samples>} plane
 * @param {ArrayLike<number>} H - (3, 3) from pixels of the result to pixels of the plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @param {Samples | null} [room] - takes the result where it has the right length
 * @returns {import("./opencv.js").Plane<Samples>} rounded where samples are bytes
 */
export function warped(plane, H, width, height, room = null) {
  const { data: source, width: stride } = plane;
  const data = roomFor(source, width * height, room);
  const rounding = source instanceof Uint8Array ? 0.5 : 0;
  const right = stride - 1;
  const bottom = plane.height - 1;
  const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = Array.from(H);
  for (let row = 0, to = 0; row < height; row++) {
    let x = h1 * row + h2;
    let y = h4 * row + h5;
    let w = h7 * row + h8;
    for (let col = 0; col < width; col++, to++, x += h0, y += h3, w += h6) {
      const scale = 1 / w;
      data[to] = between(source, right, bottom, x * scale, y * scale) + rounding;
    }
  }
  return { width, height, data };
}

/**
 * Sample a plane at any places, as `warped` does; the result is that of `cv2.remap`.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {import("./opencv.js").Plane<Samples>} plane
 * @param {Float32Array[]} places - x and y in the plane, for each pixel of the result, row by row
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @param {Samples | null} [room] - takes the result where it has the right length
 * @returns {import("./opencv.js").Plane<Samples>} rounded where samples are bytes
 */
export function remapped(plane, [xs, ys], width, height, room = null) {
  const source = plane.data;
  const data = roomFor(source, width * height, room);
  const rounding = source instanceof Uint8Array ? 0.5 : 0;
  const right = plane.width - 1;
  const bottom = plane.height - 1;
  for (let at = 0; at < data.length; at++) {
    data[at] = between(source, right, bottom, xs[at], ys[at]) + rounding;
  }
  return { width, height, data };
}

/**
 * Interpolate between the four samples around a place.
 *
 * @param {Uint8Array | Float32Array} source - samples of a plane, row by row
 * @param {number} right - number of the plane's last column
 * @param {number} bottom - number of the plane's last row
 * @param {number} x - of the place, pixels
 * @param {number} y - of the place, pixels
 * @returns {number}
 */
function between(source, right, bottom, x, y) {
  let atX = x;
  let atY = y;
  // a comparison that NaN fails, too
  if (!(atX >= 0)) atX = 0;
  else if (atX > right) atX = right;
  if (!(atY >= 0)) atY = 0;
  else if (atY > bottom) atY = bottom;
  const left = atX | 0;
  const top = atY | 0;
  const partX = atX - left;
  const partY = atY - top;
  const at = top * (right + 1) + left;
  const next = left < right ? at + 1 : at;
  const down = top < bottom ? right + 1 : 0;
  const one = source[at];
  const above = one + (source[next] - one) * partX;
  const two = source[at + down];
  const below = two + (source[next + down] - two) * partX;
  return above + (below - above) * partY;
}

/**
 * Take room that has the right length, or make some of the type of a plane's samples.
 *
 * @param {Uint8Array | Float32Array} source
 * @param {number} count
 * @param {Uint8Array | Float32Array | null} room
 * @returns {any}
 */
function roomFor(source, count, room) {
  if (room?.length === count) return room;
  return source instanceof Uint8Array ? new Uint8Array(count) : new Float32Array(count);
}
