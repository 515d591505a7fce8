/** Points of an image whose surroundings differ from all that lie near (Shi & Tomasi 1994). */

import { cv, matOf, withMats } from "./opencv.js";

/**
 * Choose the points that stand out most, as `cv2.goodFeaturesToTrack` does.
 *
 * @param {BytePlane} image
 * @param {number} count - largest number of points; 0 for any number
 * @param {number} quality - smallest strength, as a share of the greatest one in the mask
 * @param {number} apart - smallest distance between two points, pixels
 * @param {Uint8Array | null} [mask] - nonzero for each pixel that may be chosen; all where absent
 * @returns {Point[]} the strongest first
 */
export function chooseFeatures(image, count, quality, apart, mask = null) {
  const { width, height } = image;
  return withMats((keep) => {
    const points = keep(new cv.Mat());
    const free = keep(mask ? matOf({ width, height, data: mask }) : new cv.Mat());
    cv.goodFeaturesToTrack(keep(matOf(image)), points, count, quality, apart, free);
    const places = points.data32F;
    return Array.from({ length: points.rows }, (_, i) => [places[2 * i], places[2 * i + 1]]);
  });
}
