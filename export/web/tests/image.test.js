/** Images are shrunk, warped, rectified and followed, and small algebra done, as in Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Features } from "../src/image/features.js";
import { Flow } from "../src/image/flow.js";
import { resizeArea } from "../src/image/shrink.js";
import * as geometry from "../src/link/geometry.js";
import { Layout } from "../src/link/layout.js";
import { determinant, inverse, multiply3, solve } from "../src/link/linear.js";
import { matchPatches } from "../src/link/ratex.js";
import { gemanMcclureWeights, reweighted, ridgeSolution } from "../src/link/robust.js";
import { apart, close, differences, planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

test("small linear algebra", () => {
  const { A, b, ...expected } = readFixture("algebra");
  close(solve(A.data, b.data), expected.solution.data, 1e-9);
  close(inverse(A.data), expected.inverse.data, 1e-9);
  assert.ok(Math.abs(determinant(A.data) / expected.determinant - 1) < 1e-9);
  const part = (/** @type {number} */ row, /** @type {number} */ col) =>
    [0, 1, 2].flatMap((i) => [0, 1, 2].map((j) => A.data[(row + i) * 8 + col + j]));
  close(multiply3(part(0, 0), part(3, 3)), expected.product.data, 1e-12);
  assert.ok(determinant([1, 2, 2, 4]) === 0);
});

test("robust least squares", () => {
  const { A, b, ridge, pull, ...expected } = readFixture("algebra").robust;
  const median = (/** @type {Float64Array} */ values) => {
    const sorted = values.slice().sort();
    return (sorted[values.length / 2 - 1] + sorted[values.length / 2]) / 2;
  };
  const { solution, weights } = reweighted({
    solve: (weigh) => ridgeSolution(A.data, b.data, weigh, ridge.data, pull.data),
    residualsOf: (x) =>
      Float64Array.from(b.data, (/** @type {number} */ value, i) => {
        const row = A.data.subarray(3 * i);
        return Math.abs(value - row[0] * x[0] - row[1] * x[1] - row[2] * x[2]);
      }),
    scaleOf: (residuals) => 3 * median(residuals),
    rounds: 6,
    weights: new Float64Array(40).fill(1),
    weigh: gemanMcclureWeights,
  });
  close(solution, expected.solution.data, 1e-9);
  close(weights, expected.weights.data, 1e-9);
});

test("homographies, and corners that are sound", () => {
  const fixture = readFixture("geometry");
  const H = geometry.homographyFromCorners(pointsOf(fixture.corners), 128, 96);
  close(H, fixture.H.data, 1e-9);
  const points = pointsOf(fixture.points);
  close(geometry.transform(H, points).flat(), fixture.there.data, 1e-9);
  assert.deepEqual(geometry.inImage(points, 128, 96), fixture.inside.data);
  const sound = fixture.cases.map((/** @type {any} */ [corners, outside]) =>
    geometry.checkCorners(corners, 160, 110, outside),
  );
  assert.deepEqual(sound, fixture.sound);
});

test("areas are averaged", () => {
  const cases = readFixture("shrinking");
  const bytes = planeOf(cases.pop().image);
  const floats = { ...bytes, data: Float32Array.from(bytes.data) };
  for (const { size, ...expected } of cases) {
    const { most, mean } = differences(resizeArea(bytes, size[0], size[1]), expected.bytes);
    // OpenCV interpolates bytes that grow with whole numbers, which round a little differently
    const grows = size[0] > bytes.width || size[1] > bytes.height;
    assert.ok(most <= 1 && mean < (grows ? 0.2 : 2e-3), `${size}: ${most}, ${mean}`);
    close(resizeArea(floats, size[0], size[1]).data, expected.floats.data, 1e-3);
  }
});

test("displays are rectified", () => {
  for (const { image, H, rectified } of readFixture("rectifying")) {
    const [height, width] = rectified.shape;
    const view = geometry.rectify(planeOf(image), H.data, width, height);
    const { most, mean } = differences(view, rectified);
    assert.ok(most <= 1 && mean < 0.05, `${most}, ${mean}`);
  }
});

test("patches are compared with what was displayed", () => {
  const fixture = readFixture("patches");
  const match = matchPatches(planeOf(fixture.frame), new Layout(fixture.layout));
  close(match.captured, fixture.captured.data, 1e-9);
  close(match.shown, fixture.shown.data, 1e-9);
  close(match.correlation, fixture.correlation.data, 1e-9);
  assert.deepEqual([...match.label], [...fixture.label.data]);
});

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
