/**
 * Framing for fine grids: a message becomes frames of thousands of bits, any of which help.
 *
 *     information   message | CRC-32 of header and message | zeros, cut into equal blocks
 *     coded bits    as many as the loop has room for, by turns from each block (`rateless.js`)
 *     frame k       a word that says k | words that say terms | coded bits k P to k P + P
 *
 * The *terms* are what a receiver must know before it can decode: the length of the message, the
 * number of frames in the loop and a mark of the message. They make six words, of which each frame
 * shows one or more by turns (link/code/fine.py). The header is the length, after a bit that says
 * whether the message is signed; it is not sent, so the receiver tries both.
 */

import { codeFine } from "../../../generated/constants.js";
import { sha256 } from "@noble/hashes/sha2.js";

import { picked } from "../pilots.js";
import { packBits, unpackBits } from "./bits.js";
import { crc32 } from "./crc.js";
import { MAX_INFORMATION, MIN_INFORMATION, makeRateless } from "./rateless.js";
import { remembered } from "./remembered.js";
import { range, scrambled, shuffled } from "./scrambled.js";
import { NUMBERS, WORD, weighWord, wordOf } from "./words.js";

/** @import { Content } from "./message.js" */

export const { PIECES } = codeFine;
const {
  MIN_FRAMES, MAX_FRAMES, USUAL_FRAMES, USUAL_REDUNDANCY, MAX_CODED, HEADER_SHARE, CRC_BYTES,
} = codeFine;

/** What a receiver must know of a loop before it can decode it. */
export class Terms {
  /**
   * @param {number} nBytes - length of the message in bytes
   * @param {number} frames - number of frames in the loop
   * @param {number} mark - first three bytes of the message's SHA-256, as a whole number
   */
  constructor(nBytes, frames, mark) {
    this.nBytes = nBytes;
    this.frames = frames;
    this.mark = mark;
  }

  /** Number of blocks into which the information is cut. */
  get blocks() {
    return Math.ceil((8 * (this.nBytes + CRC_BYTES)) / MAX_INFORMATION);
  }

  /** Number of bytes of information in a block. */
  get blockBytes() {
    return Math.max(MIN_INFORMATION / 8, Math.ceil((this.nBytes + CRC_BYTES) / this.blocks));
  }

  /** Number of bits of information in all blocks. */
  get information() {
    return 8 * this.blocks * this.blockBytes;
  }

  /** The code of each block. */
  get code() {
    return makeRateless(8 * this.blockBytes);
  }

  /**
   * Tell the terms in (PIECES) numbers below 4096; the last 16 bits check the others.
   *
   * The mark also scrambles what follows it, so that all numbers change with the message.
   */
  pieces() {
    const { mark, check } = this;
    const length = this.nBytes - 1;
    const last = this.frames - 1;
    const mask = maskOf(mark);
    return [
      mark >>> 12,
      mark & 0xfff,
      length >>> 8,
      ((length & 0xff) << 4) | (last >>> 8),
      ((last & 0xff) << 4) | (check >>> 12),
      check & 0xfff,
    ].map((piece, at) => piece ^ mask[at]);
  }

  /** The 16 bits that check the terms. */
  get check() {
    const told = new DataView(new ArrayBuffer(8)); // the first of its bytes is left out
    told.setUint32(0, this.mark);
    told.setUint32(4, ((this.nBytes - 1) << 12) | (this.frames - 1));
    return crc32(new Uint8Array(told.buffer, 1)) & 0xffff;
  }

  /** @param {Terms | null} other */
  equals(other) {
    return (
      other !== null &&
      this.nBytes === other.nBytes &&
      this.frames === other.frames &&
      this.mark === other.mark
    );
  }
}

/** Makes the numbers that scramble the pieces; the first two are the mark itself. */
const maskOf = remembered((/** @type {number} */ mark) =>
  Array.from(scrambled(range(PIECES), mark).low, (word, at) => (at < 2 ? 0 : word % NUMBERS)),
);

/**
 * Read the terms from numbers that may be wrong.
 *
 * @param {number[]} pieces - (PIECES) numbers below 4096
 * @param {number} nBits - message blocks of a frame
 * @returns {Terms | null} null where their check fails or where no sender would make such a loop
 */
