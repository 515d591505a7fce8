/**
 * Read the frame pairs of a display by windows of the film in which it was seen.
 *
 * Now and then a `FilmReader` hands a window of the last frames to the film decoder
 * (filmGraph.js), and takes the scores of all frame pairs that ended in it.
 */

import { modelsFilmWindow, receiverReadingFilm, receiverSeen } from "../../../generated/constants.js";
import { rowsOf } from "../../image/opencv.js";
import { areaMeans } from "../../image/shrink.js";
import { homographyFromCorners, inImage, transform } from "../../link/geometry.js";
import { mixtureOfExposures } from "../../link/observation.js";
import { expectedChanges } from "../../link/pilots.js";
import { MovingPicture } from "../pilots/compensate.js";
import { CornerShift } from "../tracking/corners.js";

/** @typedef {import("../../export/filmGraph.js").WindowDecoder} WindowDecoder */
/** @typedef {import("../../link/observation.js").Mixture} Mixture */
/** @typedef {import("../sight.js").StageTimes} StageTimes */

const {
  WINDOW, FINE_WINDOW, FINE_BLOCKS, LEAST_FRAMES, STRIDE_S, LATER_STRIDE_S, HURRIED, MISSED,
  FRESH_FRAMES, LEARNT, FINE_LEARNT, MOST_PAIRS, MOST_WAITING,
} = receiverReadingFilm;
const { MESH, MOST_WHOLE } = receiverSeen;
const { SHRINK } = modelsFilmWindow;
const MESH_POINTS = Array.from(
  { length: MESH * MESH },
  (_, at) => /** @type {Point} */ ([at % MESH, Math.floor(at / MESH)]),
);

/**
 * A rectified camera frame with its time in seconds of the camera's clock. `inView` (MESH, MESH)
 * tells which points of the display lie within the camera frame; null where the whole display does.
 *
 * @typedef {{ time: number, rectified: BytePlane, inView: Uint8Array | null }} RectifiedFrame
 */

/**
 * What is kept of a camera frame: also the shrunk gray levels of the rectified display, by how much
 * motion has changed them since the frame before, if that is known, 1 for each block that lies within
 * the camera frame as a whole, else 0, and `CornerShift.total` by which it was rectified.
 *
 * @typedef {{ gray: FloatPlane, motion: Float32Array | null, seen: Float32Array,
 *   total: Float64Array } & RectifiedFrame} FilmFrame
 */

/**
 * A frame pair and its scores: its number on the display, counted from an arbitrary start, the
 * scores (nBits,), and the numbers of camera frames that show its original and its embedded state.
 *
 * @typedef {{ number: number, scores: Float32Array, frames: [number, number] }} ReadPair
 */

/** Reads the frame pairs of one display in the order in which they were shown. */
export class FilmReader {
  #layout;
  #decoder;
  #fps;
  #timing;
  #window;
  #learnt;
  #known;
  #corners;
  #picture = new MovingPicture();
  /** @type {FilmFrame[]} */
  #frames = [];
  #scoredAt = -Infinity;
  #scoredWindows = 0;
  #toldUntil = -Infinity;
  /** @type {ReadPair[]} */
  #scored = [];
  /** @type {number | null} */
  #next = null;

  /**
   * @param {Layout} layout - of the display
   * @param {WindowDecoder} decoder - the film decoder
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {StageTimes} timing - takes the time spent in each stage
   */
  constructor(layout, decoder, fps, timing) {
    this.#layout = layout;
    this.#decoder = decoder;
    this.#fps = fps;
    this.#timing = timing;
    this.#known = Float32Array.from(expectedChanges(layout));
    const isFine = this.#known.length > FINE_BLOCKS;
    this.#window = isFine ? FINE_WINDOW : WINDOW;
    this.#learnt = isFine ? FINE_LEARNT : LEARNT;
    this.#corners = new CornerShift(layout);
  }

  /** Leave out all frames so far: what comes shows another place or another picture. */
  beginAnew() {
    this.#frames = [];
    this.#scoredAt = -Infinity;
    this.#scoredWindows = 0;
    this.#corners = new CornerShift(this.#layout);
    this.#picture = new MovingPicture();
  }

