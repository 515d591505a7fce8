/**
 * Reads the fixtures that `tests/web/web_fixtures.py` writes: what Python computed, for comparison.
 *
 * Environment variable FIXTURES names their folder.
 */

import { readFileSync } from "node:fs";
import { join } from "node:path";

/** @type {Record<string, (buffer: ArrayBuffer) => any>} */
const TYPES = {
  uint8: (buffer) => new Uint8Array(buffer),
  uint16: (buffer) => new Uint16Array(buffer),
  int32: (buffer) => new Int32Array(buffer),
  float32: (buffer) => new Float32Array(buffer),
  float64: (buffer) => new Float64Array(buffer),
};

/**
 * Read one fixture. Arrays come as `{ shape, data }` with a typed array in row-major order.
 *
 * @param {string} name - of the file, without ending
 * @returns {any}
 */
export function readFixture(name) {
  const folder = process.env.FIXTURES;
  if (!folder) throw new Error("set FIXTURES to the folder of fixtures; tests/web does");
  const text = readFileSync(join(folder, `${name}.json`), "utf8");
  return JSON.parse(text, (_, value) => {
    if (value === null || typeof value !== "object" || !("dtype" in value)) return value;
    const bytes = Buffer.from(value.base64, "base64");
    const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
    return { shape: value.shape, data: TYPES[value.dtype](buffer) };
  });
}

/**
 * Cut a table into its rows.
 *
 * @param {{ shape: number[], data: Float64Array }} table
 */
export function rowsOf({ shape, data }) {
  return Array.from({ length: shape[0] }, (_, k) => data.slice(k * shape[1], (k + 1) * shape[1]));
}
