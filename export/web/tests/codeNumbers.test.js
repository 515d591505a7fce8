/** Scrambled numbers, check sums, marks and texts are those of Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { packBits, unpackBits } from "../src/link/code/bits.js";
import { crc32 } from "../src/link/code/crc.js";
import { markOf } from "../src/link/code/fine.js";
import { textOf } from "../src/link/code/message.js";
import { scrambled, shuffled } from "../src/link/code/scrambled.js";
import { readFixture } from "./fixtures.js";

const { numbers, words, texts } = readFixture("numbers");

test("scrambled numbers and their order", () => {
  for (const { seed, words: expected, order } of words) {
    const { high, low } = scrambled(Uint32Array.from(numbers.data), seed);
    const found = Array.from(high, (half, at) => hex(half) + hex(low[at]));
    assert.deepEqual(found, expected);
    assert.deepEqual(Array.from(shuffled(order.data.length, seed)), Array.from(order.data));
  }
});

/** @param {number} half */
function hex(half) {
  return half.toString(16).padStart(8, "0");
}

test("check sums, marks, texts and bits", () => {
  for (const { data, text, crc, mark } of texts) {
    assert.equal(crc32(data.data), crc);
    assert.equal(crc32(data.data.subarray(3), crc32(data.data.subarray(0, 3))), crc);
    assert.equal(markOf(data.data), mark);
    assert.equal(textOf(data.data), text);
    assert.deepEqual(packBits(unpackBits(data.data)), data.data);
  }
});
