/** A display is found by its pilots in a film as Python finds it, and no frame takes long. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { PilotSearch } from "../src/locate/pilots/search.js";
import { pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

/**
 * Pixels by which the page's corners may be farther from the truth than Python's: an eighth of the
 * blocks of these films. Whether a move of the corners made the display surer is decided by noise
 * where it was sure before.
 */
const SAME_PX = 1.5;

await loadOpenCv();
const { fps, later, images, truth, layouts, python } = readFixture("film");
const [count, height, width] = images.shape;

test("a film", () => {
  const known = layouts.map((/** @type {any} */ table) => new Layout(table));
  const search = new PilotSearch(known, fps);
  for (let frame = 0; frame < count; frame++) {
    const data = images.data.subarray(frame * width * height, (frame + 1) * width * height);
    const found = search.push({ width, height, data }, frame / fps);
    if (found === null) continue;
    assert.ok(python, `found ${JSON.stringify(found.corners)} where there is no display`);
    assert.ok(frame <= python.frame + later, `frame ${frame}, not ${python.frame}`);
    assert.equal(found.layout, known[python.layout]);
    const there = { shape: [4, 2], data: truth.data.subarray(8 * frame) };
    const off = farthest(found.corners, pointsOf(there));
    const pythonThere = { shape: [4, 2], data: truth.data.subarray(8 * python.frame) };
    const pythonOff = farthest(pointsOf(python.corners), pointsOf(pythonThere));
    assert.ok(off <= pythonOff + SAME_PX, `corners are off by ${off} px, Python's by ${pythonOff}`);
    return;
  }
  assert.equal(python, null);
});

test("layouts need pilots", () => {
  const plain = new Layout({ ...layouts[0], pilots: 0, pilot_blocks: [], pilot_bits: [] });
  assert.throws(() => new PilotSearch([plain]), /pilots/);
});

/**
 * @param {[number, number][]} points
 * @param {[number, number][]} others
 * @returns {number} the largest difference of a coordinate, pixels
 */
function farthest(points, others) {
  return Math.max(...points.flat().map((value, i) => Math.abs(value - others.flat()[i])));
}
