/** The films that are read while the page gets ready reach every stage, and end in time. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { warmUp } from "../src/receive/warm.js";
import { readFixture } from "./fixtures.js";

await loadOpenCv();
const layouts = readFixture("layouts").map((/** @type {any} */ table) => new Layout(table));
const [patches, pilots] = layouts;

test("frame pairs of a display with patches and of one with pilots are decoded", async () => {
  assert.ok((await warmUp([patches])) >= 2);
  assert.ok((await warmUp([pilots])) >= 2);
});

test("nothing is read when there is no time", async () => {
  assert.equal(await warmUp(layouts, 0), 0);
});
