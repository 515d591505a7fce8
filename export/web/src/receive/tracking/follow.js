/** Follow a display from frame to frame by optical flow, once its corners are known. */

import { receiveTrackingFollow } from "../../generated/constants.js";
import { chooseFeatures } from "../../image/features.js";
import { Flow } from "../../image/flow.js";
import { findHomography } from "../../image/homography.js";
import { stretched } from "../../image/levels.js";
import {
  Lens,
  checkCorners,
  frameCorners,
  homographyFromCorners,
  inImage,
  rectify,
  transform,
} from "../../link/geometry.js";
import { multiply3 } from "../../link/linear.js";
import { OUTSIDE } from "../../locate/refine.js";
import { Stabiliser } from "../../pilots/stabilise.js";

const {
  FEATURES, COMPARED_PX, HALVINGS, EVEN_MEAN, EVEN_DEVIATION, MIN_INLIERS, INLIER_PX, EDGE_PX,
  WORN_SHARE,
} = receiveTrackingFollow;

/** @type {Point[]} */
const STILL = [
  [0, 0],
  [0, 0],
  [0, 0],
  [0, 0],
];

/**
 * Follows the display by optical flow to a rectified reference, so that errors do not add up.
 *
 * The reference is the frame in which the display was found, and is taken anew where the picture
 * has changed (a video): points on ratex patches then hold the geometry. A display without them
 * whose picture moves is followed by what lies around it, which moves with the camera.
 */
export class Follower {
  #motion = STILL;
  /** Corners in the reference. */
  #first = STILL;
  /** @type {Stabiliser | null} */
  #room;
  /** @type {Flow | null} */
  #flow = null;
  #k;

  /**
   * @param {Layout} layout - of the display
   * @param {number} [k] - coefficient of the lens
   * @param {boolean} [pictureMoves] - whether it is followed by what lies around it
   */
  constructor(layout, k = 0, pictureMoves = false) {
    this.layout = layout;
    this.#room = pictureMoves ? new Stabiliser() : null;
    this.#k = k;
    /**
     * Corners in the last frame, in corner order, or null where nothing is followed.
     *
     * @type {Point[] | null}
     */
    this.corners = null;
  }

