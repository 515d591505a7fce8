/**
 * A loop as the player takes it (sender/player.py): a picture, and the bits that it carries.
 *
 * Python works out all that does not depend on them: where pilots lie, which levels are added to a
 * pixel, and which levels leave room for that (web/host/tables.py).
 */

import { turned as quarterTurned } from "../image/turned.js";
import { encode } from "../link/code/framing.js";
import { blockSteps } from "../link/strength.js";
import { fromBase64, toBase64 } from "./base64.js";

/** @import { Content } from "../link/code/message.js" */
/** @import { Picture } from "../link/strength.js" */

/** Preset as `send_preset` of web/host/tables.py describes it. @typedef {any} SendPreset */

/**
 * Make the loop of a message.
 *
 * @param {SendPreset} preset
 * @param {Content} content - short enough for the preset
 * @param {Picture} picture - of the size at which it is shown
 * @returns {Promise<any>} values of JSON's types
 */
export async function makeLoop(preset, content, picture) {
  const { turned, shown, steps, patches } = carrierOf(preset, picture);
  const gray = shown.data.every((level, at) => level === shown.data[at - (at % 3)]);
  const levels = gray ? shown.data.filter((_, at) => at % 3 === 0) : shown.data;
  return {
    ...(await loopOf(preset, content, shown, turned, patches)),
    pictures: [await packed(levels, gray ? 1 : 3)],
    steps: [steps && (await packed(steps))],
  };
}

/**
 * Prepare a picture for any message.
 *
 * @param {SendPreset} preset
 * @param {Picture} picture - of the size at which it is shown
 * @returns {{ turned: boolean, shown: Picture, steps: Uint8Array | null, patches: Uint8Array | null }}
 *   whether it is shown on its side; the picture to which levels are added, as it lies on the grid;
 *   steps of strength by block; and for each pixel the number of its change in a ratex patch, or 0
 */
export function carrierOf(preset, picture) {
  const turned = (picture.width - picture.height) * (preset.size[0] - preset.size[1]) < 0;
  const laid = turned ? quarterTurned(picture, 90) : picture;
  const { rows, cols } = preset.loop;
  const steps = preset.even ? blockSteps(laid, rows, cols) : null;
  const shown = withRoom(laid, preset, steps);
  const patches = preset.ratex.length ? drawPatches(shown, preset) : null;
  return { turned, shown, steps, patches };
}

/**
 * Make the loop of a message over a film, whose pictures the player takes as they come.
 *
 * @param {SendPreset} preset
 * @param {Content} content - short enough for the preset
 * @param {{ size: number[], shown: number[] }} film - width and height of the film, and of what is
 *   shown of it
 * @returns {Promise<any>} values of JSON's types, which lack the film itself
 */
export async function makeFilmLoop(preset, content, { size, shown: [across, down] }) {
  const turned = (across - down) * (preset.size[0] - preset.size[1]) < 0;
  const [width, height] = turned ? [down, across] : [across, down];
  const laid = { width, height, data: new Uint8Array(preset.ratex.length ? 3 * width * height : 0) };
  const patches = preset.ratex.length ? drawPatches(laid, preset) : null;
  const levels = patches && (await packed(laid.data.filter((_, at) => at % 3 === 0)));
  return {
    ...(await loopOf(preset, content, laid, turned, patches)),
    pictures: [],
    steps: [null],
    film: { ...preset.film, size, view: [0, 0, ...size], patches: levels },
  };
}

/**
 * @param {SendPreset} preset
 * @param {Content} content
 * @param {Picture} laid - as it lies on the grid
 * @param {boolean} turned
 * @param {Uint8Array | null} patches
 */
async function loopOf(preset, content, { width, height }, turned, patches) {
  const letters = encode(content, preset.n_bits).map((bit) => bit + 48);
  const text = new TextDecoder().decode(letters);
  const pairs = text.length / preset.n_bits;
  return {
    ...preset.loop,
    width,
    height,
    turned,
    patches: patches && (await packed(patches)),
    bits: Array.from({ length: pairs }, (_, pair) =>
      text.slice(pair * preset.n_bits, (pair + 1) * preset.n_bits),
    ),
    shown: new Array(pairs).fill(0),
  };
}

/**
 * Change a picture so that no change of its blocks leads out of the levels of a display.
 *
 * @param {Picture} picture
 * @param {SendPreset} preset
 * @param {Uint8Array | null} steps - of strength, by block
 */
function withRoom({ width, height, data }, preset, steps) {
  const { rows, cols } = preset.loop;
  const room = fromBase64(preset.film.rooms);
  const shown = new Uint8Array(data.length);
  for (let y = 0, at = 0; y < height; y++) {
    const row = Math.floor((y * rows) / height) * cols;
    for (let x = 0; x < width; x++) {
      const first = steps ? steps[row + Math.floor((x * cols) / width)] << 8 : 0;
      for (const end = at + 3; at < end; at++) shown[at] = room[first + data[at]];
    }
  }
  return { width, height, data: shown };
}

/**
 * Draw ratex patches into a picture, as they are in the original frame.
 *
 * @param {Picture} picture
 * @param {SendPreset} preset
 * @returns {Uint8Array} (height * width) numbers of the changes in patches; 0 outside them
 */
function drawPatches({ width, height, data }, { ratex, tiles, changes, loop }) {
  const numbers = new Uint8Array(width * height);
  const side = Math.sqrt(tiles[0].length);
  for (let y = 0, at = 0; y < height; y++) {
    const down = Math.floor((y * loop.rows * side) / height);
    for (let x = 0; x < width; x++, at++) {
      const across = Math.floor((x * loop.cols * side) / width);
      const [row, col] = [Math.floor(down / side), Math.floor(across / side)];
      const patch = ratex.findIndex((/** @type {number[]} */ cell) => cell[0] === row && cell[1] === col);
      if (patch < 0) continue;
      const tile = (down % side) * side + (across % side);
      data.fill(tiles[patch][tile], 3 * at, 3 * at + 3);
      numbers[at] = changes[patch][tile];
    }
  }
  return numbers;
}

/**
 * Pack whole numbers from 0 to 255 as the player reads them: zlib packs the difference of each from
 * the one before it in its channel.
 *
 * @param {Uint8Array} numbers
 * @param {number} [channels]
 * @returns {Promise<string>} base64
 */
export async function packed(numbers, channels = 1) {
  const steps = numbers.map((number, at) => number - (at < channels ? 0 : numbers[at - channels]));
  const stream = new Blob([steps]).stream().pipeThrough(new CompressionStream("deflate"));
  return toBase64(new Uint8Array(await new Response(stream).arrayBuffer()));
}

/**
 * Unpack what `packed` has packed.
 *
 * @param {string} text - base64
 * @param {number} channels
 */
export async function unpacked(text, channels) {
  const stream = new Blob([fromBase64(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const numbers = new Uint8Array(await new Response(stream).arrayBuffer());
  for (let at = channels; at < numbers.length; at++) numbers[at] += numbers[at - channels];
  return numbers;
}
