/** Toggles of patches and pilots in rectified frames, beside Python's. */

import { test } from "node:test";
import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { makeToggles } from "../src/receive/timing/toggles.js";
import { close, planeOf } from "./comparison.js";
import { readFixture, rowsOf } from "./fixtures.js";

test("toggles of a few frames", async () => {
  await loadOpenCv();
  for (const { layout, frames, places, measured, toggles } of readFixture("toggles")) {
    const meter = makeToggles(new Layout(layout));
    close(meter.places, places.data, 1e-12);
    const unseen = (/** @type {number} */ value) => (Number.isNaN(value) ? -1e9 : value);
    const values = frames.map((/** @type {any} */ frame) => meter.measure(planeOf(frame)));
    values.forEach((/** @type {Float64Array} */ value, /** @type {number} */ k) => {
      close(value.map(unseen), measured[k].data.map(unseen), 1e-4);
    });
    meter.overTime(values).forEach((value, k) => {
      close(value.map(unseen), rowsOf(toggles)[k].map(unseen), 1e-4);
    });
  }
});
