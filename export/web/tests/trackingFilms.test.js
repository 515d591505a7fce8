/** Displays are found in films, followed, and lost when they are gone. */

import assert from "node:assert/strict";
import { before, test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { identity, inverse } from "../src/link/linear.js";
import { Layout } from "../src/link/layout.js";
import { Tracker } from "../src/receive/tracking/patches.js";
import { CHECK_EVERY, PATIENCE, PilotTracker } from "../src/receive/tracking/pilots.js";
import { apart, planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

/** Largest distance of pilots' corners: a third of a block. Decoded blocks mend what is left. */
const CLOSE_PX = 4;

before(loadOpenCv);

/**
 * @param {any} fixture - (frames, 4, 2)
 * @returns {[number, number][][]}
 */
function framesOf({ shape, data }) {
  const all = pointsOf({ shape: [4 * shape[0], 2], data });
  return Array.from({ length: shape[0] }, (_, frame) => all.slice(4 * frame, 4 * frame + 4));
}

/**
 * Add noise to an image.
 *
 * @param {any} image
 * @param {number} seed
 */
function grainy({ width, height, data }, seed) {
  let state = seed + 1;
  const noisy = Uint8Array.from(data, (/** @type {number} */ level) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.min(255, Math.max(0, level + Math.floor((state / 2 ** 32) * 5) - 2));
  });
  return { width, height, data: noisy };
}

test("a display with patches is found, followed, lost and found again", () => {
  const fixture = readFixture("patches_film");
  const images = fixture.images.map(planeOf);
  const corners = framesOf(fixture.corners);
  const seen = framesOf(fixture.seen);
  const tracker = new Tracker(new Layout(fixture.layout));
  const follow = () => {
    let found = 0;
    images.forEach((/** @type {any} */ image, /** @type {number} */ number) => {
      const tracked = tracker.follow(image, 0);
      assert.ok(tracked !== null || found === 0, `frame ${number}`);
      if (tracked === null) return;
      found++;
      assert.deepEqual([tracked.rectified.width, tracked.rectified.height], [256, 192]);
      assert.ok(apart(tracked.corners, corners[number]) < 0.7);
      if (Number.isFinite(seen[number][0][0])) assert.ok(apart(tracked.corners, seen[number]) < 0.3);
    });
    return found;
  };
  assert.ok(follow() >= 8);
  const { width, height } = images[0];
  const dark = { width, height, data: new Uint8Array(width * height) };
  for (let number = 0; number < 3; number++) assert.equal(tracker.follow(dark, 0), null);
  assert.ok(follow() >= 6);
});

test("layouts need what their trackers look for", () => {
  const { layout } = readFixture("pilots_film");
  assert.throws(() => new Tracker(new Layout(layout)), /patches/);
  const { layout: patches } = readFixture("patches_film");
  assert.throws(() => new PilotTracker([new Layout(patches)], 30), /pilots/);
});

test("a display with pilots is found, moved, and lost when it stops toggling", () => {
  const fixture = readFixture("pilots_film");
  const images = fixture.images.map(planeOf);
  const corners = framesOf(fixture.corners);
  const [plain, moved] = [0, 1].map(() => new PilotTracker([new Layout(fixture.layout)], 60));
  let found = 0;
  for (let number = 0; number < images.length; number++) {
    const [here, there] = [plain, moved].map((tracker) =>
      tracker.follow(images[number], number / 60),
    );
    assert.equal(here === null, there === null);
    assert.ok(here !== null || found === 0, `frame ${number}`);
    if (here === null || there === null) continue;
    found++;
    assert.ok(apart(here.corners, corners[number]) < CLOSE_PX);
    const shift = identity(3);
    shift[2] = 7;
    shift[5] = -5;
    if (found === 2) assert.ok(apart(there.corners, here.corners) > 3);
    else assert.ok(apart(there.corners, here.corners) < 1e-3);
    // the scale of a homography means nothing
    if (found === 1) moved.correct(shift.map((value) => 2 * value));
    if (found === 2) moved.correct(inverse(shift));
  }
  assert.ok(found >= images.length - fixture.first - 4, `${found} frames`);
  let still = 0;
  for (; still < 300; still++) {
    const time = (images.length + still) / 60;
    if (plain.follow(grainy(images[images.length - 1], still % 8), time) === null) break;
  }
  assert.ok(still > CHECK_EVERY * PATIENCE - images.length && still <= CHECK_EVERY * 6, `${still}`);
});
