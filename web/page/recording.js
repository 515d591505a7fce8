/**
 * What the camera saw, as one file to send to us: a .tar of film.y4m and about.json.
 *
 * The film holds the luma of each frame, without compression; any player of .y4m shows it, and
 * `receiver` reads it.
 */

/** Largest memory, in bytes, of the frames of one recording. */
export const MAX_RECORDED_BYTES = 128 * 2 ** 20;

/** Bytes of a block of a .tar file. */
const BLOCK = 512;

/**
 * Make the header and the padding of a file in a .tar archive (POSIX ustar).
 *
 * @param {string} name - ASCII, at most 99 characters
 * @param {number} size - of the file, in bytes
 * @param {number} seconds - since 1970 at which it was written
 * @returns {[Uint8Array<ArrayBuffer>, Uint8Array<ArrayBuffer>]} what stands before and after it
 */
function tarParts(name, size, seconds) {
  const header = new Uint8Array(BLOCK);
  /** @param {number} at @param {string} text */
  const put = (at, text) => header.set(new TextEncoder().encode(text), at);
  /** @param {number} value @param {number} digits */
  const octal = (value, digits) => value.toString(8).padStart(digits, "0");
  put(0, name);
  put(100, `${octal(0o644, 7)}\0${octal(0, 7)}\0${octal(0, 7)}\0`);
  put(124, `${octal(size, 11)}\0${octal(seconds, 11)}\0`);
  put(148, " ".repeat(8)); // the sum of all bytes counts itself as blanks
  put(156, "0");
  put(257, "ustar\u000000");
  const sum = header.reduce((total, byte) => total + byte, 0);
  put(148, `${octal(sum, 6)}\0 `);
  return [header, new Uint8Array((BLOCK - (size % BLOCK)) % BLOCK)];
}

/**
 * Put frames and what is known about them into one file.
 *
 * @param {{ plane: Plane, time: number }[]} frames - all of one size; times in seconds
 * @param {number} fps - nominal number of frames a second
 * @param {Record<string, unknown>} about - written as JSON
 * @param {number} seconds - since 1970 at which it was recorded
 * @returns {Blob}
 */
export function recordingFile(frames, fps, about, seconds) {
  const { width, height } = frames[0].plane;
  const rate = `${Math.round(1000 * fps)}:1000`;
  /** @type {(string | Uint8Array<ArrayBuffer>)[]} */
  const film = [`YUV4MPEG2 W${width} H${height} F${rate} Ip A1:1 Cmono XCOLORRANGE=FULL\n`];
  for (const { plane } of frames) film.push("FRAME\n", new Uint8Array(plane.data));
  const parts = [];
  const text = JSON.stringify({ ...about, times: frames.map(({ time }) => time) }, null, 1);
  for (const [name, content] of [
    ["about.json", new Blob([text])],
    ["film.y4m", new Blob(film)],
  ]) {
    const file = /** @type {Blob} */ (content);
    const [before, after] = tarParts(String(name), file.size, seconds);
    parts.push(before, file, after);
  }
  return new Blob([...parts, new Uint8Array(2 * BLOCK)], { type: "application/x-tar" });
}
