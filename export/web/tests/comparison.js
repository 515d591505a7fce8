/** What node's tests use to compare arrays, points and planes with fixtures. */

import assert from "node:assert/strict";

/** @typedef {{ shape: number[], data: any }} Fixture */

/**
 * Fail unless all numbers lie within a tolerance of the expected ones.
 *
 * @param {ArrayLike<number>} found
 * @param {ArrayLike<number>} expected
 * @param {number} tolerance
 */
export function close(found, expected, tolerance) {
  assert.equal(found.length, expected.length);
  for (let i = 0; i < found.length; i++) {
    const apart = Math.abs(found[i] - expected[i]);
    assert.ok(apart <= tolerance, `number ${i}: ${found[i]}, not ${expected[i]}`);
  }
}

/**
 * Measure how far a plane's pixels are from a fixture's: the largest difference, and the mean.
 *
 * @param {import("../src/image/opencv.js").Plane<any>} plane
 * @param {Fixture} expected - (height, width)
 * @returns {{ most: number, mean: number }}
 */
export function differences(plane, expected) {
  assert.deepEqual([plane.height, plane.width], expected.shape);
  let most = 0;
  let sum = 0;
  for (let i = 0; i < plane.data.length; i++) {
    const apart = Math.abs(plane.data[i] - expected.data[i]);
    most = Math.max(most, apart);
    sum += apart;
  }
  return { most, mean: sum / plane.data.length };
}

/**
 * Make a plane of a fixture.
 *
 * @param {Fixture} fixture - (height, width)
 * @returns {import("../src/image/opencv.js").Plane<any>}
 */
export function planeOf({ shape, data }) {
  return { width: shape[1], height: shape[0], data };
}

/**
 * Make points of a fixture.
 *
 * @param {Fixture} fixture - (N, 2)
 * @returns {[number, number][]}
 */
export function pointsOf({ shape, data }) {
  return Array.from({ length: shape[0] }, (_, i) => [data[2 * i], data[2 * i + 1]]);
}

/**
 * Measure how far points are from where they are expected.
 *
 * @param {[number, number][]} points
 * @param {[number, number][]} expected
 * @returns {number} the largest distance on either axis
 */
export function apart(points, expected) {
  assert.equal(points.length, expected.length);
  const distances = points.flatMap(([x, y], i) => [
    Math.abs(x - expected[i][0]),
    Math.abs(y - expected[i][1]),
  ]);
  return Math.max(...distances);
}
