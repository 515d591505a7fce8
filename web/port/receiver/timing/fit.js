/**
 * Fit the display's clock to some seconds of toggles, each place weighed by its own noise.
 *
 * The toggle of a place is a constant, a slow drift, the clock's wave with one amplitude for all
 * places, and noise. The noise of a place has a variance of its own and a correlation from one
 * frame to the next, because video codecs hold errors over several frames. Toggles and waves are
 * whitened (series.js), and drift is regressed with the wave.
 */

import { receiverPilotsCode, receiverTimingFit } from "../../../generated/constants.js";
import { complexDot, dot, inverse, solve, takeOff, varianceAlong } from "../../link/linear.js";
import { mean } from "../../link/order.js";
import { PLAIN } from "../../link/pilotCode.js";
import { CLOCK_NUMBERS, DisplayClock, embeddedShare } from "../../link/clock.js";
import { CodeSearch, MOST_STATE_HZ, longestDelay } from "../pilots/code.js";
import { PlaceToggles } from "./series.js";

/** @typedef {import("./series.js").PlaceNoise} PlaceNoise */

const { PANEL_S } = receiverPilotsCode;
export const { MAX_STATES } = receiverTimingFit;
const {
  ALONG_FLAT, DAMPING, DELAY_GRID, DRIFT_HZ, EASED, HELD, LEAST_SHUTTER, LEAST_STATES, MIN_STATE_HZ,
  NEIGHBOURS, PRIOR, REACH, ROUGH_DELAYS, ROUNDS, STARTS, STATES_STEP, STEP, STIFFENED,
} = receiverTimingFit;

/** Number of waves of which derivatives are made: that of a clock, and one for each number. */
const MOVED = CLOCK_NUMBERS + 1;

/** A clock that was fitted to a window of toggles. */
export class ClockFit {
  /**
   * @param {DisplayClock} clock - its times count from the middle of the window
   * @param {number} evidence - twice the logarithm of the likelihood ratio of clock and no clock
   * @param {number} amplitude - toggle between original and embedded frames, gray levels
   * @param {number} r2 - share of the toggles' variance that the clock explains
   * @param {Float64Array} covariance - (5, 5) of the errors of the clock's numbers, seconds squared
   * @param {PlaceNoise[]} noise - of each place beside the clock's wave
   */
  constructor(clock, evidence, amplitude, r2, covariance, noise) {
    this.clock = clock;
    this.evidence = evidence;
    this.amplitude = amplitude;
    this.r2 = r2;
    this.covariance = covariance;
    this.noise = noise;
  }

  /**
   * Estimate the standard error, in states, of the state at a time.
   *
   * @param {number} time - seconds from the middle of the window
   */
  phaseError(time) {
    const slope = Float64Array.of(-this.clock.number(time), -1, 0.5, 0.5, 0.5);
    return Math.sqrt(Math.max(0, varianceAlong(this.covariance, slope))) / this.clock.period;
  }
}

/** Some seconds of toggles, made ready for fits of clocks. */
export class ToggleWindow {
  #times;
  #span;
  #places;
  #code;
  #frame;
  #drifts;
  /** Toggles of each place. @type {PlaceToggles[]} */ #toggles;
  /** Waves and delays to start from. @type {ReturnType<typeof candidateWaves> | null} */
  #candidates = null;
  /** Clocks to start from, by the code. @type {Float64Array[] | null} */ #coded = null;

