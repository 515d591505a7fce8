/** How a lens bends a display, in views that were rectified as if it bent nothing. */

import { locatePilotsBent } from "../../generated/constants.js";
import { Lens, homographyFromCorners, transform } from "../../link/geometry.js";
import { inverse, multiply3 } from "../../link/linear.js";
import { POWERS, UNIT_CORNERS, pixelsFromUnit } from "./motion.js";

const { K_STEP } = locatePilotsBent;
/** Places along a display from -1 to 1 at which its motion is worked out. */
const NODES = Float64Array.from({ length: POWERS }, (_, i) => (2 * i) / (POWERS - 1) - 1);
/** Factors (POWERS, POWERS) of powers, from the values at the nodes. */
const FACTORS_OF_VALUES = inverse(
  Float64Array.from({ length: POWERS * POWERS }, (_, i) => {
    return NODES[Math.floor(i / POWERS)] ** (i % POWERS);
  }),
);

/**
 * A display in views that were rectified by the corners at which the lens shows it.
 *
 * Displays go from -1 to 1 along both axes. The lens moves the places between the corners; the
 * corners themselves stay where they are seen.
 */
export class BentDisplay {
  #HCapturedFromOld;

  /**
   * @param {Point[]} corners - pixels of the image by which the views were rectified
   * @param {number} width - of the image, pixels
   * @param {number} height - of the image, pixels
   */
  constructor(corners, width, height) {
    this.#HCapturedFromOld = multiply3(homographyFromCorners(corners, 2, 2), pixelsFromUnit(2, 2));
    this.width = width;
    this.height = height;
  }

  /**
   * Make a lens, and the homography from the display to an image without distortion.
   *
   * @param {Homography} HOldFromNew - where the display's corners lie in the views, from -1 to 1
   * @param {number} k - coefficient of the lens
   */
  beforeLens(HOldFromNew, k) {
    const lens = new Lens(k, this.width, this.height);
    const corners = transform(multiply3(this.#HCapturedFromOld, HOldFromNew), UNIT_CORNERS);
    return { lens, H: multiply3(lens.homography(corners, 2, 2), pixelsFromUnit(2, 2)) };
  }

  /**
   * Find where in the views the pixels of a map of the display are seen.
   *
   * @param {Homography} HOldFromNew - where the display's corners lie in the views, from -1 to 1
   * @param {number} k - coefficient of the lens
   * @param {Homography} mapFromUnit - to pixels of maps and views
   * @param {number[]} size - width and height of the maps, pixels
   * @returns {{ xs: Float32Array, ys: Float32Array }} for each pixel, row by row
   */
  seenAt(HOldFromNew, k, mapFromUnit, [width, height]) {
    const { lens, H } = this.beforeLens(HOldFromNew, k);
    const { xs, ys } = lens.seenAt(multiply3(H, inverse(mapFromUnit)), width, height);
    const [h0, h1, h2, h3, h4, h5, h6, h7, h8] = multiply3(
      mapFromUnit,
      inverse(this.#HCapturedFromOld),
    );
    for (let at = 0; at < xs.length; at++) {
      const [x, y] = [xs[at], ys[at]];
      const w = h6 * x + h7 * y + h8;
      xs[at] = (h0 * x + h1 * y + h2) / w;
      ys[at] = (h3 * x + h4 * y + h5) / w;
    }
    return { xs, ys };
  }

  /**
   * Find how places of the display move for each unit of the lens's coefficient.
   *
   * @param {Homography} HOldFromNew - where the display's corners lie in the views, from -1 to 1
   * @param {number} k - coefficient of the lens
   * @returns {Float64Array[]} (POWERS, POWERS) factors of powers of y, by rows, and of x: for the
   *   motion along x, and for that along y
   */
  bending(HOldFromNew, k) {
    /** @type {Point[]} */
    const places = [...NODES].flatMap((y) => [...NODES].map((x) => /** @type {Point} */ ([x, y])));
    const { lens, H } = this.beforeLens(HOldFromNew, k);
    const stronger = this.beforeLens(HOldFromNew, k + K_STEP);
    const there = lens.undistort(stronger.lens.distort(transform(stronger.H, places)));
    const moved = transform(inverse(H), there);
    return [0, 1].map((axis) =>
      factorsOf(places.map((place, i) => (moved[i][axis] - place[axis]) / K_STEP)),
    );
  }
}

/**
 * Find the factors of powers of y and of x that give the values at the nodes.
 *
 * @param {number[]} values - (POWERS, POWERS) rows of one y each
 * @returns {Float64Array} (POWERS, POWERS) powers of y, by rows, and of x
 */
function factorsOf(values) {
  const factors = new Float64Array(POWERS * POWERS);
  for (let row = 0; row < POWERS; row++) {
    for (let col = 0; col < POWERS; col++) {
      for (let y = 0; y < POWERS; y++) {
        for (let x = 0; x < POWERS; x++) {
          factors[row * POWERS + col] +=
            FACTORS_OF_VALUES[row * POWERS + y] *
            values[y * POWERS + x] *
            FACTORS_OF_VALUES[col * POWERS + x];
        }
      }
    }
  }
  return factors;
}
