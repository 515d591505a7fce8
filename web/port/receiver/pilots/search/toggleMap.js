/**
 * Where in the image something toggles: a map that separates a display from the room around it.
 *
 * Frames are held still by the camera's motion first. A block that goes up and down, or down and
 * up, as each bit says, has power in a wide band around its toggling rate, and none at twice that
 * rate. Noise has as much in the one place as in the other. The amplitudes of the pixels are summed
 * up when an outline is asked for: only then is it known which time the frames cover, and only
 * where no edges gave the display away.
 */

import { receiverPilotsSearchToggleMap } from "../../../../generated/constants.js";
import { blurred } from "../../../image/blur.js";
import { Copies } from "../../../image/copies.js";
import { call, floatPlane, rowsOf } from "../../../image/opencv.js";
import { roundHalfEven } from "../../../image/round.js";
import { resizeArea } from "../../../image/shrink.js";
import { homographyFromCorners, pixelsInOne } from "../../../link/geometry.js";
import { median, quantile } from "../../../link/order.js";
import { quadOf, rolled, upright } from "../../locate/quads.js";
import { rowsOfWaves, spanOf, waves } from "../waves.js";

export const {
  SLOWEST, BAND, QUIET, BAND_WAVES, QUIET_WAVES, FINE_PX, COARSE_PX, SMOOTH_PX, LEAST_POWER, CEILING,
  EVEN_PX, LEAST_EXCESS, CLEAR_QUANTILE, FAINT, EDGE_SHARE, CLOSED_PX, OPENED_PX, FIT_PX, FIT_STEPS,
  LEAST_SHARE,
} = receiverPilotsSearchToggleMap;

/** Tells how much each pixel toggles at each frequency, over the frames that were added. */
export class ToggleMap {
  /** @type {BytePlane[]} */
  #stills = [];
  /** Positions of the frames. @type {number[]} */
  #at = [];
  /** The frames, which are looked at coarsely. @type {Copies[]} */
  #copies = [];
  /** @type {Map<number, FloatPlane>} */
  #logs = new Map();

  /**
   * @param {number} width - of the frames that will come
   * @param {number} height - of the frames that will come
   */
  constructor(width, height) {
    this.width = width;
    this.height = height;
  }

  /**
   * Take the next frame, aligned with those before.
   *
   * @param {BytePlane} still - is kept
   * @param {number} at - position of the frame (waves.js)
   */
  add(still, at) {
    this.#stills.push(still);
    this.#at.push(at);
    this.#copies.push(new Copies(still));
    this.#logs.clear();
  }