  /**
   * @param {Float64Array} times - (n,) seconds, rising
   * @param {Float64Array[]} toggles - n times (P,) displayed gray levels; NaN where unseen
   * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
   * @param {number} fps - frames of the camera in a second; they bound delays and shutter
   * @param {PilotCode} [code] - says in which order the states of each frame pair are shown
   */
  constructor(times, toggles, places, fps, code = PLAIN) {
    /** Time, in seconds, from which the times of fitted clocks count. */
    this.middle = mean(times);
    this.#times = times.map((time) => time - this.middle);
    this.#span = times[times.length - 1] - times[0];
    this.#places = places;
    this.#code = code;
    this.#frame = 1 / fps;
    /**
     * Numbers of states a second (F,) that are looked for. There are none where the window is too
     * short for the camera's nominal rate, which then is far below the real one.
     */
    this.stateHz = candidateRates(this.#span, this.#frame);
    const shares = times.map((time) => (time - times[0]) / Math.max(this.#span, 1e-9));
    this.#drifts = Array.from({ length: 1 + Math.floor(2 * this.#span * DRIFT_HZ) }, (_, term) =>
      shares.map((share) => Math.cos(Math.PI * term * share)),
    );
    this.#toggles = Array.from({ length: places.length / 2 }, (_, place) => {
      return new PlaceToggles(Float64Array.from(toggles, (frame) => frame[place]), this.#drifts);
    });
  }

  /** Number of places that are not unseen for most of the window. */
  get placesSeen() {
    return this.#toggles.filter(({ count }) => count > 0).length;
  }

  /** Standard deviation of the toggles of each place (P,), gray levels. */
  get deviation() {
    return this.#toggles.map(({ deviation }) => deviation);
  }

  /** Find the clock that explains the toggles best, among all that are looked for. */
  search() {
    // correlated noise hides fast clocks, and what makes it white hides slow ones
    const plain = this.deviation.map((one) => ({ deviation: one + 1e-6, correlation: 0 }));
    const fits = [plain, this.#toggles.map(({ without }) => without)].map((noise) => {
      this.#setNoise(noise);
      return this.#settle(this.#climb(this.#startClocks(), ROUNDS));
    });
    return fits[1].evidence > fits[0].evidence ? fits[1] : fits[0];
  }

  /**
   * Fit a clock, known from before, anew.
   *
   * @param {DisplayClock} clock - its times count from the middle of the window
   * @param {boolean} [rough] - whether its delays are no better than those of `pilots/code.js`
   */
  follow(clock, rough = false) {
    const { numbers } = clock;
    this.#setNoise(this.#toggles.map(({ without }) => without));
    this.#setNoise(this.#noiseBeside(numbers));
    if (rough) return this.#settle(this.#climb(otherDelays(numbers), ROUNDS));
    return this.#settle(this.#climb(this.#neighbours(numbers), Math.floor(ROUNDS / 2)));
  }

