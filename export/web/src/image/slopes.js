/** How steeply an image rises at each pixel. */

import { cv, floatPlane, matOf, withMats } from "./opencv.js";

/**
 * Differences of an image along its rows and its columns, eight times as large (Sobel).
 *
 * @param {FloatPlane} image
 * @returns {{ across: Float32Array, down: Float32Array }}
 */
export function slopesOf(image) {
  return withMats((keep) => {
    const mat = keep(matOf(image));
    const [across, down] = [0, 1].map((axis) => {
      const slope = keep(new cv.Mat());
      cv.Sobel(mat, slope, cv.CV_32F, 1 - axis, axis);
      return floatPlane(slope).data;
    });
    return { across, down };
  });
}
