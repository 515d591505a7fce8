/**
 * Films as .y4m: frames without compression, which browsers do not play.
 *
 * The format (https://wiki.multimedia.cx/index.php/YUV4MPEG2) is a line that describes the film,
 * then for each frame a line that begins with "FRAME", followed by its planes, luma first.
 */

import { images, imagesVideo } from "../generated/constants.js";
import { stretchRange } from "./planes.js";

/** Bytes with which every such film begins. */
export const Y4M_MAGIC = "YUV4MPEG2";

const { DEFAULT_FPS, MAX_FPS } = imagesVideo;

/** Largest number of bytes in a line. */
const MAX_LINE = 4096;

/** Largest number of pixels in a frame. */
const MAX_PIXELS = 1e6 * images.MAX_MEGAPIXELS;

/** Number of columns and of rows of pixels that share a chroma sample, by the format's name. */
const SHARED = new Map([
  ["mono", [0, 0]], // there is none
  ["411", [4, 1]],
  ["420", [2, 2]],
  ["422", [2, 1]],
  ["440", [1, 2]],
  ["444", [1, 1]],
]);

/** Pattern of a format: its name, where its chroma samples lie or an "alpha" plane, its bits. */
const FORMAT = /^(mono|4\d\d)(jpeg|mpeg2|paldv|alpha)?(?:p?(\d\d?))?$/;

/** Smallest and largest number of bits of a sample. */
const [MIN_BITS, MAX_BITS] = [8, 16];

/**
 * What the first line of a film says.
 *
 * @typedef {object} Y4mHeader
 * @property {number} width - of a frame, in pixels
 * @property {number} height - of a frame, in pixels
 * @property {number} fps - frames a second
 * @property {boolean} limited - whether black is known to be 16 and white 235, of 255
 * @property {number} bits - of a sample; from 9 on, it takes two bytes, the lower one first
 * @property {number} restBytes - bytes of a frame after its luma
 */

/**
 * Read the first line of a film.
 *
 * @param {string} line
 * @returns {Y4mHeader}
 * @throws {Error} it is no line of a .y4m film, or of a format that is unknown
 */
export function parseHeader(line) {
  const [magic, ...words] = line.split(" ");
  if (magic !== Y4M_MAGIC) throw new Error("the file is no .y4m film");
  /** @param {string} letter */
  const value = (letter) => words.find((word) => word.startsWith(letter))?.slice(1) ?? "";
  const [width, height] = ["W", "H"].map((letter) =>
    /^\d+$/.test(value(letter)) ? Number(value(letter)) : 0,
  );
  if (!(width >= 16 && height >= 16 && width * height <= MAX_PIXELS)) {
    throw new Error("the film does not say how large its frames are");
  }
  const chroma = value("C") || "420";
  const [, name, place, digits] = FORMAT.exec(chroma) ?? [];
  const shared = SHARED.get(name);
  const bits = Number(digits ?? MIN_BITS);
  if (!shared || !(bits >= MIN_BITS && bits <= MAX_BITS)) {
    throw new Error(`the film's format, ${chroma.slice(0, 20)}, is unknown`);
  }
  const [frames, seconds] = value("F").split(":").map(Number);
  const fps = frames / seconds;
  const [columns, rows] = shared;
  const samples = columns ? 2 * Math.ceil(width / columns) * Math.ceil(height / rows) : 0;
  const alpha = place === "alpha" ? width * height : 0;
  return {
    width,
    height,
    fps: fps > 0 && fps <= MAX_FPS ? fps : DEFAULT_FPS,
    limited: words.includes("XCOLORRANGE=LIMITED"),
    bits,
    restBytes: (samples + alpha) * (bits > 8 ? 2 : 1),
  };
}

/** Reads lines and blocks of bytes from a stream, which it draws on only as far as needed. */
class ByteReader {
  /** @param {ReadableStream<Uint8Array>} stream */
  constructor(stream) {
    this.reader = stream.getReader();
    /** @type {Uint8Array} */
    this.chunk = new Uint8Array(0);
    this.at = 0;
  }

  /**
   * Make sure that there is something to read.
   *
   * @returns {Promise<boolean>} false at the end
   */
  async fill() {
    while (this.at === this.chunk.length) {
      const { value, done } = await this.reader.read();
      if (done) return false;
      [this.chunk, this.at] = [value, 0];
    }
    return true;
  }

  /** @returns {Promise<string | null>} the next line, or null at the end */
  async line() {
    let text = "";
    while (text.length < MAX_LINE && (await this.fill())) {
      const end = this.chunk.indexOf(10, this.at);
      const stop = end < 0 ? this.chunk.length : end;
      text += String.fromCharCode(...this.chunk.subarray(this.at, Math.min(stop, this.at + 4096)));
      this.at = end < 0 ? stop : stop + 1;
      if (end >= 0) return text;
    }
    return null;
  }

  /**
   * Read, or skip, a number of bytes.
   *
   * @param {number} count
   * @param {Uint8Array} [into] - takes the bytes where it is given
   * @returns {Promise<boolean>} false where the stream ends before
   */
  async bytes(count, into) {
    for (let done = 0; done < count; ) {
      if (!(await this.fill())) return false;
      const taken = Math.min(count - done, this.chunk.length - this.at);
      into?.set(this.chunk.subarray(this.at, this.at + taken), done);
      this.at += taken;
      done += taken;
    }
    return true;
  }
}

/**
 * Read a film, frame by frame.
 *
 * A frame is shown at its number over the film's rate, or at the time, in seconds, that its line
 * states after "XTIME=", as in films that this page saved.
 *
 * @param {ReadableStream<Uint8Array>} stream
 * @returns {AsyncGenerator<{ plane: Plane, time: number, fps: number }>}
 * @throws {Error} the stream holds no such film
 */
export async function* readY4m(stream) {
  const reader = new ByteReader(stream);
  try {
    const header = parseHeader((await reader.line()) ?? "");
    const { width, height, fps, limited, bits, restBytes } = header;
    for (let number = 0; ; number++) {
      const line = await reader.line();
      if (!line?.startsWith("FRAME")) return;
      const stated = Number(/ XTIME=(\S+)/.exec(line)?.[1] ?? NaN);
      const samples = new Uint8Array(width * height * (bits > 8 ? 2 : 1));
      if (!(await reader.bytes(samples.length, samples)) || !(await reader.bytes(restBytes))) return;
      const data = bits > 8 ? upperBits(samples, bits) : samples;
      if (limited) stretchRange(data);
      const time = Number.isFinite(stated) ? stated : number / fps;
      yield { plane: { width, height, data }, time, fps };
    }
  } finally {
    await reader.reader.cancel();
  }
}

/**
 * Reduce samples of two bytes to their upper eight bits.
 *
 * @param {Uint8Array} samples - two bytes each, the lower one first
 * @param {number} bits - of a sample
 * @returns {Uint8Array} of half the length
 */
function upperBits(samples, bits) {
  return Uint8Array.from({ length: samples.length / 2 }, (_, at) =>
    Math.min(255, (samples[2 * at] | (samples[2 * at + 1] << 8)) >> (bits - 8)),
  );
}