  /**
   * Give a clock, and clocks a little faster and slower.
   *
   * @param {Float64Array} clock
   */
  #neighbours(clock) {
    const unit = this.#units(clock)[0];
    return NEIGHBOURS.map((change) => {
      const moved = clock.slice();
      moved[0] += change * unit;
      return moved;
    });
  }

  /**
   * Estimate the noise beside the best clock, fit it once more, and weigh the evidence.
   *
   * @param {Float64Array[]} clocks - the best first
   */
  #settle(clocks) {
    const noise = this.#setNoise(this.#noiseBeside(clocks[0]));
    const starts = [...this.#neighbours(clocks[0]), ...clocks.slice(1, 3)];
    const best = this.#climb(starts, Math.floor(ROUNDS / 2))[0];
    const { gram, product } = this.#products(this.#moved(best));
    const amplitude = Math.max(0, product[0] / gram[0]);
    const waves = this.#shares(best).map((wave, place) => this.#toggles[place].whitened(wave));
    let [left, whole, ofPlaces] = [0, 0, 0];
    this.#toggles.forEach((place, number) => {
      const rest = takeOff(place.x.slice(), waves[number], amplitude);
      left += dot(rest, rest);
      whole += dot(place.x, place.x);
      ofPlaces += place.evidence(dot(rest, rest)); // against clocks that explain some places only
    });
    const evidence = Math.min(ofPlaces, this.#evidenceOfAll(waves, amplitude));
    const covariance = this.#covariance(best, gram, amplitude);
    const [period, start, delayX, delayY, shutter] = best;
    const clock = new DisplayClock(period, start, delayX, delayY, shutter);
    const r2 = 1 - left / Math.max(whole, 1e-12);
    return new ClockFit(clock, evidence, amplitude, r2, covariance, noise);
  }

  /**
   * Weigh the evidence of a clock if all places may share their noise, as their mean tells.
   *
   * The mean weighs each place by its noise.
   *
   * @param {Float64Array[]} waves - of each place (n,), whitened, without drift
   * @param {number} amplitude
   */
  #evidenceOfAll(waves, amplitude) {
    const power = waves.map((wave) => dot(wave, wave));
    const all = Math.max(power.reduce((sum, one) => sum + one, 0), 1e-12);
    const weight = power.map((one) => Math.sqrt(one / all));
    let [sum, sum2, before, after] = [0, 0, 0, 0];
    for (let k = 0; k < this.#times.length; k++) {
      let [frames, mean, meanWave] = [0, 0, 0];
      this.#toggles.forEach(({ seen, x }, place) => {
        frames += weight[place] ** 2 * seen[k];
        mean += weight[place] * x[k];
        meanWave += weight[place] * waves[place][k];
      });
      sum += frames;
      sum2 += frames ** 2;
      before += mean ** 2;
      after += (mean - amplitude * meanWave) ** 2;
    }
    const free = sum ** 2 / Math.max(sum2, 1e-12) - this.#drifts.length - 1;
    return Math.max(free, 1) * Math.log(before / Math.max(after, 1e-12));
  }

  // Noise

  /**
   * Estimate the noise beside a clock's wave, whose amplitude fits the toggles.
   *
   * @param {Float64Array} clock
   */
  #noiseBeside(clock) {
    const { gram, product } = this.#products([clock]);
    const amplitude = Math.max(0, product[0] / Math.max(gram[0], 1e-9));
    return this.#shares(clock).map((wave, number) => {
      const place = this.#toggles[number];
      return place.noiseOf(takeOff(place.values.slice(), place.centred(wave), amplitude));
    });
  }

  /**
   * Whiten by this noise from now on.
   *
   * @param {PlaceNoise[]} noise - of each place
   */
  #setNoise(noise) {
    this.#toggles.forEach((place, number) => place.setNoise(noise[number]));
    return noise;
  }

  // Fits

  /**
   * Give the shares of embedded frames at each place (n,).
   *
   * @param {Float64Array} clock
   */
  #shares(clock) {
    const n = this.#times.length;
    const shares = embeddedShare(clock, this.#times, this.#places, this.#code);
    return this.#toggles.map((_, place) => shares.subarray(place * n, (place + 1) * n));
  }

  /**
   * Work out inner products of the whitened waves of K clocks, and with the toggles.
   *
   * @param {Float64Array[]} clocks
   * @returns {{ gram: Float64Array, product: Float64Array }} (K, K) and (K,)
   */
  #products(clocks) {
    const K = clocks.length;
    const shares = clocks.map((clock) => this.#shares(clock));
    const gram = new Float64Array(K * K);
    const product = new Float64Array(K);
    this.#toggles.forEach((place, number) => {
      const waves = shares.map((wave) => place.whitened(wave[number]));
      waves.forEach((wave, row) => {
        product[row] += dot(wave, place.x);
        for (let col = 0; col <= row; col++) gram[row * K + col] += dot(wave, waves[col]);
      });
    });
    for (let at = 0; at < K * K; at++) {
      const [row, col] = [Math.floor(at / K), at % K];
      if (row < col) gram[at] = gram[col * K + row];
    }
    return { gram, product };
  }

  /**
   * Find the natural units of a clock's numbers: each changes the wave about wholly.
   *
   * @param {Float64Array} clock
   */
  #units(clock) {
    const period = clock[0];
    const frame = Math.min(this.#frame, 2 * period);
    return [period ** 2 / this.#span, period, frame, frame, frame];
  }

  /**
   * Give a clock and five that differ from it in one number.
   *
   * @param {Float64Array} clock
   */
  #moved(clock) {
    const moved = this.#units(clock).map((unit, number) => {
      const other = clock.slice();
      other[number] += unit * STEP;
      return other;
    });
    return [clock, ...moved];
  }

  /**
   * Climb from each clock (Levenberg and Marquardt); clocks in order, the best first.
   *
   * @param {Float64Array[]} starts
   * @param {number} rounds - number of steps
   */
  #climb(starts, rounds) {
    const frame = this.#frame;
    const delay = frame + PANEL_S; // a camera may be held upside down
    const fastest = this.#code.isPlain ? frame / MAX_STATES : 1 / MOST_STATE_HZ;
    const low = [fastest, -Infinity, -delay, -delay, LEAST_SHUTTER * frame];
    const high = [1 / MIN_STATE_HZ, Infinity, delay, delay, frame];
    const climbed = starts.map((start) => {
      let [clock, best, score, damping] = [start, start, -Infinity, DAMPING];
      /** @type {ReturnType<typeof linearised>} */
      let linear = { normal: new Float64Array(MOVED * MOVED), right: new Float64Array(MOVED) };
      for (let round = 0; round < rounds; round++) {
        const { gram, product } = this.#products(this.#moved(clock));
        const reached = Math.max(product[0], 0) ** 2 / Math.max(gram[0], 1e-9);
        if (reached > score) {
          [best, score] = [clock, reached];
          damping /= EASED;
          linear = linearised(gram, product);
        } else {
          damping *= STIFFENED;
        }
        const units = this.#units(best);
        /** @param {number[]} dampings - of the clock's numbers */
        const stepped = (dampings) => {
          const step = dampedStep(linear.normal, linear.right, dampings);
          return best.map((value, number) => value + step[number] * units[number]);
        };
        // what is at its bound and would leave it stays, and the others step without it
        const dampings = Array.from(stepped(low.map(() => damping)), (value, number) => {
          const isLow = best[number] <= low[number] && value < low[number];
          const isHigh = best[number] >= high[number] && value > high[number];
          return isLow || isHigh ? damping + HELD : damping;
        });
        clock = stepped(dampings).map((value, number) =>
          Math.min(Math.max(value, low[number]), high[number]),
        );
      }
      return { best, score };
    });
    return climbed.sort((one, two) => two.score - one.score).map(({ best }) => best);
  }

  /**
   * Estimate the covariance of the errors of a fitted clock's numbers.
   *
   * @param {Float64Array} best
   * @param {Float64Array} gram - (6, 6) products of the moved waves
   * @param {number} amplitude
   * @returns {Float64Array} (5, 5) seconds squared
   */
  #covariance(best, gram, amplitude) {
    const { normal } = linearised(gram, new Float64Array(MOVED));
    const scale = Math.max(amplitude, 1e-3) ** 2;
    PRIOR.forEach((prior, k) => (normal[k * (MOVED + 1)] += prior * scale));
    const inverted = inverse(normal);
    const units = this.#units(best);
    return Float64Array.from({ length: CLOCK_NUMBERS ** 2 }, (_, at) => {
      const row = Math.floor(at / CLOCK_NUMBERS);
      const col = at % CLOCK_NUMBERS;
      const value = inverted[(row + 1) * MOVED + col + 1] / scale;
      return value * units[row] * units[col];
    });
  }

  /** Find clocks to start from: the strongest frequencies, each with its best delays. */
  #startClocks() {
    if (!this.#code.isPlain) return (this.#coded ??= this.#startByCode());
    const { stateHz } = this;
    this.#candidates ??= candidateWaves(stateHz, this.#times, this.#places, this.#frame);
    const { waves, across, down, grid } = this.#candidates;
    const adjoints = this.#toggles.map((place) => place.adjoint());
    const found = waves.map((wave, f) => {
      const turn = Math.cos(Math.PI * stateHz[f] * this.#frame);
      let norm = 0;
      this.#toggles.forEach(({ count, noise }, place) => {
        const r = adjoints[place].correlation;
        norm += ((1 + r * r - 2 * r * turn) * count) / noise.deviation ** 2;
      });
      const lines = {
        real: adjoints.map(({ series }) => dot(series, wave.real)),
        imaginary: adjoints.map(({ series }) => dot(series, wave.imaginary)),
      };
      let best = { power: -1, real: 0, imaginary: 0, delayX: 0, delayY: 0 };
      grid.forEach((delayY, j) => {
        const turned = turnedBy(lines, down[j][f]);
        grid.forEach((delayX, i) => {
          const [real, imaginary] = complexDot(turned, across[i][f]);
          const power = real * real + imaginary * imaginary;
          if (power > best.power) best = { power, real, imaginary, delayX, delayY };
        });
      });
      return { ...best, hz: stateHz[f], strength: best.power / Math.max(norm, 1e-12) };
    });
    const peaks = found.filter(({ strength }, f) => {
      const beside = [found.length - 1, 1].map((step) => found[(f + step) % found.length]);
      return beside.every((other) => strength >= other.strength);
    });
    peaks.sort((one, two) => one.strength - two.strength);
    return peaks.slice(-STARTS).map(({ hz, real, imaginary, delayX, delayY }) => {
      // the embedded state's middle is where the fundamental is highest
      const [period, shutter] = [1 / hz, 0.5 * this.#frame];
      const middle = (-Math.atan2(imaginary, real) * period) / Math.PI;
      return Float64Array.of(period, middle - 1.5 * period + shutter / 2, delayX, delayY, shutter);
    });
  }

  /** Find clocks to start from, by the code alone. */
  #startByCode() {
    const values = Array.from(this.#times, (_, k) =>
      Float64Array.from(this.#toggles, (place) => place.values[k] / (place.deviation + 1e-6)),
    );
    const signs = new Float64Array(this.#toggles.length).fill(1);
    const times = [...this.#times];
    const search = new CodeSearch(this.#code, signs, this.#places, times, 1 / this.#frame);
    const [best, ...others] = search.strongest(values, STARTS).map(({ clock }) => clock.numbers);
    return [...otherDelays(best), ...others];
  }
}

/**
 * Give a clock by `ROUGH_DELAYS`, each with the same state at the display's centre.
 *
 * @param {Float64Array} clock
 */
function otherDelays(clock) {
  return ROUGH_DELAYS.map(([across, down]) => {
    const [period, start, delayX, delayY, shutter] = clock;
    const begun = start + (across + down) / 2;
    return Float64Array.of(period, begun, delayX + across, delayY + down, shutter);
  });
}

/**
 * List the rates of displays that are looked for.
 *
 * @param {number} span - length of the window, seconds
 * @param {number} frame - time from one camera frame to the next, seconds
 * @returns {Float64Array} (F,) states a second
 */
function candidateRates(span, frame) {
  const first = Math.max(MIN_STATE_HZ, LEAST_STATES / span);
  const step = STATES_STEP / span;
  const F = Math.max(0, Math.ceil((MAX_STATES / frame - first) / step));
  return Float64Array.from({ length: F }, (_, f) => first + f * step);
}

/**
 * Numbers exp(-i pi hz t), at a rate, of some times; or such numbers times others.
 *
 * @typedef {{ real: number[], imaginary: number[] }} Phasors
 */

/**
 * Work out the fundamentals of displays.
 *
 * `waves` are those of the F rates at the times (n,). `grid` holds delays along each axis; `across`
 * and `down` are, for each of them and for each rate, what turns a wave so at the places (P,).
 *
 * @param {Float64Array} stateHz - (F,) numbers of states a second
 * @param {Float64Array} times - (n,) seconds
 * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
 * @param {number} frame - time from one camera frame to the next, seconds
 */
function candidateWaves(stateHz, times, places, frame) {
  const grid = DELAY_GRID.map((share) => share * longestDelay(frame));
  const [across, down] = [0, 1].map((axis) => {
    const along = [...places].filter((_, at) => at % 2 === axis);
    return grid.map((delay) => phasors(stateHz, along.map((place) => delay * place)));
  });
  return { waves: phasors(stateHz, [...times]), across, down, grid };
}

/**
 * @param {Float64Array} rates - (F,)
 * @param {number[]} times - (m,)
 * @returns {Phasors[]} F times (m,)
 */
function phasors(rates, times) {
  return Array.from(rates, (hz) => {
    const angles = times.map((time) => -Math.PI * hz * time);
    return { real: angles.map(Math.cos), imaginary: angles.map(Math.sin) };
  });
}

/**
 * Multiply complex numbers.
 *
 * @param {Phasors} one
 * @param {Phasors} other
 */
function turnedBy(one, { real, imaginary }) {
  return {
    real: one.real.map((value, at) => value * real[at] - one.imaginary[at] * imaginary[at]),
    imaginary: one.real.map((value, at) => value * imaginary[at] + one.imaginary[at] * real[at]),
  };
}

/**
 * Turn products of moved waves into those of the wave and of its five derivatives.
 *
 * @param {Float64Array} gram - (6, 6)
 * @param {Float64Array} product - (6,)
 * @returns {{ normal: Float64Array, right: Float64Array }} (6, 6) and (6,)
 */
function linearised(gram, product) {
  const turned = (/** @type {Float64Array} */ values, /** @type {number} */ k) =>
    k === 0 ? values[0] : (values[k] - values[0]) / STEP;
  const turnedRows = (/** @type {Float64Array} */ square) =>
    square.map((_, at) => {
      const [col, row] = [Math.floor(at / MOVED), at % MOVED]; // which transposes it
      return turned(square.subarray(row * MOVED, (row + 1) * MOVED), col);
    });
  const normal = turnedRows(turnedRows(gram));
  return { normal, right: product.map((_, k) => turned(product, k)) };
}

/**
 * Find the damped step of a fit in natural units.
 *
 * @param {Float64Array} normal - (6, 6)
 * @param {Float64Array} right - (6,)
 * @param {number[]} damping - of the five numbers of a clock
 * @returns {number[]} of the five numbers of a clock
 */
function dampedStep(normal, right, damping) {
  const damped = normal.slice();
  for (let k = 0; k < MOVED; k++) {
    const at = k * (MOVED + 1);
    damped[at] += k === 0 ? 1e-9 : damping[k - 1] * (normal[at] + ALONG_FLAT * normal[0]) + 1e-9;
  }
  const [amplitude, ...slopes] = solve(damped, right);
  if (!(amplitude > 1e-6)) return slopes.map(() => 0);
  return slopes.map((slope) => Math.min(Math.max(slope / amplitude, -REACH), REACH));
}
