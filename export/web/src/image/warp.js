/** Images seen through a homography, sampled between pixels. */

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
  const bytes = source instanceof Uint8Array;
  const count = width * height;
  /** @type {any} */
  let data = room;
  if (room?.length !== count) data = bytes ? new Uint8Array(count) : new Float32Array(count);
  const right = stride - 1;
  const bottom = plane.height - 1;
  // what lies before the half pixel is rounded off
  const rounding = bytes ? 0.5 : 0;
  const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = Array.from(H);
  for (let row = 0, to = 0; row < height; row++) {
    let x = h1 * row + h2;
    let y = h4 * row + h5;
    let w = h7 * row + h8;
    for (let col = 0; col < width; col++, to++, x += h0, y += h3, w += h6) {
      const scale = 1 / w;
      let atX = x * scale;
      let atY = y * scale;
      // a comparison that NaN fails, too
      if (!(atX >= 0)) atX = 0;
      else if (atX > right) atX = right;
      if (!(atY >= 0)) atY = 0;
      else if (atY > bottom) atY = bottom;
      const left = atX | 0;
      const top = atY | 0;
      const partX = atX - left;
      const partY = atY - top;
      const at = top * stride + left;
      const next = left < right ? at + 1 : at;
      const down = top < bottom ? stride : 0;
      const one = source[at];
      const above = one + (source[next] - one) * partX;
      const two = source[at + down];
      const below = two + (source[next + down] - two) * partX;
      data[to] = above + (below - above) * partY + rounding;
    }
  }
  return { width, height, data };
}
