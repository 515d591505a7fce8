/** Turned and foreshortened patches, as small images to compare parts of a photograph with. */

import { locateSpots, webTables } from "../generated/constants.js";
import { blurred } from "../image/blur.js";
import { TILES } from "../link/ratex.js";

export const { SEEN_PX, WINDOW_PX } = locateSpots;
const { TURNS, SHAPES, DRAWN_PX, DRAWN_BLUR_PX } = locateSpots;
const { LEADING } = webTables;

/** Number of pixels of a window. */
export const WINDOW_AREA = WINDOW_PX * WINDOW_PX;
/** Number of templates of each patch. */
const EACH = TURNS * SHAPES.length;
/** Number of directions, the first ones, after which the bound is looked at for the first time. */
const FIRST = 10;
/** Units of work of drawing the templates of a patch, and of taking their parts. */
const DRAW_WORK = 2;
const PARTS_WORK = 4;

/** The templates of a layout's patches. */
export class Bank {
  /** @type {Float32Array} */
  #templates;
  /** (LEADING, WINDOW_AREA) orthonormal directions. @type {Float64Array} */
  #directions;
  /** (templates, FIRST) parts along the first directions. @type {Float64Array} */
  #first;
  /** (templates, LEADING - FIRST) parts along the other directions. @type {Float64Array} */
  #more;
  /**
   * (templates, 2) lengths of what the first and what all directions leave.
   *
   * @type {Float64Array}
   */
  #rest;
  #window = new Float64Array(WINDOW_AREA);
  #part = new Float64Array(LEADING);
  #left = new Float64Array(2);

  /**
   * @param {Float32Array} templates - (count, WINDOW_AREA), patch by patch
   * @param {Float64Array} directions - (LEADING, WINDOW_AREA)
   */
  constructor(templates, directions) {
    const count = templates.length / WINDOW_AREA;
    /** Number of patches. */
    this.patches = count / EACH;
    this.#templates = templates;
    this.#directions = directions;
    this.#first = new Float64Array(count * FIRST);
    this.#more = new Float64Array(count * (LEADING - FIRST));
    this.#rest = new Float64Array(2 * count);
    const template = new Float64Array(WINDOW_AREA);
    const part = new Float64Array(LEADING);
    for (let t = 0; t < count; t++) {
      template.set(templates.subarray(t * WINDOW_AREA, (t + 1) * WINDOW_AREA));
      split(template, directions, part, this.#rest.subarray(2 * t, 2 * t + 2));
      this.#first.set(part.subarray(0, FIRST), t * FIRST);
      this.#more.set(part.subarray(FIRST), t * (LEADING - FIRST));
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
    for (let i = 0; i < WINDOW_AREA; i++) {
      const apart = (window[i] -= mean);
      square += apart * apart;
    }
    const shrink = 1 / (Math.sqrt(square) + 5);
    for (let i = 0; i < WINDOW_AREA; i++) window[i] *= shrink;
    const part = this.#part;
    split(window, this.#directions, part, this.#left);
    const [firstRest, lastRest] = this.#left;
    const rest = this.#rest;
    const first = this.#first;
    const [p0, p1, p2, p3, p4, p5, p6, p7, p8, p9] = part; // as many as FIRST
    for (let patch = 0, t = 0; patch < this.patches; patch++) {
      let least = most[patch];
      for (let i = 0; i < EACH; i++, t++) {
        const at = t * FIRST;
        // sums of few terms, which the processor works out side by side
        const leading =
          p0 * first[at] +
          p1 * first[at + 1] +
          (p2 * first[at + 2] + p3 * first[at + 3]) +
          (p4 * first[at + 4] + p5 * first[at + 5]) +
          (p6 * first[at + 6] + p7 * first[at + 7] + (p8 * first[at + 8] + p9 * first[at + 9]));
        if (leading + firstRest * rest[2 * t] <= least) continue;
        const match = this.#correlation(t, leading, lastRest, least);
        if (match <= least) continue;
        least = most[patch] = match;
        note(patch, (Math.floor(i / SHAPES.length) * 2 * Math.PI) / TURNS);
      }
    }
  }

  /**
   * Correlate the window with a template, unless that is sure to be too little.
   *
   * @param {number} t - number of the template
   * @param {number} leading - what the first directions add to the correlation
   * @param {number} left - length of what all directions leave of the window
   * @param {number} least - correlation that must be exceeded
   * @returns {number} the correlation, or a bound of it that is no more than `least`
   */
  #correlation(t, leading, left, least) {
    const part = this.#part;
    const more = this.#more;
    let bound = leading + left * this.#rest[2 * t + 1];
    for (let k = FIRST, at = t * (LEADING - FIRST); k < LEADING; k++) bound += part[k] * more[at++];
    if (bound <= least) return bound;
    const window = this.#window;
    const templates = this.#templates;
    let match = 0;
    for (let k = 0, at = t * WINDOW_AREA; k < WINDOW_AREA; k++) {
      match += window[k] * templates[at + k];
    }
    return match;
  }
}

/** @type {WeakMap<Layout, Bank>} */
const banks = new WeakMap();

/**
 * Draw the templates of a layout, once.
 *
 * @param {Layout} layout - with patches
 * @returns {Steps<Bank>}
 */
export function* bankSteps(layout) {
  const known = banks.get(layout);
  if (known) return known;
  const templates = new Float32Array(layout.ratex.length * EACH * WINDOW_AREA);
  for (let patch = 0; patch < layout.ratex.length; patch++) {
    const start = patch * EACH * WINDOW_AREA;
    drawTemplates(layout.tileLevelsToggled[patch], templates.subarray(start));
    yield DRAW_WORK;
  }
  const bank = new Bank(templates, layout.bankDirections);
  banks.set(layout, bank);
  yield PARTS_WORK;
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
  const fine = blurred({ width: size, height: size, data: flat }, DRAWN_BLUR_PX, "replicate").data;
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
 * Split a window into its parts along the directions, four of them at once, and what they leave.
 *
 * @param {Float64Array} window
 * @param {Float64Array} directions
 * @param {Float64Array} part - takes the (LEADING,) parts
 * @param {Float64Array} rest - takes the lengths of what the first directions leave, and all
 */
function split(window, directions, part, rest) {
  for (let k = 0, at = 0; k < LEADING; k += 4, at += 4 * WINDOW_AREA) {
    let [a, b, c, d] = [0, 0, 0, 0];
    for (let i = 0, to = at; i < WINDOW_AREA; i++, to++) {
      const value = window[i];
      a += value * directions[to];
      b += value * directions[to + WINDOW_AREA];
      c += value * directions[to + 2 * WINDOW_AREA];
      d += value * directions[to + 3 * WINDOW_AREA];
    }
    part[k] = a;
    part[k + 1] = b;
    part[k + 2] = c;
    part[k + 3] = d;
  }
  let left = 0;
  for (let i = 0; i < WINDOW_AREA; i++) left += window[i] * window[i];
  for (let k = 0; k < LEADING; k++) {
    if (k === FIRST) rest[0] = length(left);
    left -= part[k] * part[k];
  }
  rest[1] = length(left);
}

/**
 * @param {number} square
 * @returns {number} a little more than the root, as numbers are rounded
 */
function length(square) {
  return Math.sqrt(Math.max(0, square)) + 1e-5;
}
