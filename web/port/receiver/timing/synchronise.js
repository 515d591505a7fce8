/** Find the display's clock, follow it, hold it through weak spells, and find it again. */

import {
  receiverPilotsCode, receiverSeen, receiverTimingSynchronise,
} from "../../../generated/constants.js";
import { PLAIN } from "../../link/pilotCode.js";
import { DisplayClock } from "../../link/clock.js";
import { clocksTried } from "../pilots/code.js";
import { ClockFit, ToggleWindow } from "./fit.js";

/** @typedef {import("./toggles.js").PilotToggles} PilotToggles */

export const {
  MIN_WINDOW_S, WINDOW_S, MIN_FRAMES, CODED_WINDOW, AWAY_S, REFIT_S, SEEK_S, CONFIRMED,
  GOOD_R2, SEARCH_S, CLEARLY, SHARE, MIN_TOGGLE, HOLD_S, MAX_PHASE_ERROR, WANDER, SAME,
  FALSE_ALARM, CANDIDATES,
} = receiverTimingSynchronise;
const { MOST_TOGGLES } = receiverSeen;
const { CLOCK_ERROR, RIVAL } = receiverPilotsCode;

/**
 * Say how much evidence a search must find for its clock to be believed.
 *
 * Noise alone reaches evidence s with a chance of about `CANDIDATES` span fps s² exp(-s / 2), as
 * for the largest value of a chi-squared field (Worsley 1994). Of a code, all rates and moments are
 * tried.
 *
 * @param {number} span - length of the window, seconds
 * @param {number} fps - frames of the camera in a second
 * @param {PilotCode} [code] - of the display
 * @returns {number} twice a log-likelihood ratio, at which this chance is `FALSE_ALARM`
 */
export function neededEvidence(span, fps, code = PLAIN) {
  const tried = code.isPlain ? CANDIDATES * Math.max(span * fps, 1) : clocksTried(code);
  let evidence = 40;
  for (let round = 0; round < 20; round++) {
    evidence = 2 * Math.log((tried * evidence ** 2) / FALSE_ALARM);
  }
  return evidence;
}

/**
 * What a search for a clock found, whether it is believed or not.
 *
 * `strength` is the evidence of the best clock as a share of what is needed (1 and more is a lock),
 * `amplitude` the toggle by that clock and `deviation` the largest standard deviation of a place's
 * toggles, both in displayed gray levels, and `stateHz` the number of states a second.
 *
 * @typedef {{ strength: number, amplitude: number, stateHz: number, deviation: number }} Toggling
 */

/** Fits the clock to the toggles of the last seconds. */
export class Synchroniser {
  /** @type {{ time: number, values: Float64Array }[]} */
  #samples = [];
  /** Since when frames come again, seconds; infinite where they never stopped. */
  #backAt = Infinity;
  #fittedAt = -Infinity;
  #searchedAt = -Infinity;
  #confirmedAt = -Infinity;
  /** @type {{ fit: ClockFit, middle: number } | null} */
  #fit = null;

  /**
   * @param {number} fps - frames of the camera in a second; they bound delays and shutter
   * @param {PilotToggles} toggles - where toggles are known, and how they are worked out
   * @param {PilotCode} [code] - says in which order the states of each frame pair are shown
   */
  constructor(fps, toggles, code = PLAIN) {
    this.fps = fps;
    this.toggles = toggles;
    this.code = code;
    /** Number of states after which numbers may begin again. */
    this.again = 2 * code.period;
    /** The clock, or null while it is unknown. @type {DisplayClock | null} */
    this.clock = null;
    /** Number of times that the numbers of the states began anew. */
    this.slips = 0;
    /** The strongest toggling of all windows so far, or null. @type {Toggling | null} */
    this.best = null;
  }

