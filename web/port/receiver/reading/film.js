/**
 * Decode frame pairs from whole windows of a film, where the picture stands still in them.
 *
 * A `FilmDesk` keeps the last frames, shrunk. Now and then it hands a window of them to the film
 * decoder (filmGraph.js), and takes back the scores of all frame pairs that ended in it.
 */

import { modelsFilmWindow, receiverReadingFilm, receiverReadingPairs } from "../../../generated/constants.js";
import { rowsOf } from "../../image/opencv.js";
import { areaMeans } from "../../image/shrink.js";
import { mixtureOfExposures } from "../../link/observation.js";
import { expectedChanges } from "../../link/pilots.js";
import { MESH } from "./states.js";

/** @typedef {import("../../export/filmGraph.js").WindowDecoder} WindowDecoder */
/** @typedef {import("./states.js").RectifiedFrame} RectifiedFrame */

export const { WINDOW, LEAST_FRAMES, FINE_BLOCKS, STRIDE_S } = receiverReadingFilm;
export const { VAGUE } = receiverReadingPairs;
const { FINE_WINDOW, MISSED, FRESH_FRAMES, MOST_PAIRS } = receiverReadingFilm;
const { SHRINK } = modelsFilmWindow;

/**
 * What is kept of a camera frame: its time, the shrunk gray levels of the rectified display, and 1
 * for each block that lies within the camera frame as a whole, else 0.
 *
 * @typedef {{ time: number, gray: Float32Array, seen: Float32Array }} FilmFrame
 */

/** Keeps frames of one display, and has frame pairs scored by windows of them. */
export class FilmDesk {
  #layout;
  #scorer;
  #kept;
  #window;
  #known;
  /** @type {FilmFrame[]} */
  #frames = [];
  #scoredAt = -Infinity;

  /**
   * @param {Layout} layout - of the display
   * @param {WindowDecoder} scorer - the film decoder
   * @param {number} kept - number of frames that wait at most
   */
  constructor(layout, scorer, kept) {
    this.#layout = layout;
    this.#scorer = scorer;
    this.#kept = kept;
    this.#known = Float32Array.from(expectedChanges(layout));
    this.#window = this.#known.length > FINE_BLOCKS ? FINE_WINDOW : WINDOW;
  }

  /** Get ready: frames will soon come. */
  async load() {
    await this.#scorer.load?.();
  }

  /** Forget all frames: what comes shows another place, another picture, or another clock. */
  clear() {
    this.#frames = [];
    this.#scoredAt = -Infinity;
  }

  /**
   * Keep a frame.
   *
   * @param {RectifiedFrame} frame
   */
  add({ time, rectified, inView }) {
    const { rows, cols } = this.#layout;
    const [width, height] = [rectified.width, rectified.height].map((side) =>
      Math.floor(side / SHRINK),
    );
    const gray = areaMeans(rectified, width, height).data;
    let seen = new Float32Array(rows * cols).fill(1);
    if (inView) {
      const shares = areaMeans({ width: MESH, height: MESH, data: inView }, cols, rows).data;
      seen = shares.map((share) => (share > 1 - 1e-6 ? 1 : 0));
    }
    this.#frames.push({ time, gray, seen });
    if (this.#frames.length > this.#kept) this.#frames.shift();
  }

  /**
   * Tell whether it is time for the next window.
   *
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {number} waitingS - seconds for which the frame pairs that wait were displayed
   */
  due(fps, waitingS) {
    const frames = this.#frames;
    if (frames.length < LEAST_FRAMES) return false;
    const since = frames[frames.length - 1].time - this.#scoredAt;
    const fresh = frames.filter(({ time }) => time > this.#scoredAt).length;
    const isMissed = Number.isFinite(since) && since * fps > MISSED * fresh;
    return Math.max(since, waitingS) >= STRIDE_S && (fresh >= FRESH_FRAMES || !isMissed);
  }

  /**
   * Score frame pairs by the window that ends with the last of them that fits into it.
   *
   * @param {DisplayClock} clock - says when the display shows which state
   * @param {number[]} numbers - of frame pairs that are over, rising
   * @returns {Promise<Map<number, Float32Array>>} (nBits,) scores by the number of the frame pair,
   *   for at least one of them; the others wait for the next window
   */
  async score(clock, numbers) {
    const frames = this.#frames;
    const spans = frames.map(({ time }) => pairsShown(clock, time));
    const needed = spans.findIndex(([, last]) => last >= numbers[0]);
    let begin = Math.max(0, needed);
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
    const times = window.map(({ time }) => time);
    const { rows, cols, width, height, messageBlocks } = this.#layout;
    const scores = await this.#scorer.decode({
      frames: rowsOf(window.map(({ gray }) => gray)).data,
      seen: rowsOf(window.map(({ seen }) => seen)).data,
      known: this.#known,
      mixture: mixtureOfExposures(clock, times, this.#layout, first, last + 1 - first),
      size: [window.length, Math.floor(height / SHRINK), Math.floor(width / SHRINK), rows, cols],
    });
    this.#scoredAt = now;
    frames.splice(0, Math.max(0, end - this.#window));
    const chosen = done.length > 0 ? done : numbers.slice(0, 1);
    return new Map(
      chosen.map((number) => {
        const from = (number - first) * rows * cols;
        const isSeen = number >= first && number <= last;
        return [number, Float32Array.from(messageBlocks, (at) => (isSeen ? scores[from + at] : 0))];
      }),
    );
  }
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
