/**
 * Find a coded display's clock: which rate, which moment of the code, and how rows follow rows.
 *
 * The order in which a display shows the two states of its frame pairs follows a pseudo-random code
 * (`link/pilotCode.js`). So what its pilots do in the frames of a camera is known for each rate and
 * each moment of the code, whatever the rate of the camera, and all of them are tried.
 */

import { pilotsCode } from "../generated/constants.js";
import { roundHalfEven } from "../image/round.js";
import { DisplayClock, embeddedShare } from "./clock.js";
import { alongWave, lengthOf, takeOut } from "./waves.js";

/** @typedef {import("../link/pilotCode.js").PilotCode} PilotCode */

const { STATE_HZ, CLOCK_ERROR, PHASES, SLOPES, SIDES, OPEN, SURER, DRIFT } = pilotsCode;
export const { MOST_STATE_HZ } = pilotsCode;

/** Largest number of series that are compared with all clocks. */
const COMPARED = 256;
/** Number of `SLOPES` that is no slope. */
const NO_SLOPE = SLOPES.findIndex(([across, down]) => across === 0 && down === 0);
/** Axis along which each of `SLOPES` goes: 0 from left to right, 1 from top to bottom. */
const AXES = SLOPES.map(([, down]) => Number(down !== 0));

/**
 * How a display may run: its clock, by the unit of time of the frames' times; and the natural
 * logarithm of the probability that chance does as well, with the sign turned, after paying for
 * what was tried.
 *
 * @typedef {{ clock: DisplayClock, evidence: number }} CodeLock
 */

/** Compares what changes over the frames of a film with what a coded display shows in them. */
export class CodeSearch {
  #middle;
  #second;
  /** States a second that are tried. @type {number[]} */
  #hz;
  /** Exposure time that is taken for granted at each of these rates. @type {number[]} */
  #shutter;
  /** Number of moments that are tried at each rate. */
  #steps;
  /** Powers of time, orthogonal to each other, of length 1. @type {Float64Array[]} */
  #drifts = [];
  /** Squared length (H,) of each wave. */
  #energy;