export function readTerms(pieces, nBits) {
  const mark = (pieces[0] << 12) | pieces[1];
  const mask = maskOf(mark);
  const [, , top, middle, low] = pieces.map((piece, at) => piece ^ mask[at]);
  const nBytes = ((top << 8) | (middle >>> 4)) + 1;
  const frames = (((middle & 0xf) << 8) | (low >>> 4)) + 1;
  const terms = new Terms(nBytes, frames, mark);
  if (terms.pieces().some((piece, at) => piece !== pieces[at])) return null;
  const coded = frames * Shape.of(nBits).body;
  const possible = frames >= MIN_FRAMES && terms.information <= coded && coded <= MAX_CODED;
  return possible ? terms : null;
}

/** Where the bits of a frame's words and the coded bits lie among its message blocks. */
export class Shape {
  /** @param {number} nBits - number of message blocks of a frame */
  constructor(nBits) {
    const fitting = [2, 3, 6].filter((shown) => (1 + shown) * WORD <= HEADER_SHARE * nBits);
    const order = shuffled(nBits, nBits);
    /** Number of message blocks of a frame. */
    this.nBits = nBits;
    /** Number of the terms' words that each frame shows: 1, 2, 3 or 6. */
    this.shown = Math.max(1, ...fitting);
    const words = (1 + this.shown) * WORD;
    /**
     * Places of the words' bits, all over the frame: first those of the word that tells the frame's
     * number.
     */
    this.head = order.slice(0, words);
    /** Places of the coded bits, in rising order. */
    this.rest = order.slice(words).sort();
    /** Bits that are added to those of the word that tells the number, in all frames alike. */
    this.numberWhitening = scrambled(range(WORD), 3).low.map((word) => word & 1);
  }

  /** Number of coded bits in a frame. */
  get body() {
    return this.rest.length;
  }

  /** Shares out the bits of frames with a number of message blocks. */
  static of = remembered((/** @type {number} */ nBits) => new Shape(nBits));

  /**
   * List which words of the terms a frame shows.
   *
   * @param {number} number - of the frame
   */
  piecesShown(number) {
    return Array.from({ length: this.shown }, (_, at) => (number * this.shown + at) % PIECES);
  }

  /**
   * Make the (nBits) pseudo-random bits that are added to all of a frame's bits.
   *
   * The bits of the word that tells the number are whitened alike in all frames.
   *
   * @param {number} number - of the frame
   */
  whitening(number) {
    const white = scrambled(range(this.nBits, number * this.nBits), 2).low;
    for (let at = 0; at < WORD; at++) white[this.head[at]] = this.numberWhitening[at];
    return white;
  }
}

/** Log-likelihoods of a frame's words, and scores of its coded bits, by its known number. */
export class ReadFrame {
  /**
   * @param {Float32Array} scores - (nBits) log-likelihood ratios, positive for 1; 0 for an erasure
   * @param {number} number - number of the frame in the loop, from 0
   */
  constructor(scores, number) {
    const shape = Shape.of(scores.length);
    const white = shape.whitening(number);
    const clear = scores.map((score, at) => (white[at] & 1 ? -score : score));
    const words = picked(clear, shape.head.subarray(WORD));
    /** Number of the frame in the loop. */
    this.number = number;
    /** Which words of the terms the frame shows. */
    this.pieces = shape.piecesShown(number);
    /**
     * (4096) log-likelihoods over chance of the numbers that a shown word may tell, by the word.
     */
    this.likelihoods = this.pieces.map((_, at) => weighWord(words, at * WORD));
    /** (body) log-likelihood ratios of the coded bits. */
    this.coded = picked(clear, shape.rest);
  }

  /**
   * Give the log-likelihood of terms over chance; it is below 0 where others are shown.
   *
   * @param {Terms} terms
   */
  supports(terms) {
    const told = terms.pieces();
    return this.pieces.reduce((sum, piece, at) => sum + this.likelihoods[at][told[piece]], 0);
  }
}

/**
 * Weigh all numbers that a frame may have.
 *
 * @param {Float32Array} scores - (nBits) log-likelihood ratios, positive for 1; 0 for an erasure
 * @returns {Float64Array} (4096) log-likelihood over chance
 */
export function numberLikelihoods(scores) {
  const { head, numberWhitening } = Shape.of(scores.length);
  const shown = picked(scores, head.subarray(0, WORD));
  return weighWord(shown.map((score, at) => (numberWhitening[at] ? -score : score)));
}

