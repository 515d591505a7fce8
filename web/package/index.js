/**
 * Read hidden messages from camera frames: frames and times in, events out. `hiddenStates` makes what
 * a display shows.
 *
 * Events are those that Python's `receiver` prints (receiver/stream.py). What this
 * module exports is promised to stay. Reading keeps a processor busy, so pages do it in a worker.
 */

import * as ort from "onnxruntime-web/wasm";
import { images, imagesVideo, placement, presets as known } from "../generated/constants.js";
import { FilmGraph } from "../port/export/filmGraph.js";
import { RegionGraph } from "../port/export/regionGraph.js";
import { fitPicture } from "../port/image/fit.js";
import { loadOpenCv } from "../port/image/opencv.js";
import { Verifier } from "../port/link/code/authenticate.js";
import { Layout } from "../port/link/layout.js";
import { inTurn } from "../page/inTurn.js";
import { planeOfFrame, planeOfRgba } from "../page/planes.js";
import { explainSilence } from "../port/receiver/diagnosis.js";
import { Inbox } from "../port/receiver/inbox.js";
import { Receiver as FrameReceiver } from "../port/receiver/receiver.js";
import { unpacked } from "../port/sender/loop.js";
import { sizeOf } from "../port/sender/picture.js";
import { statesOf } from "../port/sender/states.js";
import { coded, InputError } from "./errors.js";
import { messageEvent, pairEvent, rounded } from "./events.js";

export { InputError };

/** @typedef {import("../generated/events.js").FilmEvent} FilmEvent */
/**
 * A frame: a `VideoFrame`, which is closed, or pixels row by row, one byte each of luma, or four of
 * red, green, blue and opacity, as `ImageData` has them. Of NV12 and I420 planes, where half as many
 * bytes of colour follow the luma, the luma is taken. They must not change while they are read.
 *
 * @typedef {VideoFrame | { width: number, height: number, data: Uint8Array | Uint8ClampedArray }}
 *   Frame
 */
/**
 * @typedef {object} Options
 * @property {string[]} [models] - names of the presets that are looked for, of `hidden`, `fast` and
 *   `robust`; all if absent
 * @property {Uint8Array | null} [key] - deliver only what was sent with this key
 * @property {number | null} [maxAgeS] - largest age of a message with a key, seconds
 * @property {boolean} [scores] - whether frame pairs come with their scores, too
 * @property {number} [frameMs] - for a camera that does not wait: time after which a search begins
 *   no further step with a frame, milliseconds
 */

/**
 * A picture: pixels row by row, one byte each of gray, three of red, green and blue, or four with
 * opacity, as `ImageData` has them. What is transparent is laid on white.
 *
 * @typedef {{ width: number, height: number, data: Uint8Array | Uint8ClampedArray }} Picture
 */
/**
 * A state, of which `new ImageData(data, width)` makes what a canvas shows.
 *
 * @typedef {Pick<ImageData, "width" | "height" | "data">} State
 */

/** Periods between two frames, and how often in a row, from which times are taken to be no seconds. */
const [OTHER_UNIT, OFTEN] = [300, 3];

/** Layouts that are looked for, by the name of their preset. @type {Map<string, Layout>} */
const layouts = new Map();
/**
 * Presets that are shown, by name, with the levels that `statesOf` takes.
 * @type {Map<string, { preset: import("../port/sender/loop.js").SendPreset, offsets: Uint8Array }>}
 */
const shown = new Map();
/** The graphs, once they are loaded. @type {import("../port/receiver/receiver.js").Graphs} */
let graphs;

/**
 * Load what receivers and states need, once.
 *
 * @param {string | URL} [folder] - address of the folder with this package's files and with
 *   ort-wasm-simd-threaded.wasm and .mjs of onnxruntime-web, which ends with a slash; where this
 *   script lies if it is absent
 * @returns {Promise<void>} rejected with an `InputError` where a file cannot be loaded
 */
export function load(folder = import.meta.url) {
  return coded("load", () => loadFrom(folder));
}

/** @param {string | URL} folder */
async function loadFrom(folder) {
  const place = new URL(folder, globalThis.location?.href);
  if (folder !== import.meta.url && /^http/.test(place.protocol)) ort.env.wasm.wasmPaths = place.href;
  /** @param {string} name */
  async function read(name) {
    const address = new URL(name, place);
    if (address.protocol === "file:") {
      return new Uint8Array(process.getBuiltinModule("node:fs").readFileSync(address));
    }
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: ${response.status}; name the package's folder`);
    return new Uint8Array(await response.arrayBuffer());
  }
  /** @param {string} name */
  const table = async (name) => JSON.parse(new TextDecoder().decode(await read(name)));
  const [presets, sent] = await Promise.all([
    table("presets.json"),
    table("send.json"),
    read("opencv.wasm").then(loadOpenCv),
  ]);
  for (const { name, layout } of presets) {
    if (!layouts.has(name)) layouts.set(name, new Layout(layout));
  }
  for (const preset of sent) {
    shown.set(preset.name, { preset, offsets: await unpacked(preset.loop.offsets, 3) });
  }
  graphs ??= {
    film: new FilmGraph(await read("models/film.onnx")),
    region: new RegionGraph(await read("models/region.onnx")),
  };
}