  /**
   * @param {PilotCode} code - of the display
   * @param {readonly number[]} times - of T frames, rising
   * @param {number} fps - number of frames of the camera in the unit of time
   * @param {number} [second] - a second, in the unit of time
   */
  constructor(code, times, fps, second = 1) {
    this.#middle = times.reduce((sum, time) => sum + time, 0) / times.length;
    const since = Float64Array.from(times, (time) => time - this.#middle);
    this.#second = second;
    this.#hz = rates((since[since.length - 1] - since[0]) / second);
    this.#steps = 2 * PHASES * code.period;
    this.#shutter = this.#hz.map((hz) => OPEN * Math.min(second / hz, 1 / fps));
    const farthest = Math.max(...since.map(Math.abs), 1e-9);
    for (let power = 0; power < Math.min(DRIFT, times.length); power++) {
      const drift = takeOut(since.map((time) => (time / farthest) ** power), this.#drifts);
      const length = lengthOf(drift);
      this.#drifts.push(drift.map((value) => value / length));
    }
    const count = this.#hz.length * this.#steps;
    /**
     * What a block of sign 1 shows at the display's centre, less drifts: in each frame, (H,) by H
     * clocks, those of a rate one after the other.
     */
    this.waves = times.map(() => new Float32Array(count));
    this.#energy = new Float64Array(count);
    for (let at = 0; at < count; at++) {
      const { period, shutter } = this.#clock(at, NO_SLOPE);
      const start = (-(at % this.#steps) / PHASES) * period;
      const numbers = Float64Array.of(period, start, 0, 0, shutter);
      const shares = embeddedShare(numbers, since, new Float64Array(2), code);
      const wave = takeOut(shares.map((share) => 2 * share - 1), this.#drifts);
      wave.forEach((value, t) => (this.waves[t][at] = value));
      this.#energy[at] = lengthOf(wave) ** 2;
    }
  }

  /**
   * Find the clocks by which values follow their signs most surely, the surest first.
   *
   * Clocks are compared by how much of all values they explain over time, by least squares. To tell
   * whether that is chance, the signs are regressed on X_p, the sum of a pilot's values times the
   * clock's wave, as `pilotEvidence` does with amplitudes: by chance these explain the share R2 of
   * the signs' power with probability (1 - R2)^((P - 1) / 2), for P pilots.
   *
   * @param {readonly ArrayLike<number>[]} values - (P,) of P pilots, in each frame
   * @param {Float64Array} signs - (P,) 1 or -1
   * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
   * @param {number} [count] - number of clocks, none of them within a state of another
   * @returns {CodeLock[]}
   */
  strongest(values, signs, places, count = 1) {
    const { gain, chosen } = this.#bestSlopes(values, signs, places);
    return Array.from({ length: count }, () => {
      const most = gain.reduce((greatest, each) => Math.max(greatest, each));
      const top = gain.findIndex((each) => SURER * each >= most);
      for (let near = 1 - PHASES; near < PHASES; near++) gain[this.#later(top, near)] = -1;
      return this.#lock(top, chosen[top], values, signs, places);
    });
  }

  /**
   * Find the clock by which one of many series follows the code most clearly.
   *
   * A series cannot follow any clock more clearly than its own length, less drifts, allows. So the
   * longest alone are compared, one after the other, as long as they can do better.
   *
   * @param {Float64Array[]} matches - series (T,) of alike noise
   * @returns {DisplayClock} the clock, without delays across the display
   */
  highest(matches) {
    const lengths = matches.map((each) => lengthOf(takeOut(each.slice(), this.#drifts)));
    const scale = this.#energy.map((energy) => 1 / (Math.sqrt(energy) + 1e-6));
    let [most, best] = [0, 0];
    const longest = [...lengths.keys()].sort((one, two) => lengths[two] - lengths[one]);
    for (let i = 0; i < COMPARED && lengths[longest[i]] > most; i += 2) {
      const [one, other] = [longest[i], longest[i + 1] ?? longest[i]].map((at) => matches[at]);
      const along = alongWave(this.waves, { real: one, imaginary: other });
      for (const heights of [along.real, along.imaginary]) {
        for (let at = 0; at < heights.length; at++) {
          if (heights[at] * scale[at] <= most) continue;
          most = heights[at] * scale[at];
          best = at;
        }
      }
    }
    return this.#clock(best, NO_SLOPE);
  }

  /**
   * Choose for each rate and phase how exposure and writing go across the display.
   *
   * @param {readonly ArrayLike<number>[]} values
   * @param {Float64Array} signs
   * @param {Float64Array} places
   * @returns {{ gain: Float64Array, chosen: Uint8Array }} (H,) power that is explained, 0 where
   *   values speak against the clock, and numbers of `SLOPES`
   */
  #bestSlopes(values, signs, places) {
    const gain = new Float64Array(this.#energy.length);
    const chosen = new Uint8Array(gain.length);
    const parts = Array.from({ length: SIDES }, (_, side) => {
      const within = [0, 1].map((axis) =>
        signs.map((sign, p) => (partOf(places[2 * p + axis]) === side ? sign : 0)),
      );
      const [real, imaginary] = within.map((weights) =>
        Float64Array.from(values, (now) => weights.reduce((sum, sign, p) => sum + sign * now[p], 0)),
      );
      const { real: across, imaginary: down } = alongWave(this.waves, { real, imaginary });
      return { along: [across, down], pilots: within.map((each) => each.filter(Boolean).length) };
    });
    for (let first = 0, rate = 0; first < gain.length; first += this.#steps, rate++) {
      SLOPES.forEach((_, slope) => {
        const along = new Float64Array(this.#steps);
        const power = new Float64Array(this.#steps).fill(1e-9);
        this.#laterBy(rate, slope).forEach((later, side) => {
          const [sums, pilots] = [parts[side].along[AXES[slope]], parts[side].pilots[AXES[slope]]];
          let there = this.#later(first, later);
          for (let phase = 0; phase < this.#steps; phase++) {
            along[phase] += sums[there];
            power[phase] += pilots * this.#energy[there];
            if (++there === first + this.#steps) there = first;
          }
        });
        for (let phase = 0; phase < this.#steps; phase++) {
          const explained = Math.max(along[phase], 0) ** 2 / power[phase];
          if (explained <= SURER * gain[first + phase]) continue;
          gain[first + phase] = explained;
          chosen[first + phase] = slope;
        }
      });
    }
    return { gain, chosen };
  }

  /**
   * Describe a clock, given by its number, with one of `SLOPES`, and weigh it.
   *
   * @param {number} at
   * @param {number} slope
   * @param {readonly ArrayLike<number>[]} values
   * @param {Float64Array} signs
   * @param {Float64Array} places
   * @returns {CodeLock}
   */
  #lock(at, slope, values, signs, places) {
    const later = this.#laterBy(Math.floor(at / this.#steps), slope);
    let [along, power] = [0, 0];
    for (let p = 0; p < signs.length; p++) {
      const wave = this.#later(at, later[partOf(places[2 * p + AXES[slope]])]);
      let X = 0;
      values.forEach((now, t) => (X += now[p] * this.waves[t][wave]));
      along += signs[p] * X;
      power += X * X;
    }
    const share = along ** 2 / (signs.length * power + 1e-9);
    const paid = Math.log(this.#energy.length * SLOPES.length);
    const chance = ((signs.length - 1) / 2) * Math.log(Math.max(1 - share, 1e-12)) + paid;
    return { clock: this.#clock(at, slope), evidence: Math.max(0, -chance) };
  }

  /**
   * Tell by how many phases each part along the axis of a slope is later than the centre.
   *
   * @param {number} rate - its number
   * @param {number} slope - its number
   */
  #laterBy(rate, slope) {
    const seconds = SLOPES[slope][0] + SLOPES[slope][1];
    return Array.from({ length: SIDES }, (_, side) =>
      roundHalfEven(PHASES * ((side + 0.5) / SIDES - 0.5) * this.#hz[rate] * seconds),
    );
  }

  /**
   * Give the number of the clock of the same rate that is some phases later; they come again.
   *
   * @param {number} at
   * @param {number} phases
   */
  #later(at, phases) {
    const phase = at % this.#steps;
    const there = (phase + phases) % this.#steps;
    return at - phase + (there < 0 ? there + this.#steps : there);
  }

  /**
   * Make the clock of this number with one of `SLOPES`.
   *
   * @param {number} at
   * @param {number} slope
   */
  #clock(at, slope) {
    const rate = Math.floor(at / this.#steps);
    const period = this.#second / this.#hz[rate];
    const [across, down] = SLOPES[slope].map((delay) => delay * this.#second);
    const moment = ((at % this.#steps) / PHASES) * period;
    const start = this.#middle - moment + (across + down) / 2;
    return new DisplayClock(period, start, across, down, this.#shutter[rate]);
  }
}

/**
 * Number the part along one side in which a place in [0, 1] lies.
 *
 * @param {number} place
 */
function partOf(place) {
  return Math.min(Math.floor(place * SIDES), SIDES - 1);
}

/**
 * Count the clocks that are tried in a short window of frames.
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
 * @returns {number[]}
 */
function rates(span) {
  return STATE_HZ.flatMap((hz) => {
    const steps = roundHalfEven(((CLOCK_ERROR * span) / 2) * hz);
    return Array.from(
      { length: 2 * steps + 1 },
      (_, at) => hz * (1 + (CLOCK_ERROR * (at - steps)) / Math.max(steps, 1)),
    );
  });
}
