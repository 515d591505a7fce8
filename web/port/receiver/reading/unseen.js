/**
 * Fill in what a frame pair does not show of the display, so that the rest can be decoded.
 *
 * A decoder fits its calibration to all ratex patches or pilots and refines it on all message
 * blocks. Of those that lie outside the image, or behind a hand, it would learn wrong things. So an
 * unseen message block takes the pixels of the nearest one that is seen, in both states alike, and
 * an unseen pilot those of the nearest pilot of the same bit that is seen. The tiles of an unseen
 * patch take those of patches that are seen: mixed from the two tiles of the same label whose
 * levels lie next to theirs. The decoder then has nothing to learn there. What it says of filled
 * blocks means nothing, and the receiver erases it.
 */

import { receiverReadingUnseen } from "../../../generated/constants.js";
import { roundHalfEven } from "../../image/round.js";
import { resizeArea } from "../../image/shrink.js";
import { CLEAR_MATCH, TILES, matchPatches } from "../../link/ratex.js";

/** @typedef {{ top: number, bottom: number, left: number, right: number }} Box */

const { LEAST_CLEAR } = receiverReadingUnseen;

/**
 * Tell which blocks of a frame pair are not seen.
 *
 * @param {BytePlane} original - rectified
 * @param {BytePlane} embedded - of the other state, of the size of `original`
 * @param {Float64Array} purity - (n, n) largest shares of an exposure in the two states, in
 *   [0, 1], over the display; 0 where no frame holds anything
 * @param {Layout} layout - with patches or pilots, or without either
 * @returns {Uint8Array} (rows, cols) 1 for blocks with a part that no frame holds, and for patches
 *   that something covers; nothing tells whether something covers a pilot
 */
export function unseenBlocks(original, embedded, purity, layout) {
  const { rows, cols } = layout;
  const n = Math.round(Math.sqrt(purity.length));
  const unseen = new Uint8Array(rows * cols);
  const held = Float32Array.from(purity, (share) => Number(share > 0));
  if (held.includes(0)) {
    const shares = resizeArea({ width: n, height: n, data: held }, cols, rows).data;
    shares.forEach((share, block) => (unseen[block] = Number(share < 1 - 1e-6)));
  }
  if (layout.ratex.length === 0) return unseen;
  const [one, two] = [original, embedded].map((image) => matchPatches(image, layout).correlation);
  layout.ratex.forEach(([row, col], patch) => {
    if (Math.min(one[patch], two[patch]) < CLEAR_MATCH) unseen[row * cols + col] = 1;
  });
  return unseen;
}

/**
 * Fill the unseen blocks of rectified images that show one picture.
 *
 * @param {BytePlane[]} images - of the layout's size
 * @param {Uint8Array} unseen - (rows, cols) 1 for blocks that are not seen
 * @param {Layout} layout - with patches or pilots, or without either
 * @returns {BytePlane[]} copies in which the unseen blocks are filled; the images themselves where
 *   nothing is unseen, no message block is seen, or the layout has patches of which fewer than
 *   `LEAST_CLEAR` are seen. Pilots of a bit of which none is seen stay as they are.
 */
export function fillUnseen(images, unseen, layout) {
  const { cols, ratex, messageMask } = layout;
  const patches = [...ratex.keys()];
  const seenPatches = patches.filter((i) => !unseen[ratex[i][0] * cols + ratex[i][1]]);
  const fewPatches = ratex.length > 0 && seenPatches.length < LEAST_CLEAR;
  const seenMessage = messageMask.some((message, block) => message && !unseen[block]);
  if (!unseen.includes(1) || !seenMessage || fewPatches) return images;
  const filled = images.map((image) => ({ ...image, data: image.data.slice() }));
  copyNearest(filled, messageMask, unseen, layout);
  for (const bit of [0, 1]) {
    const pilots = new Uint8Array(unseen.length);
    layout.pilotBlocks.forEach((block, i) => {
      if (layout.pilotBits[i] === bit) pilots[block] = 1;
    });
    copyNearest(filled, pilots, unseen, layout);
  }
  mixTiles(filled, seenPatches, layout);
  return filled;
}

/**
 * Give each unseen block of a kind, in place, the pixels of the nearest one that is seen.
 *
 * Distances count steps along rows and columns; of blocks equally near the first in reading order
 * is taken.
 *
 * @param {BytePlane[]} images
 * @param {Uint8Array} kind - (rows, cols) 1 for blocks that may stand for each other
 * @param {Uint8Array} unseen - (rows, cols) 1 for blocks that are not seen
 * @param {Layout} layout - of the images
 */