  /**
   * Average all frames so far; what is behind the point is dropped.
   *
   * @returns {BytePlane}
   */
  mean() {
    const { width, height } = this;
    const sums = new Uint32Array(width * height);
    for (const { data } of this.#stills) for (let i = 0; i < sums.length; i++) sums[i] += data[i];
    const count = this.#stills.length;
    const data = new Uint8Array(sums.length);
    for (let i = 0; i < sums.length; i++) data[i] = sums[i] / count;
    return { width, height, data };
  }

  /**
   * Work out, step by step, what `outline` needs for a frequency, so that it does not take long.
   *
   * @param {number} frequency - in periods for each nominal frame
   * @returns {Generator<void, void>}
   */
  *prepare(frequency) {
    for (const number of this.#needed(frequency).flat()) {
      if (this.#logs.has(number)) continue;
      this.logPower(number);
      yield;
    }
  }

  /**
   * Outline what toggles at a frequency.
   *
   * @param {number} frequency - in periods for each nominal frame
   * @returns {Point[] | null} pixels of the map, in corner order nearest to upright; null where
   *   nothing toggles there, or the frames do not cover enough time
   */
  outline(frequency) {
    const [toggling, quiet] = this.#needed(frequency);
    if (toggling.length === 0 || quiet.length === 0) return null;
    const { width, height } = this;
    const over = new Float32Array(width * height);
    for (const [numbers, sign] of /** @type {[number[], number][]} */ ([
      [toggling, 1],
      [quiet, -1],
    ])) {
      for (const number of numbers) {
        const { data } = this.logPower(number);
        const share = sign / numbers.length;
        for (let i = 0; i < over.length; i++) over[i] += share * data[i];
      }
    }
    for (let i = 0; i < over.length; i++) {
      over[i] = Math.min(CEILING, Math.max(-CEILING, over[i]));
    }
    const excess = blurred({ width, height, data: over }, EVEN_PX).data;
    const usual = median(excess);
    const clear = Math.max(LEAST_EXCESS, 0.5 * quantile(excess, CLEAR_QUANTILE));
    const places = excess.filter((value) => value > clear);
    const level = places.length ? median(places) : 0;
    const edge = Math.max(FAINT, EDGE_SHARE * (level - usual));
    const gain = new Float32Array(excess.length);
    const mask = new Uint8Array(excess.length);
    for (let i = 0; i < excess.length; i++) {
      gain[i] = Math.min(2, Math.max(-1, (excess[i] - usual) / edge - 1));
      mask[i] = excess[i] > clear ? 1 : 0;
    }
    let most = -Infinity;
    /** @type {Point[] | null} */
    let best = null;
    const [across, down] = [width, height].map((side) => Math.max(1, roundHalfEven(side / FIT_PX)));
    const small = resizeArea({ width, height, data: gain }, across, down);
    for (const start of outlines({ width, height, data: mask })) {
      const { corners, sum } = fittedOutline(start, small);
      if (sum <= most && best !== null) continue;
      most = sum;
      best = corners;
    }
    return best && upright(best);
  }

  /**
   * Show what a quadrilateral bounds in frames, in small maps. Frames are averaged down where the
   * maps are coarser, without rounding.
   *
   * @param {Point[][]} quads - pixels of the map: one for all frames, or one for each of the first
   * @param {number} width - of the small maps
   * @param {number} height - of the small maps
   * @param {number} [turn] - number of quarter turns after which they are upright
   * @param {number} [first] - number of the first frame that is shown
   * @returns {FloatPlane[]}
   */
  views(quads, width, height, turn = 0, first = 0) {
    const factor = Math.floor(pixelsInOne(rolled(quads[0], turn), width, height));
    const [from, end] = quads.length === 1 ? [0, this.#copies.length] : [first, quads.length];
    const ways = quads
      .slice(from)
      .map((quad) => homographyFromCorners(rolled(quad, turn), width, height));
    return this.#copies
      .slice(first, end)
      .map((still, at) => still.sampled(ways[at] ?? ways[0], factor, width, height));
  }

  /**
   * Find the logarithm of the smoothed power at one of the frequencies.
   *
   * @param {number} number - of periods in the window, from 1
   * @returns {FloatPlane}
   */
  logPower(number) {
    const known = this.#logs.get(number);
    if (known) return known;
    const { width, height } = this;
    const { span } = spanOf(this.#at);
    const slower = Array.from({ length: SLOWEST - 1 }, (_, periods) => periods / span);
    const [wave] = waves(this.#at, [number / span], slower);
    const power = floatPlane(width, height);
    const sizes = [FINE_PX, COARSE_PX, SMOOTH_PX, LEAST_POWER];
    const frames = rowsOf(this.#stills.map(({ data }) => data), Uint8Array);
    call("logPower", [frames, rowsOfWaves([wave]), ...sizes], [power]);
    this.#logs.set(number, power);
    return power;
  }

  /**
   * List the numbers of periods whose power an outline needs, in `BAND` and in `QUIET`.
   *
   * @param {number} frequency
   * @returns {number[][]} two empty lists where no outline can be had
   */
  #needed(frequency) {
    const { span, fastest } = spanOf(this.#at);
    const toggling = spread(frequency * span, BAND, fastest, BAND_WAVES);
    const quiet = spread(frequency * span, QUIET, fastest, QUIET_WAVES);
    return toggling.length && quiet.length ? [toggling, quiet] : [[], []];
  }
}

/**
 * Choose numbers of periods that are spread evenly over a band.
 *
 * @param {number} rate - number of periods of the toggling
 * @param {number[]} ends - ends of the band, as multiples of the rate
 * @param {number} fastest - largest number that the frames can tell
 * @param {number} most - number of them that is enough
 * @returns {number[]} at most so many, rising; none where the band holds none from `SLOWEST` on
 */
function spread(rate, [first, last], fastest, most) {
  const low = Math.max(SLOWEST, Math.ceil(first * rate));
  const high = Math.min(fastest, Math.floor(last * rate));
  if (high < low) return [];
  const step = (high - low) / (most - 1);
  const numbers = Array.from({ length: most }, (_, i) => roundHalfEven(low + i * step));
  return [...new Set(numbers)];
}

/**
 * Bound the largest part of a mask, specks dropped and holes closed.
 *
 * @param {BytePlane} mask - of 0 and 1
 * @returns {Point[][]} the smallest quadrilateral and the smallest rectangle around it, pixels;
 *   none where no part is large enough
 */
function outlines(mask) {
  const quads = new Float64Array(16);
  const area = LEAST_SHARE * mask.width * mask.height;
  const isFound = call("outlines", [mask, CLOSED_PX, OPENED_PX, area], [quads]);
  return isFound ? [quadOf(quads), quadOf(quads.subarray(8))] : [];
}

/**
 * Move the corners of a quadrilateral, one by one, while that adds to the sum within it.
 *
 * @param {Point[]} quad - pixels of the map
 * @param {FloatPlane} gain - what each pixel adds, in a map `FIT_PX` times smaller
 */
function fittedOutline(quad, gain) {
  const fitted = new Float64Array(8);
  const start = Float64Array.from(quad.flat());
  const sum = call("fittedOutline", [gain, start, FIT_PX, Float64Array.from(FIT_STEPS)], [fitted]);
  return { corners: quadOf(fitted), sum };
}
