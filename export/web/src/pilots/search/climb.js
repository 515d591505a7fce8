/**
 * Move the corners of a display, one after the other, while its pilots toggle more surely.
 *
 * Where the toggling is weak, no part of the display stands out of the noise by itself
 * (`parts.js`), and all pilots together still do. From corners that are off by a block or two,
 * the sum over all pilots leads to where they lie.
 */

import { pilotsSearchClimb } from "../../generated/constants.js";
import { boxMeans } from "../../image/blur.js";
import { BEYOND, BY } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { between } from "../../image/warp.js";
import {
  frameCorners, homographyFromCorners, resizedHomography, transform,
} from "../../link/geometry.js";
import { inverse, multiply3 } from "../../link/linear.js";
import { withoutSlope } from "../motion.js";
import { pilotCentres, signedPhases, turnedSums } from "../signal.js";

/** @typedef {import("../toggling.js").Amplitudes} Amplitudes */

export const { STEPS_BLOCKS, MOVES, GROUPS, LEAST_GAIN } = pilotsSearchClimb;

/**
 * Find corners at which the pilots of a display toggle most surely.
 *
 * What is raised is the share of the power of all pilots that has their signs,
 * |sum of s_p X_p|^2 / (P sum of |X_p|^2) with the complex amplitudes X_p at P pilots, whose phases
 * may slope across the display as `PHASE_SLOPES` of signal.js says.
 *
 * @param {Amplitudes} change - at one frequency of the rectified display, each pixel divided by its
 *   usual deviation; of any phase
 * @param {Layout} layout - of the display, with pilots
 * @returns {Float64Array} HOldFromNew in layout pixels: where a point of the display, as it should
 *   have been rectified, lies in the image as it was
 */
export function climbToPilots(change, layout) {
  const { width, height } = change;
  const blockX = width / layout.cols;
  const blockY = height / layout.rows;
  const real = averaged({ width, height, data: change.real }, [blockX, blockY]);
  const imaginary = averaged({ width, height, data: change.imaginary }, [blockX, blockY]);
  const phases = signedPhases(layout);
  const pilots = layout.pilotBlocks.length;
  const centres = pilotCentres(layout).map(
    ([x, y]) => /** @type {Point} */ ([x * width - 0.5, y * height - 0.5]),
  );

  const share = (/** @type {Point[]} */ corners) => {
    const H = homographyFromCorners(corners, width, height);
    const places = [new Float32Array(pilots), new Float32Array(pilots)];
    transform(H, centres).forEach((point, p) => [places[0][p], places[1][p]] = point);
    const values = [real, imaginary].map((plane) => between(plane, places, BY.linear, BEYOND.zero));
    let power = 0;
    for (const part of values) for (const value of part) power += value * value;
    const along = phases.map((slope) => turnedSums(values[0], values[1], slope));
    return Math.max(...along.map(({ a, b }) => a * a + b * b)) / (power * pilots + 1e-12);
  };

  let corners = frameCorners(width, height);
  let best = share(corners);
  for (const step of STEPS_BLOCKS) {
    for (let improved = true; improved; ) {
      improved = false;
      for (const group of GROUPS) {
        for (const [x, y] of MOVES) {
          const tried = corners.slice();
          for (const i of group) {
            tried[i] = [corners[i][0] + x * step * blockX, corners[i][1] + y * step * blockY];
          }
          const found = share(tried);
          if (found > best + LEAST_GAIN) [corners, best, improved] = [tried, found, true];
        }
      }
    }
  }
  const HOldFromNew = homographyFromCorners(corners, width, height);
  const HLayoutFromMap = resizedHomography(layout.width / width, layout.height / height);
  return multiply3(multiply3(HLayoutFromMap, HOldFromNew), inverse(HLayoutFromMap));
}

/**
 * Take off the slope, and average over a block around each pixel; beyond the border all is 0.
 *
 * @param {FloatPlane} plane
 * @param {[number, number]} block - its width and height, in pixels
 */
function averaged(plane, block) {
  const [across, down] = block.map((side) => Math.max(1, roundHalfEven(side)));
  return boxMeans(withoutSlope(plane, block), across, down, BEYOND.zero);
}
