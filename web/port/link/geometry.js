/**
 * The convention of pixels and corners, homographies, and rectification.
 *
 * Pixel centres lie at whole coordinates, points are [x, y], and the corners of a picture are the
 * outer corners of its corner pixels. A display frame spans [-0.5, width - 0.5] x
 * [-0.5, height - 0.5]. Corner order: top-left, top-right, bottom-right, bottom-left of the
 * displayed picture, whatever way up the camera was. Homographies are nine numbers, row by row.
 */

import { geometry } from "../../generated/constants.js";
import { shrunkByWhole } from "../image/shrink.js";
import { remapped, warped } from "../image/warp.js";
import { inverse, multiply3, solve } from "./linear.js";

/** @typedef {[number, number]} Point */
/** @typedef {ArrayLike<number>} Homography */

export const { MIN_AREA_PX } = geometry;
const { OUTER_PX, UNDISTORT_STEPS, LEAST_FACTOR } = geometry;

/**
 * A lens that bends straight lines, around the centre of the image: a point r half diagonals from
 * the centre is seen at r (1 + k r^2), or at LEAST_FACTOR r where that is farther. Where k is 0 it
 * leaves points as they are.
 */
export class Lens {
  /**
   * @param {number} k - coefficient; below 0 the image bulges like a barrel
   * @param {number} width - of the image, pixels
   * @param {number} height - of the image, pixels
   */
  constructor(k, width, height) {
    this.k = k;
    /** Centre of the image. @type {Point} */
    this.middle = [(width - 1) / 2, (height - 1) / 2];
    /** Half the diagonal of the image, pixels. */
    this.half = Math.hypot(width, height) / 2;
  }

  /**
   * Move points of an image without distortion to where the lens shows them.
   *
   * @param {Point[]} points
   * @returns {Point[]}
   */
  distort(points) {
    return this.#moved(points, (r) => Math.max(1 + this.k * r * r, LEAST_FACTOR));
  }

  /**
   * Find the points that `distort` moves to given ones, by Newton's method.
   *
   * @param {Point[]} points
   * @returns {Point[]}
   */
  undistort(points) {
    const { k } = this;
    const most = k < 0 ? Math.sqrt((LEAST_FACTOR - 1) / k) : Infinity;
    return this.#moved(points, (seen) => {
      let found = Math.min(seen, most);
      for (let step = 0; step < UNDISTORT_STEPS; step++) {
        found -= (found + k * found ** 3 - seen) / (1 + 3 * k * found ** 2);
        found = Math.min(found, most);
      }
      return 1 / (1 + k * found ** 2);
    });
  }

  /**
   * Find the homography from a display to an image without distortion.
   *
   * @param {Point[]} corners - pixels where the lens shows the corners of the display
   * @param {number} width - of the display frame, pixels
   * @param {number} height - of the display frame, pixels
   * @returns {Float64Array} HStraightFromDisplay, nine numbers
   */
  homography(corners, width, height) {
    return homographyFromCorners(this.undistort(corners), width, height);
  }

  /**
   * Find where the lens shows every pixel of a display.
   *
   * @param {Homography} HStraightFromDisplay - which `homography` finds
   * @param {number} width - of the display frame, pixels
   * @param {number} height - of the display frame, pixels
   * @returns {Float32Array[]} x and y, for each pixel, row by row
   */
  seenAt(HStraightFromDisplay, width, height) {
    const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = Array.from(HStraightFromDisplay);
    const [middleX, middleY] = this.middle;
    const bend = this.k / this.half ** 2;
    const xs = new Float32Array(width * height);
    const ys = new Float32Array(width * height);
    for (let row = 0, at = 0; row < height; row++) {
      for (let col = 0; col < width; col++, at++) {
        const scale = 1 / (h6 * col + h7 * row + h8);
        const x = (h0 * col + h1 * row + h2) * scale - middleX;
        const y = (h3 * col + h4 * row + h5) * scale - middleY;
        const farther = Math.max(1 + bend * (x * x + y * y), LEAST_FACTOR);
        xs[at] = middleX + farther * x;
        ys[at] = middleY + farther * y;
      }
    }
    return [xs, ys];
  }

  /**
   * @param {Point[]} points
   * @param {(r: number) => number} farther - how many times as far from the centre a point comes,
   *   by its distance in half diagonals
   * @returns {Point[]}
   */
  #moved(points, farther) {
    const [middleX, middleY] = this.middle;
    if (this.k === 0) return points;
    return points.map(([x, y]) => {
      const times = farther(Math.hypot(x - middleX, y - middleY) / this.half);
      return [middleX + times * (x - middleX), middleY + times * (y - middleY)];
    });
  }
}

