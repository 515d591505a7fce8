/** Turned and foreshortened patches, as small images that parts of a photograph are compared with. */

import { blurred } from "../image/blur.js";
import { TILES } from "../link/ratex.js";

/** @typedef {import("../link/layout.js").Layout} Layout */

/** Side, in pixels of the resized image, of a patch. */
export const SEEN_PX = 15;
/** Side, in pixels of the resized image, of the window that is compared. */
export const WINDOW_PX = 15;
/** Number of pixels of a window. */
export const WINDOW_AREA = WINDOW_PX * WINDOW_PX;
/** Number of directions of a patch that are tried. */
const TURNS = 24;
/** Foreshortenings of a patch's two axes, and shears, that are tried. */
const SHAPES = [
  [1.0, 1.0, 0.0],
  [0.65, 1.0, 0.0],
  [1.0, 0.65, 0.0],
  [0.42, 1.0, 0.0],
  [1.0, 0.42, 0.0],
  [0.75, 0.75, 0.45],
  [0.75, 0.75, -0.45],
];
/** Number of templates of each patch. */
const EACH = TURNS * SHAPES.length;
/** Pixels along each axis of a tile from which templates are sampled. */
const DRAWN_PX = 8;
/** Standard deviation, in pixels, of the blur of what templates are sampled from. */
const DRAWN_BLUR = 1.6;
/**
 * Number of directions in the space of windows along which all templates are compared. The rest
 * of a window and the rest of a template have lengths, which bound what the rest can add to the
 * correlation; only where that could make a match is the whole window compared.
 */
const LEADING = 16;

/** The templates of a layout's patches. */
export class Bank {
  /** @type {Float32Array} */
  #templates;
  /** (LEADING, WINDOW_AREA) orthonormal directions. @type {Float64Array} */
  #directions;
  /** (templates, LEADING) @type {Float32Array} */
  #leading;
  /** (templates,) lengths of what the directions leave. @type {Float32Array} */
  #rest;
  #window = new Float64Array(WINDOW_AREA);
  #part = new Float64Array(LEADING);

  /** @param {Layout} layout */
  constructor(layout) {
    /** Number of patches. */
    this.patches = layout.ratex.length;
    const count = this.patches * EACH;
    this.#templates = new Float32Array(count * WINDOW_AREA);
    layout.tileLevelsToggled.forEach((tiles, patch) => {
      drawTemplates(tiles, this.#templates.subarray(patch * EACH * WINDOW_AREA));
    });
    this.#directions = mainDirections(this.#templates, count);
    this.#leading = new Float32Array(count * LEADING);
    this.#rest = new Float32Array(count);
    for (let t = 0; t < count; t++) {
      const template = this.#templates.subarray(t * WINDOW_AREA, (t + 1) * WINDOW_AREA);
      const part = this.#leading.subarray(t * LEADING, (t + 1) * LEADING);
      this.#rest[t] = split(template, this.#directions, part);
    }
  }

  /**
   * Compare a window of an image with the templates of all patches.
   *
   * @param {Float32Array} data - of the image
   * @param {number} width - of the image, pixels
   * @param {number} start - number of the window's first pixel
   * @param {Float64Array} most - (patches,) least correlation that counts; takes what is found
   * @param {(patch: number, turn: number) => void} note - called where a template of a patch
   *   correlates more than `most`, with the direction of the display's x axis, radians
   */
  compare(data, width, start, most, note) {
    const window = this.#window;
    let sum = 0;
    for (let row = 0, to = 0; row < WINDOW_PX; row++) {
      const line = start + row * width;
      for (let col = 0; col < WINDOW_PX; col++) sum += window[to++] = data[line + col];
    }
    const mean = sum / WINDOW_AREA;
    let square = 0;
    for (let i = 0; i < WINDOW_AREA; i++) square += (window[i] -= mean) ** 2;
    const norm = Math.sqrt(square) + 5;
    for (let i = 0; i < WINDOW_AREA; i++) window[i] /= norm;
    const part = this.#part;
    const rest = split(window, this.#directions, part);
    const templates = this.#templates;
    const leading = this.#leading;
    for (let patch = 0, t = 0; patch < this.patches; patch++) {
      for (let i = 0; i < EACH; i++, t++) {
        let match = 0;
        for (let k = 0, at = t * LEADING; k < LEADING; k++) match += part[k] * leading[at + k];
        if (match + rest * this.#rest[t] <= most[patch]) continue;
        match = 0;
        for (let k = 0, at = t * WINDOW_AREA; k < WINDOW_AREA; k++) {
          match += window[k] * templates[at + k];
        }
        if (match <= most[patch]) continue;
        most[patch] = match;
        note(patch, (Math.floor(i / SHAPES.length) * 2 * Math.PI) / TURNS);
      }
    }
  }
}

/** @type {WeakMap<Layout, Bank>} */
const banks = new WeakMap();

/**
 * Draw the templates of a layout, once.
 *
 * @param {Layout} layout - with patches
 * @returns {Bank}
 */
export function bankOf(layout) {
  let bank = banks.get(layout);
  if (!bank) {
    bank = new Bank(layout);
    banks.set(layout, bank);
  }
  return bank;
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
  const fine = blurred({ width: size, height: size, data: flat }, DRAWN_BLUR, "replicate").data;
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

/**
 * Find orthonormal directions along which templates lie: those of the templates themselves that
 * the directions found so far leave longest.
 *
 * @param {Float32Array} templates - (count, WINDOW_AREA)
 * @param {number} count
 * @returns {Float64Array} (LEADING, WINDOW_AREA)
 */
function mainDirections(templates, count) {
  const left = Float64Array.from(templates);
  const directions = new Float64Array(LEADING * WINDOW_AREA);
  for (let k = 0; k < LEADING; k++) {
    let [longest, square] = [0, -1];
    for (let t = 0; t < count; t++) {
      let sum = 0;
      for (let i = t * WINDOW_AREA; i < (t + 1) * WINDOW_AREA; i++) sum += left[i] * left[i];
      if (sum > square) [longest, square] = [t, sum];
    }
    const norm = Math.sqrt(square) + 1e-12;
    const direction = left
      .slice(longest * WINDOW_AREA, (longest + 1) * WINDOW_AREA)
      .map((value) => value / norm);
    directions.set(direction, k * WINDOW_AREA);
    for (let t = 0; t < count; t++) {
      let dot = 0;
      for (let i = 0; i < WINDOW_AREA; i++) dot += left[t * WINDOW_AREA + i] * direction[i];
      for (let i = 0; i < WINDOW_AREA; i++) left[t * WINDOW_AREA + i] -= dot * direction[i];
    }
  }
  return directions;
}

/**
 * Split a window into its parts along the directions, and what they leave.
 *
 * @param {Float32Array | Float64Array} window
 * @param {Float64Array} directions
 * @param {Float32Array | Float64Array} part - takes the (LEADING,) parts
 * @returns {number} length of what is left
 */
function split(window, directions, part) {
  let left = 0;
  for (let i = 0; i < WINDOW_AREA; i++) left += window[i] * window[i];
  for (let k = 0, at = 0; k < LEADING; k++) {
    let dot = 0;
    for (let i = 0; i < WINDOW_AREA; i++) dot += window[i] * directions[at++];
    part[k] = dot;
    left -= dot * dot;
  }
  return Math.sqrt(Math.max(0, left)) + 1e-6;
}