/** Reads messages from the frames of a camera that films a display. */
export class Receiver {
  #receiver;
  #inbox;
  #scores;
  #time = -Infinity;
  #inView = false;
  #clocked = false;
  #finished = false;
  #period;
  /** Number of frames, to the last, that came much later than those before them. */
  #far = 0;

  /**
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {Options} [options]
   * @throws {InputError} load() was not awaited, or an argument is no good
   */
  constructor(fps, options = {}) {
    checkLoaded();
    checkOptions(options, ["models", "key", "maxAgeS", "scores", "frameMs"]);
    const { models, key = null, maxAgeS = null, scores = false, frameMs } = options;
    checkNumber("fps", fps, imagesVideo.MIN_FPS, imagesVideo.MAX_FPS);
    if (frameMs !== undefined && frameMs !== Infinity) checkNumber("frameMs", frameMs, 0, 1e9);
    if (maxAgeS !== null) checkNumber("maxAgeS", maxAgeS, 0, Infinity);
    if (models !== undefined && !(Array.isArray(models) && models.length && new Set(models).size === models.length)) {
      throw new InputError("argument", "models: need an array of names, each once, such as ['hidden']");
    }
    if (typeof scores !== "boolean") {
      throw new InputError("argument", `scores: need true or false, got ${asText(scores)}`);
    }
    const wanted = (models ?? [...layouts.keys()]).map((name) => {
      const layout = layouts.get(name);
      if (layout) return layout;
      const read = [...layouts.keys()].join(", ");
      throw new InputError("argument", `models: ${asText(name)} is none of ${read}, which this package reads`);
    });
    if (key !== null && !(key instanceof Uint8Array)) {
      throw new InputError("argument", `key: need a Uint8Array or null, got ${typeof key}`);
    }
    if (key === null && maxAgeS !== null) {
      throw new InputError("argument", "maxAgeS: only a message with a key has an age; give a key");
    }
    this.#receiver = new FrameReceiver(wanted, graphs, fps, frameMs);
    const verifier = coded("argument", () => key && new Verifier(key, maxAgeS));
    this.#inbox = new Inbox(verifier);
    this.#scores = scores;
    this.#period = 1 / fps;
  }