  /** Begin to count frame pairs anew. */
  startRun() {
    this.#next = null;
    this.#scored = [];
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
   * Keep a frame.
   *
   * @param {RectifiedFrame} frame
   */
  add(frame) {
    const { rectified, inView } = frame;
    const { rows, cols } = this.#layout;
    const [width, height] = [rectified.width, rectified.height].map((side) =>
      Math.floor(side / SHRINK),
    );
    const gray = areaMeans(rectified, width, height);
    let seen = new Float32Array(rows * cols).fill(1);
    if (inView) {
      const shares = areaMeans({ width: MESH, height: MESH, data: inView }, cols, rows).data;
      seen = shares.map((share) => (share > 1 - 1e-6 ? 1 : 0));
    }
    this.#frames.push({ ...frame, gray, motion: null, seen, total: this.#corners.total });
    if (this.#frames.length > MOST_WHOLE) this.#frames.shift();
  }

  /**
   * Read the next frame pairs, where it is time for a window.
   *
   * @param {DisplayClock} clock - says when the display shows which state
   * @param {number} now - time of the newest frame, seconds; infinite where the frames have ended,
   *   and all pairs are read
   * @returns {AsyncGenerator<ReadPair, void, void>}
   */
  async *read(clock, now) {
    const isOver = now === Infinity;
    const newest = this.#frames.at(-1)?.time ?? -Infinity;
    const end = clock.number(isOver ? newest + clock.latest : now + clock.earliest);
    for (;;) {
      for (let pair; (pair = this.#scored.shift()); ) yield pair;
      const waiting = this.#waiting(clock, Math.floor(end / 2));
      if (waiting.length === 0) return;
      if (!isOver && !this.#isDue(2 * clock.period * waiting.length)) return;
      await this.#score(clock, waiting.slice(0, MOST_WAITING));
    }
  }

  /**
   * List the numbers, below `end`, of frame pairs that were seen and are not read yet.
   *
   * @param {DisplayClock} clock
   * @param {number} end
   */
  #waiting(clock, end) {
    const frames = this.#frames.filter(({ time }) => time > this.#toldUntil);
    if (frames.length === 0) return [];
    const from = (this.#next ??= Math.ceil(clock.number(frames[0].time) / 2));
    /** @type {Set<number>} */
    const seen = new Set();
    for (const { time } of frames) {
      const [first, last] = pairsShown(clock, time);
      for (let number = first; number <= last; number++) seen.add(number);
    }
    return [...seen].filter((number) => from <= number && number < end).sort((a, b) => a - b);
  }

  /**
   * Tell whether it is time for the next window.
   *
   * @param {number} waitingS - seconds for which the frame pairs that wait were displayed
   */
  #isDue(waitingS) {
    const frames = this.#frames;
    if (frames.length < LEAST_FRAMES) return false;
    const since = frames[frames.length - 1].time - this.#scoredAt;
    const fresh = frames.filter(({ time }) => time > this.#scoredAt).length;
    const isMissed = Number.isFinite(since) && since * this.#fps > MISSED * fresh;
    const stride = this.#scoredWindows < HURRIED ? STRIDE_S : LATER_STRIDE_S;
    return Math.max(since, waitingS) >= stride && (fresh >= FRESH_FRAMES || !isMissed);
  }

  /**
   * Score frame pairs by the window that ends with the last of them that fits into it.
   *
   * @param {DisplayClock} clock - says when the display shows which state
   * @param {number[]} numbers - of frame pairs that are over, rising; at least one of them is scored,
   *   and the others wait for the next window
   */
  async #score(clock, numbers) {
    const frames = this.#frames;
    const spans = frames.map(({ time }) => pairsShown(clock, time));
    let begin = Math.max(0, spans.findIndex(([, last]) => last >= numbers[0]));
    let end = Math.min(frames.length, Math.max(begin + this.#window, LEAST_FRAMES));
    const isTooWide = () => spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS;
    while (isTooWide()) end--;
    begin = Math.max(0, end - this.#window);
    while (isTooWide()) begin++;
    const window = frames.slice(begin, end);
    const now = frames[end - 1].time;
    const first = spans[begin][0];
    const last = Math.max(...spans.slice(begin, end).map((span) => span[1]));
    const over = end === frames.length ? Infinity : clock.number(now + clock.earliest) / 2;
    const done = numbers.filter((number) => number <= Math.min(last, over - 1));
    if (done.length === 0) done.push(numbers[0]);
    const times = window.map(({ time }) => time);
    const start = performance.now();
    const { rows, cols, width, height, messageBlocks } = this.#layout;
    const mixture = mixtureOfExposures(clock, times, this.#layout, first, last + 1 - first);
    this.#follow(frames.slice(0, end));
    const scores = await this.#decoder.decode({
      frames: rowsOf(heldStill(window)).data,
      seen: rowsOf(window.map(({ seen }) => seen)).data,
      known: this.#known,
      mixture,
      size: [window.length, Math.floor(height / SHRINK), Math.floor(width / SHRINK), rows, cols],
    });
    this.#timing.add("film", start);
    for (const number of done.filter((each) => each >= first && each <= last)) {
      const from = (number - first) * rows * cols;
      this.#scored.push({
        number,
        scores: Float32Array.from(messageBlocks, (at) => scores[from + at]),
        frames: framesOf(mixture, number - first, rows * cols),
      });
    }
    const next = (this.#next = done[done.length - 1] + 1);
    const old = times.filter((time) => time <= this.#scoredAt).length;
    this.#correct(window, mixture, scores, Math.max(0, old - 1, window.length - this.#learnt));
    this.#scoredAt = now;
    this.#scoredWindows++;
    const told = frames.filter(({ time }) => clock.number(time + clock.latest) < 2 * next);
    this.#toldUntil = Math.max(this.#toldUntil, ...told.map(({ time }) => time));
    frames.splice(0, Math.max(0, end - this.#window));
  }

  /**
   * Find how the picture moves in frames, where that is not known.
   *
   * The first frame alone would be a picture with its message. So it is made of the frames that
   * follow, backwards.
   *
   * @param {FilmFrame[]} frames - from the oldest that is kept on
   */
  #follow(frames) {
    if (!frames[0].motion) {
      for (const { gray } of frames.slice(0, LEAST_FRAMES).reverse()) this.#picture.take(gray);
    }
    for (const frame of frames) frame.motion ??= this.#picture.take(frame.gray);
  }

  /**
   * Learn from frames of a window where the corners lie.
   *
   * @param {FilmFrame[]} window
   * @param {Mixture} mixture
   * @param {Float32Array} scores - (pairs rows cols,)
   * @param {number} begin - first frame
   */
  #correct(window, mixture, scores, begin) {
    const frames = window.slice(begin);
    if (frames.length < 2) return;
    const start = performance.now();
    const blocks = this.#known.length;
    const { slots } = mixture;
    const changes = scores.map((score, at) => {
      const known = this.#known[at % blocks];
      return known === 0 ? Math.tanh(Math.min(Math.max(score, -20), 20) / 2) : known;
    });
    const expected = frames.map((_, at) => {
      const sum = new Float32Array(blocks);
      for (let slot = (begin + at) * slots; slot < (begin + at + 1) * slots; slot++) {
        const pair = Number(mixture.pair[slot]);
        if (pair < 0) continue;
        for (let i = 0; i < blocks; i++) {
          sum[i] += mixture.shares[slot * blocks + i] * changes[pair * blocks + i];
        }
      }
      return sum;
    });
    const images = frames.map(({ rectified }) => rectified);
    const totals = frames.map(({ total }) => total);
    this.#corners.take(images, expected, totals);
    this.#timing.add("correct", start);
  }
}

/**
 * Hold the picture still in a window: what has only moved since the middle frame is taken off.
 *
 * @param {FilmFrame[]} window - whose motion is known
 * @returns {Float32Array[]} gray levels of each frame
 */
function heldStill(window) {
  const sum = new Float32Array(window[0].gray.data.length);
  const moved = window.map(({ motion }) => {
    motion?.forEach((step, i) => (sum[i] += step));
    return sum.slice();
  });
  const middle = moved[window.length >> 1];
  return window.map(({ gray }, t) => gray.data.map((level, i) => level - moved[t][i] + middle[i]));
}

/**
 * Count the frames of a window that show the original and the embedded state of a frame pair.
 *
 * @param {Mixture} mixture - of the window
 * @param {number} place - of the pair among those of the window
 * @param {number} blocks - number of blocks
 * @returns {[number, number]} a frame that mixes both states evenly counts for neither
 */
function framesOf({ pair, shares }, place, blocks) {
  /** @type {[number, number]} */
  const count = [0, 0];
  pair.forEach((own, slot) => {
    if (Number(own) !== place) return;
    const sum = shares
      .subarray(slot * blocks, (slot + 1) * blocks)
      .reduce((total, share) => total + share, 0);
    if (sum !== 0) count[sum < 0 ? 0 : 1]++;
  });
  return count;
}

/**
 * Give the numbers of the first and the last frame pair of which a frame shows a part.
 *
 * @param {DisplayClock} clock
 * @param {number} time - seconds
 */
function pairsShown(clock, time) {
  return [clock.earliest, clock.latest].map((end) => Math.floor(clock.number(time + end) / 2));
}

/**
 * Tell which points of the display lie within a camera frame.
 *
 * @param {Point[]} corners - pixels of the camera frame, in corner order
 * @param {number} width - of the camera frame, pixels
 * @param {number} height - of the camera frame, pixels
 * @returns {Uint8Array | null} (MESH, MESH), or null where the whole display lies within the frame
 */
export function pointsInView(corners, width, height) {
  if (inImage(corners, width, height).every(Boolean)) return null;
  const HCapturedFromDisplay = homographyFromCorners(corners, MESH, MESH);
  return inImage(transform(HCapturedFromDisplay, MESH_POINTS), width, height);
}