/** A lens that leaves all lines straight, in images of any size. */
export const STRAIGHT = new Lens(0, 1, 1);

/**
 * List the outer corners of a displayed frame, in corner order.
 *
 * @param {number} width - of the frame, pixels
 * @param {number} height - of the frame, pixels
 * @returns {Point[]}
 */
export function frameCorners(width, height) {
  const right = width - 0.5;
  const bottom = height - 0.5;
  return [
    [-0.5, -0.5],
    [right, -0.5],
    [right, bottom],
    [-0.5, bottom],
  ];
}

/**
 * Tell whether four points can be the corners of a display in an image: finite, not too far
 * outside the image, not mirrored, convex, and not tiny. Python's `check_corners` raises an error
 * in place of false.
 *
 * @param {Point[]} corners - four points in corner order
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @param {number} [outside] - distance by which corners may lie outside the image, as a share of
 *   its longer side
 * @returns {boolean}
 */
export function checkCorners(corners, width, height, outside = 0) {
  const isSound = isNear(corners, width, height, outside) && turns(corners).every((turn) => turn > 0);
  return isSound && contourArea(corners) >= MIN_AREA_PX;
}

/**
 * Tell whether points lie in an image, or not too far outside.
 *
 * @param {Point[]} points
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @param {number} outside - distance by which they may lie outside, as a share of the longer side
 */
export function isNear(points, width, height, outside) {
  const beyond = 0.5 + outside * Math.max(width, height);
  return points.every(([x, y]) => {
    return x >= -beyond && x <= width - 1 + beyond && y >= -beyond && y <= height - 1 + beyond;
  });
}

/**
 * Multiply the length of each side of a polygon by that of the next, and by the sine of the angle by
 * which it turns there; it is positive where it turns clockwise.
 *
 * @param {number[][]} points - in order
 */
export function turns(points) {
  return points.map((a, i) => {
    const [b, c] = [1, 2].map((k) => points[(i + k) % points.length]);
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
  });
}

/**
 * Tell whether a polygon is convex, whichever way round it goes (`cv2.isContourConvex`).
 *
 * @param {Point[]} points
 * @returns {boolean} false where three neighbours lie on a line, or a number is not finite
 */
export function isConvex(points) {
  const turned = turns(points.map(inSingle));
  return turned.every((turn) => turn > 0) || turned.every((turn) => turn < 0);
}

/**
 * Find the area of a polygon, in square pixels, as OpenCV does.
 *
 * @param {Point[]} points - in order
 * @returns {number}
 */
export function contourArea(points) {
  return Math.abs(signedArea(points.map(inSingle)));
}

/**
 * Measure the area of a polygon, in square pixels; that of a clockwise one is positive.
 *
 * @param {number[][]} points - in order
 */
export function signedArea(points) {
  let twice = 0;
  points.forEach(([x, y], i) => {
    const [nextX, nextY] = points[(i + 1) % points.length];
    twice += x * nextY - y * nextX;
  });
  return twice / 2;
}

/**
 * Round a point to 32-bit floats, as OpenCV does.
 *
 * @param {Point} point
 */
function inSingle(point) {
  return point.map(Math.fround);
}

/**
 * Tell which points lie in an image; a hundredth of a pixel counts for nothing.
 *
 * @param {Point[]} points
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @returns {Uint8Array} 1 for each point that does
 */
export function inImage(points, width, height) {
  const isWithin = (/** @type {number} */ at, /** @type {number} */ length) =>
    at >= -OUTER_PX && at <= length - 1 + OUTER_PX;
  return Uint8Array.from(points, ([x, y]) => Number(isWithin(x, width) && isWithin(y, height)));
}

/**
 * Find the homography that maps pixels of the displayed picture to pixels of the image.
 *
 * Corners are rounded to 32-bit floats, as OpenCV does.
 *
 * @param {Point[]} corners - pixels of the image, in corner order
 * @param {number} width - of the displayed picture, pixels
 * @param {number} height - of the displayed picture, pixels
 * @returns {Float64Array} HCapturedFromDisplay, nine numbers
 */
export function homographyFromCorners(corners, width, height) {
  return homographyFromPoints(frameCorners(width, height), corners);
}

