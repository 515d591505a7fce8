/**
 * Move the corners of a display, one after the other, while its pilots toggle more surely.
 *
 * Where the toggling is weak, no part of the display stands out of the noise by itself
 * (`parts.js`), and all pilots together still do. From corners that are off by a block or two,
 * the sum over all pilots leads to where they lie.
 */

import { pilotsSearchClimb } from "../../generated/constants.js";
import { cv, floatPlane, matOf, withMats } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { frameCorners, homographyFromCorners, resizedHomography } from "../../link/geometry.js";
import { inverse, multiply3 } from "../../link/linear.js";
import { withoutSlope } from "../motion.js";
import { signedPhases, sumsAlong } from "../signal.js";

/** @typedef {import("./partMatches.js").Amplitudes} Amplitudes */

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
  const valuesReal = new Float64Array(pilots);
  const valuesImaginary = new Float64Array(pilots);
  const centreX = Float64Array.from(
    layout.pilotBlocks,
    (block) => ((block % layout.cols) + 0.5) * blockX - 0.5,
  );
  const centreY = Float64Array.from(
    layout.pilotBlocks,
    (block) => (Math.floor(block / layout.cols) + 0.5) * blockY - 0.5,
  );

  const share = (/** @type {Point[]} */ corners) => {
    const H = homographyFromCorners(corners, width, height);
    let power = 0;
    for (let p = 0; p < pilots; p++) {
      const [x, y] = [centreX[p], centreY[p]];
      const w = H[6] * x + H[7] * y + H[8];
      const atX = (H[0] * x + H[1] * y + H[2]) / w;
      const atY = (H[3] * x + H[4] * y + H[5]) / w;
      const one = (valuesReal[p] = sampled(real, atX, atY));
      const other = (valuesImaginary[p] = sampled(imaginary, atX, atY));
      power += one * one + other * other;
    }
    const along = sumsAlong(valuesReal, valuesImaginary, phases);
    return Math.max(...along.map(([a, b]) => a * a + b * b)) / (power * pilots + 1e-12);
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
 * @returns {FloatPlane}
 */
function averaged(plane, block) {
  const [across, down] = block.map((side) => Math.max(1, roundHalfEven(side)));
  return withMats((keep) => {
    const mean = keep(matOf(withoutSlope(plane, block)));
    const size = new cv.Size(across, down);
    cv.blur(mean, mean, size, new cv.Point(-1, -1), cv.BORDER_CONSTANT);
    return floatPlane(mean);
  });
}

/**
 * Sample a plane between pixels; beyond the border all is 0.
 *
 * @param {FloatPlane} plane
 * @param {number} x
 * @param {number} y
 * @returns {number}
 */
function sampled({ width, height, data }, x, y) {
  const left = Math.floor(x);
  const top = Math.floor(y);
  if (!(left >= -1 && left < width && top >= -1 && top < height)) return 0;
  const at = top * width + left;
  const [hasLeft, hasRight] = [left >= 0, left + 1 < width];
  const [hasTop, hasBottom] = [top >= 0, top + 1 < height];
  const one = hasTop && hasLeft ? data[at] : 0;
  const two = hasTop && hasRight ? data[at + 1] : 0;
  const three = hasBottom && hasLeft ? data[at + width] : 0;
  const four = hasBottom && hasRight ? data[at + width + 1] : 0;
  const above = one + (two - one) * (x - left);
  return above + (three + (four - three) * (x - left) - above) * (y - top);
}
