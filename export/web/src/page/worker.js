/**
 * The worker: takes one frame at a time, reads it, and says what it saw. Graphs run in another one
 * (decoding.js).
 */

import { loadOpenCv } from "../image/opencv.js";
import { Verifier } from "../link/code/authenticate.js";
import { equalBytes } from "../link/code/bits.js";
import { Layout } from "../link/layout.js";
import { FRAME_MS } from "../locate/pilots/search.js";
import { explainSilence, OFTEN } from "../receive/diagnosis.js";
import { Inbox } from "../receive/inbox.js";
import { Receiver } from "../receive/receiver.js";
import { warmUp } from "../receive/warm.js";
import { planeOfFrame, planeOfRgba, turned } from "./planes.js";
import { MAX_RECORDED_BYTES, recordingFile } from "./recording.js";
import { DecodingWorker, RemoteDecoder } from "./remoteDecoder.js";
import { addressOf, load } from "./site.js";

/** @import { Plane } from "../image/opencv.js" */
/** @import { Pixels } from "./frames.js" */
/** @import { Answer, Request } from "./protocol.js" */
/** @import { Message } from "../link/code/message.js" */

/** Time after which getting ready ends, milliseconds; what is not compiled by then is so later. */
const WARM_MS = 4000;

const scope = /** @type {DedicatedWorkerGlobalScope} */ (/** @type {unknown} */ (self));

/** Name of the preset, by its layout. @type {Map<Layout, string>} */
const presets = new Map();
/** @type {RemoteDecoder[]} */
const decoders = [];

/** What is read now. */
const film = {
  session: 0,
  fps: 30,
  width: 0,
  height: 0,
  /** @type {Receiver | null} */
  receiver: null,
  inbox: new Inbox(null),
};

/** Judges messages with a key; it knows what was delivered until another key or age is chosen. */
const judge = {
  /** @type {Uint8Array | null} */
  key: null,
  /** @type {number | null} */
  maxAgeS: null,
  /** @type {Verifier | null} */
  verifier: null,
};

/** What is kept in place of being read. */
const recording = {
  wanted: 0,
  /** @type {Record<string, unknown>} */
  about: {},
  /** @type {{ plane: Plane, time: number }[]} */
  frames: [],
};

/** @param {Answer} answer */
function say(answer) {
  scope.postMessage(answer);
}

/** Load OpenCV, the table of presets, and their graphs; and run everything once. */
async function prepare() {
  const decoding = new DecodingWorker(addressOf("decoding.js"));
  decoding.ready.catch(() => {}); // waited for below
  const [table] = await Promise.all([load("presets.json").then((it) => it.json()), loadOpenCv()]);
  for (const [number, { name, layout }] of table.entries()) {
    const known = new Layout(layout);
    presets.set(known, name);
    decoders.push(new RemoteDecoder(known, number, decoding));
  }
  say({ type: "loaded" });
  await warmUp([...presets.keys()], WARM_MS);
  await decoding.ready;
}

/**
 * Do what the page asks for.
 *
 * @param {Request} request
 */
async function answer(request) {
  switch (request.type) {
    case "start":
      return start(request);
    case "record":
      endRecording();
      recording.wanted = request.frames;
      recording.about = request.about;
      recording.frames = [];
      return;
    case "frame": {
      const plane = await planeOf(request);
      [film.width, film.height] = [plane.width, plane.height];
      return recording.wanted ? keep(plane, request.time) : read(plane, request.time);
    }
    case "finish": {
      const step = await film.receiver?.finish();
      return report(null, step?.message ?? null, true);
    }
  }
}

/** @param {Pixels} pixels @returns {Promise<Plane>} */
async function planeOf({ frame, rotation = 0, flip = false, rgba, plane }) {
  if (plane) return plane;
  if (rgba) return planeOfRgba(rgba);
  if (frame) return turned(await planeOfFrame(frame), rotation, flip);
  throw new Error("a frame without pixels");
}

/** @param {Extract<Request, { type: "start" }>} request */
function start({ session, fps, key, maxAgeS }) {
  Object.assign(film, { session, fps });
  film.receiver = new Receiver(decoders, fps, FRAME_MS);
  const isSame = key && judge.key && equalBytes(key, judge.key) && maxAgeS === judge.maxAgeS;
  if (!isSame) Object.assign(judge, { key, maxAgeS, verifier: key && new Verifier(key, maxAgeS) });
  film.inbox = new Inbox(judge.verifier);
}

/** @param {Plane} plane @param {number} time */
async function read(plane, time) {
  const step = await film.receiver?.push(plane, time);
  report(step?.tracked?.corners ?? null, step?.message ?? null, false);
}

/**
 * Tell the page what is seen, and what arrived.
 *
 * @param {number[][] | null} corners - of the display
 * @param {Message | null} message
 * @param {boolean} last - whether the film has ended
 */
function report(corners, message, last) {
  const { receiver, inbox, session, width, height } = film;
  if (!receiver) return;
  const delivery = message && inbox.take(message, Date.now() / 1000);
  const observations = { ...receiver.observations, refused: inbox.refused };
  say({
    type: "step",
    session,
    last,
    width,
    height,
    corners,
    preset: observations.found ? (presets.get(receiver.layout) ?? null) : null,
    synchronised: receiver.synchronised,
    progress: receiver.progress,
    level: observations.level,
    clipped: observations.clipped,
    cut: observations.cut > OFTEN * observations.found,
    explanation: explainSilence(observations),
    arrival: delivery && {
      data: delivery.message.data,
      refused: delivery.refused,
      stale: delivery.stale,
      stamp: delivery.stamp,
    },
  });
}

/** @param {Plane} plane @param {number} time */
function keep(plane, time) {
  const { frames } = recording;
  const [first] = frames;
  const fits = !first || first.plane.data.length === plane.data.length;
  if (fits) frames.push({ plane, time });
  const most = Math.floor(MAX_RECORDED_BYTES / plane.data.length);
  const share = frames.length / Math.min(recording.wanted, most);
  say({ type: "kept", share });
  if (!fits || share >= 1) endRecording();
}

/** Make a file of the frames that were kept, where any were wanted. */
function endRecording() {
  const { wanted, frames, about } = recording;
  if (!wanted) return;
  const observations = film.receiver?.observations ?? null;
  const seconds = Math.floor(Date.now() / 1000);
  const whole = { ...about, observations };
  Object.assign(recording, { wanted: 0, frames: [] });
  say({
    type: "recording",
    file: frames.length ? recordingFile(frames, film.fps, whole, seconds) : null,
  });
}

/** @param {unknown} error */
function fail(error) {
  console.error(error);
  say({ type: "failed", reason: error instanceof Error ? error.message : String(error) });
}

// One request after another: a frame takes time, and the next request may come meanwhile.
let work = prepare().then(() => say({ type: "ready" }), fail);
scope.onmessage = (/** @type {MessageEvent<Request>} */ { data }) => {
  work = work.then(() => answer(data)).catch(fail);
};
