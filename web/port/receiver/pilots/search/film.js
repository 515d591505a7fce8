/** Frames of a film that are kept, and what they show of a display. */

import { receiverPilotsSearchFilm } from "../../../../generated/constants.js";
import { Copies } from "../../../image/copies.js";
import {
  contourArea,
  farthest,
  homographyFromCorners,
  homographyFromPoints,
  isConvex,
  pixelsInOne,
  resizedHomography,
  transform,
} from "../../../link/geometry.js";
import { multiply3 } from "../../../link/linear.js";
import { rolled } from "../../locate/quads.js";
import { Border, Outline } from "../outline.js";

/** @typedef {import("../motion.js").GridMaps} GridMaps */
/** @typedef {import("../stabilise.js").Tracks} Tracks */

export const { FAR_OUTSIDE, LEAST_AREA } = receiverPilotsSearchFilm;
const { OUTLINE_WIDTH, APART, ABOUT, VOTES } = receiverPilotsSearchFilm;

/**
 * What is added to the step from sample to sample, in pixels of the frame, before it is cut to the
 * whole factor by which the frame is averaged down. So frames are averaged from a step of 1.65
 * pixels on, where samples would pass over too many pixels.
 */
const AVERAGED_FROM = 0.35;

/**
 * One frame, and how what it shows has moved since a reference frame.
 *
 * A camera that moves sideways sees what is near move farther than what is behind it (parallax). So
 * a display is held still by the points within it, and only where they do not suffice, by the room.
 */
export class HeldFrame {
  /** What views show of the frame, which is looked at coarsely. */
  #copies;

  /**
   * @param {BytePlane} gray - is kept
   * @param {Homography} HFrameFromReference
   * @param {number} at - position since the reference (waves.js)
   * @param {number} time - when it was taken, seconds
   * @param {Tracks | null} [tracks] - points of the reference that were found again in it; null to
   *   go by the room alone, because pictures may move
   * @param {Surrounded[]} [surrounded] - quadrilaterals that are followed by what lies around them,
   *   too, with where they lie here
   * @param {BytePlane | null} [changes] - what a small copy of the frame shows beyond what has moved;
   *   null to look at the frame itself
   */
  constructor(gray, HFrameFromReference, at, time, tracks = null, surrounded = [], changes = null) {
    this.gray = gray;
    this.changes = changes;
    this.#copies = new Copies(changes ?? gray);
    this.at = at;
    this.time = time;
    this.HFrameFromReference = HFrameFromReference;
    this.tracks = tracks;
    this.surrounded = surrounded;
  }

  /**
   * Find where a display lies.
   *
   * @param {Point[]} corners - in the reference frame
   * @returns {Point[]} in this frame
   */
  corners(corners) {
    const around = surroundingsOf(corners, this.surrounded);
    if (around?.outline.pictureMoves) return transform(around.motion, corners);
    const own = this.tracks?.motionWithin(corners);
    return transform(own ?? this.HFrameFromReference, corners);
  }

  /**
   * Show a display as it would be seen from the front, in a map of a size.
   *
   * Python rectifies to the layout's size and averages down to the map's. Here the frame is averaged
   * down where the map is much coarser, and sampled once for each pixel of the map: a quarter of the
   * work, and nearly every pixel of the frame still counts.
   *
   * @param {Point[]} corners - of the display, in the reference frame
   * @param {number} width - of the map
   * @param {number} height - of the map
   * @returns {FloatPlane | null} null where corners make no sound quadrilateral near the image
   */
  view(corners, width, height) {
    const quad = this.#quad(corners);
    if (quad === null) return null;
    const H = homographyFromCorners(quad, width, height);
    return this.#copies.sampled(H, factorOf(quad, width, height), width, height);
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
    const [[width, height], [across, down]] = [maps.size, maps.inner];
    const { layout } = maps;
    const H = multiply3(homographyFromCorners(quad, layout.width, layout.height), maps.toLayout());
    return this.#copies.sampled(H, factorOf(quad, across, down), width, height);
  }

  /**
   * Find where corners lie in what views show.
   *
   * @param {Point[]} corners - in the reference frame
   * @returns {Point[] | null} null where they make no sound quadrilateral near the image
   */
  #quad(corners) {
    const quad = this.corners(corners);
    const { width, height } = this.gray;
    if (!isNear(quad, width, height)) return null;
    const shown = this.#copies.image;
    return transform(resizedHomography(shown.width / width, shown.height / height), quad);
  }
}

/**
 * Where a quadrilateral lies in a frame, as what surrounds it tells: what follows it, and the
 * homography from the reference to the frame.
 *
 * @typedef {{ outline: MovingOutline, motion: Float64Array }} Surrounded
 */

/**
 * Choose the quadrilateral that is nearest to corners of the reference.
 *
 * @param {Point[]} corners
 * @param {readonly Surrounded[]} near
 * @returns {Surrounded | null} null where none is within `ABOUT`
 */
export function surroundingsOf(corners, near) {
  let nearest = null;
  let least = ABOUT;
  for (const each of near) {
    const distance = each.outline.distance(corners);
    if (distance < least || (nearest === null && distance === least)) {
      [nearest, least] = [each, distance];
    }
  }
  return nearest;
}

/** Follows a quadrilateral by what surrounds it, and notices where its picture moves. */
export class MovingOutline {
  #outline;
  #border;
  #size;
  #votes = 0;

  /**
   * @param {BytePlane} gray - the reference frame
   * @param {Point[]} quad - pixels of it
   */
  constructor(gray, quad) {
    /** Pixels of the reference. */
    this.quad = quad;
    this.#outline = new Outline(gray, quad, OUTLINE_WIDTH);
    this.#border = new Border(gray, quad);
    this.#size = Math.sqrt(contourArea(quad));
  }

  /** Whether what it shows has moved in another way than what surrounds it. */
  get pictureMoves() {
    return this.#votes >= VOTES;
  }

  /**
   * Find the quadrilateral in the next frame.
   *
   * @param {BytePlane} gray
   * @param {Point[] | null} shown - pixels of the frame where the points within it say that it lies,
   *   if they agree
   * @returns {Surrounded | null} null where its surroundings do not tell
   */
  take(gray, shown) {
    if (!this.#outline.isClear) return null;
    let corners = this.#outline.follow(gray);
    if (corners === null && shown !== null) corners = this.#outline.follow(gray, shown);
    if (corners === null) return null;
    if (shown === null) {
      this.#votes++;
    } else if (farthest(corners, shown) > APART * this.#size) {
      this.#votes += Number(this.#border.isRather(gray, corners, shown));
      this.#votes -= Number(this.#border.isRather(gray, shown, corners));
    }
    return { outline: this, motion: homographyFromPoints(this.quad, corners) };
  }

  /**
   * Tell how far corners are from those of the quadrilateral, as a share of its size.
   *
   * @param {Point[]} corners - pixels of the reference, from any of them on
   */
  distance(corners) {
    const turns = [0, 1, 2, 3].map((turn) => farthest(rolled(corners, turn), this.quad));
    return Math.min(...turns) / this.#size;
  }
}

/**
 * Say by which whole factor a frame is averaged down for a map of a size.
 *
 * @param {Point[]} quad - what the map shows, pixels of the frame
 * @param {number} width - of the map
 * @param {number} height - of the map
 */
function factorOf(quad, width, height) {
  return Math.floor(pixelsInOne(quad, width, height) + AVERAGED_FROM);
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
