/**
 * Move the corners of a display so that its blocks lie where the grid says they lie.
 *
 * What toggles in the rectified image is compared with what should toggle: pilots whose signs are
 * known. Corners may be off by blocks: parts of the display are shifted by themselves, and a
 * transform is fitted to their shifts (`coarseShift`). Where corners are off by less than a block,
 * the whole display is fitted at once (`allBlocks.js`).
 */

import { receiverPilotsSearchParts } from "../../../../generated/constants.js";
import { arraysOf, call, floatPlane, rowsOf } from "../../../image/opencv.js";
import { fitMotion } from "../../../image/points.js";
import { areaMeans } from "../../../image/shrink.js";
import { resizedHomography, transform } from "../../../link/geometry.js";
import { median } from "../../../link/order.js";
import { slopeSpan } from "../motion.js";
import { overDeviation } from "../signal.js";
import { CodedToggling, codeSearch } from "../toggling.js";

/** @typedef {import("../../../link/pilots.js").AnyPlane} AnyPlane */
/** @typedef {import("../toggling.js").Amplitudes} Amplitudes */

/**
 * Matches of one part, in each of some maps, for shifts from -reach to reach along y and, faster,
 * along x.
 *
 * @typedef {Float32Array[]} Matches
 */

export const {
  PARTS, COARSE_SIZE, ROUGH_PX, REACH_BLOCKS, REACH_SHARE, CLEAR, HALF_REAL, FEW, MANY, SAME_BLOCKS,
} = receiverPilotsSearchParts;

/** Units of work of matching all frames, and of trying all clocks. */
const [MATCH_WORK, CLOCK_WORK] = [30, 30];

/**
 * Find where the parts of a display lie that toggle as they should.
 *
 * @param {Amplitudes} change - at one frequency of the rectified display, in a map such as of
 *   `COARSE_SIZE`, each pixel divided by its usual deviation; of any phase
 * @param {ArrayLike<number>} blocks - (rows * cols,) expected change of each block, 0 where it is
 *   not known
 * @param {Layout} layout - of the display
 * @param {boolean} [far] - whether to look farther than `REACH_BLOCKS`
 * @returns {{ HOldFromNew: Float64Array, parts: number } | null} the transform, and the number of
 *   parts that clearly match and agree with it; null where there are none
 */
export function coarseShift(change, blocks, layout, far = false) {
  const { width, height, real, imaginary } = change;
  const shown = imaginary.some((value) => value !== 0) ? [real, imaginary] : [real];
  // of the matches that chance makes, so many medians are one e-th as frequent as the median
  const unit = shown.length > 1 ? Math.log(2) : HALF_REAL;
  const reach = reachOf(change, layout, far);
  const smallest = matchParts(shown, [width, height], blocks, layout, reach, PARTS[0]);
  for (const parts of PARTS) {
    const found = shiftsOfParts(joined(smallest, PARTS[0], parts), change, parts, reach, unit);
    const fit = fittedShift(found, layout, change);
    if (fit !== null) return fit;
  }
  return null;
}

/**
 * Choose the largest shift that is looked for.
 *
 * @param {{ width: number, height: number }} map
 * @param {Layout} layout
 * @param {boolean} far - whether to look farther than `REACH_BLOCKS`
 * @returns {[number, number]} along x and along y, pixels of the map
 */
function reachOf({ width, height }, { rows, cols }, far) {
  const least = far ? REACH_SHARE * width : 0;
  const [x, y] = [width / cols, height / rows].map((side) =>
    Math.ceil(Math.max(REACH_BLOCKS * side, least)),
  );
  return [x, y];
}

/**
 * Match each part of some maps with what is expected of it, at every shift.
 *
 * @param {readonly Float32Array[]} maps - amplitudes or values of the rectified display
 * @param {[number, number]} size - width and height of each map
 * @param {ArrayLike<number>} blocks - (rows * cols,) what is expected of each block
 * @param {Layout} layout
 * @param {[number, number]} reach - largest shift along x and along y, pixels
 * @param {[number, number]} parts - their number from top to bottom, and from left to right
 * @returns {Matches[]} of each part, from the top left on, row by row
 */
