/** How far each pixel stands out of its surroundings. */

import { cv, floatPlane, matOf, withMats } from "../../image/opencv.js";

/**
 * Take off the mean around each pixel; beyond the border the image is mirrored.
 *
 * @param {FloatPlane} plane
 * @param {number} across - width of what counts as around, pixels, odd
 * @param {number} down - its height, pixels, odd
 * @returns {FloatPlane}
 */
export function lessMeanAround(plane, across, down) {
  const around = withMats((keep) => {
    const mean = keep(new cv.Mat());
    cv.blur(keep(matOf(plane)), mean, new cv.Size(across, down));
    return floatPlane(mean);
  });
  const { data } = around;
  for (let i = 0; i < data.length; i++) data[i] = plane.data[i] - data[i];
  return around;
}
