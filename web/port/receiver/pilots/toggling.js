/**
 * How a display toggles over the frames of a film: in one wave, or as its code says.
 *
 * Where pilots always toggle with the same signs, a frequency says how (`signal.js`). Where they
 * follow a code (`link/pilotCode.js`), it takes a clock (`code.js`).
 */

import { receiverPilotsToggling } from "../../../generated/constants.js";
import { call, floatPlane, rowsOf } from "../../image/opencv.js";
import { DisplayClock, embeddedShare } from "../../link/clock.js";
import { dot } from "../../link/linear.js";
import { CodeSearch } from "./code.js";
import { pilotCentres, pilotSigns, pilotValues } from "../../link/pilots.js";
import { commonPhase, overDeviation, pilotEvidence } from "./signal.js";
import { alongWave, waves } from "./waves.js";

/** @typedef {import("./motion.js").GridMaps} GridMaps */

const { LEAST_WAVE, UNCLEAR, MOST_FRAMES } = receiverPilotsToggling;

/**
 * Amplitudes: real and imaginary part of each pixel of a map.
 *
 * @typedef {{ width: number, height: number, real: Float32Array, imaginary: Float32Array }}
 *   Amplitudes
 */

/**
 * How a display toggles over the frames of a film, whose positions are those of waves.js.
 *
 * `amplitudes` measures how each place of maps of a size toggles, given `overDeviation` of each map:
 * in any phase, or real where the phase is known. `changeSteps` measures by how much each pixel of views,
 * rectified to maps, changed in each frame pair that they show: positive where a pixel's embedded
 * frame is brighter, over its usual deviation. `clockInSeconds` tells when the display shows which
 * state, where that is known, by the nominal frames in a second and the time of position 0. `clear`
 * says that no other way explains about as much.
 *
 * @typedef {object} Toggling
 * @property {boolean} clear
 * @property {(
 *   series: readonly Float32Array[], at: readonly number[], size: [number, number],
 * ) => Amplitudes} amplitudes
 * @property {(
 *   maps: GridMaps, views: readonly FloatPlane[], at: readonly number[],
 * ) => Steps<FloatPlane[]>} changeSteps
 * @property {(fps: number, origin: number) => DisplayClock | null} clockInSeconds
 */

/**
 * Tell how surely values over time toggle with the pilots' signs, in any way.
 *
 * @param {readonly Float32Array[]} values - (pilots,) for each of some frames
 * @param {Layout} layout - with these pilots
 * @param {readonly number[]} at - positions of the frames, rising
 * @param {number} fps - nominal number of frames in a second
 * @returns {{ evidence: number, toggling: Toggling }} the natural logarithm of the probability that
 *   chance does as well, with the sign turned, after paying for all ways that were tried; and the
 *   way in which they toggle most surely
 */
export function findToggling(values, layout, at, fps) {
  const { code } = layout;
  if (code.isPlain) {
    const { evidence, frequency } = pilotEvidence(values, layout, at);
    return { evidence, toggling: new Wave(frequency) };
  }
  const search = codeSearch(layout, at.slice(-MOST_FRAMES), fps);
  const [lock] = search.strongest(values.slice(-MOST_FRAMES));
  const toggling = new CodedToggling(lock.clock, code, lock.rival < UNCLEAR);
  return { evidence: lock.evidence, toggling };
}

/** Searches for codes that were made last. @type {{ key: string, search: CodeSearch }[]} */
let made = [];

/**
 * Make a search for a layout's code in frames at these positions, for all that is tried there.
 *
 * @param {Layout} layout
 * @param {readonly number[]} at
 * @param {number} fps - nominal number of frames in a second
 * @returns {CodeSearch} by nominal frames
 */
