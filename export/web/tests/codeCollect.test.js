/** Collectors return the same messages at the same frames as Python's. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { makeCollector } from "../src/link/code/collect.js";
import { close } from "./comparison.js";
import { readFixture } from "./fixtures.js";

for (const { rows, counts, starts, steps, messages } of readFixture("sequences")) {
  test(`${rows.shape[0]} frames of ${rows.shape[1]} bits`, () => {
    const [, nBits] = rows.shape;
    const collector = makeCollector(nBits);
    const expected = messages.values();
    for (let at = 0; at < counts.length; at++) {
      if (starts.includes(at)) collector.startRun();
      const message = collector.add(rows.data.subarray(at * nBits, (at + 1) * nBits), counts[at]);
      const { progress, attempts, collecting } = collector;
      const step = steps.data.subarray(3 * at, 3 * at + 3);
      close([progress, attempts, Number(collecting)], step, 1e-4);
      if (message === null) continue;
      const { at: when, data, numbers } = expected.next().value;
      assert.equal(at, when);
      assert.deepEqual(message.data, data.data);
      const { frames, seen, agreement, changed } = message;
      close([frames, seen, agreement, Number(changed)], numbers.data, 1e-5);
    }
    assert.ok(expected.next().done, "a message is missing");
  });
}

test("frames of too few blocks for a signature", () => {
  assert.throws(() => makeCollector(15), /15 message blocks a frame, a message needs at least 16/);
});
