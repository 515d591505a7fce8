/** Why no message came, in the words of Python. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { explainSilence } from "../src/receive/diagnosis.js";
import { readFixture } from "./fixtures.js";

test("reasons", () => {
  for (const { seen, text } of readFixture("silence")) {
    const toggling = seen.toggling && { ...seen.toggling, stateHz: seen.toggling.state_hz };
    assert.equal(explainSilence({ ...seen, toggling, stateHz: seen.state_hz }), text);
  }
});