  /**
   * Estimate the standard error, in states, of the state's number at a time.
   *
   * @param {number} time - seconds
   * @returns {number} infinite without a clock
   */
  phaseError(time) {
    if (this.clock === null || this.#fit === null) return Infinity;
    const { fit, middle } = this.#fit;
    const wander = (WANDER * (time - middle)) / this.clock.period;
    return Math.hypot(fit.phaseError(time - middle), wander);
  }

  /**
   * Take what was measured in one frame, and fit the clock where it is time.
   *
   * @param {number} time - of the frame, seconds; later than before
   * @param {Float64Array} values - (V,) as `Toggles.measure` gives them; NaN where unseen
   * @param {boolean} [fit] - whether the clock may be fitted now
   */
  add(time, values, fit = true) {
    const samples = this.#samples;
    if (values.some(Number.isFinite)) {
      if (samples.length > 0 && time - samples[samples.length - 1].time > AWAY_S) {
        this.#backAt = time;
      }
      samples.push({ time, values });
    }
    let oldest = time - WINDOW_S;
    if (time - this.#backAt >= MIN_WINDOW_S) {
      const fresh = samples.filter((sample) => sample.time >= this.#backAt).length;
      if (fresh >= MIN_FRAMES) {
        oldest = Math.max(oldest, this.#backAt);
        this.#backAt = Infinity;
      }
    }
    let old = Math.max(0, samples.length - MOST_TOGGLES);
    while (old < samples.length && samples[old].time < oldest) old++;
    samples.splice(0, old);
    const unconfirmed = time - this.#confirmedAt;
    const isOverdue = this.#fit !== null && unconfirmed > 2 * REFIT_S;
    const unsure = isOverdue && this.phaseError(time) > MAX_PHASE_ERROR;
    if (unsure || unconfirmed > HOLD_S) this.clock = null;
    const [frames, seconds] = this.code.isPlain ? [MIN_FRAMES, MIN_WINDOW_S] : CODED_WINDOW;
    const begun = samples[0]?.time ?? time;
    const enough = samples.length >= frames && time - begun >= seconds;
    const pause = this.clock === null ? SEEK_S : Math.min(REFIT_S, (this.#fittedAt - begun) / 2);
    if (fit && enough && time >= this.#fittedAt + pause) {
      this.#fittedAt = time;
      this.#update(time);
    }
  }

  /**
   * Take the clock with which the display was found.
   *
   * @param {DisplayClock} clock - by the camera's time, seconds
   * @param {number} time - of the newest frame, seconds
   */
  begin(clock, time) {
    this.clock = clock;
    this.#fit = null;
    this.#confirmedAt = time;
    this.slips++;
  }

  /**
   * Fit the clock to the last seconds, and look for another one where that is in doubt.
   *
   * @param {number} time
   */
  #update(time) {
    const samples = this.#samples;
    const times = Float64Array.from(samples, (sample) => sample.time);
    const toggles = this.toggles.overTime(samples.map((sample) => sample.values));
    const window = new ToggleWindow(times, toggles, this.toggles.places, this.fps, this.code);
    if (window.placesSeen === 0 || window.stateHz.length === 0) return;
    const deviation = Math.max(...window.deviation);
    if (deviation < MIN_TOGGLE) {
      this.clock = null;
      this.#note({ strength: 0, amplitude: 0, stateHz: 0, deviation });
      return;
    }
    const needed = neededEvidence(times[times.length - 1] - times[0], this.fps, this.code);
    let followed = null;
    if (this.clock !== null) {
      followed = this.#follow(this.clock, window);
      const isSure = followed.evidence >= needed && followed.r2 >= GOOD_R2;
      const isRecent = time < this.#searchedAt + SEARCH_S;
      if (isSure || (isRecent && followed.evidence >= CONFIRMED)) {
        this.#adopt(followed, window, time);
        return;
      }
    }
    const found = window.search();
    this.#searchedAt = time;
    const strength = Math.max(found.evidence, 0) / needed;
    const stateHz = 1 / found.clock.period;
    this.#note({ strength, amplitude: found.amplitude, stateHz, deviation });
    if (followed !== null && followed.evidence >= CONFIRMED) {
      const lead = found.evidence - followed.evidence;
      const needs = Math.max(CLEARLY, SHARE * followed.evidence);
      if (lead < needs || found.evidence < needed) {
        this.#adopt(followed, window, time);
        return;
      }
    }
    const wanted = this.#agrees(found, window) ? CONFIRMED : needed;
    if (found.evidence >= wanted && found.amplitude >= MIN_TOGGLE) {
      this.#adopt(found, window, time);
    }
  }

  /**
   * Tell whether a clock that was found is about the one with which the display was found.
   *
   * @param {ClockFit} found
   * @param {ToggleWindow} window
   */
  #agrees(found, window) {
    const held = this.clock;
    if (held === null || this.#fit !== null) return false;
    const apart = numberSeen(found.clock, 0) - numberSeen(held, window.middle);
    const near = Math.abs(apart - this.again * Math.round(apart / this.again)) <= RIVAL;
    return near && Math.abs(found.clock.period / held.period - 1) <= CLOCK_ERROR;
  }

  /** @param {Toggling} toggling */
  #note(toggling) {
    if (this.best === null || toggling.strength > this.best.strength) this.best = toggling;
  }

  /**
   * Fit the held clock to the window, from where it has run to.
   *
   * @param {DisplayClock} clock
   * @param {ToggleWindow} window
   */
  #follow(clock, window) {
    const number = this.again * Math.round(clock.number(window.middle) / this.again);
    const start = clock.start + number * clock.period - window.middle;
    return window.follow(clock.startingAt(start), this.#fit === null);
  }

  /**
   * Take a fitted clock; states keep their numbers where it goes on from the held one.
   *
   * @param {ClockFit} fit
   * @param {ToggleWindow} window
   * @param {number} time
   */
  #adopt(fit, window, time) {
    let clock = fit.clock.startingAt(fit.clock.start + window.middle);
    const held = this.clock;
    if (held === null) {
      this.slips++;
    } else {
      const at = [this.#samples[0].time, time];
      const ends = at.map((end) => numberSeen(clock, end) - numberSeen(held, end));
      const shift = this.again * Math.round(ends[1] / this.again);
      clock = clock.startingAt(clock.start + shift * clock.period);
      if (Math.max(...ends.map((end) => Math.abs(end - shift))) > SAME) this.slips++;
    }
    this.clock = clock;
    this.#fit = { fit, middle: window.middle };
    this.#confirmedAt = time;
  }
}

/**
 * Number the state in the middle of the exposure of the display's centre, of a frame at a time.
 *
 * @param {DisplayClock} clock
 * @param {number} time - seconds
 */
function numberSeen(clock, time) {
  return clock.number(time + clock.centre);
}
