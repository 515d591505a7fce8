/** The decoder's graphs in onnxruntime-web, beside Python's onnxruntime. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { Decoder } from "../src/decoder.js";
import { Layout } from "../src/link/layout.js";
import { planeOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

const known = readFixture("decoders");
const models = known.map((/** @type {any} */ one) => new Uint8Array(readFileSync(one.model)));

test("scores of every preset's graph", async () => {
  for (const [at, one] of known.entries()) {
    const decoder = new Decoder(new Layout(one.layout), models[at]);
    const { scores, head } = await decoder.decode(planeOf(one.original), planeOf(one.embedded));
    assert.equal(scores.length, one.scores.data.length);
    scores.forEach((score, bit) => {
      const expected = one.scores.data[bit];
      assert.ok(Math.abs(score - expected) < 1e-3, `${one.model}: ${score} for ${expected}`);
      assert.equal(score > 0, expected > 0, `bit ${bit} of ${one.model}`);
    });
    head.forEach((weight, k) => assert.ok(Math.abs(weight - one.head.data[k]) < 1e-3));
  }
});

test("a graph of another layout is refused, and may be given again", async () => {
  const decoder = new Decoder(new Layout(known[0].layout), models[1]);
  await assert.rejects(decoder.load(), /gives 730 scores/);
  decoder.model = models[0];
  await decoder.load();
});

test("the frames of a pair have one size", async () => {
  const decoder = new Decoder(new Layout(known[0].layout), models[0]);
  const { width, height, data } = planeOf(known[0].original);
  const small = { width, height: height / 2, data: data.slice(data.length / 2) };
  await assert.rejects(decoder.decode({ width, height, data }, small), /one size/);
});
