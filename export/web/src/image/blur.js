/** Gaussian blur of real gray levels. */

import { cv, floatPlane, matOf, withMats } from "./opencv.js";

/**
 * Blur a plane as `cv2.GaussianBlur` blurs floats, or bytes before it rounds them.
 *
 * @param {BytePlane | FloatPlane} plane
 * @param {number} sigma - standard deviation, in pixels
 * @param {"reflect" | "replicate"} [border] - what lies beyond the border: the image mirrored
 *   about its outermost pixels, or these pixels repeated
 * @returns {FloatPlane}
 */
export function blurred(plane, sigma, border = "reflect") {
  // OpenCV reaches less far where pixels are bytes
  const reach = plane.data instanceof Uint8Array ? 3 : 4;
  const length = Math.round(sigma * reach * 2 + 1) | 1;
  const beyond = border === "replicate" ? cv.BORDER_REPLICATE : cv.BORDER_REFLECT_101;
  const { width, height, data } = plane;
  return withMats((keep) => {
    const floats = keep(matOf({ width, height, data: Float32Array.from(data) }));
    const result = keep(new cv.Mat());
    cv.GaussianBlur(floats, result, new cv.Size(length, length), sigma, sigma, beyond);
    return floatPlane(result);
  });
}