export function codeSearch(layout, at, fps) {
  const key = [fps, at, layout.code.signs, layout.pilotBlocks, layout.cols].join(" ");
  const known = made.find((each) => each.key === key);
  const search = known?.search ?? new CodeSearch(
    layout.code, pilotSigns(layout), Float64Array.from(pilotCentres(layout).flat()), at, 1, fps,
  );
  made = [{ key, search }, ...made.filter((each) => each !== known)].slice(0, 2);
  return search;
}

/**
 * A display whose pilots always toggle with the same signs.
 *
 * @implements {Toggling}
 */
export class Wave {
  /** @param {number} frequency - at which it toggles, in periods for each nominal frame */
  constructor(frequency) {
    this.frequency = frequency;
    this.clear = true;
  }

  /** @type {Toggling["amplitudes"]} */
  amplitudes(series, at, [width, height]) {
    const [wave] = waves(at, [this.frequency], [0]);
    // an imaginary part that is 0 but for rounding must be 0
    const rounded = (/** @type {number} */ value) => Math.round(value * 1e12) / 1e12;
    const turns = { real: wave.real.map(rounded), imaginary: wave.imaginary.map(rounded) };
    const { real, imaginary } = alongWave(series, turns);
    return { width, height, real: Float32Array.from(real), imaginary: Float32Array.from(imaginary) };
  }

  /**
   * The phase of the toggling, which may slope across the display, is that of the pilots. A period
   * begins where the first state of a frame pair does, so that the bits of different frame pairs
   * are kept apart.
   *
   * @type {Toggling["changeSteps"]}
   */
  *changeSteps(maps, views, at) {
    const [width, height] = maps.size;
    const { real, imaginary, angle } = this.#turns(maps, views, at);
    yield views.length * maps.work * 0.2;
    const series = overDeviation(views.map(({ data }) => data));
    yield views.length * maps.work * 0.2;
    const periods = at.map((place) => this.frequency * (place - at[0]));
    const begun = periods.map((period) => Math.floor(period + angle / (2 * Math.PI) - 0.25 + 1e-6));
    const changes = [];
    for (const taken of groups(begun)) {
      const wave = waveOf(taken.map((frame) => periods[frame]));
      if (wave === null) continue;
      const sums = alongWave(taken.map((frame) => series[frame]), wave);
      const data = Float32Array.from(
        sums.real,
        (sum, i) => sum * real[i] - sums.imaginary[i] * imaginary[i],
      );
      changes.push({ width, height, data });
      yield 0.3 * taken.length * maps.work;
    }
    return changes;
  }

  /**
   * Find by how much the phase at each pixel is to be turned back.
   *
   * @param {GridMaps} maps
   * @param {readonly FloatPlane[]} views
   * @param {readonly number[]} at
   * @returns {{ real: Float32Array, imaginary: Float32Array, angle: number }} the turns, and the
   *   phase at the centre of the display
   */
  #turns(maps, views, at) {
    const [wave] = waves(at, [this.frequency], [0]);
    const values = views.map((view) => pilotValues(maps.within(view), maps.layout));
    const { slope, phase: angle } = commonPhase(alongWave(values, wave), maps.layout);
    const [xs, ys] = maps.places();
    const real = new Float32Array(xs.length * ys.length);
    const imaginary = new Float32Array(real.length);
    for (let i = 0; i < real.length; i++) {
      const [x, y] = [xs[i % xs.length], ys[Math.floor(i / xs.length)]];
      const phase = angle + (slope[0] * x + slope[1] * y) / 2;
      real[i] = Math.cos(phase);
      imaginary[i] = -Math.sin(phase);
    }
    return { real, imaginary, angle };
  }

  /** A wave comes again with each frame pair, which tells no number. */
  clockInSeconds() {
    return null;
  }
}

/**
 * A display whose frame pairs follow a code.
 *
 * @implements {Toggling}
 */
export class CodedToggling {
  /**
   * @param {DisplayClock} clock - by nominal frames since position 0
   * @param {PilotCode} code - of the display
   * @param {boolean} [clear] - whether no other clock explains about as much
   */
  constructor(clock, code, clear = false) {
    this.clock = clock;
    this.code = code;
    this.clear = clear;
  }

