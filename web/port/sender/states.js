/**
 * States of a loop over one picture, one after another, without a graphics card. They are those that
 * the player shows (sender/player.html), from the same tables.
 */

import { loop } from "../../generated/constants.js";
import { encode } from "../link/code/framing.js";
import { carrierOf } from "./loop.js";

/** @import { Content } from "../link/code/message.js" */
/** @import { Picture } from "../link/strength.js" */
/** @import { SendPreset } from "./loop.js" */

/** Opaque, in the highest byte of a pixel; red is in the lowest one. */
const OPAQUE = 255 << 24;

/**
 * Give the states of one loop, as `Loop.states` of link/loop.py does.
 *
 * @param {SendPreset} preset
 * @param {Uint8Array} offsets - 128 and the levels to add, as the player has them: red, green and
 *   blue of each pixel of a tile, for each change of each of four states
 * @param {Content} content - short enough for the preset
 * @param {Picture} picture - of the size at which it is shown
 */
export function* statesOf(preset, offsets, content, picture) {
  const { turned, shown, steps, patches } = carrierOf(preset, picture);
  const { width, height, data } = shown;
  const { rows, cols, order } = preset.loop;
  const [known] = preset.loop.known;
  const bits = encode(content, preset.n_bits);
  const given = bits.length / preset.n_bits;
  // No sum of a level and its offset leaves 0 to 255, so that those of all channels are added at once.
  const levels = numbersOf(data, 0).map((number) => number + OPAQUE);
  const added = numbersOf(offsets, 128);
  const column = Int32Array.from({ length: width }, (_, x) => Math.floor((x * cols) / width));
  const [right, down, first] = turned ? [-height, 1, (width - 1) * height] : [1, width, 0];
  for (let number = 0; number < pairsOf(given, order.length); number++) {
    const pair = number % given;
    let at = pair * preset.n_bits;
    const changes = Uint8Array.from(known, (letter, block) => {
      const bit = letter === "." ? bits[at++] : Number(letter);
      return bit + 2 * (steps ? steps[block] : 0);
    });
    const before = Number(order[number % order.length]); // 1 where the embedded frame comes first
    for (const embedded of [before, 1 - before]) {
      const table = added.subarray(((2 * (pair % 2) + embedded) * added.length) / 4);
      const state = new Int32Array(width * height);
      for (let y = 0, i = 0; y < height; y++) {
        const row = Math.floor((y * rows) / height) * cols;
        const tile = (y & 3) << 2;
        for (let x = 0, to = first + y * down; x < width; x++, i++, to += right) {
          const change = (patches && patches[i]) || changes[row + column[x]];
          state[to] = levels[i] + table[(change << 4) | tile | (x & 3)];
        }
      }
      const [across, high] = turned ? [height, width] : [width, height];
      yield { width: across, height: high, data: new Uint8ClampedArray(state.buffer) };
    }
  }
}

/**
 * Write red, green and blue of each pixel as one number.
 *
 * @param {Uint8Array} levels
 * @param {number} zero - the level that counts as 0
 */
function numbersOf(levels, zero) {
  const numbers = new Int32Array(levels.length / 3);
  for (let i = 0, at = 0; i < numbers.length; i++) {
    for (let unit = 1; unit < 2 ** 24; unit *= 256) numbers[i] += unit * (levels[at++] - zero);
  }
  return numbers;
}

/**
 * Count the frame pairs after which message and code both begin again. Where those are too many, the
 * code alone does, and the message breaks off.
 *
 * @param {number} given - frame pairs of the message
 * @param {number} period - of the code, in frame pairs
 */
function pairsOf(given, period) {
  const most = Math.max(given, loop.MOST_WHOLE);
  let whole = given;
  while (whole % period && whole <= most) whole += given;
  return whole <= most ? whole : Math.ceil(given / period) * period;
}