function matchParts(maps, [width, height], blocks, { rows, cols }, reach, [down, across]) {
  const expected = { width: cols, height: rows, data: Float32Array.from(blocks) };
  const ends = [divided(height, down), divided(width, across)].map((at) => Int32Array.from(at));
  const span = slopeSpan([width / cols, height / rows]);
  const each = (2 * reach[0] + 1) * (2 * reach[1] + 1);
  const found = floatPlane(down * across * each, maps.length);
  call("matchParts", [rowsOf(maps), width, ...span, expected, ...ends, ...reach], [found]);
  const ofMaps = arraysOf(found);
  return Array.from({ length: down * across }, (_, part) =>
    ofMaps.map((matches) => matches.subarray(part * each, (part + 1) * each)),
  );
}

/**
 * What is known of some parts' shifts: where each lies in the layout and where it was seen, in
 * pixels of the map, and how clearly.
 *
 * @typedef {{ places: Point[], seen: Point[], heights: number[] }} Shifts
 */

/**
 * Shift each part by itself to where it matches best.
 *
 * @param {Matches[]} matches - of each part
 * @param {{ width: number, height: number }} map
 * @param {[number, number]} parts - their number from top to bottom, and from left to right
 * @param {[number, number]} reach - largest shift along x and y, pixels of the map
 * @param {number} unit - power of e by which a match of a median more is rarer
 */
function shiftsOfParts(matches, map, [down, across], [reachX, reachY], unit) {
  const ys = divided(map.height, down);
  const xs = divided(map.width, across);
  const wide = 2 * reachX + 1;
  /** @type {Shifts} */
  const found = { places: [], seen: [], heights: [] };
  matches.forEach((match, part) => {
    const squared = new Float32Array(match[0].length);
    for (const shown of match) {
      for (let i = 0; i < squared.length; i++) squared[i] += shown[i] * shown[i];
    }
    const best = squared.indexOf(squared.reduce((most, each) => Math.max(most, each)));
    found.heights.push((unit * squared[best]) / (median(squared) + 1e-12));
    const row = Math.floor(part / across);
    const col = part % across;
    const x = best % wide;
    const y = Math.floor(best / wide);
    const placeX = (xs[col] + xs[col + 1] - 1) / 2;
    const placeY = (ys[row] + ys[row + 1] - 1) / 2;
    const line = squared.subarray(y * wide, (y + 1) * wide);
    const column = Float32Array.from({ length: 2 * reachY + 1 }, (_, k) => squared[k * wide + x]);
    found.places.push([placeX, placeY]);
    found.seen.push([
      placeX + x - reachX + peakOffset(line, x),
      placeY + y - reachY + peakOffset(column, y),
    ]);
  });
  return found;
}

/**
 * Fit a transform to the shifts of clear parts.
 *
 * @param {Shifts} shifts
 * @param {Layout} layout
 * @param {{ width: number, height: number }} map
 * @returns {{ HOldFromNew: Float64Array, parts: number } | null} as `coarseShift`
 */
function fittedShift({ places, seen, heights }, layout, map) {
  const scale = resizedHomography(layout.width / map.width, layout.height / map.height);
  const clear = heights.map((_, i) => i).filter((i) => heights[i] > CLEAR);
  const [place, old] = [places, seen].map((points) =>
    transform(scale, clear.map((i) => points[i])),
  );
  const same = SAME_BLOCKS * Math.min(layout.width / layout.cols, layout.height / layout.rows);
  const count = clear.length;
  if (count === 0) return null;
  if (count >= FEW && heights.length > 1) {
    const [from, to] = [place, old].map((points) => Float64Array.from(points.flat()));
    const fit = fitMotion(from, to, same, count < MANY);
    return fit && fit.count >= FEW ? { HOldFromNew: fit.H, parts: fit.count } : null;
  }
  let best = 0;
  for (let i = 1; i < count; i++) if (heights[clear[i]] > heights[clear[best]]) best = i;
  const shifts = old.map(([x, y], i) => [x - place[i][0], y - place[i][1]]);
  const [shiftX, shiftY] = shifts[best];
  const agree = shifts.filter(([x, y]) => Math.hypot(x - shiftX, y - shiftY) < same).length;
  if (heights.length > 1 && agree < 2) return null;
  return { HOldFromNew: Float64Array.of(1, 0, shiftX, 0, 1, shiftY, 0, 0, 1), parts: agree };
}

