/**
 * Framing turns a message into the protected bits of a loop of frames.
 *
 * Frames of `FINE_BITS` message blocks or more are those of a fine grid, which `fine.js` describes.
 * What follows is the framing of coarse grids (link/code/framing.py), which the page sends and does
 * not read:
 *
 *     information   length (2 bytes) | message | zeros | CRC-32 of all before
 *     codeword      information + parity, rate 1/2 (`ldpc.js`): N P bits for N frames
 *     frame k       SIGNATURE bits that say (N, k) | P bits of the codeword
 *
 * The highest bit of the length says that the message is signed (`authenticate.js`).
 * The codeword is whitened, and interleaved over all frames and blocks.
 */

import { codeFine, codeFraming } from "../../../generated/constants.js";
import { unpackBits } from "./bits.js";
import { crc32 } from "./crc.js";
import { encodeFine, fineFrames } from "./fine.js";
import { makeCode } from "./ldpc.js";
import { remembered } from "./remembered.js";
import { range, scrambled, shuffled } from "./scrambled.js";

const { CRC_BYTES } = codeFine;
const { FINE_BITS, LENGTH_BYTES, SIGNATURE, SIGNED } = codeFraming;

/** @import { Content } from "./message.js" */

/**
 * Tell whether frames with a number of message blocks have the framing of fine grids.
 *
 * @param {number} nBits
 */
function isFine(nBits) {
  return nBits >= FINE_BITS;
}

/**
 * Count the bytes of information that a loop carries, length and CRC included.
 *
 * @param {number} frames - number of frames in the loop
 * @param {number} nBits - message blocks of a frame
 */
function informationBytes(frames, nBits) {
  return Math.floor((frames * (nBits - SIGNATURE)) / 16);
}

/**
 * Count the frames of the loop that carries a message, which is the shortest on coarse grids.
 *
 * @param {number} nBytes - length of the message
 * @param {number} nBits - message blocks of a frame
 */
export function framesNeeded(nBytes, nBits) {
  if (isFine(nBits)) return fineFrames(nBytes, nBits);
  return Math.ceil((16 * (nBytes + LENGTH_BYTES + CRC_BYTES)) / (nBits - SIGNATURE));
}

/** Makes the error-correcting code of a loop from its number of frames, and of their blocks. */
const codeOf = remembered((/** @type {number} */ frames, /** @type {number} */ nBits) => {
  const information = 8 * informationBytes(frames, nBits);
  return makeCode(information, frames * (nBits - SIGNATURE) - information);
});

/** Makes interleaving and whitening of a codeword: displayed = codeword[order] ^ white. */
const mixingOf = remembered((/** @type {number} */ length) => {
  const white = scrambled(range(length), length).low.map((word) => word & 1);
  return { order: shuffled(length, length), white };
});

/**
 * List the signatures that tell the frames of a loop from one another.
 *
 * @param {number} frames - number of frames in the loop; loops of other lengths have other
 *   signatures
 * @returns {Uint8Array} (frames) words of `SIGNATURE` bits
 */
function signatures(frames) {
  const { high } = scrambled(range(frames), 1000 + frames);
  const words = new Uint8Array(frames); // a loop: `from` is many times slower
  for (let at = 0; at < frames; at++) words[at] = high[at] >>> (32 - SIGNATURE);
  return words;
}

/**
 * Find where a bit of the interleaved codeword stands among all bits of the loop.
 *
 * @param {number} at
 * @param {number} nBits
 */
function placeOf(at, nBits) {
  const body = nBits - SIGNATURE;
  return Math.floor(at / body) * nBits + SIGNATURE + (at % body);
}

/**
 * Turn a message into the bits of the loop that carries it.
 *
 * @param {Content} content - at least 1 byte, and at most as many as the table of presets says
 * @param {number} nBits - message blocks of a frame
 * @returns {Uint8Array} (frames * nBits) bits, frame by frame
 */
export function encode(content, nBits) {
  if (isFine(nBits)) return encodeFine(content, nBits);
  const { data: message, signed } = content;
  const frames = framesNeeded(message.length, nBits);
  const data = new Uint8Array(informationBytes(frames, nBits));
  const view = new DataView(data.buffer);
  view.setUint16(0, message.length | (signed ? SIGNED : 0));
  data.set(message, LENGTH_BYTES);
  const room = data.length - CRC_BYTES;
  view.setUint32(room, crc32(data.subarray(0, room)));
  const codeword = codeOf(frames, nBits).encode(unpackBits(data));
  const { order, white } = mixingOf(codeword.length);
  const bits = new Uint8Array(frames * nBits);
  const heads = unpackBits(signatures(frames));
  for (let frame = 0; frame < frames; frame++) {
    bits.set(heads.subarray(frame * SIGNATURE, (frame + 1) * SIGNATURE), frame * nBits);
  }
  for (let at = 0; at < codeword.length; at++) {
    bits[placeOf(at, nBits)] = codeword[order[at]] ^ white[at];
  }
  return bits;
}
