/** The search finds a display where Python finds it, and nothing where Python finds nothing. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { searchSteps } from "../src/locate/find.js";
import { planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

/** Largest distance, in pixels, of a corner from Python's. */
const CORNER_PX = 0.3;
/** Largest distance, in pixels, of a corner from the true one, whatever is in view. */
const TRUE_CORNER_PX = 3;
/** Largest number of units of work of a step, and of a search in vain. */
const STEP_WORK = 20;
const SEARCH_WORK = 450;

const { layout, plain, searches } = readFixture("locate_find");
await loadOpenCv();

for (const [name, search] of Object.entries(searches)) {
  test(name, () => {
    const steps = searchSteps(planeOf(search.image), new Layout(search.patches ? layout : plain));
    /** @type {number[]} */
    const works = [];
    let step = steps.next();
    for (; !step.done; step = steps.next()) works.push(step.value);
    const found = step.value;
    assert.ok(Math.max(...works) <= STEP_WORK);
    if (!search.corners) {
      assert.equal(found, null);
      assert.ok(works.reduce((sum, work) => sum + work, 0) <= SEARCH_WORK);
      return;
    }
    assert.ok(found);
    assert.ok(farthest(found.corners, search.corners) < CORNER_PX);
    assert.ok(farthest(found.corners, search.truth) < TRUE_CORNER_PX);
    assert.ok(Math.abs(found.score - search.score) < 0.01, `${found.score} for ${search.score}`);
  });
}

/**
 * @param {[number, number][]} corners
 * @param {import("./comparison.js").Fixture} expected
 */
function farthest(corners, expected) {
  const distances = pointsOf(expected).map(([x, y], i) =>
    Math.hypot(corners[i][0] - x, corners[i][1] - y),
  );
  return Math.max(...distances);
}
