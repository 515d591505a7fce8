/**
 * The worker: takes one frame at a time, reads it, and says what it saw. Graphs run in another one
 * (decoding.js).
 */

import { expose } from "comlink";
import { loadOpenCv } from "../port/image/opencv.js";
import { turned } from "../port/image/turned.js";
import { Verifier } from "../port/link/code/authenticate.js";
import { equalBytes } from "../port/link/code/bits.js";
import { Layout } from "../port/link/layout.js";
import { FRAME_MS } from "../port/receiver/pilots/search/pilotSearch.js";
import { explainSilence, neededFps, OFTEN } from "../port/receiver/diagnosis.js";
import { Inbox } from "../port/receiver/inbox.js";
import { Receiver } from "../port/receiver/receiver.js";
import { warmUp } from "../port/receiver/warm.js";
import { inTurn } from "./inTurn.js";
import { planeOfFrame, planeOfRgba } from "./planes.js";
import { MAX_RECORDED_BYTES, recordingFile } from "./recording.js";
import { load } from "./site.js";
import { startWorker } from "./workers.js";

/** @import { Pixels } from "./frames.js" */
/** @import { Step } from "./protocol.js" */
/** @import { Message } from "../port/link/code/message.js" */
/** @import { Graphs } from "../port/receiver/receiver.js" */
/** @import { WarmFilm } from "../port/receiver/warm.js" */

/** Time after which getting ready ends, milliseconds; what is not compiled by then is so later. */
const WARM_MS = 800;

/** Name of the preset, by its layout. @type {Map<Layout, string>} */
const presets = new Map();
/** The graphs, which another worker runs. @type {Graphs} */
let graphs;
/** Film that is read to get ready; null before it is loaded. @type {WarmFilm | null} */
let warmFilm = null;

