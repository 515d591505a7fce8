/** The parts of the search for a display do what Python's do. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { blurred } from "../src/image/blur.js";
import { Layout } from "../src/link/layout.js";
import { alignSteps } from "../src/locate/align.js";
import { edgeLevels, sideFeatures, snapToEdges } from "../src/locate/edges.js";
import {
  cornersFromPatches,
  imagePyramid,
  patchesInView,
  searchPatches,
  seenCorrelation,
} from "../src/locate/patches.js";
import { distinct, isSound, upright } from "../src/locate/quads.js";
import { cornersOnEdges, cornersOnPatches } from "../src/locate/refine.js";
import { runToEnd } from "../src/link/code/steps.js";
import { apart, close, planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

const { layout: table, image: pixels, shapes, sides, patches } = readFixture("locate");
const layout = new Layout(table);
const image = planeOf(pixels);

/**
 * Make quadrilaterals of a fixture.
 *
 * @param {import("./comparison.js").Fixture} fixture - (N, 4, 2)
 */
function quadsOf({ shape, data }) {
  const size = 8;
  return Array.from({ length: shape[0] }, (_, i) =>
    pointsOf({ shape: [4, 2], data: data.subarray(size * i, size * (i + 1)) }),
  );
}

test("quadrilaterals", () => {
  const quads = quadsOf(shapes.quads);
  [0.01, 0.25].forEach((outside, i) => {
    const sound = quads.map((quad) => Number(isSound(quad, image.width, image.height, outside)));
    assert.deepEqual(sound, Array.from(shapes.sound[i].data));
  });
  assert.deepEqual(distinct(quads, shapes.rank.data, 8, 15), Array.from(shapes.distinct.data));
  const turned = quadsOf(shapes.turned).map(upright);
  assert.deepEqual(turned, quadsOf(shapes.upright));
});

test("what the sides show", () => {
  const levels = edgeLevels(image);
  const features = quadsOf(sides.quads).flatMap((quad) => sideFeatures(image, quad, levels));
  // a place whose step is as large as the least that counts may be counted or not
  close(features, sides.features.data, 0.03);
});

test("sides snap to edges", () => {
  const smooth = blurred(image, 0.7);
  const expected = quadsOf(sides.snapped);
  const snapped = quadsOf(sides.quads).map((quad) => snapToEdges(smooth, quad, 5));
  const off = snapped.map((quad, i) => apart(quad, expected[i]));
  // steps of a pixel are tried, and two of them may be as good
  assert.ok(off.filter((distance) => distance < 0.01).length >= 0.8 * off.length, `${off}`);
  assert.ok(Math.max(...off) < 1.5, `${off}`);
  const fitted = quadsOf(sides.quads).map((quad) => cornersOnEdges(image, quad, 6));
  quadsOf(sides.onEdges).forEach((quad, i) => assert.ok(apart(fitted[i], quad) < 0.1));
});

test("patches are found", () => {
  const pyramid = imagePyramid(image);
  for (const [near, promise, expected] of [
    [patches.near, patches.promise, patches.found],
    [patches.cut, patches.cutPromise, patches.cutFound],
  ]) {
    const result = searchPatches(pyramid, pointsOf(near), layout);
    assert.ok(Math.abs(result.promise - promise) < 0.01);
    close(result.found.flat(), expected.data, 0.01);
  }
  const { found } = searchPatches(pyramid, pointsOf(patches.near), layout);
  const moved = cornersFromPatches(pointsOf(patches.near), found, layout);
  assert.ok(apart(moved, pointsOf(patches.moved)) < 0.1);
  const inView = patchesInView(pointsOf(patches.cut), layout, image.width, image.height);
  assert.deepEqual(inView, patches.cutInView.data);
});

test("corners move onto patches", () => {
  const pyramid = imagePyramid(image);
  const aligned = runToEnd(alignSteps(pyramid, pointsOf(patches.close), layout));
  assert.ok(apart(aligned, pointsOf(patches.aligned)) < 0.05);
  const { corners, seen } = cornersOnPatches(image, pyramid, pointsOf(patches.near), layout);
  assert.ok(apart(corners, pointsOf(patches.onPatches)) < 0.05);
  assert.ok(Math.abs(seen - patches.seen) < 1e-3);
});

test("correlation of patches, some of them out of view", () => {
  const count = patches.match.shape[1];
  const found = patches.correlation.map((/** @type {number} */ _, /** @type {number} */ i) =>
    seenCorrelation(
      patches.match.data.subarray(i * count, (i + 1) * count),
      patches.inView.data.subarray(i * count, (i + 1) * count),
    ),
  );
  close(found, patches.correlation, 1e-9);
});
