/**
 * Follow a display by what lies around it, whatever it shows.
 *
 * A display may show a film, whose points move by themselves. What surrounds it does not: the bezel
 * lies in the display's plane, and letterbox bars, desk and wall keep their edges. So a ring around
 * the display is compared, pixel by pixel, with the same ring in a reference frame, and the eight
 * numbers of a homography follow by least squares (Lucas & Kanade 1981), with less weight for pixels
 * that changed in another way (as behind a display that is nearer than the wall, when the hand
 * moves).
 */

import { receiverPilotsOutline, robust } from "../../../generated/constants.js";
import { blurred } from "../../image/blur.js";
import { floatPlane } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { warped } from "../../image/warp.js";
import {
  STRAIGHT, homographyFromCorners, isConvex, resizedHomography, sideLengths, transform,
} from "../../link/geometry.js";
import { dot, inverse, multiply3, solve, varianceAlong } from "../../link/linear.js";
import { mean, median, spreadOf } from "../../link/order.js";
import { profiles } from "../locate/edges.js";
import { MotionEquations, NUMBERS, UNIT_CORNERS, UnitMaps, unitHomography } from "./motion.js";

const {
  WIDTH, RING, BORDER_PX, SUPERSAMPLED, BLUR_PX, ROUNDS, SETTLED, LEAST_DEVIATION, OUTLIER, DAMPING,
  ALIKE, CLEAR_PX, CORRELATED_PX, PROFILE_PX, ALONG, PROFILE_PLACES, PROFILE_OFFSETS, BETTER,
} = receiverPilotsOutline;

/** Smallest distance, in pixels, from the border of an image to a pixel that counts as seen. */
const INSIDE_PX = 3;

/**
 * Tells which of two places is that of a display, by the edges along its border.
 *
 * The edges of picture and bezel lie along the border, whatever the picture shows and however far the
 * wall is behind. What is compared is the mean steepness across each side, by distance from it.
 */
export class Border {
  /** @type {Float64Array[]} */
  #profiles;

  /**
   * @param {BytePlane} gray - a reference frame
   * @param {Point[]} corners - of the display in it
   */
  constructor(gray, corners) {
    this.#profiles = borderProfiles(gray, corners);
  }

  /**
   * Tell whether the display is clearly rather at one place than at another in a frame.
   *
   * @param {BytePlane} gray
   * @param {Point[]} one - corners
   * @param {Point[]} other - corners
   */
  isRather(gray, one, other) {
    const [first, second] = [one, other].map((at) => this.#likeness(borderProfiles(gray, at)));
    return first > second + BETTER;
  }

  /**
   * Correlate all profiles with the reference's, in [-1, 1].
   *
   * @param {Float64Array[]} profiles
   */
  #likeness(profiles) {
    const [one, other] = [profiles, this.#profiles].map((each) =>
      each.flatMap((profile) => {
        const usual = mean(profile);
        return Array.from(profile, (step) => step - usual);
      }),
    );
    return cosine(one, other);
  }
}

/**
 * Find the cosine of the angle between two vectors.
 *
 * @param {ArrayLike<number>} one
 * @param {ArrayLike<number>} other
 */
function cosine(one, other) {
  return dot(one, other) / Math.sqrt(dot(one, one) * dot(other, other) + 1e-9);
}

/**
 * Measure how steep a frame is across the sides of a quadrilateral.
 *
 * @param {BytePlane} gray
 * @param {Point[]} corners
 * @returns {Float64Array[]} of each side, the mean size of the step between neighbouring places, in
 *   gray levels, from outside to inside
 */
export function borderProfiles(gray, corners) {
  const levels = profiles(gray, corners, PROFILE_PLACES, PROFILE_OFFSETS);
  return corners.map((_, side) => {
    const profile = new Float64Array(2 * PROFILE_PX);
    for (let i = 0; i < ALONG; i++) {
      const at = (side * ALONG + i) * PROFILE_OFFSETS.length;
      for (let k = 0; k < profile.length; k++) {
        profile[k] += Math.abs(levels[at + k + 1] - levels[at + k]) / ALONG;
      }
    }
    return profile;
  });
}

