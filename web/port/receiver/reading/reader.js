/**
 * Read a display whose layout is known: clock, states, bits, message.
 *
 * A `DisplayReader` takes the rectified display of one camera frame after another. The receiver
 * finds the display and hands its frames to the reader of its layout (receiver.js).
 */

import { receiverReadingReader } from "../../../generated/constants.js";
import { FineCollector } from "../../link/code/collectFine.js";
import { FilmReader, pointsInView } from "./film.js";
import { Synchroniser } from "../timing/synchronise.js";
import { PilotToggles } from "../timing/toggles.js";

/** @typedef {import("../../export/filmGraph.js").WindowDecoder} WindowDecoder */
/** @typedef {import("../../link/code/message.js").Message} Message */
/** @typedef {import("../tracking/pilots.js").Tracked} Tracked */
/** @typedef {import("../sight.js").Sight} Sight */
/** @typedef {import("../sight.js").StageTimes} StageTimes */
/** @typedef {import("./film.js").ReadPair} ReadPair */

export const { WORK_A_FRAME, PAIR_WORK } = receiverReadingReader;

/**
 * A frame pair that the receiver has decoded: seconds of the camera's clock at which it was, and
 * information received so far, as a share of what is needed.
 *
 * @typedef {{ time: number, progress: number } & ReadPair} DecodedPair
 */

/**
 * What reading a frame brought: frame pairs that could be decoded with it, in order, and the
 * message where it became whole.
 *
 * @typedef {{ pairs: DecodedPair[], message: Message | null }} Reading
 */

/** Reads the message of a display that shows one layout. */
export class DisplayReader {
  #fps;
  #timing;
  #sight;
  #source;
  #slips = 0;
  #toggles;
  #newest = -Infinity;

  /**
   * @param {Layout} layout - of the display
   * @param {WindowDecoder} film - decodes windows of film
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {StageTimes} timing - takes the time spent in each stage
   * @param {Sight} sight - takes what the frames show
   */
  constructor(layout, film, fps, timing, sight) {
    this.layout = layout;
    /** Number of frame pairs decoded. */
    this.decoded = 0;
    /** Turns the scores of frame pairs into messages. */
    this.collector = new FineCollector(layout.nBits);
    this.#fps = fps;
    this.#timing = timing;
    this.#sight = sight;
    this.#source = new FilmReader(layout, film, fps, timing);
    this.#toggles = new PilotToggles(layout);
    /** Finds and holds the display's clock. */
    this.sync = new Synchroniser(fps, this.#toggles, layout.code);
  }

  /** Forget the clock and the frames that wait for it; the collector keeps what it has. */
  restart() {
    this.sync = new Synchroniser(this.#fps, this.#toggles, this.layout.code);
    this.#slips = 0;
    this.#source.beginAnew();
    this.#startRun();
  }

  /** Begin to count frame pairs anew. */
  #startRun() {
    this.#source.startRun();
    this.collector.startRun();
  }

  /**
   * Take the display in the next camera frame.
   *
   * @param {Tracked} tracked - the display
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @param {number} width - of the camera frame, pixels
   * @param {number} height - of the camera frame, pixels
   * @returns {Promise<Reading>}
   */
  async take(tracked, time, width, height) {
    const start = performance.now();
    const { anew, before = [], clock } = tracked;
    if (anew) this.#source.beginAnew();
    if (clock) this.sync.begin(clock, time);
    for (const earlier of before) this.#keep(earlier.seen, earlier.time, width, height, false);
    const inView = this.#keep(tracked, time, width, height, true);
    this.#sight.see(tracked.rectified, time, inView);
    if (this.sync.clock !== null) {
      this.#sight.stateHz = 1 / this.sync.clock.period;
      this.#sight.exposed = this.sync.clock.shutter / this.sync.clock.period;
    }
    if (this.sync.slips !== this.#slips) {
      this.#slips = this.sync.slips;
      this.#startRun();
    }
    this.#timing.add("synchronise", start);
    const reading = await this.#decodeReady(time);
    return reading.pairs.length > 0 ? reading : { pairs: [], message: this.goOn() };
  }

  /**
   * Measure the display in a frame, and keep it until its frame pairs are read.
   *
   * @param {Tracked} tracked - the display
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @param {number} width - of the camera frame, pixels
   * @param {number} height - of the camera frame, pixels
   * @param {boolean} fit - whether the clock may be fitted now; of many frames at once, the newest
   *   fits it
   * @returns {Uint8Array | null} what `pointsInView` says
   */
  #keep({ corners, rectified }, time, width, height, fit) {
    const inView = pointsInView(corners, width, height);
    this.sync.add(time, this.#toggles.measure(rectified), fit);
    this.#source.add({ time, rectified, inView });
    this.#newest = time;
    return inView;
  }

  /**
   * Go on with decoding the message, where that takes longer than one camera frame.
   *
   * @param {number} [work] - units of work (`GRAPH_WORK` says which) after which it stops for now
   * @returns {Message | null} the message where it became whole
   */
  goOn(work = WORK_A_FRAME) {
    if (!this.collector.decoding) return null;
    const start = performance.now();
    const message = this.collector.goOn(work);
    this.#timing.add("collect", start);
    return message;
  }

  /**
   * Say where the display lies in its rectified image, as its decoded blocks tell.
   *
   * @returns {Float64Array | null} HOldFromNew in layout pixels, once; null where nothing is new
   */
  shift() {
    return this.#source.shift();
  }

  /**
   * Decode what is left when the frames have ended.
   *
   * @returns {Promise<Reading>}
   */
  async finish() {
    const reading = await this.#decodeReady(Infinity);
    return reading.message !== null ? reading : { ...reading, message: this.goOn(Infinity) };
  }

  /**
   * Decode frame pairs whose time on the display is over: all of them once frames have ended.
   *
   * @param {number} now - seconds; infinite where the frames have ended
   */
  async #decodeReady(now) {
    const { clock } = this.sync;
    /** @type {DecodedPair[]} */
    const pairs = [];
    if (clock === null) return { pairs, message: null };
    const left = Math.max(0, WORK_A_FRAME - PAIR_WORK * this.layout.nBits);
    const work = now === Infinity ? Infinity : left;
    for await (const pair of this.#source.read(clock, now)) {
      this.decoded++;
      const start = performance.now();
      const message = this.collector.add(pair.scores, pair.number, work);
      this.#timing.add("collect", start);
      pairs.push({ ...pair, time: this.#newest, progress: this.collector.progress });
      if (message !== null) return { pairs, message };
    }
    return { pairs, message: null };
  }
}
