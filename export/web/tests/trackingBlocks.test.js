/** Unseen and covered blocks and repeated frames are those of Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Layout } from "../src/link/layout.js";
import { fillUnseen, unseenBlocks } from "../src/receive/unseen.js";
import { Occlusion } from "../src/receive/occlusion.js";
import { Repeats } from "../src/receive/repeats.js";
import { differences, planeOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

for (const name of ["partly out of view", "behind a hand", "pilots", "all seen"]) {
  test(`unseen blocks are filled: ${name}`, () => {
    const fixture = readFixture("hiding")[name];
    const layout = new Layout(fixture.layout);
    const images = fixture.images.map(planeOf);
    const unseen = unseenBlocks(images[0], images[1], fixture.purity.data, layout);
    assert.deepEqual([...unseen], [...fixture.unseen.data]);
    assert.equal(unseen.includes(1), name !== "all seen");
    fillUnseen(images, unseen, layout).forEach((image, i) => {
      assert.deepEqual(differences(image, fixture.filled[i]), { most: 0, mean: 0 });
    });
    images.forEach((/** @type {any} */ image, /** @type {number} */ i) => {
      assert.equal(image.data, fixture.images[i].data);
    });
  });
}

test("covered blocks are found", () => {
  const fixture = readFixture("covering");
  const occlusion = new Occlusion(new Layout(fixture.layout));
  fixture.images.forEach((/** @type {any} */ image, /** @type {number} */ number) => {
    const covered = occlusion.covered(planeOf(image));
    assert.deepEqual([...covered], [...fixture.covered[number].data], `image ${number}`);
  });
});

test("repeated frames are recognised", () => {
  for (const { images, repeated } of readFixture("repeating")) {
    const repeats = new Repeats();
    const found = images.map((/** @type {any} */ image) => repeats.isRepeat(planeOf(image)));
    assert.deepEqual(found, repeated);
    assert.equal(repeats.count, repeated.filter(Boolean).length);
  }
});
