/**
 * Read a display whose layout is known: clock, states, bits, message.
 *
 * A `DisplayReader` takes the rectified display of one camera frame after another. The receiver
 * finds the display and hands its frames to the reader of its layout (receiver.js).
 */

import {
  receiverReadingPairs,
  receiverReadingReader,
  receiverSeen,
} from "../../../generated/constants.js";
import { FineCollector } from "../../link/code/collectFine.js";
import { informationOf } from "../../link/code/scores.js";
import { FilmDesk, VAGUE } from "./film.js";
import { PairScorer } from "./pairs.js";
import { composeState, pointsInView, unseenState } from "./states.js";
import { Synchroniser } from "../timing/synchronise.js";
import { PilotToggles } from "../timing/toggles.js";
import { CornerShift } from "../tracking/corners.js";

/** @typedef {import("../../export/filmGraph.js").WindowDecoder} WindowDecoder */
/** @typedef {import("../../link/code/message.js").Message} Message */
/** @typedef {import("../tracking/pilots.js").Tracked} Tracked */
/** @typedef {import("../sight.js").Sight} Sight */
/** @typedef {import("../sight.js").StageTimes} StageTimes */
/** @typedef {import("./pairs.js").ComposedPair} ComposedPair */
/** @typedef {import("./pairs.js").PairDecoder} PairDecoder */
/** @typedef {import("./states.js").DisplayState} DisplayState */
/** @typedef {import("./states.js").RectifiedFrame} RectifiedFrame */

export const { WORK_A_FRAME, PAIR_WORK } = receiverReadingReader;
export const { PAIRS_A_FRAME, MOST_WAITING } = receiverReadingPairs;
export const { MOST_WHOLE } = receiverSeen;

/**
 * A frame pair that the receiver has decoded.
 *
 * @typedef {object} DecodedPair
 * @property {number} number - of the pair on the display, counted from an arbitrary start
 * @property {number} time - seconds of the camera's clock at which the pair was decoded
 * @property {Float64Array} scores - as they went to the collector: 0 for an erased block
 * @property {DisplayState} original - the pair's original frame
 * @property {DisplayState} embedded - the pair's embedded frame
 * @property {number} progress - information received so far, as a share of what is needed
 */

/**
 * What reading a frame brought: frame pairs that could be decoded with it, in order, and the
 * message where it became whole.
 *
 * @typedef {{ pairs: DecodedPair[], message: Message | null }} Reading
 */

/**
 * A camera frame that is kept until its frame pairs can be decoded: the display in it; (V,) what
 * `Toggles.measure` says of it; and (8,) `CornerShift.total` when it was rectified, or null where
 * the display was found anew since.
 *
 * @typedef {{
 *   frame: RectifiedFrame,
 *   measured: Float64Array,
 *   moved: Float64Array | null,
 * }} BufferedFrame
 */

/** @typedef {{ composed: ComposedPair, scores: Float64Array }} ScoredPair */

/** Reads the message of a display that shows one layout. */
export class DisplayReader {
  #fps;
  #timing;
  #sight;
  #scorer;
  #corners;
  /** @type {BufferedFrame[]} */
  #buffer = [];
  /** @type {number | null} */
  #next = null;
  #slips = 0;
  #toggles;
  #desk;
  /** @type {ComposedPair[]} */
  #waiting = [];
  /** @type {ScoredPair[]} */
  #scored = [];
  /** Number of waiting pairs that are decoded one by one, and of those that this frame brought. */
  #byPairs = 0;
  #alone = 0;