  /**
   * The message's length, or what was seen so far and why none came, in one line.
   *
   * @returns {string}
   */
  get explanation() {
    const { last } = this.#inbox;
    if (last) {
      const times = `${this.#receiver.decoded} frame pairs of ${this.#receiver.frames} camera frames`;
      return `a message of ${last.data.length} bytes came, after ${times}`;
    }
    return explainSilence({ ...this.#receiver.observations, refused: this.#inbox.refused });
  }

  /**
   * Take the next camera frame.
   *
   * @param {Frame} frame
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {Promise<FilmEvent[]>} what the frame brought, often nothing; rejected with an
   *   `InputError` where frame or time are no good
   */
  push(frame, time) {
    return inTurn(async () => {
      this.#checkOpen();
      this.#checkTime(time);
      const name = `frame ${this.#receiver.frames}`;
      const plane = await coded("frame", () => planeOf(frame));
      const step = await coded("failed", () => this.#receiver.push(plane, time));
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
   * @returns {Promise<FilmEvent[]>} the last one sums up what was read; rejected with an `InputError`
   *   where it was called before
   */
  finish() {
    return inTurn(async () => {
      this.#checkOpen();
      this.#finished = true;
      const events = this.#decoded(await coded("failed", () => this.#receiver.finish()));
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

  #checkOpen() {
    if (!this.#finished) return;
    throw new InputError("finished", "this receiver has finished; make a new one for other frames");
  }

  /** @param {number} time */
  #checkTime(time) {
    if (typeof time !== "number" || !Number.isFinite(time)) {
      throw new InputError("time", `time: need a finite number of seconds, got ${asText(time)}`);
    }
    if (!(time > this.#time)) {
      throw new InputError("time", `time: must rise, got ${time} s after ${this.#time} s`);
    }
    const step = (time - this.#time) / this.#period;
    this.#far = this.#receiver.frames > 0 && step > OTHER_UNIT ? this.#far + 1 : 0;
    if (this.#far < OFTEN) return;
    const apart = `frames come ${rounded(time - this.#time)} s apart, at ${rounded(1 / this.#period)} a second`;
    throw new InputError("time", `time: ${apart}; give seconds, not milliseconds`);
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

/**
 * Hide a message in a picture: the states of one loop, which a display shows over and over.
 *
 * @param {Picture} picture
 * @param {Uint8Array} message - 1 byte or more
 * @param {{ preset?: string }} [options] - the preset: `hidden`, which is taken if it is absent and is
 *   shown at 60 states a second, `fast` (30), `robust` or `paper` (15)
 * @returns {Generator<State>} the states in turn, of at most 1920 x 1080 pixels, each made when it is
 *   asked for; they must be shown pixel by pixel
 * @throws {InputError} load() was not awaited, or an argument is no good
 */
export function hiddenStates(picture, message, options = {}) {
  checkLoaded();
  checkOptions(options, ["preset"]);
  const { preset: name = known.DEFAULT_PRESET } = options;
  const found = shown.get(name);
  if (!found) {
    throw new InputError("argument", `preset: ${asText(name)} is none of ${[...shown.keys()].join(", ")}`);
  }
  const { preset, offsets } = found;
  if (!(message instanceof Uint8Array)) {
    throw new InputError("argument", `message: need a Uint8Array, got ${asText(message)}`);
  }
  if (!message.length || message.length > preset.longest_bytes) {
    const most = `1 to ${preset.longest_bytes} bytes with preset ${name}`;
    throw new InputError("argument", `message: need ${most}, got ${message.length}`);
  }
  const laid = coded("frame", () => {
    const given = rgbOf(picture);
    const size = sizeOf(given, preset.size);
    if (Math.max(...size) > placement.MAX_ASPECT * Math.min(...size) + 1) {
      throw new Error(`a shown picture of ${size.join(" x ")} is longer than ${placement.MAX_ASPECT}:1; crop it`);
    }
    return fitPicture(given, size[0], size[1]);
  });
  return statesOf(preset, offsets, { data: Uint8Array.from(message), signed: false }, laid);
}

/** @throws {InputError} the package is not loaded */
function checkLoaded() {
  if (!graphs) throw new InputError("load", "await load() before anything else");
}

/**
 * @param {unknown} options
 * @param {string[]} names - of those that there are
 */
function checkOptions(options, names) {
  if (options === null || typeof options !== "object") {
    throw new InputError("argument", `options: need an object, got ${options}`);
  }
  const unknown = Object.keys(options).find((name) => !names.includes(name));
  if (unknown === undefined) return;
  throw new InputError("argument", `options: ${unknown} is none of ${names.join(", ")}`);
}

/**
 * @param {string} name - of an argument
 * @param {unknown} value
 * @param {number} least
 * @param {number} most
 */
function checkNumber(name, value, least, most) {
  if (typeof value === "number" && value >= least && value <= most) return;
  const range = most === Infinity ? `a number above ${least}` : `a number from ${least} to ${most}`;
  throw new InputError("argument", `${name}: need ${range}, got ${asText(value)}`);
}

/** @param {unknown} value @returns {string} the value as messages show it, so that "1" is not 1 */
function asText(value) {
  if (typeof value === "string") return JSON.stringify(value);
  return value && typeof value === "object" ? Object.prototype.toString.call(value) : String(value);
}

/** @param {Frame} frame */
async function planeOf(frame) {
  if (typeof VideoFrame !== "undefined" && frame instanceof VideoFrame) return planeOfFrame(frame);
  const { width, height, data, size } = pixelsOf(frame, "a frame is a VideoFrame, or", [1, 1.5, 4]);
  if (size === 4) return planeOfRgba({ width, height, data });
  return { width, height, data: Uint8Array.from(data.subarray(0, width * height)) };
}

/** @param {Picture} picture @returns {import("../port/link/strength.js").Picture} */
function rgbOf(picture) {
  const { width, height, data, size } = pixelsOf(picture, "a picture", [1, 3, 4]);
  const rgb = new Uint8Array(3 * width * height);
  for (let to = 0, from = 0; to < rgb.length; from += size) {
    for (let channel = 0; channel < 3; channel++, to++) {
      const level = data[from + (size === 1 ? 0 : channel)];
      const opacity = size === 4 ? data[from + 3] : 255;
      rgb[to] = Math.round((level * opacity + 255 * (255 - opacity)) / 255);
    }
  }
  return { width, height, data: rgb };
}

/**
 * Take pixels, with the number of bytes that each of them has.
 *
 * @param {any} given
 * @param {string} what - says what it is
 * @param {number[]} sizes - numbers of bytes that a pixel may have
 * @returns {Picture & { size: number }}
 */
function pixelsOf(given, what, sizes) {
  if (given === null || typeof given !== "object" || !("data" in given)) {
    throw new Error(`${what} has width, height and data`);
  }
  const { width, height, data } = given;
  if (![width, height].every((side) => Number.isInteger(side) && side >= images.MIN_SIDE_PX)) {
    const sides = `${asText(width)} x ${asText(height)}`;
    throw new Error(`width, height: need whole numbers of ${images.MIN_SIDE_PX} px or more, got ${sides}`);
  }
  if (!(data instanceof Uint8Array || data instanceof Uint8ClampedArray)) {
    throw new Error("data: need a Uint8Array or Uint8ClampedArray");
  }
  const size = data.length / (width * height);
  if (sizes.includes(size)) return { width, height, data, size };
  throw new Error(`data: need ${sizes.join(", ")} bytes a pixel, got ${data.length} for ${width} x ${height}`);
}
