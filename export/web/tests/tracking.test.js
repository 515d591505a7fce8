/** A display is followed, and its corners corrected, as in Python. */

import assert from "node:assert/strict";
import { before, test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { frameCorners, transform } from "../src/link/geometry.js";
import { Layout } from "../src/link/layout.js";
import { CornerShift } from "../src/receive/tracking/corners.js";
import { Follower } from "../src/receive/tracking/follow.js";
import { apart, close, planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

before(loadOpenCv);

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

test("corners move to where decoded blocks lie", () => {
  const fixture = readFixture("shifting");
  const layout = new Layout(fixture.layout);
  const shifts = new CornerShift(layout);
  const corners = frameCorners(layout.width, layout.height);
  const total = new Float64Array(8);
  for (const { images, scores, shift } of fixture.pairs) {
    const [first, second] = images.map(planeOf);
    shifts.take(first, second, scores.data, total);
    const found = shifts.shift();
    assert.equal(found === null, shift === null);
    if (found === null) continue;
    const expected = transform(shift.data, corners).flat();
    close(transform(found, corners).flat(), expected, 2e-3);
    assert.equal(shifts.shift(), null);
  }
});