/**
 * Add up the matches of small parts to those of larger ones.
 *
 * @param {Matches[]} small
 * @param {[number, number]} numbers - of small parts from top to bottom, and from left to right
 * @param {[number, number]} parts - of larger ones
 * @returns {Matches[]}
 */
function joined(small, [rows, cols], [down, across]) {
  if (down === rows && across === cols) return small;
  const sums = Array.from({ length: down * across }, () =>
    small[0].map((match) => new Float32Array(match.length)),
  );
  small.forEach((matches, part) => {
    const row = Math.floor((Math.floor(part / cols) * down) / rows);
    const col = Math.floor(((part % cols) * across) / cols);
    matches.forEach((match, map) => {
      const sum = sums[row * across + col][map];
      for (let i = 0; i < sum.length; i++) sum[i] += match[i];
    });
  });
  return sums;
}

/**
 * @param {number} length - pixels
 * @param {number} count - of parts
 * @returns {number[]} where the parts begin and end
 */
function divided(length, count) {
  return Array.from({ length: count + 1 }, (_, i) => Math.floor((i * length) / count));
}

/**
 * Find the offset, within half a step, of a parabola's top through a maximum and its neighbours.
 *
 * @param {ArrayLike<number>} values
 * @param {number} at
 */
function peakOffset(values, at) {
  if (!(at > 0 && at < values.length - 1)) return 0;
  const [before, here, after] = [values[at - 1], values[at], values[at + 1]];
  const bend = before - 2 * here + after;
  return bend < 0 ? (0.5 * (before - after)) / bend : 0;
}

/**
 * What maps of a display show over time (`overDeviation`), for each frame, and their width and
 * height.
 *
 * @typedef {{ frames: Float32Array[], size: [number, number] }} Series
 */

/**
 * Shrink maps of a display to `ROUGH_PX` pixels a block.
 *
 * @param {readonly AnyPlane[]} views - of each frame
 * @param {Layout} layout
 * @returns {Series}
 */
export function roughSeries(views, { rows, cols }) {
  const [width, height] = [ROUGH_PX * cols, ROUGH_PX * rows];
  const frames = overDeviation(views.map((view) => areaMeans(view, width, height).data));
  return { frames, size: [width, height] };
}

/**
 * Find how a coded display may toggle of which it is not known where it lies.
 *
 * What a frame shows at each shift of the display, less the mean of all frames, is compared with
 * the expected changes. Only then are the clocks tried, all at once. The display may lie shifted as
 * a whole, or its parts each by itself.
 *
 * @param {Series} series - of maps of the display, such as `roughSeries`
 * @param {ArrayLike<number>} blocks - (rows * cols,) as of `coarseShift`
 * @param {Layout} layout - of the display
 * @param {readonly number[]} at - positions of the frames
 * @param {number} fps - nominal number of frames of the camera in a second
 * @returns {Steps<CodedToggling[]>}
 */
export function* shiftedTogglings({ frames, size }, blocks, layout, at, fps) {
  const [width, height] = size;
  const reach = reachOf({ width, height }, layout, true);
  const smallest = matchParts(frames, size, blocks, layout, reach, PARTS[1]);
  yield MATCH_WORK;
  const found = [];
  for (const parts of PARTS.slice(1)) {
    const matches = joined(smallest, PARTS[1], parts);
    found.push(new CodedToggling(codeSearch(layout, at, fps).highest(matches), layout.code));
    yield CLOCK_WORK;
  }
  return found;
}
