/** Turned and foreshortened patches, as small images to compare parts of a photograph with. */

import { receiverLocateSpots } from "../../../generated/constants.js";
import { call, rowsOf } from "../../image/opencv.js";
import { TILES } from "../../link/ratex.js";

export const { SEEN_PX, WINDOW_PX } = receiverLocateSpots;
const { TURNS, SHAPES, SHIFTS, MIN_MATCH, DRAWN_PX, DRAWN_BLUR_PX } = receiverLocateSpots;

/** Number of templates of each patch. */
const EACH = TURNS * SHAPES.length;

/** Numbers of the templates that OpenCV's memory keeps, by the patches. @type {Map<string, number>} */
const banks = new Map();

/**
 * Draw the templates of a layout's patches, once.
 *
 * @param {Layout} layout - with patches
 * @returns {number} the number by which `compare` knows them
 */
export function bankOf(layout) {
  const key = layout.tileLevelsToggled.join(";");
  const known = banks.get(key);
  if (known !== undefined) return known;
  const patches = rowsOf(layout.tileLevelsToggled);
  const data = layout.bankDirections;
  const directions = { width: WINDOW_PX ** 2, height: data.length / WINDOW_PX ** 2, data };
  const sizes = [TURNS, TILES, DRAWN_PX, DRAWN_BLUR_PX, SEEN_PX, WINDOW_PX];
  const bank = call("keepBank", [patches, Float64Array.from(SHAPES.flat()), ...sizes, directions]);
  banks.set(key, bank);
  return bank;
}

/**
 * Where a template was compared, which one, and the correlation.
 *
 * @typedef {{ left: number, top: number, turn: number, match: number }} BestTemplate
 */

/**
 * Compare windows of an image with the templates of all patches.
 *
 * @param {number} bank
 * @param {number} patches - their number
 * @param {BytePlane} image
 * @param {Point[]} spots - pixels
 * @returns {(BestTemplate | null)[][]} what matches each patch best around each spot: left and top
 *   of the window, the direction of the display's x axis in radians, and the correlation; null
 *   where nothing matches
 */
export function compare(bank, patches, image, spots) {
  const numbers = new Float64Array(4 * patches * spots.length);
  const places = [Int32Array.from(spots.flat()), Int32Array.from(SHIFTS)];
  call("bestTemplates", [bank, image, ...places, MIN_MATCH], [numbers]);
  return spots.map((_, spot) =>
    Array.from({ length: patches }, (_, patch) => {
      const [number, left, top, match] = numbers.subarray(4 * (spot * patches + patch));
      const turn = (Math.floor((number % EACH) / SHAPES.length) * 2 * Math.PI) / TURNS;
      return match > MIN_MATCH ? { left, top, turn, match } : null;
    }),
  );
}
