/** Codes, signatures and messages of coarse grids are those of Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { decode, encode, framesNeeded, parityMask, signatures } from "../src/link/code/framing.js";
import { informationBytes } from "../src/link/code/framing.js";
import { makeCode } from "../src/link/code/ldpc.js";
import { readFixture } from "./fixtures.js";

const { codes, words, loops } = readFixture("coarse");

test("graphs and codewords", () => {
  for (const { information, parity, bit, starts, bits, codeword } of codes) {
    const code = makeCode(information, parity);
    assert.deepEqual(code.checks.members, bit.data);
    assert.deepEqual(code.checks.starts, Int32Array.of(...starts.data, bit.data.length));
    assert.deepEqual(code.encode(bits.data), codeword.data);
  }
});

test("codewords are found where Python finds them", () => {
  const information = 8 * informationBytes(9, 59);
  const code = makeCode(information, 9 * 51 - information);
  for (const { llr, codeword } of words) {
    assert.deepEqual(code.decode(llr.data), codeword && codeword.data);
  }
});

test("loops", () => {
  for (const { message, n_bits, bits, signatures: heads, parity, read } of loops) {
    const frames = bits.shape[0];
    assert.equal(framesNeeded(message.data.length, n_bits), frames);
    assert.deepEqual(encode(message.data, n_bits), bits.data);
    assert.deepEqual(signatures(frames), heads.data);
    assert.deepEqual(parityMask(frames, n_bits), parity.data);
    for (const { scores, message: found } of read) {
      assert.deepEqual(decode(scores.data, n_bits), found && found.data);
    }
    assert.equal(decode(new Float64Array(bits.data.length), n_bits), null);
  }
});