/** The film or camera that is read now. */
const film = {
  fps: 30,
  width: 0,
  height: 0,
  /** @type {Receiver | null} */
  receiver: null,
  inbox: new Inbox(null),
  /** Scores of the frame pair that was read last. @type {Float32Array | null} */
  scores: null,
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

/** Frames that are kept for a recording, and not read. */
const recording = {
  wanted: 0,
  /** @type {Record<string, unknown>} */
  about: {},
  /** @type {{ plane: Plane, time: number }[]} */
  frames: [],
  /**
   * Takes the file of the recording, or null where no frame was kept.
   * @type {(file: Blob | null) => void}
   */
  ended: () => {},
};

/** Why graphs cannot be run, or null where nothing speaks against it. @type {unknown} */
let undecodable = null;
/** Resolves when the graphs can run, or never will. */
let graphsReady = Promise.resolve();

/** Functions of this worker that the page may call. @typedef {typeof functions} Reading */
const functions = {
  /** Load OpenCV and the table of presets; graphs are loaded meanwhile. */
  load: () => inTurn(loadAll),

  /** Run everything once. */
  warm: () =>
    inTurn(async () => {
      if (warmFilm) await warmUp(warmFilm, WARM_MS);
      await graphsReady;
    }),

  /**
   * Begin a new film or camera.
   *
   * @param {number} fps - nominal number of frames a second
   * @param {Uint8Array | null} key - of its messages, or null
   * @param {number | null} maxAgeS - largest age of a message in seconds, or null
   * @param {boolean} isCamera - whether frames come from a camera, and not from a film
   */
  start: (fps, key, maxAgeS, isCamera) => inTurn(() => start(fps, key, maxAgeS, isCamera)),

  /**
   * Read the next frame, or keep it where a recording is wanted.
   *
   * @param {Pixels} pixels
   * @param {number} time - seconds
   * @returns {Promise<Step | { kept: number }>} what became of the frame, or which share of the
   *   recording there is
   */
  take: (pixels, time) =>
    inTurn(async () => {
      if (undecodable) throw undecodable;
      const plane = await planeOf(pixels);
      [film.width, film.height] = [plane.width, plane.height];
      if (recording.wanted) return { kept: keep(plane, time) };
      const step = await film.receiver?.push(plane, time);
      film.scores = step?.pairs.at(-1)?.scores ?? film.scores;
      return report(step?.tracked?.corners ?? null, step?.message ?? null, false);
    }),

  /** Say what became of the film at its end. */
  finish: () =>
    inTurn(async () => {
      const step = await film.receiver?.finish();
      return report(null, step?.message ?? null, true);
    }),

  /**
   * Keep the next frames in place of reading them. What was kept before becomes a recording.
   *
   * @param {number} wanted - how many, at most; 0 to keep none any more
   * @param {Record<string, unknown>} about - what is written beside them
   * @returns {Promise<Blob | null>} the recording when it has ended; null where it has no frames
   */
  record: (wanted, about) =>
    new Promise((ended) => {
      void inTurn(() => {
        endRecording();
        Object.assign(recording, { wanted, about, frames: [], ended });
      });
    }),
};

/** Load what reading needs, but for the graphs, which are loaded beside. */
async function loadAll() {
  graphsReady = new Promise((resolve, reject) => {
    /** @type {import("comlink").Remote<import("./decoding.js").Decoding>} */
    const decoding = startWorker("decoding.js", reject);
    graphs = { film: decoding, region: decoding };
    decoding.prepare().then(resolve, reject);
  }).catch((error) => void (undecodable = error)); // the next frame tells
  const [table, { layout, width, height }, levels] = await Promise.all([
    ...["presets.json", "warm.json"].map(async (name) => (await load(name)).json()),
    load("warm/states.bin").then(async (file) => new Uint8Array(await file.arrayBuffer())),
    load("opencv.wasm").then(loadOpenCv),
  ]);
  for (const { name, layout } of table) presets.set(new Layout(layout), name);
  const size = width * height;
  const states = [0, size].map((at) => ({ width, height, data: levels.subarray(at, at + size) }));
  warmFilm = { layout: new Layout(layout), states };
}

/** @param {Pixels} pixels @returns {Promise<Plane>} */
async function planeOf({ frame, rotation = 0, rgba }) {
  if (rgba) return planeOfRgba(rgba);
  if (frame) return turned(await planeOfFrame(frame), rotation);
  throw new Error("a frame without pixels");
}

/** @type {(fps: number, key: Uint8Array | null, maxAgeS: number | null, isCamera: boolean) => void} */
function start(fps, key, maxAgeS, isCamera) {
  film.fps = fps;
  film.scores = null;
  film.receiver = new Receiver([...presets.keys()], graphs, fps, isCamera ? FRAME_MS : Infinity);
  const isSame = key && judge.key && equalBytes(key, judge.key) && maxAgeS === judge.maxAgeS;
  if (!isSame) Object.assign(judge, { key, maxAgeS, verifier: key && new Verifier(key, maxAgeS) });
  film.inbox = new Inbox(judge.verifier);
}

/**
 * Say what is seen, and what arrived.
 *
 * @param {number[][] | null} corners - of the display
 * @param {Message | null} message
 * @param {boolean} last - whether the film has ended
 */
function report(corners, message, last) {
  const { receiver, inbox, width, height } = film;
  if (!receiver) throw new Error("a frame of no film");
  const delivery = message && inbox.take(message, Date.now() / 1000);
  const seen = receiver.observations;
  const preset = seen.found ? (presets.get(receiver.layout) ?? null) : null;
  const known = preset === null ? [...presets.values()] : [preset];
  const observations = { ...seen, refused: inbox.refused, presets: known };
  return {
    last,
    width,
    height,
    corners,
    bits: bitsOf(receiver.layout),
    preset,
    found: seen.found,
    synchronised: receiver.synchronised,
    progress: receiver.progress,
    level: observations.level,
    clipped: observations.clipped,
    cut: observations.cut > OFTEN * observations.found,
    neededFps: neededFps(observations),
    exposed: observations.exposed,
    explanation: explainSilence(observations),
    arrival: delivery && {
      data: delivery.message.data,
      signed: delivery.message.signed,
      refused: delivery.refused,
      stale: delivery.stale,
      stamp: delivery.stamp,
    },
  };
}

/**
 * Draw the bits that were read last.
 *
 * @param {Layout} layout
 * @returns {Plane | null} a pixel for each block: the surer of 1, the brighter
 */
function bitsOf(layout) {
  const { scores } = film;
  if (scores?.length !== layout.nBits) return null;
  const data = new Uint8Array(layout.rows * layout.cols).fill(128);
  layout.messageBlocks.forEach((block, at) => (data[block] += 127 * Math.tanh(scores[at])));
  return { width: layout.cols, height: layout.rows, data };
}

/**
 * Keep a frame.
 *
 * @param {Plane} plane
 * @param {number} time - seconds
 * @returns {number} share of the recording that there is, at most 1
 */
function keep(plane, time) {
  const { frames, wanted } = recording;
  const [first] = frames;
  const fits = !first || first.plane.data.length === plane.data.length;
  if (fits) frames.push({ plane, time });
  const most = Math.floor(MAX_RECORDED_BYTES / plane.data.length);
  const share = frames.length / Math.min(wanted, most);
  if (!fits || share >= 1) endRecording();
  return share;
}

/** Make a file of the frames that were kept, where any were wanted. */
function endRecording() {
  const { wanted, frames, about, ended } = recording;
  const observations = film.receiver?.observations ?? null;
  const seconds = Math.floor(Date.now() / 1000);
  const whole = { ...about, observations };
  Object.assign(recording, { wanted: 0, frames: [] });
  ended(wanted && frames.length ? recordingFile(frames, film.fps, whole, seconds) : null);
}

expose(functions);
