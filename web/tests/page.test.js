/** The page's parts that need no browser: luma, films, texts, links, advice. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { expose } from "comlink";
import { turned } from "../port/image/turned.js";
import { adviceFor, barOf, failureOf, isOfSite, shareOf, stateOf } from "../page/advice.js";
import { shortenExposure } from "../page/camera.js";
import { risingTimes } from "../page/films.js";
import { rateOf } from "../page/frames.js";
import { planeOfFrame, planeOfRgba } from "../page/planes.js";
import { Reception } from "../page/reception.js";
import { linkOf, noteOf } from "../page/text.js";

/**
 * @param {string} format @param {boolean | null} fullRange @param {Uint8Array} data
 * @param {object[]} [planes] - that are copied
 */
function frameOf(format, fullRange, data, planes = [{}]) {
  const visibleRect = { x: 0, y: 0, width: 3, height: 2 };
  let isClosed = false;
  const frame = {
    format,
    visibleRect,
    colorSpace: { fullRange },
    allocationSize: () => data.length,
    async copyTo(/** @type {Uint8Array} */ into) {
      into.set(data);
      return planes;
    },
    close: () => (isClosed = true),
    isClosed: () => isClosed,
  };
  return /** @type {any} */ (frame);
}

test("luma is taken from the plane, and stretched only where its range is limited", async () => {
  const data = Uint8Array.from([16, 126, 235, 17, 0, 255, 80, 80, 80, 80]);
  const kept = Uint8Array.from([16, 126, 235, 17, 0, 255]);
  for (const [range, expected] of [
    [true, kept],
    [null, kept],
    [false, Uint8Array.from([0, 128, 255, 1, 0, 255])],
  ]) {
    for (const format of ["I420", "NV12"]) {
      const frame = frameOf(format, /** @type {any} */ (range), data);
      const plane = await planeOfFrame(frame);
      assert.deepEqual(plane, { width: 3, height: 2, data: expected });
      assert.ok(frame.isClosed());
    }
  }
});

test("colours become luma, wherever the browser has them", async () => {
  const data = Uint8Array.from({ length: 24 }, (_, i) => (i * 53) % 256);
  const plane = await planeOfFrame(frameOf("BGRX", null, data));
  assert.deepEqual(plane, planeOfRgba({ width: 3, height: 2, data }));
  const drawImage = () => {};
  const context = { drawImage, getImageData: () => ({ data }) };
  Object.assign(globalThis, { OffscreenCanvas: class { getContext = () => context; } });
  for (const [copied, planes] of [
    [new Uint8Array(24), [{}, {}, {}]],
    [new Uint8Array(36), [{}]],
  ]) {
    const ignorant = frameOf("I422P10", null, /** @type {any} */ (copied), /** @type {any} */ (planes));
    assert.deepEqual(await planeOfFrame(ignorant), plane); // drawn, as no colours were copied
  }
});

test("times tell the rate, and missing frames count", () => {
  assert.ok(Math.abs(rateOf([0, 0.1, 0.2, 0.5, 0.6]) - 10) < 1e-9);
  for (const times of [[], [3], [1, 1], [0, 1e-4, 2e-4]]) assert.equal(rateOf(times), 30);
});

test("times begin at 0, and those that cannot be are replaced", () => {
  for (const [stated, shown] of [
    [[9182.5, 9182.6, 9182.9], [0, 0.1, 0.4]],
    [[NaN, 7, 7.25], [0, 0.1, 0.35]],
    [[0, 0.1, 0.1, 0.05, 1e9, 0.55], [0, 0.1, 0.2, 0.3, 0.4, 0.55]],
  ]) {
    const times = stated.map(risingTimes(10));
    times.forEach((time, i) => assert.ok(Math.abs(time - shown[i]) < 1e-6, `${times}`));
  }
});

/**
 * Make the page's end of a worker that takes frames in this way, and wait until it is ready.
 *
 * @param {(pixels: any, time: number) => any} take
 */
