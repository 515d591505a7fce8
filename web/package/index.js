/**
 * Read hidden messages from camera frames: frames and times in, events out.
 *
 * Events are those that Python's `receiver` prints (receiver/stream.py). What this
 * module exports is promised to stay. Reading keeps a processor busy, so pages do it in a worker.
 */

import { FilmGraph } from "../port/export/filmGraph.js";
import { loadOpenCv } from "../port/image/opencv.js";
import { Verifier } from "../port/link/code/authenticate.js";
import { Layout } from "../port/link/layout.js";
import { inTurn } from "../page/inTurn.js";
import { planeOfFrame, planeOfRgba } from "../page/planes.js";
import { explainSilence } from "../port/receiver/diagnosis.js";
import { Inbox } from "../port/receiver/inbox.js";
import { Receiver as FrameReceiver } from "../port/receiver/receiver.js";
import { messageEvent, pairEvent, rounded } from "./events.js";

/** @typedef {import("../generated/events.js").FilmEvent} FilmEvent */
/**
 * A frame: a `VideoFrame`, which is closed, or pixels row by row, one byte each of luma, or four of
 * red, green, blue and opacity, as `ImageData` has them. They must not change while they are read.
 *
 * @typedef {VideoFrame | { width: number, height: number, data: Uint8Array | Uint8ClampedArray }}
 *   Frame
 */

/** What is looked for, by the name of its preset. @type {Map<string, Layout>} */
const layouts = new Map();
/** Decodes windows of film, once it is loaded. @type {FilmGraph} */
let film;

/**
 * Load what all receivers need, once.
 *
 * @param {string | URL} [folder] - address of the folder with this package's files, which ends with
 *   a slash; where this script lies if it is absent
 * @returns {Promise<void>} rejected where a file cannot be loaded
 */
export async function load(folder = import.meta.url) {
  /** @param {string} name */
  async function read(name) {
    const address = new URL(name, new URL(folder, globalThis.location?.href));
    if (address.protocol === "file:") {
      return new Uint8Array(process.getBuiltinModule("node:fs").readFileSync(address));
    }
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: ${response.status}; name the package's folder`);
    return new Uint8Array(await response.arrayBuffer());
  }
  const [presets] = await Promise.all([
    read("presets.json"),
    read("opencv.wasm").then(loadOpenCv),
  ]);
  for (const { name, layout } of JSON.parse(new TextDecoder().decode(presets))) {
    if (!layouts.has(name)) layouts.set(name, new Layout(layout));
  }
  film ??= new FilmGraph(await read("models/film.onnx"));
}

/** Reads messages from the frames of a camera that films a display. */
export class Receiver {
  #receiver;
  #inbox;
  #scores;
  #time = -Infinity;
  #inView = false;
  #clocked = false;

  /**
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {object} [options]
   * @param {string[]} [options.models] - names of the presets that are looked for, of `hidden`, `fast`
   *   and `robust`; all if absent
   * @param {Uint8Array | null} [options.key] - deliver only what was sent with this key
   * @param {number | null} [options.maxAgeS] - largest age of a message with a key, seconds
   * @param {boolean} [options.scores] - whether frame pairs come with their scores, too
   * @param {number} [options.frameMs] - for a camera that does not wait: time after which a search
   *   begins no further step with a frame, milliseconds
   */
  constructor(fps, { models, key = null, maxAgeS = null, scores = false, frameMs } = {}) {
    if (!(fps > 0)) throw new Error(`fps: need more than 0, got ${fps}`);
    if (layouts.size === 0) throw new Error("await load() before the first receiver is made");
    const wanted = (models ?? [...layouts.keys()]).map((name) => {
      const layout = layouts.get(name);
      if (!layout) {
        const read = [...layouts.keys()].join(", ");
        throw new Error(`models: ${name} is none of ${read}; python -m receiver reads paper, too`);
      }
      return layout;
    });
    this.#receiver = new FrameReceiver(wanted, film, fps, frameMs);
    if (key !== null && !(key instanceof Uint8Array)) throw new Error("key: need bytes, or null");
    if (key === null && maxAgeS !== null) throw new Error("maxAgeS: only with a key");
    this.#inbox = new Inbox(key === null ? null : new Verifier(key, maxAgeS));
    this.#scores = scores;
  }

  /** What was seen so far, and why no message came, in one line. @returns {string} */
  get explanation() {
    return explainSilence({ ...this.#receiver.observations, refused: this.#inbox.refused });
  }

  /**
   * Take the next camera frame.
   *
   * @param {Frame} frame
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {Promise<FilmEvent[]>} what the frame brought, often nothing
   */
  push(frame, time) {
    return inTurn(async () => {
      if (!(time > this.#time)) throw new Error(`time: must rise, got ${time} after ${this.#time}`);
      const name = `frame ${this.#receiver.frames}`;
      const step = await this.#receiver.push(await planeOf(frame), time);
      this.#time = time;
      /** @type {FilmEvent[]} */
      const events = [];
      const seen = step.tracked;
      if ((seen !== null) !== this.#inView || (this.#inView && seen?.anew)) {
        this.#inView = seen !== null;
        const corners = seen && seen.corners.map((point) => point.map((at) => rounded(at, 2)));
        const preset = [...layouts].find(([, layout]) => layout === this.#receiver.layout);
        const shown = seen ? { preset: preset?.[0] ?? null } : {};
        events.push({ event: "display", time: rounded(time), frame: name, corners, ...shown });
      }
      const { stateHz, synchronised } = this.#receiver;
      if (synchronised !== this.#clocked) {
        this.#clocked = synchronised;
        const rate = stateHz === null ? null : rounded(stateHz, 3);
        events.push({ event: "clock", time: rounded(time), state_hz: rate });
      }
      return [...events, ...this.#decoded(step)];
    });
  }

  /**
   * Decode what is left when the frames have ended.
   *
   * @returns {Promise<FilmEvent[]>} the last one sums up what was read
   */
  finish() {
    return inTurn(async () => {
      const events = this.#decoded(await this.#receiver.finish());
      const { frames, found, timing } = this.#receiver;
      const times = Object.entries(timing.spent).map(([stage, seconds]) => [
        stage,
        rounded((1000 * seconds) / timing.count[stage], 2),
      ]);
      events.push({
        event: "end",
        frames,
        frames_with_display: found,
        seconds: rounded(Math.max(this.#time, 0), 3),
        message: this.#inbox.last?.text ?? null,
        milliseconds: Object.fromEntries(times),
      });
      return events;
    });
  }

  /**
   * @param {import("../port/receiver/reading/reader.js").Reading} reading
   * @returns {FilmEvent[]}
   */
  #decoded({ pairs, message }) {
    /** @type {FilmEvent[]} */
    const events = pairs.map((pair) => pairEvent(pair, this.#scores));
    if (message) events.push(messageEvent(this.#inbox.take(message, Date.now() / 1000)));
    return events;
  }
}

/** @param {Frame} frame */
async function planeOf(frame) {
  if (!("data" in frame)) return planeOfFrame(frame);
  const { width, height, data } = frame;
  if (data.length === 4 * width * height) return planeOfRgba(frame);
  if (data.length === width * height) return { width, height, data: Uint8Array.from(data) };
  throw new Error(`a frame needs 1 or 4 bytes a pixel, got ${data.length} for ${width}x${height}`);
}
