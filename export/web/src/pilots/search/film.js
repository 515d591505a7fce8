/** Frames of a film that are kept, and what they show of a display. */

import { pilotsSearchFilm } from "../../generated/constants.js";
import { areaMeans } from "../../image/shrink.js";
import { warped } from "../../image/warp.js";
import {
  contourArea,
  homographyFromCorners,
  isConvex,
  pixelsInOne,
  rectify,
  resizedHomography,
  transform,
} from "../../link/geometry.js";
import { inverse, multiply3 } from "../../link/linear.js";

/** @typedef {import("../motion.js").GridMaps} GridMaps */
/** @typedef {import("../stabilise.js").Tracks} Tracks */

export const { FAR_OUTSIDE, LEAST_AREA } = pilotsSearchFilm;

/** Room for a rectified frame that is averaged down at once. */
let room = new Uint8Array(0);

/**
 * One frame, and how what it shows has moved since a reference frame.
 *
 * A camera that moves sideways sees what is near move farther than what is behind it (parallax). So
 * a display is held still by the points within it, and only where they do not suffice, by the room.
 */
export class HeldFrame {
  /** Copies of the frame, averaged down by whole factors. @type {Map<number, FloatPlane>} */
  #copies = new Map();

  /**
   * @param {BytePlane} gray - is kept
   * @param {Homography} HFrameFromReference
   * @param {number} at - position since the reference (waves.js)
   * @param {number} time - when it was taken, seconds
   * @param {Tracks | null} [tracks] - points of the reference that were found again in it; null to
   *   go by the room alone, because pictures may move
   */
  constructor(gray, HFrameFromReference, at, time, tracks = null) {
    this.gray = gray;
    this.at = at;
    this.time = time;
    this.HFrameFromReference = HFrameFromReference;
    this.tracks = tracks;
  }

  /**
   * Find where a display lies.
   *
   * @param {Point[]} corners - in the reference frame
   * @returns {Point[]} in this frame
   */
  corners(corners) {
    const own = this.tracks?.motionWithin(corners);
    return transform(own ?? this.HFrameFromReference, corners);
  }

  /**
   * Show a display as it would be seen from the front, in a map of a size.
   *
   * Python rectifies to the layout's size and averages down to the map's. Where the camera sees the
   * display finer than half the layout's size, the frame is averaged down first, and rectified to
   * that half: a quarter of the work, and every pixel still counts.
   *
   * @param {Point[]} corners - of the display, in the reference frame
   * @param {Layout} layout - of the display
   * @param {number} width - of the map, no more than the layout's
   * @param {number} height - of the map, no more than the layout's
   * @returns {FloatPlane | null} null where corners make no sound quadrilateral near the image
   */
  view(corners, layout, width, height) {
    const quad = this.#quad(corners);
    if (quad === null) return null;
    const halfWidth = layout.width >> 1;
    const halfHeight = layout.height >> 1;
    const factor = Math.floor(pixelsInOne(quad, halfWidth, halfHeight));
    if (width > halfWidth || height > halfHeight || factor < 2) {
      const H = homographyFromCorners(quad, layout.width, layout.height);
      return areaMeans(this.#rectified(H, layout.width, layout.height), width, height);
    }
    const H = homographyFromCorners(quad, halfWidth, halfHeight);
    const half = this.#averaged(factor, H, halfWidth, halfHeight);
    return width === halfWidth && height === halfHeight ? half : areaMeans(half, width, height);
  }

  /**
   * Show a display and what lies around it, as `view` does.
   *
   * @param {Point[]} corners - of the display, in the reference frame
   * @param {GridMaps} maps
   * @returns {FloatPlane | null} null where corners make no sound quadrilateral near the image
   */
  blockView(corners, maps) {
    const quad = this.#quad(corners);
    if (quad === null) return null;
    const { layout } = maps;
    const shrunk = Math.floor(layout.width / maps.inner[0]);
    const [width, height] = maps.size;
    const H = multiply3(homographyFromCorners(quad, layout.width, layout.height), maps.toLayout());
    const factor = Math.floor(pixelsInOne(quad, maps.inner[0], maps.inner[1]));
    if (shrunk > 1 && factor >= 2) return this.#averaged(factor, H, width, height);
    const toMap = resizedHomography(1 / shrunk, 1 / shrunk);
    const fine = this.#rectified(multiply3(H, toMap), shrunk * width, shrunk * height);
    return areaMeans(fine, width, height);
  }

  /**
   * Rectify the frame in room that the next call uses again.
   *
   * @param {ArrayLike<number>} H - from pixels of the result to pixels of the frame
   * @param {number} width - of the result
   * @param {number} height - of the result
   */
  #rectified(H, width, height) {
    if (room.length !== width * height) room = new Uint8Array(width * height);
    return rectify(this.gray, H, width, height, room);
  }

  /**
   * Find where corners lie in the frame.
   *
   * @param {Point[]} corners - in the reference frame
   * @returns {Point[] | null} null where they make no sound quadrilateral near the image
   */
  #quad(corners) {
    const quad = this.corners(corners);
    return isNear(quad, this.gray.width, this.gray.height) ? quad : null;
  }

  /**
   * Sample the frame, averaged down, where a homography leads.
   *
   * @param {number} factor - whole, by which it is averaged down
   * @param {ArrayLike<number>} H - from pixels of the result to pixels of the frame
   * @param {number} width - of the result
   * @param {number} height - of the result
   */
  #averaged(factor, H, width, height) {
    const copy = this.#copy(factor);
    const [x, y] = [this.gray.width / copy.width, this.gray.height / copy.height];
    return warped(copy, multiply3(inverse(resizedHomography(x, y)), H), width, height);
  }

  /**
   * Average the frame down, without rounding.
   *
   * @param {number} factor - whole
   */
  #copy(factor) {
    const { width, height } = this.gray;
    const [across, down] = [width, height].map((side) => Math.floor(side / factor));
    const copy = this.#copies.get(factor) ?? areaMeans(this.gray, across, down);
    this.#copies.set(factor, copy);
    return copy;
  }
}

/**
 * Tell whether corners make a sound quadrilateral that is near the image.
 *
 * @param {Point[]} quad - pixels of the image
 * @param {number} width - of the image
 * @param {number} height - of the image
 */
function isNear(quad, width, height) {
  for (const [x, y] of quad) {
    if (!(x > -FAR_OUTSIDE * width && x < (1 + FAR_OUTSIDE) * width)) return false;
    if (!(y > -FAR_OUTSIDE * height && y < (1 + FAR_OUTSIDE) * height)) return false;
  }
  return isConvex(quad) && contourArea(quad) >= LEAST_AREA * width * height;
}
