/** Put display states together from rectified camera frames. */

import { receiverReadingStates, receiverSeen } from "../../../generated/constants.js";
import { bytePlane, call, floatPlane } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { homographyFromCorners, inImage, transform } from "../../link/geometry.js";

export const { PURE } = receiverReadingStates;
export const { MESH } = receiverSeen;

/** Points (MESH MESH, 2) of the display, x and y in [0, 1], at which exposure is worked out. */
export const PLACES = Float64Array.from({ length: 2 * MESH * MESH }, (_, at) => {
  const point = at >> 1;
  return ((at % 2 === 0 ? point % MESH : Math.floor(point / MESH)) + 0.5) / MESH;
});
const MESH_POINTS = Array.from(
  { length: MESH * MESH },
  (_, at) => /** @type {Point} */ ([at % MESH, Math.floor(at / MESH)]),
);

/**
 * A rectified camera frame with its time in seconds of the camera's clock. `inView` (MESH, MESH)
 * tells which points of the display lie within the camera frame; null where the whole display does.
 *
 * @typedef {{ time: number, rectified: BytePlane, inView: Uint8Array | null }} RectifiedFrame
 */

/**
 * What one state of the display looked like, an original or an embedded frame.
 *
 * `purity` (MESH, MESH) is the largest share of an exposure that fell into this state, in [0, 1],
 * and `frames` the number of camera frames that were averaged.
 *
 * @typedef {{ image: BytePlane, purity: Float64Array, frames: number }} DisplayState
 */

/**
 * Tell which points of the display lie within a camera frame.
 *
 * @param {Point[]} corners - pixels of the camera frame, in corner order
 * @param {number} width - of the camera frame, pixels
 * @param {number} height - of the camera frame, pixels
 * @returns {Uint8Array | null} (MESH, MESH), or null where the whole display lies within the frame
 */
export function pointsInView(corners, width, height) {
  if (inImage(corners, width, height).every(Boolean)) return null;
  const HCapturedFromDisplay = homographyFromCorners(corners, MESH, MESH);
  return inImage(transform(HCapturedFromDisplay, MESH_POINTS), width, height);
}

/**
 * Average what camera frames hold of one state.
 *
 * Each point of the display takes the frames whose exposure there is pure; where none is, it takes
 * the purest. A frame holds nothing of a point outside it.
 *
 * @param {RectifiedFrame[]} frames - in any order, of one size
 * @param {DisplayClock} clock - says when the display shows which state
 * @param {number} number - of the state
 * @returns {DisplayState | null} null where no frame holds any of the state
 */
export function composeState(frames, clock, number) {
  const purity = new Float64Array(MESH * MESH);
  /** @type {{ image: BytePlane, share: Float64Array }[]} */
  const used = [];
  const pure = [];
  for (const { time, rectified, inView } of frames) {
    // frames that were exposed wholly before or after the state
    if (clock.number(time + clock.latest) < number) continue;
    if (clock.number(time + clock.earliest) > number + 1) continue;
    const share = clock.shares(time, PLACES, number);
    let [most, least] = [0, 1];
    for (let at = 0; at < share.length; at++) {
      if (inView !== null && !inView[at]) share[at] = 0;
      if (share[at] > most) most = share[at];
      if (share[at] < least) least = share[at];
      if (share[at] > purity[at]) purity[at] = share[at];
    }
    if (most === 0) continue;
    used.push({ image: rectified, share });
    if (least >= PURE) pure.push(rectified);
  }
  if (used.length === 0) return null;
  if (pure.length > 0) return { image: mean(pure), purity, frames: pure.length };
  const limit = purity.map((share) => Math.min(share, PURE) - 1e-6);
  const chosen = used.map(({ image, share }) => ({
    image,
    weight: share.map((value, at) => Number(value >= limit[at])),
  }));
  return { image: weightedMean(chosen), purity, frames: used.length };
}

/**
 * Stand in for a state that no frame holds, beside one that some hold: nothing is pure.
 *
 * @param {DisplayState | null} other
 * @returns {DisplayState | null}
 */
export function unseenState(other) {
  return other && { image: other.image, purity: new Float64Array(MESH * MESH), frames: 0 };
}

/**
 * Average images of one size.
 *
 * @param {BytePlane[]} images - one or more
 * @returns {BytePlane} rounded, halves to the even level; the image itself where there is one
 */
function mean(images) {
  if (images.length === 1) return images[0];
  const share = Math.fround(1 / images.length);
  const level = Uint8Array.from({ length: 255 * images.length + 1 }, (_, sum) =>
    roundHalfEven(Math.fround(sum * share)),
  );
  const { width, height } = images[0];
  const sums = Uint32Array.from(images[0].data);
  for (const { data } of images.slice(1)) {
    for (let at = 0; at < sums.length; at++) sums[at] += data[at];
  }
  return { width, height, data: new Uint8Array(sums.map((sum) => level[sum])) };
}

/**
 * Average images of one size, each weighed by a mesh that is interpolated bilinearly.
 *
 * @param {{ image: BytePlane, weight: Float64Array }[]} parts - with weights (MESH, MESH)
 * @returns {BytePlane} rounded, halves up; 0 where all weights are 0
 */
function weightedMean(parts) {
  const { width, height } = parts[0].image;
  const images = bytePlane(width, parts.length * height);
  const meshes = floatPlane(MESH, parts.length * MESH);
  parts.forEach(({ image, weight }, i) => {
    images.data.set(image.data, i * width * height);
    meshes.data.set(weight, i * MESH * MESH);
  });
  const mean = bytePlane(width, height);
  call("weightedMean", [images, meshes], [mean]);
  return mean;
}

/**
 * Average the purity of a state over each message block.
 *
 * @param {Float64Array} purity - (MESH, MESH) in [0, 1]
 * @param {Layout} layout - of the display
 * @returns {Float64Array} (nBits,) in [0, 1]
 */
export function blockPurity(purity, layout) {
  const mesh = { width: MESH, height: MESH, data: Float32Array.from(purity) };
  const blocks = resizeArea(mesh, layout.cols, layout.rows).data;
  return Float64Array.from(layout.messageBlocks, (block) => blocks[block]);
}
