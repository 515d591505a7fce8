/** A film of gray frames, read by the page's receiver and by Python's. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { Decoder } from "../src/decoder.js";
import { loadOpenCv } from "../src/image/opencv.js";
import { Layout } from "../src/link/layout.js";
import { explainSilence } from "../src/receive/diagnosis.js";
import { Receiver } from "../src/receive/receiver.js";
import { readFixture } from "./fixtures.js";

/** Number of frames by which the page's receiver may be later or earlier than Python's. */
const FRAMES_APART = 10;
/** Mean distance in pixels, along each axis, by which its corners may be farther from the truth. */
const CORNERS_WORSE = 0.5;
/** Share by which rates of states may differ; the first fit looks back a second or less. */
const CLOCKS_APART = 0.05;
/** Share of bits in which a pair must be like one that Python has decoded. */
const BITS_ALIKE = 0.97;

const known = readFixture("film");
const film = new Uint8Array(readFileSync(join(String(process.env.FIXTURES), "film.gray")));

/** Read the film until the message is whole. */
async function readFilm() {
  const decoders = known.decoders.map(
    (/** @type {any} */ one) =>
      new Decoder(new Layout(one.layout), new Uint8Array(readFileSync(one.model))),
  );
  const receiver = new Receiver(decoders, 30);
  const [height, width] = known.shape;
  const events = [];
  for (const [k, time] of known.times.entries()) {
    const data = film.slice(k * width * height, (k + 1) * width * height);
    const step = await receiver.push({ width, height, data }, time);
    const corners = step.tracked && step.tracked.corners;
    events.push({ corners, pairs: step.pairs, clock: receiver.stateHz });
    if (step.message !== null) return { receiver, events, message: step.message };
  }
  return { receiver, events, message: (await receiver.finish()).message };
}

/**
 * @param {ArrayLike<number>} one
 * @param {ArrayLike<number>} other
 */
function bitsAlike(one, other) {
  const alike = Array.from(one).filter((score, bit) => score > 0 === other[bit] > 0);
  return alike.length / one.length;
}

test("the same message at about the same frame", async () => {
  await loadOpenCv();
  const { receiver, events, message } = await readFilm();
  assert.equal(message && message.text, known.message);
  assert.ok(Math.abs(events.length - known.events.length) <= FRAMES_APART);
  const decoded = known.events.flatMap((/** @type {any} */ event) => event.scores);
  let [seen, both, worse] = [0, 0, 0];
  events.forEach(({ corners, clock, pairs }, k) => {
    const { error, truth, clock: knownClock } = known.events[k] ?? {};
    if (corners) seen++;
    if (corners && typeof error === "number") {
      const apart = corners.flat().map((value, at) => Math.abs(value - truth.data[at]));
      worse += apart.reduce((sum, value) => sum + value) / apart.length - error;
      both++;
    }
    if (clock && knownClock) {
      assert.ok(Math.abs(clock / knownClock - 1) < CLOCKS_APART, `${clock} at frame ${k}`);
    }
    for (const { scores } of known.message === null || decoded.length === 0 ? [] : pairs) {
      const alike = decoded.map((/** @type {any} */ one) => bitsAlike(scores, one.data));
      assert.ok(Math.max(...alike) > BITS_ALIKE, `a pair at frame ${k} is like no other`);
    }
  });
  assert.equal(seen > 0, known.events.some((/** @type {any} */ event) => event.error !== null));
  assert.ok(both === 0 || worse / both < CORNERS_WORSE, `corners ${worse / both} pixels worse`);
  if (known.message === null) {
    assert.equal(explainSilence(receiver.observations), known.silence);
  }
});