/**
 * Find the homography that maps four points to four others (`cv2.getPerspectiveTransform`).
 *
 * @param {Point[]} from - four points
 * @param {Point[]} to - where each of them goes
 * @returns {Float64Array} nine numbers, the last of which is 1
 */
export function homographyFromPoints(from, to) {
  const A = new Float64Array(64);
  const b = new Float64Array(8);
  for (let i = 0; i < 4; i++) {
    const [[x, y], [u, v]] = [from[i], to[i]].map(inSingle);
    A.set([x, y, 1, 0, 0, 0, -x * u, -y * u], i * 8);
    A.set([0, 0, 0, x, y, 1, -x * v, -y * v], (i + 4) * 8);
    b[i] = u;
    b[i + 4] = v;
  }
  return Float64Array.from([...solve(A, b), 1]);
}

/**
 * Find where the pixels of an image lie once it is resized: corners go to corners.
 *
 * @param {number} x - factor by which the image becomes wider
 * @param {number} y - factor by which the image becomes taller
 * @returns {number[]} HResizedFromImage, nine numbers
 */
export function resizedHomography(x, y) {
  return [x, 0, (x - 1) / 2, 0, y, (y - 1) / 2, 0, 0, 1];
}

/**
 * Apply a homography to points.
 *
 * @param {Homography} H - nine numbers
 * @param {Point[]} points
 * @returns {Point[]}
 */
export function transform(H, points) {
  return points.map(([x, y]) => {
    const w = H[6] * x + H[7] * y + H[8];
    return [(H[0] * x + H[1] * y + H[2]) / w, (H[3] * x + H[4] * y + H[5]) / w];
  });
}

/**
 * Resample a captured image to the display's frame.
 *
 * Bilinear; a capture finer than twice the display grid is first averaged down by a whole factor,
 * so that every captured pixel counts and nothing aliases.
 *
 * @param {BytePlane} image
 * @param {Homography} HCapturedFromDisplay - such as `homographyFromCorners` finds
 * @param {number} width - of the display frame, pixels
 * @param {number} height - of the display frame, pixels
 * @param {Lens} [lens] - shows where in the image the points lie to which the homography leads
 * @returns {BytePlane}
 */
export function rectify(image, HCapturedFromDisplay, width, height, lens = STRAIGHT) {
  const corners = transform(HCapturedFromDisplay, frameCorners(width, height));
  const factor = Math.floor(pixelsInOne(corners, width, height));
  if (!(factor >= 2)) return sampled(image, HCapturedFromDisplay, width, height, lens);
  const H = multiply3(inverse(resizedHomography(factor, factor)), HCapturedFromDisplay);
  const small = new Lens(lens.k, image.width / factor, image.height / factor);
  return sampled(shrunkByWhole(image, factor), H, width, height, small);
}

/**
 * Measure how far two points are apart.
 *
 * @param {Point} one
 * @param {Point} other
 */
export function distance(one, other) {
  return Math.hypot(one[0] - other[0], one[1] - other[1]);
}

/**
 * Find the largest difference between coordinates of points.
 *
 * @param {Point[]} points
 * @param {Point[]} others - as many
 */
export function farthest(points, others) {
  let most = 0;
  points.forEach(([x, y], i) => {
    most = Math.max(most, Math.abs(x - others[i][0]), Math.abs(y - others[i][1]));
  });
  return most;
}

/**
 * Measure the sides of a quadrilateral: top, right, bottom and left, in pixels.
 *
 * @param {Point[]} corners
 */
export function sideLengths(corners) {
  return corners.map((corner, i) => distance(corners[(i + 1) % 4], corner));
}

/**
 * Count the pixels of an image in one of a display's frame, along the side where they are fewest.
 *
 * @param {Point[]} corners - of the display, pixels of the image
 * @param {number} width - of the display's frame, pixels
 * @param {number} height - of the display's frame, pixels
 */
export function pixelsInOne(corners, width, height) {
  const [top, right, bottom, left] = sideLengths(corners);
  return Math.min(Math.min(top, bottom) / width, Math.min(left, right) / height);
}

/**
 * Sample an image where a homography and a lens lead.
 *
 * @param {BytePlane} image
 * @param {Homography} H
 * @param {number} width
 * @param {number} height
 * @param {Lens} lens
 * @returns {BytePlane}
 */
function sampled(image, H, width, height, lens) {
  if (lens.k === 0) return warped(image, H, width, height);
  return remapped(image, lens.seenAt(H, width, height), width, height);
}