async function receptionOf(take) {
  /** @type {any[]} */
  const heard = [];
  const listener = new Proxy({}, { get: (_, name) => (/** @type {any} */ step) => {
    if (name === "step") heard.push(step);
  } });
  const { port1, port2 } = new MessageChannel();
  expose({ load() {}, warm() {}, start() {}, take }, /** @type {any} */ (port2));
  const Worker = function () {
    return port1;
  };
  const fetch = async () => new Response("1");
  Object.assign(globalThis, { Worker, VERSION: "1", fetch, self: { location: { href: "http://localhost/" } } });
  const reception = new Reception(/** @type {any} */ (listener));
  while (!reception.isReady) await new Promise((resolve) => setTimeout(resolve));
  return { reception, heard, port: port1 };
}

test("answers on what was read before are not heard", async () => {
  const step = { progress: 0.5 };
  const { reception, heard, port } = await receptionOf(() => step);
  for (const isOver of [false, true]) {
    reception.begin(30);
    const heardOf = reception.offer({}, 0);
    if (isOver) reception.end();
    await heardOf;
  }
  port.close();
  assert.deepEqual(heard, [step]);
});

test("of the frames that come while the worker is busy, the newest waits", async () => {
  const { reception, heard, port } = await receptionOf((_, time) => ({ time }));
  reception.begin(30);
  let closed = 0;
  reception.offer({}, 0);
  const frame = /** @type {any} */ ({ close: () => closed++ });
  for (const time of [1, 2]) reception.offer({ frame }, time);
  reception.offer({}, 3);
  await reception.whenIdle();
  assert.deepEqual([closed, reception.taken, reception.dropped], [2, 2, 2]);
  reception.offer({}, 5);
  reception.offer({ frame }, 6);
  reception.begin(30);
  await reception.whenIdle();
  port.close();
  assert.deepEqual([closed, ...heard.map(({ time }) => time)], [3, 0, 3]);
});

test("a frame is turned clockwise", () => {
  const plane = { width: 3, height: 2, data: Uint8Array.from([1, 2, 3, 4, 5, 6]) };
  assert.deepEqual(turned(plane, 0), plane);
  const quarter = { width: 2, height: 3, data: Uint8Array.from([4, 1, 5, 2, 6, 3]) };
  assert.deepEqual(turned(plane, 90), quarter);
  assert.deepEqual(turned(plane, 180).data, plane.data.slice().reverse());
  assert.deepEqual(turned(turned(plane, 90), 270), plane);
  assert.deepEqual(plane.data, Uint8Array.from([1, 2, 3, 4, 5, 6]));
});

test("what cannot be seen in a message is said", () => {
  const bytesOf = (/** @type {string} */ text) => new TextEncoder().encode(text);
  for (const text of ["Hi", "two\nlines\twith tabs\r\n", "\u05e9\u05dc\u05d5\u05dd", "👩‍👩‍👧", "\\xff"]) {
    assert.equal(noteOf(bytesOf(text), text), "", text);
  }
  for (const text of ["a\u0000b", "\u202emoc.live", "pass\u200bword", "\u001b[31mred"]) {
    assert.match(noteOf(bytesOf(text), text), /cannot be seen or/, text);
  }
  assert.match(noteOf(bytesOf(" \n\u0007"), " \n\u0007"), /nothing .* are 20 0a 07$/);
  assert.match(noteOf(new Uint8Array(99), "\0".repeat(99)), /00 …$/);
});

test("only plain addresses of the web can be opened", () => {
  for (const [text, host] of [
    ["https://example.org/a?b#c", "example.org"],
    [" http://localhost:8000/ \n", "localhost:8000"],
    ["HTTPS://EXAMPLE.ORG", "example.org"],
    ["https://\u0430pple.com/", "xn--pple-43d.com"],
  ]) {
    assert.equal(linkOf(text)?.host, host);
  }
  for (const text of [
    "javascript:alert(1)",
    "data:text/html,x",
    "example.org",
    "see https://example.org",
    "https://good.example@evil.example/",
    "https://",
    "https://a b",
    "https:\\\\evil.example",
    "file:///etc/passwd",
  ]) {
    assert.equal(linkOf(text), null, text);
  }
});