/**
 * Count the frames of the loop that carries a message with the usual redundancy, or with less where
 * that would make too long a loop, or with more where it would be too short.
 *
 * @param {number} nBytes - length of the message
 * @param {number} nBits - message blocks of a frame
 */
export function fineFrames(nBytes, nBits) {
  const { body } = Shape.of(nBits);
  const coded = USUAL_REDUNDANCY * new Terms(nBytes, MIN_FRAMES, 0).information;
  const most = Math.min(MAX_FRAMES, Math.floor(MAX_CODED / body));
  return Math.min(Math.max(USUAL_FRAMES, Math.ceil(coded / body)), most);
}

/**
 * Turn a message into the bits of the loop that carries it.
 *
 * @param {Content} content
 * @param {number} nBits - message blocks of a frame
 * @returns {Uint8Array} (frames * nBits) bits, frame by frame
 */
export function encodeFine(content, nBits) {
  const frames = fineFrames(content.data.length, nBits);
  const terms = new Terms(content.data.length, frames, markOf(content.data));
  const shape = Shape.of(nBits);
  const pieces = terms.pieces().map(wordOf);
  const coded = codedBits(content, terms, nBits);
  const bits = new Uint8Array(frames * nBits);
  for (let number = 0; number < frames; number++) {
    const row = bits.subarray(number * nBits, (number + 1) * nBits);
    const shown = shape.piecesShown(number).map((piece) => pieces[piece]);
    const white = shape.whitening(number);
    [wordOf(number), ...shown].forEach((word, turn) =>
      word.forEach((bit, at) => (row[shape.head[turn * WORD + at]] = bit)),
    );
    shape.rest.forEach((place, at) => (row[place] = coded[number * shape.body + at]));
    for (let at = 0; at < nBits; at++) row[at] ^= white[at] & 1;
  }
  return bits;
}

/**
 * Encode a message: all coded bits of its loop, frame by frame, before whitening.
 *
 * @param {Content} message
 * @param {Terms} terms
 * @param {number} nBits - message blocks of a frame
 * @returns {Uint8Array} (frames * body) bits
 */
export function codedBits(message, terms, nBits) {
  const content = new Uint8Array(terms.information / 8);
  content.set(message.data);
  new DataView(content.buffer).setUint32(message.data.length, crcOf(message));
  const size = terms.frames * Shape.of(nBits).body;
  const coded = terms.code.encode(unpackBits(content), Math.ceil(size / terms.blocks));
  return coded.subarray(0, size);
}

/**
 * Read a message whose terms are known, step by step.
 *
 * @param {Float32Array} scores - (frames * body) log-likelihood ratios of the coded bits, positive
 *   for 1; 0 where nothing is known. They are copied, and may change between steps.
 * @param {Terms} terms - terms of the loop
 * @returns {Steps<Content | null>} the message, or null where the scores do not suffice
 */
export function codedDecodingSteps(scores, terms) {
  const llr = new Float32Array(Math.ceil(scores.length / terms.blocks) * terms.blocks);
  llr.set(scores);
  return messageSteps(llr, terms);
}

/**
 * Decode log-likelihood ratios of coded bits, and check the message.
 *
 * @param {Float32Array} llr
 * @param {Terms} terms
 */
function* messageSteps(llr, terms) {
  const information = yield* terms.code.decodingSteps(llr, terms.blocks);
  if (information === null) return null;
  const content = packBits(information);
  const data = content.slice(0, terms.nBytes);
  const crc = new DataView(content.buffer).getUint32(terms.nBytes);
  const padding = content.subarray(terms.nBytes + CRC_BYTES);
  if (padding.some((byte) => byte !== 0) || markOf(data) !== terms.mark) return null;
  const possible = [false, true].map((signed) => ({ data, signed }));
  return possible.find((message) => crc === crcOf(message)) ?? null;
}

/**
 * Give the mark by which the terms tell a message from others.
 *
 * @param {Uint8Array} message
 */
export function markOf(message) {
  const digest = sha256(message);
  return (digest[0] << 16) | (digest[1] << 8) | digest[2];
}

/** @param {Content} message */
function crcOf({ data, signed }) {
  const header = new DataView(new ArrayBuffer(4));
  header.setUint32(0, data.length);
  header.setUint8(0, signed ? 0x80 : 0);
  return crc32(data, crc32(new Uint8Array(header.buffer)));
}
