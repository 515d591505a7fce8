/** A display is followed, and its corners corrected, as in Python. */

import assert from "node:assert/strict";
import { before, test } from "node:test";

import { Features } from "../src/image/features.js";
import { Flow } from "../src/image/flow.js";
import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { Follower } from "../src/receive/tracking/follow.js";
import { planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

before(loadOpenCv);

/**
 * @param {[number, number][]} points
 * @param {[number, number][]} expected
 * @returns {number} largest distance of a point from where it is expected, on either axis
 */
function apart(points, expected) {
  assert.equal(points.length, expected.length);
  const distances = points.flatMap(([x, y], i) => [
    Math.abs(x - expected[i][0]),
    Math.abs(y - expected[i][1]),
  ]);
  return Math.max(...distances);
}

test("points are chosen", () => {
  const fixture = readFixture("optical_flow");
  const features = new Features(planeOf(fixture.first));
  const cases = [
    { found: features.choose(50, 0.05, 4, fixture.mask.data), expected: pointsOf(fixture.few) },
    { found: features.choose(300, 0.005, 8), expected: pointsOf(fixture.many) },
  ];
  for (const { found, expected } of cases) {
    // of two pixels that are equally strong, rounding chooses
    const known = new Set(expected.map(String));
    const same = found.filter((point) => known.has(String(point))).length;
    assert.equal(found.length, expected.length);
    assert.ok(same >= 0.98 * expected.length, `${same} of ${expected.length}`);
  }
});

test("points are followed", () => {
  const fixture = readFixture("optical_flow");
  const points = pointsOf(fixture.points);
  const cases = [
    { windowPx: 13, guess: points, moved: fixture.moved, status: fixture.status },
    { windowPx: 15, guess: pointsOf(fixture.guess), moved: fixture.guessed },
  ];
  for (const { windowPx, guess, moved, status = fixture.guessed_status } of cases) {
    const flow = new Flow(planeOf(fixture.first), points, windowPx, 2);
    const there = flow.follow(planeOf(fixture.second), guess);
    assert.deepEqual([...there.found], [...status.data]);
    const kept = [...points.keys()].filter((i) => there.found[i]);
    const expected = pointsOf(moved);
    const far = apart(
      kept.map((i) => there.moved[i]),
      kept.map((i) => expected[i]),
    );
    assert.ok(far < 0.01, `${far}`);
  }
});

for (const name of ["patches", "pilots", "partly out of view", "another picture"]) {
  test(`a display is followed: ${name}`, () => {
    const fixture = readFixture("followed")[name];
    const images = fixture.images.map(planeOf);
    const follower = new Follower(new Layout(fixture.layout));
    /** @type {any} */
    let corners = pointsOf(fixture.start);
    const begin = (/** @type {any} */ image) => {
      const view = follower.rectified(image, corners);
      assert.ok(view);
      follower.begin(image, corners, view);
    };
    begin(images[0]);
    const all = pointsOf({ shape: [40, 2], data: fixture.corners.data });
    for (let number = 1; number < images.length; number++) {
      const step = follower.step(images[number]);
      assert.ok(step, `frame ${number}`);
      ({ corners } = step);
      const far = apart(corners, all.slice(4 * number - 4, 4 * number));
      assert.ok(far < 0.1, `frame ${number}: ${far}`);
      assert.equal(step.fresh, fixture.fresh[number - 1]);
      follower.advance(corners);
      if (step.fresh) begin(images[number]);
    }
  });
}