test("advice says what would help, and waits before it does", () => {
  const image = { width: 100, height: 100 };
  const corners = [[10, 10], [90, 10], [90, 90], [10, 90]];
  const far = [[45, 45], [55, 45], [55, 55], [45, 55]];
  const seen = { found: 90, neededFps: 0, exposed: 0, level: 120, clipped: 0, cut: false };
  const sight = { ...seen, corners, synchronised: true, progress: 0.5 };
  assert.ok(Math.abs(shareOf(corners, image) - 0.64) < 1e-12);
  const lost = { ...sight, corners: null, synchronised: false, progress: 0 };
  assert.equal(stateOf(lost), "Looking for the display");
  assert.equal(stateOf({ ...lost, progress: 0.2 }), "Display lost, looking again");
  assert.equal(stateOf({ ...sight, synchronised: false }), "Display found, hold still");
  assert.equal(stateOf(sight), "Receiving the message");
  assert.equal(adviceFor({ ...lost, level: 5 }, 1, image), "");
  assert.match(adviceFor({ ...sight, level: 5 }, 9, image), /too dark/);
  assert.match(adviceFor({ ...lost, level: 5 }, 9, image), /It is dark: come closer/);
  assert.match(adviceFor({ ...lost, neededFps: 30 }, 9, image), /need 30 frames a second/);
  assert.match(adviceFor({ ...lost, clipped: 0.5 }, 9, image), /too bright/);
  assert.match(adviceFor(lost, 9, image), /come closer/);
  assert.match(adviceFor({ ...sight, corners: far }, 9, image), /small.*closer/);
  assert.match(adviceFor({ ...sight, cut: true, level: 5 }, 9, image), /outside/);
  assert.match(adviceFor({ ...sight, exposed: 2 }, 9, image), /shorter exposure/);
  assert.match(adviceFor({ ...sight, synchronised: false }, 9, image), /still/);
  assert.equal(adviceFor(sight, 9, image), "");
  const steps = [{ found: 0 }, { found: 9 }, { found: 60 }, { found: 99, progress: 0.2 }, sight];
  const bars = steps.map((step) => barOf({ ...lost, ...step }));
  assert.ok(bars[0] === 0 && bars.every((bar, i) => i === 0 || bar > bars[i - 1]));
  assert.ok(barOf({ ...sight, progress: 1.3 }) < 1);
});

test("why the receiver will not work is said without jargon", () => {
  for (const [reason, said] of [
    ["WebAssembly.instantiate(): Compiling or instantiating WebAssembly module violates the following Content Security policy directive because neither 'wasm-eval' nor 'unsafe-eval' is an allowed source", /server forbids/],
    ["call to WebAssembly.instantiate() blocked by CSP", /server forbids/],
    ["this page is older than what its server has now", /renewed: .*Reload/],
    ["opencv.wasm is missing on the server", /part .* is missing: .*Reload.*opencv\.wasm is missing/],
    ["Uncaught SyntaxError: Unexpected token '<'", /damaged one/],
    ["WebAssembly.instantiate(): expected magic word 00 61 73 6d, found 3c 21 64 6f", /damaged one/],
    ["no WebAssembly", /in this browser: No WebAssembly\. Try/],
  ]) {
    assert.match(failureOf(/** @type {string} */ (reason)).join(": "), /** @type {RegExp} */ (said));
    assert.equal(isOfSite(/** @type {string} */ (reason)), /renewed|missing|damaged/.test(String(said)));
  }
});

test("frames are exposed for a shorter time, and the gain makes up for it", async () => {
  /** @type {any[]} */
  const applied = [];
  const able = {
    exposureMode: ["continuous", "manual"],
    exposureTime: { min: 50, max: 2000, step: 1 },
    iso: { min: 100, max: 800, step: 1 },
  };
  const track = (/** @type {any} */ offered) =>
    /** @type {any} */ ({
      getCapabilities: () => offered,
      getSettings: () => ({ exposureMode: "continuous", exposureTime: 300, iso: 200 }),
      applyConstraints: async (/** @type {any} */ { advanced }) => applied.push(...advanced),
    });
  assert.ok(await shortenExposure(track(able), 0.5));
  assert.ok(await shortenExposure(track(able), 0.01));
  assert.deepEqual(applied, [
    { exposureMode: "manual", exposureTime: 150, iso: 400 },
    { exposureMode: "manual", exposureTime: 50, iso: 800 },
  ]);
  const refusing = [{}, { ...able, iso: undefined }, { ...able, exposureMode: ["continuous"] }];
  for (const less of refusing) assert.ok(!(await shortenExposure(track(less), 0.5)));
  assert.equal(applied.length, 2);
});
