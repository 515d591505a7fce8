/**
 * Fill in what a frame pair does not show of the display, so that the rest can be decoded.
 *
 * A decoder fits its calibration to all pilots and refines it on all message blocks. Of those that
 * lie outside the image it would learn wrong things. So an unseen message block takes the pixels of
 * the nearest one that is seen, in both states alike, and an unseen pilot those of the nearest pilot
 * of the same bit that is seen. The decoder then has nothing to learn there. What it says of filled
 * blocks means nothing, and the receiver erases it.
 */

import { resizeArea } from "../../image/shrink.js";

/**
 * Tell which blocks of a frame pair are not seen.
 *
 * @param {Float64Array} purity - (n, n) largest shares of an exposure in the two states, in
 *   [0, 1], over the display; 0 where no frame holds anything
 * @param {Layout} layout - of the display
 * @returns {Uint8Array} (rows, cols) 1 for blocks with a part that no frame holds
 */
export function unseenBlocks(purity, { rows, cols }) {
  const n = Math.round(Math.sqrt(purity.length));
  const unseen = new Uint8Array(rows * cols);
  const held = Float32Array.from(purity, (share) => Number(share > 0));
  if (held.includes(0)) {
    const shares = resizeArea({ width: n, height: n, data: held }, cols, rows).data;
    shares.forEach((share, block) => (unseen[block] = Number(share < 1 - 1e-6)));
  }
  return unseen;
}

/**
 * Fill the unseen blocks of rectified images that show one picture.
 *
 * @param {BytePlane[]} images - of the layout's size
 * @param {Uint8Array} unseen - (rows, cols) 1 for blocks that are not seen
 * @param {Layout} layout - of the display
 * @returns {BytePlane[]} copies in which the unseen blocks are filled; the images themselves where
 *   nothing is unseen or no message block is seen. Pilots of a bit of which none is seen stay as
 *   they are.
 */
export function fillUnseen(images, unseen, layout) {
  const { messageMask } = layout;
  const seenMessage = messageMask.some((message, block) => message && !unseen[block]);
  if (!unseen.includes(1) || !seenMessage) return images;
  const filled = images.map((image) => ({ ...image, data: image.data.slice() }));
  copyNearest(filled, messageMask, unseen, layout);
  for (const bit of [0, 1]) {
    const pilots = new Uint8Array(unseen.length);
    layout.pilotBlocks.forEach((block, i) => {
      if (layout.pilotBits[i] === bit) pilots[block] = 1;
    });
    copyNearest(filled, pilots, unseen, layout);
  }
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
    const target = layout.cellBox(row, col);
    const source = layout.cellBox((best - bestCol) / cols, bestCol);
    for (const image of images) copyBox(image, source, target);
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
 * Copy the pixels of a box to another, whose sides may differ by a pixel.
 *
 * @param {BytePlane} image - changed
 * @param {[number, number, number, number]} source - as `Layout.cellBox` gives it
 * @param {[number, number, number, number]} target - likewise
 */
function copyBox({ width, data }, [fromTop, fromBottom, fromLeft, fromRight], target) {
  const [top, bottom, left, right] = target;
  for (let y = top; y < bottom; y++) {
    const row = fromTop + Math.floor(((y - top) * (fromBottom - fromTop)) / (bottom - top));
    for (let x = left; x < right; x++) {
      const across = Math.floor(((x - left) * (fromRight - fromLeft)) / (right - left));
      data[y * width + x] = data[row * width + fromLeft + across];
    }
  }
}