/** Follows what surrounds a display, from a reference frame on. */
export class Outline {
  /** Geometry of the view. */
  #maps;
  #viewFromUnit;
  /** Corners of the display in its view. */
  #first;
  /** Motion of each corner that is expected until the next frame. @type {Point[]} */
  #motion = UNIT_CORNERS.map(() => [0, 0]);
  /** Numbers of the ring's pixels in the view. @type {Int32Array} */
  #ring;
  /** The view of the reference, and mean and standard deviation of its ring. */
  #reference;
  #mean;
  #deviation;
  /** The ring in the newest frame, at the exposure of the reference. */
  #seen;
  /** Weight of each pixel of the view, in [0, 1]. */
  #weight;

  /**
   * @param {BytePlane} gray - the reference frame
   * @param {Point[]} corners - of the display in it
   * @param {number} [width] - of the display, pixels of its view; fewer cost less
   */
  constructor(gray, corners, width = WIDTH) {
    const [top, right, bottom, left] = sideLengths(corners);
    const height = Math.max(8, roundHalfEven((width * (left + right)) / Math.max(top + bottom, 1)));
    const margin = roundHalfEven(RING * width);
    this.#maps = new UnitMaps([width, height], [margin, margin]);
    this.#viewFromUnit = this.#maps.fromUnit();
    this.#first = transform(this.#viewFromUnit, UNIT_CORNERS);
    /** Pixels of the display in the newest frame. */
    this.corners = corners;
    const H = this.#homography(corners);
    this.#ring = ringOf(this.#maps).filter(insideOf(gray, H, this.#maps.size));
    this.#reference = this.#view(gray, H);
    const { data } = this.#reference;
    [this.#mean, this.#deviation] = spreadOf(Float32Array.from(this.#ring, (at) => data[at]));
    this.#seen = floatPlane(this.#reference.width, this.#reference.height);
    this.#weight = floatPlane(this.#reference.width, this.#reference.height);
    /** Whether the ring tells where the display is; a plain wall does not. */
    this.isClear = this.#isClear();
  }

  /**
   * Find the display in the next frame.
   *
   * @param {BytePlane} gray - of the reference's size
   * @param {Point[] | null} [guess] - corners from which to begin; null for where the display was,
   *   moved on
   * @returns {Point[] | null} pixels, or null where the ring is not found
   */
  follow(gray, guess = null) {
    const [before, motion] = [this.corners, this.#motion];
    let H = this.#homography(
      guess ?? before.map(([x, y], i) => [x + motion[i][0], y + motion[i][1]]),
    );
    const unitFromView = inverse(this.#viewFromUnit);
    this.#compare(gray, H);
    for (let round = 0; round < ROUNDS; round++) {
      const { matrix, right } = this.#equations();
      const step = solve(matrix, right);
      const moved = multiply3(inverse(unitHomography(step)), unitFromView);
      H = multiply3(multiply3(H, this.#viewFromUnit), moved);
      this.#compare(gray, H);
      if (step.every((number) => Math.abs(number) < SETTLED)) break;
    }
    if (!(this.#correlation() >= ALIKE)) return null;
    const corners = transform(H, this.#first);
    if (!isConvex(corners)) return null;
    this.#motion = corners.map(([x, y], i) => [0.5 * (x - before[i][0]), 0.5 * (y - before[i][1])]);
    this.corners = corners;
    return corners;
  }

  /**
   * Find the homography from pixels of the view to the frame in which the display has corners.
   *
   * @param {Point[]} corners
   */
  #homography(corners) {
    const { inner, margin } = this.#maps;
    const HCapturedFromInner = homographyFromCorners(corners, ...inner);
    return multiply3(HCapturedFromInner, [1, 0, -margin[0], 0, 1, -margin[1], 0, 0, 1]);
  }

  /**
   * Show the display with its ring, smoothed.
   *
   * @param {BytePlane} gray
   * @param {Float64Array} H - from pixels of the view to pixels of the frame
   */
  #view(gray, H) {
    const [width, height] = this.#maps.size;
    const finer = multiply3(H, resizedHomography(1 / SUPERSAMPLED, 1 / SUPERSAMPLED));
    const view = warped(gray, finer, SUPERSAMPLED * width, SUPERSAMPLED * height);
    return blurred(resizeArea(view, width, height), BLUR_PX);
  }

  /**
   * Compare the ring in a frame with that of the reference: shows it at the reference's exposure, and
   * finds weights, which are 0 for pixels that do not lie within the frame.
   *
   * @param {BytePlane} gray
   * @param {Float64Array} H - from pixels of the view to pixels of the frame
   */
  #compare(gray, H) {
    const { data } = this.#view(gray, H);
    const [ring, seen, weight] = [this.#ring, this.#seen.data, this.#weight.data];
    const reference = this.#reference.data;
    const [mean, deviation] = spreadOf(Float32Array.from(ring, (at) => data[at]));
    const gain = this.#deviation / Math.max(deviation, 1e-3);
    const far = Float32Array.from(ring, (at) => {
      seen[at] = gain * (data[at] - mean) + this.#mean;
      return Math.abs(seen[at] - reference[at]);
    });
    const usual = robust.MAD_TO_SIGMA * median(far) + LEAST_DEVIATION;
    const inFrame = insideOf(gray, H, this.#maps.size);
    ring.forEach((at, i) => {
      weight[at] = inFrame(at) ? 1 / (1 + (far[i] / (OUTLIER * usual)) ** 2) : 0;
    });
  }

  /** Write the normal equations of the motion, (8, 8) and (8,). */
  #equations() {
    const equations = new MotionEquations(this.#maps);
    equations.take(this.#seen, this.#reference, 1, this.#weight);
    const { matrix, right } = equations.normal();
    for (let i = 0; i < matrix.length; i += NUMBERS + 1) matrix[i] += DAMPING * this.#ring.length;
    return { matrix, right };
  }

  /** Correlate the ring in the newest frame with that of the reference, by weights, in [-1, 1]. */
  #correlation() {
    const weight = Float64Array.from(this.#ring, (at) => this.#weight.data[at]);
    const total = weight.reduce((sum, one) => sum + one, 1e-9);
    const [one, other] = [this.#seen, this.#reference].map(({ data }) => {
      const values = Float64Array.from(this.#ring, (at) => data[at]);
      const usual = dot(values, weight) / total;
      return values.map((value, i) => Math.sqrt(weight[i]) * (value - usual));
    });
    return cosine(one, other);
  }

  /** Tell whether noise alone would move no corner by much. */
  #isClear() {
    if (this.#ring.length < NUMBERS) return false;
    for (const at of this.#ring) this.#weight.data[at] = 1;
    const noise = CORRELATED_PX * (LEAST_DEVIATION * 2) ** 2;
    const covariance = inverse(this.#equations().matrix).map((value) => value * noise);
    const errors = UNIT_CORNERS.flatMap(([x, y]) =>
      this.#maps.inner.map((side, axis) => {
        const along = new Float64Array(NUMBERS);
        along.set([x, y, 1], 3 * axis);
        along.set([-[x, y][axis] * x, -[x, y][axis] * y], 6);
        return (side / 2) * Math.sqrt(varianceAlong(covariance, along));
      }),
    );
    return Math.max(...errors) <= CLEAR_PX;
  }
}

/**
 * List the numbers of a view's pixels that lie around a display, and not at its border.
 *
 * @param {UnitMaps} maps - of the view
 */
function ringOf({ size, margin }) {
  const [width, height] = size;
  const [beyondX, beyondY] = size.map((side, axis) =>
    Float64Array.from({ length: side }, (_, at) =>
      Math.max(margin[axis] - at, at - (side - margin[axis] - 1)),
    ),
  );
  const all = Int32Array.from({ length: width * height }, (_, at) => at);
  return all.filter((at) => {
    return Math.max(beyondX[at % width], beyondY[Math.floor(at / width)]) >= BORDER_PX;
  });
}

/**
 * Make a function that tells whether a pixel of a view, by its number, lies within a frame, some
 * pixels from its border.
 *
 * @param {BytePlane} frame
 * @param {Float64Array} H - from the view to the frame
 * @param {[number, number]} size - width and height of the view
 * @returns {(at: number) => boolean}
 */
function insideOf(frame, H, [width, height]) {
  const [xs, ys] = STRAIGHT.seenAt(H, width, height);
  const [right, bottom] = [frame.width - 1 - INSIDE_PX, frame.height - 1 - INSIDE_PX];
  return (at) => xs[at] > INSIDE_PX && ys[at] > INSIDE_PX && xs[at] < right && ys[at] < bottom;
}
