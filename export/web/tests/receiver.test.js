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
/** Distance in pixels by which corners may differ at a frame in which both see the display. */
const CORNERS_APART = 1.5;

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
    const numbers = step.pairs.map(({ number }) => number);
    const corners = step.tracked && step.tracked.corners;
    events.push({ corners, numbers, pairs: step.pairs, clock: receiver.stateHz });
    if (step.message !== null) return { receiver, events, message: step.message };
  }
  return { receiver, events, message: (await receiver.finish()).message };
}

test("the same message at about the same frame", async () => {
  await loadOpenCv();
  const { receiver, events, message } = await readFilm();
  const shared = Math.min(events.length, known.events.length);
  let apart = 0;
  let [seen, both, right, pairs] = [0, 0, 0, 0];
  for (let k = 0; k < shared; k++) {
    const expected = known.events[k];
    if (events[k].corners) seen++;
    events[k].corners?.forEach(([x, y], corner) => {
      if (!expected.corners) return;
      const [knownX, knownY] = expected.corners.data.slice(2 * corner, 2 * corner + 2);
      apart = Math.max(apart, Math.hypot(x - knownX, y - knownY));
      both++;
    });
    if (expected.clock !== null && events[k].clock !== null) {
      const ratio = Number(events[k].clock) / expected.clock;
      assert.ok(Math.abs(ratio - 1) < 0.01, `clock at frame ${k}: ${ratio} times Python's`);
    }
    for (const { number, scores } of events[k].pairs) {
      const at = expected.pairs.indexOf(number);
      if (at < 0) continue;
      const data = expected.scores[at].data;
      right += scores.filter((score, bit) => score > 0 === data[bit] > 0).length / scores.length;
      pairs++;
    }
  }
  console.log(`frames ${events.length} for ${known.events.length}; display in ${seen}`);
  console.log(`corners apart ${apart}; pairs ${pairs}, bits alike ${right / pairs}`);
  console.log(receiver.timing, receiver.observations);
  assert.equal(message && message.text, known.message);
  assert.ok(Math.abs(events.length - known.events.length) <= FRAMES_APART);
  assert.ok(apart < CORNERS_APART, `corners are ${apart} pixels apart`);
  assert.ok(both === 0 || both > 2 * shared, `the display is seen in ${both / 4} frames`);
  assert.ok(pairs === 0 || right / pairs > 0.98);
  if (known.message === null) {
    assert.equal(explainSilence(receiver.observations), known.silence);
  }
});
