/** CRC-32, as in zlib and PNG: polynomial 0xedb88320, reflected. */

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let rest = byte;
  for (let turn = 0; turn < 8; turn++) rest = rest & 1 ? (rest >>> 1) ^ 0xedb88320 : rest >>> 1;
  return rest;
});

/**
 * Compute the CRC-32 of bytes.
 *
 * @param {Uint8Array} data
 * @param {number} [before] - the CRC-32 of the bytes that stand before these
 * @returns {number} from 0 to 2 ** 32 - 1
 */
export function crc32(data, before = 0) {
  let rest = ~before;
  for (const byte of data) rest = (rest >>> 8) ^ TABLE[(rest ^ byte) & 255];
  return ~rest >>> 0;
}
