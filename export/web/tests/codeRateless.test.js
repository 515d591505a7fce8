/** Belief propagation finds the information where Python's finds it. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { makeRateless } from "../src/link/code/rateless.js";
import { runToEnd } from "../src/link/code/steps.js";
import { readFixture } from "./fixtures.js";

test("information", () => {
  const { information, cases } = readFixture("rateless");
  const code = makeRateless(information);
  for (const { llr, blocks, information: expected } of cases) {
    assert.deepEqual(runToEnd(code.decodingSteps(llr.data, blocks)), expected && expected.data);
  }
});
