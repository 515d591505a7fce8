/** Toggles of patches and pilots in rectified frames, beside Python's. */

import { test } from "node:test";
import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { makeToggles } from "../src/receive/timing/toggles.js";
import { close, planeOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

test("toggles of a few frames", async () => {
  await loadOpenCv();
  for (const { layout, frames, places, toggles } of readFixture("toggles")) {
    const meter = makeToggles(new Layout(layout));
    close(meter.places, places.data, 1e-12);
    frames.forEach((/** @type {any} */ frame, /** @type {number} */ k) => {
      const hidden = (/** @type {number} */ value) => (Number.isNaN(value) ? -1e9 : value);
      close(meter.measure(planeOf(frame)).map(hidden), toggles[k].data.map(hidden), 1e-4);
    });
  }
});
