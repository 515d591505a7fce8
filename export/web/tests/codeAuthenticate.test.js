/** Signed messages are judged as in Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Verifier } from "../src/link/code/authenticate.js";
import { readFixture } from "./fixtures.js";

test("messages are taken, stale or refused", () => {
  for (const { key, max_age_s, said } of readFixture("verifiers")) {
    const verifier = new Verifier(key.data, max_age_s);
    for (const { message, now, data, stamp, refused, stale, newest } of said) {
      const judged = verifier.judge(message.data, now);
      assert.deepEqual(judged.signed && judged.signed.data, data && data.data);
      assert.equal(judged.signed && judged.signed.stamp, stamp);
      assert.equal(judged.stale, stale);
      assert.equal(verifier.newest, newest);
      // Python names the flag
      const expected = refused && refused.replace(/--max-age is (\d+)/, "the largest age is $1 s");
      assert.equal(judged.refused, expected);
    }
  }
});

test("keys and ages have bounds", () => {
  for (const size of [0, 15, 4097]) {
    assert.throws(() => new Verifier(new Uint8Array(size)), /need 16 to 4096 random bytes/);
  }
  for (const age of [0, -1, NaN, Infinity, 1e300]) {
    assert.throws(() => new Verifier(new Uint8Array(16), age), /maxAgeS: need more than 0/);
  }
});
