/** Bytes as bits and back, and equal bytes; the first bit of a byte is its most significant. */

/**
 * Spread bytes into bits.
 *
 * @param {Uint8Array} data
 * @returns {Uint8Array} eight times as many bits, 0 or 1
 */
export function unpackBits(data) {
  const bits = new Uint8Array(8 * data.length);
  for (let at = 0; at < bits.length; at++) bits[at] = (data[at >> 3] >> (7 - (at & 7))) & 1;
  return bits;
}

/**
 * Gather bits into bytes.
 *
 * @param {Uint8Array} bits - 0 or 1; a multiple of eight
 * @returns {Uint8Array}
 */
export function packBits(bits) {
  const data = new Uint8Array(bits.length >> 3);
  for (let at = 0; at < bits.length; at++) data[at >> 3] |= bits[at] << (7 - (at & 7));
  return data;
}

/**
 * Compare bytes in a time that does not depend on where they differ.
 *
 * @param {Uint8Array} one
 * @param {Uint8Array} other
 */
export function equalBytes(one, other) {
  if (one.length !== other.length) return false;
  let differing = 0;
  for (let at = 0; at < one.length; at++) differing |= one[at] ^ other[at];
  return differing === 0;
}