  /**
   * Give the lens through which an image was taken.
   *
   * @param {BytePlane} image
   * @returns {Lens}
   */
  lens(image) {
    return new Lens(this.#k, image.width, image.height);
  }

  /**
   * Rectify the display in an image, or return null where the corners are not sound.
   *
   * @param {BytePlane} image
   * @param {Point[]} corners - pixels of the image, in corner order
   * @returns {BytePlane | null}
   */
  rectified(image, corners) {
    if (!checkCorners(corners, image.width, image.height, OUTSIDE)) return null;
    const { width, height } = this.layout;
    const lens = this.lens(image);
    const H = lens.homography(corners, width, height);
    return rectify(image, H, width, height, null, lens);
  }

  /**
   * Take a frame, and the display rectified by its corners, as the reference.
   *
   * @param {BytePlane} image
   * @param {Point[]} corners - pixels of the image, in corner order
   * @param {BytePlane} rectified
   */
  begin(image, corners, rectified) {
    if (this.corners === null) this.#motion = STILL;
    this.corners = this.#first = corners;
    if (this.#room) {
      this.#room.begin(image, true, corners);
      return;
    }
    const H = homographyFromCorners(corners, this.layout.width, this.layout.height);
    const copy = { ...rectified, data: rectified.data.slice() };
    const reference = stretched(copy, EVEN_MEAN, EVEN_DEVIATION);
    this.#flow = this.#flowFrom(reference, this.#viewMask(H, image.width, image.height));
  }

  /**
   * Take the corners in the next frame, which `step` found.
   *
   * @param {Point[]} corners
   */
  advance(corners) {
    const before = this.corners;
    if (before) {
      this.#motion = corners.map(([x, y], i) => {
        return [0.5 * (x - before[i][0]), 0.5 * (y - before[i][1])];
      });
    }
    this.corners = corners;
  }

  /** Follow nothing any more. */
  forget() {
    this.corners = null;
  }

  /**
   * Find the display in the next frame.
   *
   * @param {BytePlane} image
   * @returns {{ corners: Point[], fresh: boolean } | null} pixels of the image, and whether the
   *   picture has changed so much that the reference should be taken anew; null where the display
   *   is lost
   */
  step(image) {
    const room = this.#room;
    if (room && this.corners !== null) {
      const H = room.follow(image);
      return H && { corners: transform(H, this.#first), fresh: room.share < WORN_SHARE };
    }
    const flow = this.#flow;
    if (this.corners === null || flow === null || flow.points.length < MIN_INLIERS) return null;
    const { width, height } = this.layout;
    const motion = this.#motion;
    /** @type {Point[]} */
    const guess = this.corners.map(([x, y], i) => [x + motion[i][0], y + motion[i][1]]);
    const lens = this.lens(image);
    const HStraightFromGuess = lens.homography(guess, width, height);
    const rectified = rectify(image, HStraightFromGuess, width, height, null, lens);
    const { moved, found } = flow.follow(stretched(rectified, EVEN_MEAN, EVEN_DEVIATION));
    if (!inImage(guess, image.width, image.height).every(Boolean)) {
      const there = lens.distort(transform(HStraightFromGuess, moved));
      inImage(there, image.width, image.height).forEach((inside, i) => (found[i] &= inside));
    }
    const from = flow.points.filter((_, i) => found[i]);
    const to = moved.filter((_, i) => found[i]);
    if (from.length < MIN_INLIERS) return null;
    const fit = findHomography(from, to, INLIER_PX);
    if (fit === null || fit.count < MIN_INLIERS) return null;
    const H = multiply3(HStraightFromGuess, fit.H);
    const corners = lens.distort(transform(H, frameCorners(width, height)));
    return { corners, fresh: fit.count / from.length < 0.5 };
  }

  /**
   * Mark, by 1, the pixels of the layout that lie in the image, and not near its border.
   *
   * @param {Float64Array} HCapturedFromDisplay
   * @param {number} imageWidth
   * @param {number} imageHeight
   * @returns {Uint8Array | null} null where all do
   */
  #viewMask(HCapturedFromDisplay, imageWidth, imageHeight) {
    const { width, height } = this.layout;
    const corners = transform(HCapturedFromDisplay, frameCorners(width, height));
    if (inImage(corners, imageWidth, imageHeight).every(Boolean)) return null;
    const seen = new Uint8Array(width * height);
    const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = HCapturedFromDisplay;
    for (let y = 0, at = 0; y < height; y++) {
      for (let x = 0; x < width; x++, at++) {
        const w = h6 * x + h7 * y + h8;
        const column = (h0 * x + h1 * y + h2) / w;
        const row = (h3 * x + h4 * y + h5) / w;
        const across = column >= -0.5 && column < imageWidth - 0.5;
        seen[at] = Number(across && row >= -0.5 && row < imageHeight - 0.5);
      }
    }
    return eroded(seen, width, height, EDGE_PX);
  }

  /**
   * Choose the points that are followed.
   *
   * @param {BytePlane} reference
   * @param {Uint8Array | null} seen - nonzero where points may lie; null where they may everywhere
   * @returns {Flow}
   */
  #flowFrom(reference, seen) {
    const { width, height } = reference;
    const { layout } = this;
    const patches = new Uint8Array(width * height);
    for (const [row, col] of layout.ratex) {
      const [top, bottom, left, right] = layout.cellBox(row, col);
      for (let y = top; y < bottom; y++) patches.fill(1, y * width + left, y * width + right);
    }
    const rest = patches.map((value) => 1 - value);
    for (const mask of [patches, rest]) {
      if (seen) for (let at = 0; at < mask.length; at++) mask[at] &= seen[at];
    }
    const points = layout.ratex.length
      ? [
          ...chooseFeatures(reference, FEATURES / 2, 0.05, 4, patches),
          ...chooseFeatures(reference, FEATURES / 2, 0.02, 8, rest),
        ]
      : chooseFeatures(reference, FEATURES, 0.02, 8, rest);
    const inside = points.filter(
      ([x, y]) => x > 3 && x < width - 3 && y > 3 && y < height - 3,
    );
    return new Flow(reference, inside, COMPARED_PX, HALVINGS);
  }
}

/**
 * Keep the pixels of a mask around which all others are marked; beyond the border all count so.
 *
 * @param {Uint8Array} mask
 * @param {number} width
 * @param {number} height
 * @param {number} reach - pixels along each axis
 * @returns {Uint8Array}
 */
function eroded(mask, width, height, reach) {
  const lines = erodedAlong(mask, height, width, width, 1, reach);
  return erodedAlong(lines, width, height, 1, width, reach);
}

/**
 * @param {Uint8Array} mask
 * @param {number} lines - number of lines that are eroded, each by itself
 * @param {number} length - number of pixels of a line
 * @param {number} nextLine - step from a line to the next one
 * @param {number} next - step from a pixel of a line to the next one
 * @param {number} reach
 */
function erodedAlong(mask, lines, length, nextLine, next, reach) {
  const kept = mask.slice();
  for (let line = 0; line < lines; line++) {
    const start = line * nextLine;
    for (let at = 0, clear = Infinity; at < length; at++) {
      clear = mask[start + at * next] ? clear + 1 : 0;
      if (clear <= reach) kept[start + at * next] = 0;
    }
    for (let at = length - 1, clear = Infinity; at >= 0; at--) {
      clear = mask[start + at * next] ? clear + 1 : 0;
      if (clear <= reach) kept[start + at * next] = 0;
    }
  }
  return kept;
}
