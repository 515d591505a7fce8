/** Turned and foreshortened patches, as small images to compare parts of a photograph with. */

import { locateSpots } from "../generated/constants.js";
import { blurred } from "../image/blur.js";
import { BEYOND, call, floatPlane } from "../image/opencv.js";
import { TILES } from "../link/ratex.js";

export const { SEEN_PX, WINDOW_PX } = locateSpots;
const { TURNS, SHAPES, SHIFTS, MIN_MATCH, DRAWN_PX, DRAWN_BLUR_PX } = locateSpots;

/** Number of pixels of a window. */
const WINDOW_AREA = WINDOW_PX * WINDOW_PX;
/** Number of templates of each patch. */
const EACH = TURNS * SHAPES.length;
/** Units of work of drawing the templates of a patch. */
const DRAW_WORK = 2;

/** Numbers of the templates that OpenCV's memory keeps, by the patches. @type {Map<string, number>} */
const banks = new Map();

/**
 * Draw the templates of a layout's patches, once.
 *
 * @param {Layout} layout - with patches
 * @returns {Steps<number>} the number by which `compare` knows them
 */
export function* bankSteps(layout) {
  const key = layout.tileLevelsToggled.join(";");
  const known = banks.get(key);
  if (known !== undefined) return known;
  const count = layout.ratex.length * EACH;
  const templates = floatPlane(WINDOW_AREA, count);
  for (let patch = 0; patch < layout.ratex.length; patch++) {
    const start = patch * EACH * WINDOW_AREA;
    drawTemplates(layout.tileLevelsToggled[patch], templates.data.subarray(start));
    yield DRAW_WORK;
  }
  const data = layout.bankDirections;
  const directions = { width: WINDOW_AREA, height: data.length / WINDOW_AREA, data };
  const bank = call("keepBank", [templates, directions]);
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

/**
 * Draw a patch in all turns and shapes, with mean 0 and norm 1.
 *
 * @param {number[]} tiles - levels of the patch's tiles
 * @param {Float32Array} templates - takes (EACH, WINDOW_AREA)
 */
function drawTemplates(tiles, templates) {
  const size = TILES * DRAWN_PX;
  const centre = tiles.reduce((sum, level) => sum + level, 0) / tiles.length;
  const flat = Float32Array.from({ length: size * size }, (_, at) => {
    const row = Math.floor(at / size / DRAWN_PX);
    return tiles[row * TILES + Math.floor((at % size) / DRAWN_PX)] - centre;
  });
  const fine = blurred({ width: size, height: size, data: flat }, DRAWN_BLUR_PX, BEYOND.replicate).data;
  const middle = fine.reduce((sum, level) => sum + level, 0) / fine.length;
  for (let at = 0; at < fine.length; at++) fine[at] -= middle;
  const pixel = (/** @type {number} */ x, /** @type {number} */ y) =>
    x >= 0 && y >= 0 && x < size && y < size ? fine[y * size + x] : 0;
  const half = WINDOW_PX >> 1;
  let to = 0;
  for (let turn = 0; turn < TURNS; turn++) {
    const cos = Math.cos((turn * 2 * Math.PI) / TURNS);
    const sin = Math.sin((turn * 2 * Math.PI) / TURNS);
    for (const [wide, high, shear] of SHAPES) {
      const template = templates.subarray(to, to + WINDOW_AREA);
      to += WINDOW_AREA;
      for (let y = -half, at = 0; y <= half; y++) {
        for (let x = -half; x <= half; x++) {
          const across = cos * x + sin * y;
          const down = cos * y - sin * x;
          const u = ((across - shear * down) / (SEEN_PX * wide) + 0.5) * size - 0.5;
          const v = ((down - shear * across) / (SEEN_PX * high) + 0.5) * size - 0.5;
          const [left, top] = [Math.floor(u), Math.floor(v)];
          const above =
            pixel(left, top) + (pixel(left + 1, top) - pixel(left, top)) * (u - left);
          const below =
            pixel(left, top + 1) + (pixel(left + 1, top + 1) - pixel(left, top + 1)) * (u - left);
          template[at++] = above + (below - above) * (v - top);
        }
      }
      const mean = template.reduce((sum, level) => sum + level, 0) / WINDOW_AREA;
      for (let at = 0; at < WINDOW_AREA; at++) template[at] -= mean;
      const norm = Math.sqrt(template.reduce((sum, level) => sum + level * level, 0));
      for (let at = 0; at < WINDOW_AREA; at++) template[at] /= norm;
    }
  }
}