  /**
   * @param {PairDecoder} decoder - of the layout
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {StageTimes} timing - takes the time spent in each stage
   * @param {Sight} sight - takes what the frames show
   * @param {WindowDecoder} film - decodes windows of film where the picture stands still in them
   */
  constructor(decoder, fps, timing, sight, film) {
    this.decoder = decoder;
    this.layout = decoder.layout;
    /** Number of frame pairs decoded. */
    this.decoded = 0;
    /** Turns the scores of frame pairs into messages. */
    this.collector = new FineCollector(this.layout.nBits);
    this.#fps = fps;
    this.#timing = timing;
    this.#sight = sight;
    this.#scorer = new PairScorer(decoder, timing);
    this.#corners = new CornerShift(this.layout);
    this.#toggles = new PilotToggles(this.layout);
    this.#desk = new FilmDesk(this.layout, film, MOST_WHOLE);
    /** Finds and holds the display's clock. */
    this.sync = new Synchroniser(fps, this.#toggles, this.layout.code);
  }

  /** Forget the clock and the frames that wait for it; the collector keeps what it has. */
  restart() {
    this.sync = new Synchroniser(this.#fps, this.#toggles, this.layout.code);
    this.#slips = 0;
    this.#buffer = [];
    this.#desk.clear();
    this.#startRun();
  }

  /** Begin to count frame pairs anew. */
  #startRun() {
    this.#next = null;
    this.#byPairs = 0;
    this.#waiting = [];
    this.#scored = [];
    this.collector.startRun();
  }

  /** Get ready: frames of this layout will soon come. The film decoder mostly needs no other. */
  async load() {
    await this.#desk.load();
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
    if (anew) {
      this.#desk.clear();
      this.#corners = new CornerShift(this.layout);
      for (const waiting of this.#buffer) waiting.moved = null;
    }
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
   * Measure the display in a frame, and keep it until its frame pairs can be decoded.
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
    const measured = this.#toggles.measure(rectified);
    this.sync.add(time, measured, fit);
    const frame = { time, rectified, inView };
    this.#buffer.push({ frame, measured, moved: this.#corners.total });
    this.#desk.add(frame);
    if (this.#buffer.length > MOST_WHOLE) this.#buffer.shift();
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
    return this.#corners.shift();
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
    const buffer = this.#buffer;
    /** @type {DecodedPair[]} */
    const pairs = [];
    if (clock === null || buffer.length === 0) return { pairs, message: null };
    this.#next ??= Math.ceil(clock.number(buffer[0].frame.time) / 2);
    const last = buffer[buffer.length - 1].frame.time;
    const isOver = now === Infinity;
    const end = clock.number(isOver ? last + clock.latest : now + clock.earliest);
    const most = isOver ? Infinity : MOST_WAITING;
    while (end >= 2 * this.#next + 2 && this.#waiting.length < most) {
      this.#compose(clock, this.#next++);
    }
    const left = Math.max(0, WORK_A_FRAME - PAIR_WORK * this.layout.nBits);
    const work = isOver ? Infinity : left;
    this.#alone = 0;
    for (;;) {
      const scored = await this.#nextScored(clock, isOver);
      if (scored === null) break;
      const { pair, message } = this.#finishPair(scored, last, work);
      pairs.push(pair);
      if (message !== null) return { pairs, message };
    }
    return { pairs, message: null };
  }

  /**
   * Put the two states of a frame pair together, and let go of frames that no other needs.
   *
   * @param {DisplayClock} clock
   * @param {number} number - of the frame pair
   */
  #compose(clock, number) {
    const start = performance.now();
    const buffer = this.#buffer;
    const frames = buffer.map(({ frame }) => frame);
    let [original, embedded] = this.layout.code
      .statesOf(number)
      .map((state) => composeState(frames, clock, state));
    let over = 0;
    while (
      over < buffer.length &&
      clock.number(buffer[over].frame.time + clock.latest) < 2 * (number + 1)
    ) {
      over++;
    }
    const moved = buffer.splice(0, over).map((waiting) => waiting.moved);
    // the film decoder reads what a slow camera sees of one state alone
    original ??= unseenState(embedded);
    embedded ??= unseenState(original);
    if (original && embedded) this.#waiting.push({ number, original, embedded, moved });
    this.#timing.add("compose", start);
  }

  /**
   * Score the next frame pair that waits, or return null where that is left for later.
   *
   * Scores come from a window of film. Where the picture moves, the film decoder says next to
   * nothing, and less than a single frame pair does; the pairs of that window are then decoded one
   * by one.
   *
   * @param {DisplayClock} clock
   * @param {boolean} isOver - whether the frames have ended
   */
  async #nextScored(clock, isOver) {
    const [waiting, desk] = [this.#waiting, this.#desk];
    if (this.#scored.length === 0 && waiting.length > 0 && this.#byPairs === 0) {
      const waitingS = 2 * clock.period * waiting.length;
      if (!isOver && !desk.due(this.#fps, waitingS)) return null;
      const start = performance.now();
      const numbers = waiting.map(({ number }) => number);
      const scores = await desk.score(clock, numbers);
      this.#timing.add("film", start);
      if (await this.#saysLess(scores, waiting[scores.size - 1])) {
        this.#byPairs = scores.size;
      } else {
        for (const composed of waiting.splice(0, scores.size)) {
          const found = scores.get(composed.number) ?? new Float32Array(0);
          this.#scored.push({ composed, scores: this.#scorer.withoutCovered(composed, found) });
        }
      }
    }
    if (this.#scored.length > 0) return this.#scored.shift() ?? null;
    if (this.#alone >= PAIRS_A_FRAME && !isOver) return null;
    const composed = waiting.shift();
    if (!composed) return null;
    this.#alone++;
    this.#byPairs = Math.max(0, this.#byPairs - 1);
    return { composed, scores: await this.#scorer.score(composed) };
  }

  /**
   * Tell whether the film says less of its frame pairs than the last one's two states do.
   *
   * @param {Map<number, Float32Array>} scores - by the film
   * @param {ComposedPair} last
   */
  async #saysLess(scores, last) {
    const each = [...scores.values()].map((found) => informationOf(found) / found.length);
    const known = each.reduce((sum, one) => sum + one, 0) / each.length;
    if (known >= VAGUE) return false;
    const alone = await this.#scorer.scoreStates(last);
    return known < informationOf(alone) / alone.length;
  }

  /**
   * Learn from a pair's scores where the corners lie, and hand them to the collector.
   *
   * @param {ScoredPair} scored - the pair, and its scores, 0 for erased blocks
   * @param {number} time - of the newest frame, seconds
   * @param {number} work - units of work after which decoding of the message stops for now
   */
  #finishPair({ composed, scores }, time, work) {
    const { number, original, embedded, moved } = composed;
    let start = performance.now();
    const trust = this.#scorer.trust(composed);
    this.#sight.mixed += 1 - trust.reduce((sum, share) => sum + share, 0) / trust.length;
    const total = meanOf(moved);
    if (total !== null) this.#corners.take(original.image, embedded.image, scores, total);
    this.decoded++;
    this.#timing.add("correct", start);
    start = performance.now();
    const message = this.collector.add(scores, number, work);
    this.#timing.add("collect", start);
    const { progress } = this.collector;
    return { pair: { number, time, scores, original, embedded, progress }, message };
  }
}

/**
 * Average arrays of one length.
 *
 * @param {(Float64Array | null)[]} arrays
 * @returns {Float64Array | null} null where there are none, or one is missing
 */
function meanOf(arrays) {
  const [first] = arrays;
  if (!first) return null;
  const sum = new Float64Array(first.length);
  for (const array of arrays) {
    if (array === null) return null;
    array.forEach((value, i) => (sum[i] += value));
  }
  return sum.map((value) => value / arrays.length);
}