function copyNearest(images, kind, unseen, layout) {
  const { rows, cols } = layout;
  const seen = kind.map((is, block) => is & ~unseen[block]);
  if (!seen.includes(1)) return;
  const nearest = nearestInRows(seen, rows, cols);
  for (let block = 0; block < kind.length; block++) {
    if (!kind[block] || !unseen[block]) continue;
    const col = block % cols;
    const row = (block - col) / cols;
    let best = -1;
    let least = Infinity;
    for (let other = 0; other < rows; other++) {
      const from = nearest[other * cols + col];
      const apart = Math.abs(from - col) + Math.abs(other - row);
      if (from >= 0 && apart < least) {
        least = apart;
        best = other * cols + from;
      }
    }
    const bestCol = best % cols;
    const target = boxOf(layout, row, col);
    const source = boxOf(layout, (best - bestCol) / cols, bestCol);
    for (const image of images) mixBoxes(image, source, source, 0, target);
  }
}

/**
 * Find, for each block, the column of the nearest block in its row that is seen, or -1.
 *
 * @param {Uint8Array} seen - (rows, cols)
 * @param {number} rows
 * @param {number} cols
 * @returns {Int32Array} (rows, cols)
 */
function nearestInRows(seen, rows, cols) {
  const nearest = new Int32Array(rows * cols).fill(-1);
  for (let start = 0; start < rows * cols; start += cols) {
    for (let col = 0, last = -1; col < cols; col++) {
      if (seen[start + col]) last = col;
      nearest[start + col] = last;
    }
    for (let col = cols - 1, next = -1; col >= 0; col--) {
      if (seen[start + col]) next = col;
      const before = nearest[start + col];
      // of two equally near ones the first is taken
      if (next >= 0 && (before < 0 || next - col < col - before)) nearest[start + col] = next;
    }
  }
  return nearest;
}

/**
 * Mix the tiles of unseen patches, in place, from those of the patches that are seen.
 *
 * @param {BytePlane[]} images
 * @param {number[]} seenPatches - numbers of the patches that are seen
 * @param {Layout} layout
 */
function mixTiles(images, seenPatches, layout) {
  const { ratex, tileLevels, tileLabels } = layout;
  const known = seenPatches.flatMap((patch) =>
    tileLevels[patch].map((level, tile) => ({
      level,
      label: tileLabels[patch][tile],
      box: tileBox(layout, patch, tile),
    })),
  );
  known.sort((one, other) => one.level - other.level);
  for (let patch = 0; patch < ratex.length; patch++) {
    if (seenPatches.includes(patch)) continue;
    for (let tile = 0; tile < TILES * TILES; tile++) {
      const level = tileLevels[patch][tile];
      const alike = known.filter(({ label }) => label === tileLabels[patch][tile]);
      const below = alike.filter((other) => other.level <= level).at(-1) ?? alike[0];
      const above = alike.find((other) => other.level >= level) ?? alike[alike.length - 1];
      const part = (level - below.level) / Math.max(above.level - below.level, 1);
      const share = Math.min(Math.max(part, 0), 1);
      const target = tileBox(layout, patch, tile);
      for (const image of images) mixBoxes(image, below.box, above.box, share, target);
    }
  }
}

/**
 * Mix the pixels of two boxes into a third; sizes of boxes may differ by a pixel.
 *
 * @param {BytePlane} image - changed
 * @param {Box} one
 * @param {Box} two
 * @param {number} share - of the second one, in [0, 1]
 * @param {Box} target
 */
function mixBoxes({ width, data }, one, two, share, target) {
  const tall = target.bottom - target.top;
  const wide = target.right - target.left;
  const rest = Math.fround(1 - share);
  const part = Math.fround(share);
  /**
   * @param {Box} box
   * @param {number} y
   * @param {number} x
   */
  const at = (box, y, x) => {
    const row = box.top + Math.floor((y * (box.bottom - box.top)) / tall);
    return data[row * width + box.left + Math.floor((x * (box.right - box.left)) / wide)];
  };
  for (let y = 0; y < tall; y++) {
    for (let x = 0; x < wide; x++) {
      const mixed = Math.fround(at(one, y, x) * rest) + Math.fround(at(two, y, x) * part);
      data[(target.top + y) * width + target.left + x] = roundHalfEven(Math.fround(mixed));
    }
  }
}

/**
 * @param {Layout} layout
 * @param {number} row
 * @param {number} col
 */
function boxOf(layout, row, col) {
  const [top, bottom, left, right] = layout.cellBox(row, col);
  return { top, bottom, left, right };
}

/**
 * Find the pixels of a tile.
 *
 * @param {Layout} layout
 * @param {number} patch
 * @param {number} tile - number in the patch, row by row
 */
function tileBox({ rows, cols, width, height, ratex }, patch, tile) {
  const row = TILES * ratex[patch][0] + Math.floor(tile / TILES);
  const col = TILES * ratex[patch][1] + (tile % TILES);
  return {
    top: Math.ceil((row * height) / (TILES * rows)),
    bottom: Math.ceil(((row + 1) * height) / (TILES * rows)),
    left: Math.ceil((col * width) / (TILES * cols)),
    right: Math.ceil(((col + 1) * width) / (TILES * cols)),
  };
}
