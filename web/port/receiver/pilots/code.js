/**
 * Find a coded display's clock: which rate, which moment of the code, and how rows follow rows.
 *
 * The order in which a display shows the two states of its frame pairs follows a pseudo-random code
 * (`link/pilotCode.js`). So what its pilots do in the frames of a camera is known for each rate and
 * each moment of the code, whatever the rate of the camera, and all of them are tried.
 */

import { pilotCode, receiverPilotsCode } from "../../../generated/constants.js";
import { call, floatPlane, rowsOf } from "../../image/opencv.js";
import { roundHalfEven } from "../../image/round.js";
import { dot } from "../../link/linear.js";
import { DisplayClock } from "../../link/clock.js";
import { NEAR, apartFromNear, clippedChanges, limited } from "./signal.js";

const { STATE_HZ } = pilotCode;
const { CLOCK_ERROR, MOST_STEPS, PHASES, PANEL_S, SLOPES, SIDES } = receiverPilotsCode;
const { COMPARED, RIVAL, OPEN, SURER } = receiverPilotsCode;
export const { MOST_STATE_HZ } = receiverPilotsCode;

/**
 * How a display may run: its clock, by the unit of time of the frames' times; the natural logarithm
 * of the probability that chance does as well, with the sign turned, after paying for what was
 * tried; and the largest share of what it explains that a clock explains which shows quite another
 * state in the newest frame.
 *
 * @typedef {{ clock: DisplayClock, evidence: number, rival: number }} CodeLock
 */

/** Compares what changes over the frames of a film with what a coded display shows in them. */
export class CodeSearch {
  #signs;
  /** Part (P,) along x, and along y, in which each place lies. @type {Int32Array[]} */
  #part;
  #middle;
  /** Time of the newest frame after the middle. */
  #newest;
  #second;
  /** Those of `SLOPES` that the camera allows. */
  #slopes;
  /** Axis along which each of them goes: 0 from left to right, 1 from top to bottom. */
  #axes;
  /** States a second that are tried. @type {number[]} */
  #hz;
  /** Exposure time that is taken for granted at each of these rates. */
  #shutter;
  /** Number of moments that are tried at each rate. */
  #steps;
  /** Squared length (H,) of each wave. */
  #energy;
  /** Signs of the places within each part along x, and along y; 0 elsewhere. */
  #within;
  /** Number of phases by which each part is later, for each rate and, faster, for each slope. */
  #later;
  /** Power of what all places show: a row of H for each slope. */
  #powers;

