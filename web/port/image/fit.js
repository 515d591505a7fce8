/** Pictures that are cut and resized for a display, as `fit_picture` of link/images does it. */

import { bytePlane } from "./opencv.js";
import { roundHalfEven } from "./round.js";
import { resizeArea } from "./shrink.js";

/** @import { Picture } from "../link/strength.js" */

/** OpenCV's unit of the weights by which it interpolates bytes. */
const UNIT = 2 ** 11;

/**
 * Cut the largest centred window of the wanted aspect and resize it.
 *
 * @param {Picture} picture
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 * @returns {Picture} averaged down, or interpolated up
 */
export function fitPicture(picture, width, height) {
  const scale = Math.min(picture.width / width, picture.height / height);
  const [cols, rows] = [width, height].map((side) => Math.max(1, roundHalfEven(scale * side)));
  const [left, top] = [(picture.width - cols) >> 1, (picture.height - rows) >> 1];
  const resize = scale < 1 ? resizeLinear : resizeArea;
  const data = new Uint8Array(3 * width * height);
  for (let channel = 0; channel < 3; channel++) {
    const plane = bytePlane(cols, rows);
    for (let y = 0, to = 0; y < rows; y++) {
      let from = 3 * ((top + y) * picture.width + left) + channel;
      for (let x = 0; x < cols; x++, from += 3) plane.data[to++] = picture.data[from];
    }
    resize(plane, width, height).data.forEach((level, at) => (data[3 * at + channel] = level));
  }
  return { width, height, data };
}

/**
 * Resize a plane by bilinear interpolation, as `cv2.resize` with INTER_LINEAR does it with bytes.
 *
 * @param {BytePlane} plane
 * @param {number} width - of the result, pixels
 * @param {number} height - of the result, pixels
 */
function resizeLinear(plane, width, height) {
  const [across, down] = [neighbours(plane.width, width), neighbours(plane.height, height)];
  const result = bytePlane(width, height);
  for (let y = 0, to = 0; y < height; y++) {
    const [upper, lower] = down.places[y].map((place) => place * plane.width);
    const [above, below] = down.weights[y];
    for (let x = 0; x < width; x++) {
      const [[left, right], [before, after]] = [across.places[x], across.weights[x]];
      const first = before * plane.data[upper + left] + after * plane.data[upper + right];
      const second = before * plane.data[lower + left] + after * plane.data[lower + right];
      result.data[to++] = (((above * (first >> 4)) >> 16) + ((below * (second >> 4)) >> 16) + 2) >> 2;
    }
  }
  return result;
}

/**
 * Find between which two pixels of an axis each one of the result lies, and what each of them weighs.
 *
 * @param {number} given - pixels of the axis
 * @param {number} wanted - pixels of the result
 */
function neighbours(given, wanted) {
  const ratio = 1 / (wanted / given); // rounded as OpenCV rounds it
  const at = Array.from({ length: wanted }, (_, i) => Math.fround((i + 0.5) * ratio - 0.5));
  const weights = at.map((place) => {
    const share = Math.fround(place - Math.floor(place));
    return [Math.fround(1 - share), share].map((weight) => roundHalfEven(UNIT * weight));
  });
  const within = (/** @type {number} */ place) => Math.min(Math.max(place, 0), given - 1);
  return { places: at.map(Math.floor).map((place) => [within(place), within(place + 1)]), weights };
}