  /** @type {Toggling["amplitudes"]} */
  amplitudes(series, at, [width, height]) {
    const centres = [width, height].map((side) =>
      Float64Array.from({ length: side }, (_, i) => (2 * i + 1) / side - 1),
    );
    const { data: real } = this.#along(series, at, centres);
    return { width, height, real, imaginary: new Float32Array(real.length) };
  }

  /** @type {Toggling["changeSteps"]} */
  *changeSteps(maps, views, at) {
    const [width, height] = maps.size;
    const series = overDeviation(views.map(({ data }) => data));
    yield views.length * maps.work * 0.3;
    const numbers = at.map((place) => Math.floor(this.clock.number(place + this.clock.centre) / 2));
    const changes = [];
    for (const taken of groups(numbers)) {
      const frames = taken.map((frame) => series[frame]);
      const then = taken.map((frame) => at[frame]);
      const { data, power } = this.#along(frames, then, maps.places());
      if (power < LEAST_WAVE) continue;
      changes.push({ width, height, data: data.map((sum) => sum / Math.sqrt(power)) });
      yield 0.3 * taken.length * maps.work;
    }
    return changes;
  }

  /**
   * Add up frames times what a block of bit 1 shows in them, from -1 to 1.
   *
   * @param {readonly Float32Array[]} series - (h w,) values of each frame
   * @param {readonly number[]} at - positions of the frames
   * @param {Float64Array[]} places - (w,) and (h,) of the columns and rows, from -1 to 1
   * @returns {{ data: Float32Array, power: number }} (h w,) the sums, and the mean power of what is
   *   shown
   */
  #along(series, at, [xs, ys]) {
    const isDown = this.clock.delayX === 0;
    const line = isDown ? ys : xs;
    const places = new Float64Array(2 * line.length).fill(0.5);
    line.forEach((place, i) => (places[2 * i + Number(isDown)] = (place + 1) / 2));
    const times = Float64Array.from(at);
    const shown = embeddedShare(this.clock.numbers, times, places, this.code).map(
      (share) => 2 * share - 1,
    );
    const all = { width: at.length, height: line.length, data: shown };
    const sums = floatPlane(xs.length, ys.length);
    call("sumsAlong", [rowsOf(series), all, Number(isDown)], [sums]);
    return { data: sums.data, power: dot(shown, shown) / line.length };
  }

  /** @type {Toggling["clockInSeconds"]} */
  clockInSeconds(fps, origin) {
    const { period, start, delayX, delayY, shutter } = this.clock;
    return new DisplayClock(
      period / fps, origin + start / fps, delayX / fps, delayY / fps, shutter / fps,
    );
  }
}

/**
 * Group frames by a number of each, in the order in which the numbers come.
 *
 * @param {number[]} numbers
 * @returns {number[][]} frames
 */
function groups(numbers) {
  return [...new Set(numbers)].map((number) =>
    numbers.flatMap((other, frame) => (other === number ? [frame] : [])),
  );
}

/**
 * Make the wave of one period at some times, without its mean, of power 1.
 *
 * @param {number[]} times - in periods
 * @returns {import("./waves.js").Wave | null} null where the times tell nothing of it
 */
function waveOf(times) {
  const parts = [Math.cos, (/** @type {number} */ turn) => -Math.sin(turn)];
  const [real, imaginary] = parts.map((wave) => {
    const values = Float64Array.from(times, (time) => wave(2 * Math.PI * time));
    const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
    return values.map((value) => value - mean);
  });
  const length = Math.hypot(...real, ...imaginary);
  if (length ** 2 < LEAST_WAVE) return null;
  const shortened = (/** @type {number} */ value) => value / length;
  return { real: real.map(shortened), imaginary: imaginary.map(shortened) };
}