  /**
   * @param {PilotCode} code - of the display
   * @param {Float64Array} signs - (P,) 1 or -1, the signs of P places that show the code
   * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
   * @param {readonly number[]} times - of T frames, rising
   * @param {number} fps - number of frames of the camera in the unit of time
   * @param {number} [second] - a second, in the unit of time
   */
  constructor(code, signs, places, times, fps, second = 1) {
    this.#signs = signs;
    this.#part = [0, 1].map((axis) =>
      Int32Array.from(signs, (_, p) =>
        Math.min(Math.floor(places[2 * p + axis] * SIDES), SIDES - 1),
      ),
    );
    this.#middle = times.reduce((sum, time) => sum + time, 0) / times.length;
    const since = Float64Array.from(times, (time) => time - this.#middle);
    this.#newest = since[since.length - 1];
    this.#second = second;
    const longest = longestDelay(1 / (fps * second));
    this.#slopes = SLOPES.filter((slope) => slope.every((delay) => Math.abs(delay) <= longest));
    this.#axes = Int32Array.from(this.#slopes, ([across]) => Number(across === 0));
    this.#hz = rates((this.#newest - since[0]) / second);
    this.#steps = 2 * PHASES * code.period;
    this.#shutter = Float64Array.from(this.#hz, (hz) => OPEN * Math.min(second / hz, 1 / fps));
    const count = this.#hz.length * this.#steps;
    /**
     * What a block of sign 1 shows at the display's centre, less the mean of near frames: in each
     * frame, a row, by H clocks, those of a rate one after the other.
     */
    this.waves = floatPlane(count, times.length);
    this.#energy = new Float32Array(count);
    const periods = Float64Array.from(this.#hz, (hz) => second / hz);
    call(
      "codeWaves",
      [since, NEAR, periods, this.#shutter, code.signs, PHASES],
      [this.waves, this.#energy],
    );
    this.#within = this.#part.map((parts) =>
      Array.from({ length: SIDES }, (_, side) =>
        signs.map((sign, p) => (parts[p] === side ? sign : 0)),
      ),
    );
    const later = this.#hz.flatMap((hz) =>
      this.#slopes.flatMap(([across, down]) =>
        Array.from({ length: SIDES }, (_, side) => {
          const phases = PHASES * ((side + 0.5) / SIDES - 0.5) * hz * (across + down);
          return (roundHalfEven(phases) + this.#steps) % this.#steps;
        }),
      ),
    );
    this.#later = Int32Array.from(later);
    this.#powers = floatPlane(count, this.#slopes.length);
    const counts = this.#within.flat().map((weights) => weights.filter(Boolean).length);
    const parts = [this.#energy, this.#later, Int32Array.from(counts), this.#axes];
    call("slopePowers", parts, [this.#powers]);
  }

  /**
   * Find the clocks by which values follow their signs most surely, the surest first.
   *
   * Clocks are compared by how much of all values they explain over time, less the mean of near
   * frames, by least squares. To tell whether that is chance, the signs are regressed on X_p, the sum
   * of a place's values times the clock's wave, as `pilotEvidence` does with amplitudes: by chance
   * these explain the share R2 of the signs' power with probability (1 - R2)^((P - 1) / 2), for P
   * places.
   *
   * @param {readonly ArrayLike<number>[]} seen - (P,) values of the places in each frame
   * @param {number} [count] - number of clocks, none of them within a state of another
   * @returns {CodeLock[]}
   */
  strongest(seen, count = 1) {
    const { changes: values, usual } = clippedChanges(seen);
    for (const now of values) now.forEach((value, p) => (now[p] = value / usual[p]));
    const { gain, chosen } = this.#bestSlopes(values);
    const left = gain.slice();
    return Array.from({ length: count }, () => {
      const most = left.reduce((greatest, each) => Math.max(greatest, each));
      const top = left.findIndex((each) => SURER * each >= most);
      for (let near = 1 - PHASES; near < PHASES; near++) left[this.#turned(top, near)] = -1;
      return this.#lock(top, chosen[top], gain, values);
    });
  }

  /**
   * Find the clock that the parts of a display follow most clearly, each by its best series.
   *
   * A series cannot follow any clock more clearly than its own length, less the mean of near frames,
   * allows, so that the longest alone are compared.
   *
   * @param {Float32Array[][]} matches - for each part and each of T frames, the values of S series
   *   of alike noise
   * @returns {DisplayClock} the clock, without delays across the display
   */
  highest(matches) {
    const total = new Float64Array(this.#energy.length);
    for (const seen of matches) {
      const frames = apartFromNear(seen);
      const { longest, deviation } = this.#longest(frames);
      const series = longest.map((number) => frames.map((now) => now[number]));
      const most = new Float32Array(total.length);
      call("largestSums", [this.waves, rowsOf(series)], [most]);
      const unit = deviation + 1e-9;
      for (let at = 0; at < most.length; at++) {
        total[at] += (most[at] / unit) ** 2 / (this.#energy[at] + 1e-6);
      }
    }
    return this.#clock(total.indexOf(Math.max(...total)), 0);
  }

  /**
   * Find which series are the longest.
   *
   * @param {readonly Float32Array[]} frames - (S,) values of all series in each of T frames
   * @returns {{ longest: number[], deviation: number }} numbers of `COMPARED` series, and the
   *   standard deviation of all values
   */
  #longest(frames) {
    const squares = new Float64Array(frames[0].length);
    let sum = 0;
    for (const now of frames) {
      for (let i = 0; i < squares.length; i++) {
        squares[i] += now[i] * now[i];
        sum += now[i];
      }
    }
    const count = frames.length * squares.length;
    const power = squares.reduce((all, square) => all + square, 0) / count;
    const least = squares.slice().sort().at(-COMPARED) ?? -Infinity;
    const longest = [...squares.keys()].filter((number) => squares[number] >= least);
    return { longest, deviation: Math.sqrt(power - (sum / count) ** 2) };
  }

  /**
   * Choose for each rate and phase how exposure and writing go across the display.
   *
   * @param {readonly ArrayLike<number>[]} values
   * @returns {{ gain: Float64Array, chosen: Uint8Array }} (H,) power that is explained, 0 where
   *   values speak against the clock, and numbers of slopes
   */
  #bestSlopes(values) {
    const gain = new Float64Array(this.#energy.length);
    const chosen = new Uint8Array(gain.length);
    const series = this.#within.flat().map((weights) => values.map((now) => dot(weights, now)));
    const along = floatPlane(this.waves.width, series.length);
    call("weightedSums", [this.waves, rowsOf(series)], [along]);
    call("bestSlopes", [along, this.#later, this.#powers, this.#axes, SURER], [gain, chosen]);
    return { gain, chosen };
  }

  /**
   * Describe a clock, given by its number, with one of the slopes, and weigh it.
   *
   * @param {number} at
   * @param {number} slope
   * @param {Float64Array} gain - of all clocks
   * @param {readonly ArrayLike<number>[]} values
   */
  #lock(at, slope, gain, values) {
    const count = this.#signs.length;
    const rate = Math.floor(at / this.#steps);
    const later = this.#later.subarray((rate * this.#slopes.length + slope) * SIDES);
    const amplitudes = Float64Array.from(this.#signs, (_, p) => {
      const wave = this.#turned(at, later[this.#part[this.#axes[slope]][p]]);
      let X = 0;
      values.forEach((now, t) => (X += now[p] * this.waves.data[t * this.waves.width + wave]));
      return X;
    });
    let [along, power] = [0, 0];
    limited(amplitudes).forEach((X, p) => {
      along += this.#signs[p] * X;
      power += X * X;
    });
    const share = along ** 2 / (count * power + 1e-9);
    const paid = Math.log(gain.length * this.#slopes.length);
    const chance = ((count - 1) / 2) * Math.log(Math.max(1 - share, 1e-12)) + paid;
    const clock = this.#clock(at, slope);
    if (chance >= 0) return { clock, evidence: 0, rival: 1 };
    const rival = gain.reduce((most, each, other) => {
      const phases = this.#phase(other) - this.#phase(at);
      const apart = Math.abs(phases - this.#steps * Math.round(phases / this.#steps));
      return apart >= RIVAL * PHASES ? Math.max(most, each) : most;
    }, 0);
    return { clock, evidence: -chance, rival: rival / (gain[at] + 1e-9) };
  }

  /**
   * Give the phase at which a clock is in the newest frame.
   *
   * @param {number} at
   */
  #phase(at) {
    const hz = this.#hz[Math.floor(at / this.#steps)];
    return (PHASES * this.#newest * hz) / this.#second + (at % this.#steps);
  }

  /**
   * Give the number of the clock of the same rate that is some phases later; they come again.
   *
   * @param {number} at
   * @param {number} phases
   */
  #turned(at, phases) {
    const phase = at % this.#steps;
    const there = (phase + phases) % this.#steps;
    return at - phase + (there < 0 ? there + this.#steps : there);
  }

  /**
   * Make the clock of this number with one of the slopes.
   *
   * @param {number} at
   * @param {number} slope
   */
  #clock(at, slope) {
    const rate = Math.floor(at / this.#steps);
    const period = this.#second / this.#hz[rate];
    const [across, down] = this.#slopes[slope].map((delay) => delay * this.#second);
    const moment = ((at % this.#steps) / PHASES) * period;
    const start = this.#middle - moment + (across + down) / 2;
    return new DisplayClock(period, start, across, down, this.#shutter[rate]);
  }
}

/**
 * Give the longest delay across the display, in seconds, with which a search begins.
 *
 * @param {number} frame - time from one frame of the camera to the next, seconds
 */
export function longestDelay(frame) {
  return Math.max(frame, PANEL_S);
}

/**
 * Count the clocks that are tried in a short window of frames, at most.
 *
 * @param {PilotCode} code
 */
export function clocksTried(code) {
  return 2 * PHASES * code.period * STATE_HZ.length * SLOPES.length;
}

/**
 * List the rates that are told apart in some seconds, with clocks that run fast or slow.
 *
 * @param {number} span - seconds
 */
function rates(span) {
  return STATE_HZ.flatMap((hz) => {
    const steps = Math.min(roundHalfEven(((CLOCK_ERROR * span) / 2) * hz), MOST_STEPS);
    return Array.from(
      { length: 2 * steps + 1 },
      (_, at) => hz * (1 + (CLOCK_ERROR * (at - steps)) / Math.max(steps, 1)),
    );
  });
}
