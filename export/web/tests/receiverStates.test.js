/** Display states put together from camera frames, beside Python's. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { blockPurity, composeState, pointsInView } from "../src/receive/states.js";
import { DisplayClock } from "../src/receive/timing/clock.js";
import { close, differences } from "./comparison.js";
import { readFixture } from "./fixtures.js";

await loadOpenCv();

test("states of frames that are pure, mixed and cut", () => {
  for (const known of readFixture("states")) {
    const [period, start, delayX, delayY, shutter] = known.clock.data;
    const clock = new DisplayClock(period, start, delayX, delayY, shutter);
    const [, height, width] = known.images.shape;
    const frames = known.times.map((/** @type {number} */ time, /** @type {number} */ k) => {
      const data = known.images.data.slice(k * width * height, (k + 1) * width * height);
      const inView = known.in_view[k] && known.in_view[k].data;
      return { time, rectified: { width, height, data }, inView };
    });
    known.numbers.forEach((/** @type {number} */ number, /** @type {number} */ k) => {
      const [state, expected] = [composeState(frames, clock, number), known.states[k]];
      if (expected === null) return assert.equal(state, null);
      assert.ok(state !== null);
      assert.equal(state.frames, expected.frames);
      close(state.purity, expected.purity.data, 1e-12);
      const { most, mean } = differences(state.image, expected.image);
      assert.ok(most <= 1 && mean < 0.01, `${most} ${mean}`);
      for (const { layout, purity } of expected.blocks) {
        close(blockPurity(state.purity, new Layout(layout)), purity.data, 1e-6);
      }
    });
  }
});

test("points in view", () => {
  const inside = /** @type {[number, number][]} */ ([[0, 0], [99, 0], [99, 99], [0, 99]]);
  assert.equal(pointsInView(inside, 100, 100), null);
  const seen = pointsInView(inside, 50, 100);
  assert.equal(seen?.reduce((sum, value) => sum + value, 0), 128);
});
