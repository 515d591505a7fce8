/** How steeply an image rises at each pixel. */

import { call } from "./opencv.js";

/**
 * Differences of an image along its rows and its columns, eight times as large (Sobel).
 *
 * @param {FloatPlane} image
 * @returns {{ across: Float32Array, down: Float32Array }}
 */
export function slopesOf(image) {
  const [across, down] = [0, 1].map(() => ({ ...image, data: new Float32Array(image.data.length) }));
  call("slopes", [image], [across, down]);
  return { across: across.data, down: down.data };
}
