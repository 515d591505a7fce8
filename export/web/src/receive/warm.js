/**
 * Let a receiver read short films that are drawn here, before the first frame of a camera.
 *
 * Browsers compile code while it runs: the first frames take many times as long as later ones, and
 * a camera does not wait. So all parts of the receiver run on small frames first, in which a
 * display of each kind, with patches and with pilots, is to be found, followed, and decoded.
 */

import { homographyFromCorners } from "../link/geometry.js";
import { Layout } from "../link/layout.js";
import { inverse } from "../link/linear.js";
import { TILES } from "../link/ratex.js";
import { warped } from "../image/warp.js";
import { pilotSigns } from "../locate/pilots/evidence.js";
import { Receiver } from "./receiver.js";

/** Width and height, in pixels, of the films. */
const SIZE = [480, 270];
/** Corners of the display in them, in pixels. @type {Point[]} */
const CORNERS = [
  [74, 22],
  [398, 28],
  [403, 248],
  [68, 244],
];
/** Frames a second of the films, and number of frames for which a state is shown. */
const [FPS, HELD] = [30, 2];
/** Number of frame pairs that are decoded, and largest number of frames until then. */
const [DECODED, FRAMES] = [2, 60];
/** Gray levels by which blocks toggle, and largest noise of a pixel. */
const [TOGGLED, NOISE] = [6, 3];
/** Gray level of the room around the display. */
const ROOM = 40;
/** Factor of a patch's gray levels, so that there is room above for the change. */
const FAINTER = 0.9;
/** Pixels along each side of the squares that make up the displayed picture. */
const SQUARE_PX = 12;
/** Gray levels by which these squares differ at most. */
const CONTRAST = 40;

/**
 * Read a film of each kind of display, until frame pairs are decoded or it has taken long enough.
 *
 * @param {readonly Layout[]} layouts - those that will be looked for
 * @param {number} [mostMs] - time after which no further frame is read, milliseconds
 * @returns {Promise<number>} the number of frame pairs that were decoded
 */
export async function warmUp(layouts, mostMs = Infinity) {
  const end = performance.now() + mostMs;
  const kinds = [
    layouts.find(({ ratex }) => ratex.length > 0),
    layouts.find(({ pilotBlocks }) => pilotBlocks.length > 0),
  ];
  let decoded = 0;
  for (const known of kinds) {
    if (known === undefined) continue;
    const layout = halved(known);
    const receiver = new Receiver([{ layout, decode: async () => guesses(layout) }], FPS);
    const states = [0, 1].map((embedded) => inRoom(displayed(layout, embedded)));
    for (let frame = 0; frame < FRAMES && receiver.decoded < DECODED; frame++) {
      if (performance.now() >= end) break;
      const state = states[Math.floor(frame / HELD) % states.length];
      await receiver.push(noisy(state, frame), frame / FPS);
    }
    decoded += receiver.decoded;
  }
  return decoded;
}

/**
 * Take a layout with half as many pixels along each axis, so that all takes less time.
 *
 * @param {Layout} layout
 * @returns {Layout}
 */
function halved(layout) {
  const { width, height } = layout;
  return Object.assign(Object.create(Layout.prototype), layout, {
    width: width >> 1,
    height: height >> 1,
  });
}

/**
 * Draw what a display shows: a picture, patches or pilots, and bits.
 *
 * @param {Layout} layout
 * @param {number} embedded - 1 in embedded frames, 0 in original ones
 * @returns {BytePlane}
 */
function displayed(layout, embedded) {
  const { width, height, rows, cols } = layout;
  const toggled = TOGGLED * (embedded - 0.5);
  const changes = new Float32Array(rows * cols);
  for (const block of layout.messageBlocks) changes[block] = hashed(block) < 0.5 ? -1 : 1;
  if (layout.pilotBlocks.length > 0) {
    const signs = pilotSigns(layout);
    layout.pilotBlocks.forEach((block, pilot) => (changes[block] = signs[pilot]));
  }
  const data = new Uint8Array(width * height);
  for (let y = 0, at = 0; y < height; y++) {
    const row = Math.floor((y * rows) / height);
    for (let x = 0; x < width; x++, at++) {
      const change = changes[row * cols + Math.floor((x * cols) / width)];
      const square = Math.floor(y / SQUARE_PX) * width + Math.floor(x / SQUARE_PX);
      data[at] = 100 + CONTRAST * hashed(square) + toggled * change;
    }
  }
  layout.ratex.forEach(([row, col], patch) => {
    const [top, bottom, left, right] = layout.cellBox(row, col);
    for (let y = top; y < bottom; y++) {
      const down = Math.floor(((y - top) * TILES) / (bottom - top));
      for (let x = left; x < right; x++) {
        const across = Math.floor(((x - left) * TILES) / (right - left));
        const tile = down * TILES + across;
        const change = TOGGLED * embedded * layout.tileLabels[patch][tile];
        data[y * width + x] = FAINTER * layout.tileLevels[patch][tile] + change;
      }
    }
  });
  return { width, height, data };
}

/**
 * Show a display in a room.
 *
 * @param {BytePlane} display
 * @returns {BytePlane} of size `SIZE`
 */
function inRoom(display) {
  const [width, height] = SIZE;
  const H = inverse(homographyFromCorners(CORNERS, display.width, display.height));
  const seen = warped(display, H, width, height);
  const [right, bottom] = [display.width - 0.5, display.height - 0.5];
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at++) {
      const w = H[6] * x + H[7] * y + H[8];
      const across = (H[0] * x + H[1] * y + H[2]) / w;
      const down = (H[3] * x + H[4] * y + H[5]) / w;
      const inside = across >= -0.5 && across < right && down >= -0.5 && down < bottom;
      if (!inside) seen.data[at] = ROOM + 20 * hashed((y >> 5) * 64 + (x >> 5));
    }
  }
  return seen;
}

/**
 * Add noise to a frame.
 *
 * @param {BytePlane} state
 * @param {number} frame - number of the frame, of which each has its own noise
 * @returns {BytePlane}
 */
function noisy({ width, height, data }, frame) {
  const noise = Int8Array.from({ length: 997 }, (_, at) => {
    return Math.round(NOISE * (2 * hashed(frame * 997 + at) - 1));
  });
  return { width, height, data: data.map((level, at) => level + noise[at % noise.length]) };
}

/**
 * Say scores of bits that were drawn, so that no message comes of them.
 *
 * @param {Layout} layout
 */
function guesses({ nBits }) {
  return { scores: Float32Array.from({ length: nBits }, (_, bit) => (hashed(bit) < 0.5 ? -4 : 4)) };
}

/**
 * Draw a number that looks like chance.
 *
 * @param {number} number - whole
 * @returns {number} in [0, 1)
 */
function hashed(number) {
  let mixed = Math.imul(number ^ (number >>> 15), 0x2c1b3c6d);
  mixed = Math.imul(mixed ^ (mixed >>> 12), 0x297a2d39);
  return ((mixed ^ (mixed >>> 15)) >>> 0) / 2 ** 32;
}
