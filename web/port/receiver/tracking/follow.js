/** Follow a display from frame to frame by optical flow, once its corners are known. */

import { receiverLocateRefine, receiverTrackingFollow } from "../../../generated/constants.js";
import { stretched } from "../../image/levels.js";
import { bytePlane, call } from "../../image/opencv.js";
import { chooseFeatures, chosen, fitMotion, follow, pointsOf } from "../../image/points.js";
import {
  Lens,
  STRAIGHT,
  checkCorners,
  contourArea,
  farthest,
  frameCorners,
  homographyFromCorners,
  inImage,
  rectify,
  transform,
} from "../../link/geometry.js";
import { multiply3 } from "../../link/linear.js";
import { UNIT_CORNERS } from "../pilots/motion.js";
import { Border, Outline } from "../pilots/outline.js";

const {
  FEATURES, COMPARED_PX, HALVINGS, EVEN_MEAN, EVEN_DEVIATION, MIN_INLIERS, INLIER_PX, EDGE_PX,
  CHECKED, APART_BLOCKS,
} = receiverTrackingFollow;
const { OUTSIDE } = receiverLocateRefine;

/** @type {Point[]} */
const STILL = UNIT_CORNERS.map(() => [0, 0]);

/**
 * Follows the display by optical flow to a rectified reference, so that errors do not add up.
 *
 * The reference is the frame in which the display was found, and is taken anew where the picture
 * has changed. A display is followed by what surrounds it (`pilots/outline.js`) once its picture
 * moves.
 */
export class Follower {
  #motion = STILL;
  /** Follows the surroundings of the display, where its picture moves. @type {Outline | null} */
  #outline = null;
  /** Tells where the display's border is. @type {Border | null} */
  #border = null;
  /** Number of frames in which the display was followed by what it shows. */
  #steps = 0;
  #pictureMoves;
  /** View of the display whose points are followed. @type {BytePlane | null} */
  #reference = null;
  /** Points of the reference: x, y, x, ... */
  #points = new Float32Array(0);
  #k;

  /**
   * @param {Layout} layout - of the display
   * @param {number} [k] - coefficient of the lens
   * @param {boolean} [pictureMoves] - whether the picture is known to move; if not, the follower
   *   notices
   */
  constructor(layout, k = 0, pictureMoves = false) {
    this.layout = layout;
    this.#pictureMoves = pictureMoves;
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
    return rectify(image, H, width, height, lens);
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
    this.corners = corners;
    this.#outline ??= new Outline(image, corners);
    this.#border ??= new Border(image, corners);
    const H = homographyFromCorners(corners, this.layout.width, this.layout.height);
    const reference = stretched(rectified, EVEN_MEAN, EVEN_DEVIATION);
    this.#reference = reference;
    this.#points = this.#pointsOf(reference, this.#viewMask(H, image.width, image.height));
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
    if (this.corners === null) return null;
    const outline = this.#outline?.isClear ? this.#outline : null;
    if (outline && this.#pictureMoves) {
      const around = outline.follow(image);
      return around ? { corners: around, fresh: false } : this.#byPicture(image);
    }
    const step = this.#byPicture(image);
    this.#steps++;
    if (outline === null || (step !== null && this.#steps % CHECKED !== 0)) return step;
    const around = outline.follow(image, step?.corners);
    if (around === null) return step;
    if (step !== null) {
      const { rows, cols } = this.layout;
      const apart = APART_BLOCKS * Math.sqrt(contourArea(this.corners) / (rows * cols));
      const near = farthest(around, step.corners) <= apart;
      if (near || !this.#border?.isRather(image, around, step.corners)) return step;
    }
    this.#pictureMoves = true;
    return { corners: around, fresh: false };
  }

  /**
   * Find the display in the next frame by what it shows.
   *
   * @param {BytePlane} image
   * @returns {{ corners: Point[], fresh: boolean } | null} as `step` does
   */
  #byPicture(image) {
    const reference = this.#reference;
    if (this.corners === null || reference === null) return null;
    if (this.#points.length < 2 * MIN_INLIERS) return null;
    const { width, height } = this.layout;
    const motion = this.#motion;
    /** @type {Point[]} */
    const guess = this.corners.map(([x, y], i) => [x + motion[i][0], y + motion[i][1]]);
    const lens = this.lens(image);
    const HStraightFromGuess = lens.homography(guess, width, height);
    const rectified = rectify(image, HStraightFromGuess, width, height, lens);
    const view = stretched(rectified, EVEN_MEAN, EVEN_DEVIATION);
    const { moved, found } = follow(reference, view, this.#points, COMPARED_PX, HALVINGS);
    if (!inImage(guess, image.width, image.height).every(Boolean)) {
      const there = lens.distort(transform(HStraightFromGuess, pointsOf(moved)));
      inImage(there, image.width, image.height).forEach((inside, i) => (found[i] &= inside));
    }
    const [from, to] = [this.#points, moved].map((points) => chosen(points, (i) => found[i]));
    if (from.length < 2 * MIN_INLIERS) return null;
    const fit = fitMotion(from, to, INLIER_PX);
    if (fit === null || fit.count < MIN_INLIERS) return null;
    const H = multiply3(HStraightFromGuess, fit.H);
    const corners = lens.distort(transform(H, frameCorners(width, height)));
    return { corners, fresh: (2 * fit.count) / from.length < 0.5 };
  }

  /**
   * Mark, by 255, the pixels of the layout that lie in the image, and not near its border.
   *
   * @param {Float64Array} HCapturedFromDisplay
   * @param {number} imageWidth
   * @param {number} imageHeight
   * @returns {BytePlane | null} null where all do
   */
  #viewMask(HCapturedFromDisplay, imageWidth, imageHeight) {
    const { width, height } = this.layout;
    const corners = transform(HCapturedFromDisplay, frameCorners(width, height));
    if (inImage(corners, imageWidth, imageHeight).every(Boolean)) return null;
    const [xs, ys] = STRAIGHT.seenAt(HCapturedFromDisplay, width, height);
    const seen = bytePlane(width, height);
    xs.forEach((x, at) => {
      const across = x >= -0.5 && x < imageWidth - 0.5;
      if (across && ys[at] >= -0.5 && ys[at] < imageHeight - 0.5) seen.data[at] = 255;
    });
    const inside = bytePlane(width, height);
    call("eroded", [seen, 2 * EDGE_PX + 1], [inside]);
    return inside;
  }

  /**
   * Choose the points that are followed.
   *
   * @param {BytePlane} reference
   * @param {BytePlane | null} seen - nonzero where points may lie; null where they may everywhere
   */
  #pointsOf(reference, seen) {
    const { width, height } = reference;
    const points = chooseFeatures(reference, FEATURES, 0.02, 8, seen);
    return chosen(points, (i) => {
      const [x, y] = [points[2 * i], points[2 * i + 1]];
      return x > 3 && x < width - 3 && y > 3 && y < height - 3;
    });
  }
}
