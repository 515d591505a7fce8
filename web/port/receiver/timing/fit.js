/**
 * Fit the display's clock to some seconds of toggles, each place weighed by its own noise.
 *
 * The toggle of a place is a constant, a slow drift, the clock's wave with one amplitude for all
 * places, and noise. The noise of a place has a variance of its own and a correlation from one
 * frame to the next, because video codecs hold errors over several frames. Toggles and waves are
 * whitened (series.js), and drift is regressed with the wave.
 */

import { receiverTimingFit } from "../../../generated/constants.js";
import { dot, inverse, solve } from "../../link/linear.js";
import { PLAIN } from "../../link/pilotCode.js";
import { CLOCK_NUMBERS, DisplayClock, embeddedShare } from "../../link/clock.js";
import { CodeSearch, MOST_STATE_HZ, longestDelay } from "../pilots/code.js";
import {
  driftBasis,
  squares,
  takeOff,
  takeOffBasis,
  whiten,
  whiteningFactors,
  withoutOutliers,
} from "./series.js";

/** @typedef {import("./series.js").Factors} Factors */

export const {
  MIN_STATE_HZ, MAX_STATES, DRIFT_HZ, STARTS, ROUNDS, NEIGHBOURS, MIN_SEEN,
  MAX_CORRELATION, STEP, REACH, ROUGH_DELAYS,
} = receiverTimingFit;

/** Number of waves of which derivatives are made: that of a clock, and one for each number. */
const MOVED = CLOCK_NUMBERS + 1;
/** Number of delays along each axis from which fits may start. */
const GRID = 7;

/**
 * What the toggles of each place hold beside the wave and its drift: the standard deviation (P,),
 * in gray levels, of what the frame before does not predict, and the correlation (P,) from one
 * frame to the next, in [0, `MAX_CORRELATION`].
 *
 * @typedef {{ deviation: Float64Array, correlation: Float64Array }} PlaceNoise
 */

/** A clock that was fitted to a window of toggles. */
export class ClockFit {
  /**
   * @param {DisplayClock} clock - its times count from the middle of the window
   * @param {number} evidence - twice the logarithm of the likelihood ratio of clock and no clock
   * @param {number} amplitude - toggle between original and embedded frames, gray levels
   * @param {number} r2 - share of the toggles' variance that the clock explains
   * @param {Float64Array} covariance - (5, 5) of the errors of the clock's numbers, seconds squared
   * @param {PlaceNoise} noise - of the places beside the clock's wave
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
    const slope = [-this.clock.number(time), -1, 0.5, 0.5, 0.5];
    let variance = 0;
    slope.forEach((one, row) => {
      slope.forEach((two, col) => {
        variance += one * this.covariance[CLOCK_NUMBERS * row + col] * two;
      });
    });
    return Math.sqrt(Math.max(0, variance)) / this.clock.period;
  }
}

/** Some seconds of toggles, made ready for fits of clocks. */
export class ToggleWindow {
  /** @type {Float64Array} */ #times;
  /** @type {Float64Array} */ #places;
  /** @type {PilotCode} */ #code;
  #span;
  #frame;
  /** Number of places and of frames. */
  #P;
  #n;
  /** @type {Uint8Array} */ #seen;
  /** Number of toggles that are seen of each place. @type {Float64Array} */ #count;
  /** @type {Float64Array[]} */ #drift;
  /** @type {Float64Array} */ #values;
  /** @type {Float64Array[]} */ #plain;
  /** @type {Float64Array} */ #free;
  /** @type {PlaceNoise} */ #without;
  /** @type {Float64Array} */ #leftWithout;
  /** @type {Factors} */ #factors;
  /** Squared deviation of the noise. @type {Float64Array} */ #scale2;
  /** @type {Float64Array[]} */ #basis;
  /** Whitened toggles without drift. @type {Float64Array} */ #x;
  /** @type {ReturnType<typeof candidateWaves> | null} */ #candidates = null;
  /** Clocks to start from, by the code. @type {Float64Array[] | null} */ #coded = null;
  /** Room for the waves of a clock and of those beside it. @type {Float64Array[]} */ #room;

  /**
   * @param {Float64Array} times - (n,) seconds, rising
   * @param {Float64Array[]} toggles - n times (P,) displayed gray levels; NaN where unseen
   * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
   * @param {number} fps - frames of the camera in a second; they bound delays and shutter
   * @param {PilotCode} [code] - says in which order the states of each frame pair are shown
   */
  constructor(times, toggles, places, fps, code = PLAIN) {
    const n = (this.#n = times.length);
    const P = (this.#P = places.length / 2);
    let sum = 0;
    for (const time of times) sum += time;
    /** Time, in seconds, from which the times of fitted clocks count. */
    this.middle = sum / n;
    this.#times = times.map((time) => time - this.middle);
    this.#span = times[n - 1] - times[0];
    this.#places = places;
    this.#code = code;
    this.#frame = 1 / fps;
    /**
     * Numbers of states a second (F,) that are looked for. There are none where the window is too
     * short for the camera's nominal rate, which then is far below the real one.
     */
    this.stateHz = candidateRates(this.#span, this.#frame);
    const values = new Float64Array(P * n);
    for (let at = 0; at < values.length; at++) values[at] = toggles[at % n][Math.floor(at / n)];
    const seen = (this.#seen = withoutOutliers(values, P));
    this.#count = new Float64Array(P);
    const terms = 1 + Math.floor(2 * this.#span * DRIFT_HZ);
    this.#drift = Array.from({ length: terms }, (_, term) =>
      times.map((time) =>
        Math.cos((Math.PI * term * (time - times[0])) / Math.max(this.#span, 1e-9)),
      ),
    );
    for (let place = 0; place < P; place++) {
      const own = seen.subarray(place * n, (place + 1) * n);
      const count = own.reduce((sum, one) => sum + one, 0);
      if (count < MIN_SEEN) own.fill(0);
      this.#count[place] = count < MIN_SEEN ? 0 : count;
    }
    this.#values = this.#centre(values.map((value, at) => (seen[at] ? value : 0)));
    /** Standard deviation (P,) of the toggles of each place, gray levels. */
    this.deviation = this.#ofPlaces((from, to, place) =>
      Math.sqrt(squares(this.#values, from, to) / Math.max(this.#count[place], 1)),
    );
    const whole = { now: Float64Array.from(seen), back: new Float64Array(P * n) };
    this.#plain = driftBasis(this.#drift, whole);
    this.#free = this.#count.map((count) => Math.max(count - terms - 1, 1));
    this.#room = Array.from({ length: MOVED }, () => new Float64Array(P * n));
    const without = (this.#without = this.#noiseOf(this.#values.slice()));
    this.#factors = whole;
    this.#basis = this.#plain;
    this.#scale2 = this.#x = this.#values; // until the noise is set
    this.#setNoise(without);
    this.#leftWithout = this.#scale2.map(
      (scale2, place) => scale2 * squares(this.#x, place * n, (place + 1) * n),
    );
  }

  /** Number of places that are not unseen for most of the window. */
  get placesSeen() {
    return this.#count.filter((count) => count > 0).length;
  }

  /** Find the clock that explains the toggles best, among all that are looked for. */
  search() {
    // correlated noise hides fast clocks, and what makes it white hides slow ones
    const deviation = this.deviation.map((value) => value + 1e-6);
    const plain = { deviation, correlation: new Float64Array(this.#P) };
    const fits = [plain, this.#without].map((noise) => {
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
    this.#setNoise(this.#without);
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
    const wave = this.#shares(best);
    takeOffBasis(whiten(wave, this.#factors, wave), this.#basis, this.#P);
    const left = takeOff(this.#x.slice(), wave, amplitude);
    const rss = this.#ofPlaces((from, to) => squares(left, from, to));
    const evidence = Math.min(
      this.#evidenceOfPlaces(rss),
      this.#evidenceOfAll(wave, amplitude),
    );
    const r2 = 1 - squares(left) / Math.max(squares(this.#x), 1e-12);
    const covariance = this.#covariance(best, gram, amplitude);
    const [period, start, delayX, delayY, shutter] = best;
    const clock = new DisplayClock(period, start, delayX, delayY, shutter);
    return new ClockFit(clock, evidence, amplitude, r2, covariance, noise);
  }

  /**
   * Weigh the evidence of a clock if the noise of each place is its own.
   *
   * It speaks against a clock that explains some places and not the others.
   *
   * @param {Float64Array} left - (P,) squares that the clock leaves
   */
  #evidenceOfPlaces(left) {
    let evidence = 0;
    for (let place = 0; place < this.#P; place++) {
      if (this.#count[place] === 0) continue;
      const ratio = this.#leftWithout[place] / Math.max(left[place] * this.#scale2[place], 1e-12);
      evidence += this.#free[place] * Math.log(ratio);
    }
    return evidence;
  }

  /**
   * Weigh the evidence of a clock if all places may share their noise, as their mean tells.
   *
   * The mean weighs each place by its noise.
   *
   * @param {Float64Array} wave - (P, n) whitened, without drift
   * @param {number} amplitude
   */
  #evidenceOfAll(wave, amplitude) {
    const n = this.#n;
    const all = Math.max(squares(wave), 1e-12);
    const weight = this.#ofPlaces((from, to) => Math.sqrt(squares(wave, from, to) / all));
    let [sum, sum2, before, after] = [0, 0, 0, 0];
    for (let k = 0; k < n; k++) {
      let [frames, mean, meanWave] = [0, 0, 0];
      for (let place = 0, at = k; place < this.#P; place++, at += n) {
        frames += weight[place] ** 2 * this.#seen[at];
        mean += weight[place] * this.#x[at];
        meanWave += weight[place] * wave[at];
      }
      sum += frames;
      sum2 += frames ** 2;
      before += mean ** 2;
      after += (mean - amplitude * meanWave) ** 2;
    }
    const free = sum ** 2 / Math.max(sum2, 1e-12) - this.#drift.length - 1;
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
    const wave = this.#centre(this.#shares(clock));
    return this.#noiseOf(takeOff(this.#values.slice(), wave, amplitude));
  }

  /**
   * Estimate the noise of each place from what is left of its toggles.
   *
   * @param {Float64Array} left - (P, n); it is used up
   */
  #noiseOf(left) {
    const n = this.#n;
    for (let at = 0; at < left.length; at++) left[at] *= this.#seen[at];
    takeOffBasis(left, this.#plain, this.#P);
    for (let at = 0; at < left.length; at++) left[at] *= this.#seen[at];
    const correlation = this.#ofPlaces((from, to, place) => {
      const power = Math.max(squares(left, from, to), 1e-12);
      let lag = 0;
      for (let at = from + 1; at < to; at++) {
        if (this.#seen[at] && this.#seen[at - 1]) lag += left[at] * left[at - 1];
      }
      lag /= power;
      lag += (1 + 3 * lag) / Math.max(this.#count[place], 1); // its bias in short windows
      return Math.min(Math.max(lag, 0), MAX_CORRELATION);
    });
    const ones = new Float64Array(this.#P).fill(1);
    const fresh = whiten(left, whiteningFactors(this.#seen, ones, correlation), left);
    const deviation = this.#free.map((free, place) => {
      const variance = squares(fresh, place * n, (place + 1) * n) / free;
      return Math.sqrt(Math.max(variance, 1e-8));
    });
    return { deviation, correlation };
  }

  /**
   * Whiten by this noise from now on.
   *
   * @param {PlaceNoise} noise
   */
  #setNoise(noise) {
    this.#factors = whiteningFactors(this.#seen, noise.deviation, noise.correlation);
    this.#scale2 = noise.deviation.map((value) => value ** 2);
    this.#basis = driftBasis(this.#drift, this.#factors);
    this.#x = takeOffBasis(whiten(this.#values, this.#factors), this.#basis, this.#P);
    return noise;
  }

  /**
   * Take the mean off a wave at each place, in place; 0 where a place is unseen.
   *
   * @param {Float64Array} wave - (P, n)
   */
  #centre(wave) {
    for (let place = 0; place < this.#P; place++) {
      const [from, to] = [place * this.#n, (place + 1) * this.#n];
      let total = 0;
      for (let at = from; at < to; at++) total += wave[at] * this.#seen[at];
      const mean = total / Math.max(this.#count[place], 1);
      for (let at = from; at < to; at++) wave[at] = (wave[at] - mean) * this.#seen[at];
    }
    return wave;
  }

  /**
   * Work out a number for each place, from its first index and the one after its last.
   *
   * @param {(from: number, to: number, place: number) => number} work
   */
  #ofPlaces(work) {
    const results = new Float64Array(this.#P);
    for (let place = 0; place < this.#P; place++) {
      results[place] = work(place * this.#n, (place + 1) * this.#n, place);
    }
    return results;
  }

  // Fits

  /**
   * Give the shares of embedded frames.
   *
   * @param {Float64Array} clock
   * @param {Float64Array} [shares] - (P, n), where they are written
   */
  #shares(clock, shares) {
    return embeddedShare(clock, this.#times, this.#places, this.#code, shares);
  }

  /**
   * Work out inner products of the whitened waves of K clocks, and with the toggles.
   *
   * @param {Float64Array[]} clocks - at most `MOVED`
   * @returns {{ gram: Float64Array, product: Float64Array }} (K, K) and (K,)
   */
  #products(clocks) {
    const K = clocks.length;
    const waves = this.#room.slice(0, K);
    clocks.forEach((clock, k) => {
      this.#shares(clock, waves[k]);
      whiten(waves[k], this.#factors, waves[k]);
    });
    const inner = waves.map((wave) =>
      this.#basis.map((vector) => this.#ofPlaces((from, to) => dot(wave, vector, from, to))),
    );
    const gram = new Float64Array(K * K);
    for (let row = 0; row < K; row++) {
      for (let col = 0; col <= row; col++) {
        let value = dot(waves[row], waves[col]);
        for (let q = 0; q < this.#basis.length; q++) value -= dot(inner[row][q], inner[col][q]);
        gram[row * K + col] = gram[col * K + row] = value;
      }
    }
    return { gram, product: Float64Array.from(waves, (wave) => dot(wave, this.#x)) };
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
    const delay = longestDelay(frame);
    const fastest = this.#code.isPlain ? frame / MAX_STATES : 1 / MOST_STATE_HZ;
    const low = [fastest, -Infinity, -delay, -delay, 0.02 * frame];
    const high = [1 / MIN_STATE_HZ, Infinity, delay, delay, frame];
    const climbed = starts.map((start) => {
      let [clock, best, score, damping] = [start, start, -Infinity, 0.1];
      /** @type {ReturnType<typeof linearised>} */
      let linear = { normal: new Float64Array(MOVED * MOVED), right: new Float64Array(MOVED) };
      for (let round = 0; round < rounds; round++) {
        const { gram, product } = this.#products(this.#moved(clock));
        const reached = Math.max(product[0], 0) ** 2 / Math.max(gram[0], 1e-9);
        if (reached > score) {
          [best, score] = [clock, reached];
          damping /= 3;
          linear = linearised(gram, product);
        } else {
          damping *= 5;
        }
        const step = dampedStep(linear.normal, linear.right, damping);
        const units = this.#units(best);
        clock = best.map((value, number) =>
          Math.min(Math.max(value + step[number] * units[number], low[number]), high[number]),
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
    // delays and shutter are known beforehand to about a frame
    [1e-6, 0.01, 0.01, 1, 1, 1].forEach((prior, k) => {
      normal[k * (MOVED + 1)] += prior * scale;
    });
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
    const P = this.#P;
    const n = this.#n;
    const { stateHz } = this;
    this.#candidates ??= candidateWaves(stateHz, this.#times, this.#places, this.#frame);
    const { real, imaginary, across, down, grid } = this.#candidates;
    const adjoint = new Float64Array(P * n);
    const { now, back } = this.#factors;
    for (let at = 0; at < adjoint.length; at++) {
      // `back` is 0 at the first sample of the next place
      const later = at + 1 < adjoint.length ? this.#x[at + 1] * back[at + 1] : 0;
      adjoint[at] = this.#x[at] * now[at] - later;
    }
    const correlation = this.#ofPlaces(
      (from, to, place) =>
        back.subarray(from, to).reduce((most, value) => Math.max(most, value)) *
        Math.sqrt(this.#scale2[place]),
    );
    const F = stateHz.length;
    const strongest = new Float64Array(F);
    const best = new Int32Array(F);
    const phase = new Float64Array(F);
    const byRow = new Float64Array(2 * GRID * P);
    for (let f = 0; f < F; f++) {
      const turn = Math.cos(Math.PI * stateHz[f] * this.#frame);
      let norm = 0;
      for (let place = 0; place < P; place++) {
        const r = correlation[place];
        norm += ((1 + r * r - 2 * r * turn) * this.#count[place]) / this.#scale2[place];
        const line = adjoint.subarray(place * n, (place + 1) * n);
        const re = dot(real[f], line);
        const im = dot(imaginary[f], line);
        // turned by the delay along y
        for (let j = 0; j < GRID; j++) {
          const c = down.real[f][place * GRID + j];
          const s = down.imaginary[f][place * GRID + j];
          byRow[2 * (j * P + place)] = re * c - im * s;
          byRow[2 * (j * P + place) + 1] = re * s + im * c;
        }
      }
      let most = -1;
      const alongRe = across.real[f];
      const alongIm = across.imaginary[f];
      for (let at = 0; at < GRID * GRID; at++) {
        const i = at % GRID;
        let row = 2 * P * ((at - i) / GRID);
        let re = 0;
        let im = 0;
        for (let turned = i; turned < P * GRID; turned += GRID, row += 2) {
          const c = alongRe[turned];
          const s = alongIm[turned];
          re += byRow[row] * c - byRow[row + 1] * s;
          im += byRow[row] * s + byRow[row + 1] * c;
        }
        const power = re * re + im * im;
        if (power > most) {
          most = power;
          best[f] = at;
          phase[f] = Math.atan2(im, re);
        }
      }
      strongest[f] = Math.sqrt(most) / Math.sqrt(Math.max(norm, 1e-12));
    }
    const peaks = [...strongest.keys()].filter((f) => {
      const [before, after] = [strongest[(f + F - 1) % F], strongest[(f + 1) % F]];
      return strongest[f] >= Math.max(before, after);
    });
    peaks.sort((one, two) => strongest[one] - strongest[two]);
    return peaks.slice(-STARTS).map((peak) => {
      // the embedded state's middle is where the fundamental is highest
      const period = 1 / stateHz[peak];
      const shutter = 0.5 * this.#frame;
      const middle = (-phase[peak] * period) / Math.PI;
      const start = middle - 1.5 * period + shutter / 2;
      const [delayX, delayY] = [best[peak] % GRID, Math.floor(best[peak] / GRID)];
      return Float64Array.of(period, start, grid[delayX], grid[delayY], shutter);
    });
  }

  /** Find clocks to start from, by the code alone. */
  #startByCode() {
    const values = Array.from(this.#times, (_, k) =>
      this.deviation.map((scale, place) => this.#values[place * this.#n + k] / (scale + 1e-6)),
    );
    const signs = new Float64Array(this.#P).fill(1);
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
  const first = Math.max(MIN_STATE_HZ, 3 / span);
  const step = 0.25 / span;
  const F = Math.max(0, Math.ceil((MAX_STATES / frame - first) / step));
  return Float64Array.from({ length: F }, (_, f) => first + f * step);
}

/**
 * Work out the fundamentals of displays.
 *
 * `real` and `imaginary` are the F waves (n,). `grid` holds delays along each axis; `across` and
 * `down` are, for each rate, the phases (P, GRID) by which these turn a wave at each place.
 *
 * @param {Float64Array} stateHz - (F,) numbers of states a second
 * @param {Float64Array} times - (n,) seconds
 * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
 * @param {number} frame - time from one camera frame to the next, seconds
 */
function candidateWaves(stateHz, times, places, frame) {
  const delay = longestDelay(frame);
  const grid = Array.from({ length: GRID }, (_, i) => (-0.9 + (1.8 * i) / (GRID - 1)) * delay);
  const [across, down] = [0, 1].map((axis) => {
    const delays = new Float64Array((places.length / 2) * GRID);
    for (let at = 0; at < delays.length; at++) {
      delays[at] = grid[at % GRID] * places[2 * Math.floor(at / GRID) + axis];
    }
    return phasors(stateHz, delays);
  });
  return { ...phasors(stateHz, times), across, down, grid };
}

/**
 * Work out exp(-i pi hz t).
 *
 * @param {Float64Array} rates - (F,)
 * @param {Float64Array} times - (m,)
 * @returns {{ real: Float64Array[], imaginary: Float64Array[] }} F times (m,) each
 */
function phasors(rates, times) {
  const angles = Array.from(rates, (hz) => times.map((time) => -Math.PI * hz * time));
  const real = angles.map((row) => row.map(Math.cos));
  return { real, imaginary: angles.map((row) => row.map(Math.sin)) };
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
 * @param {number} damping
 * @returns {number[]} of the five numbers of a clock
 */
function dampedStep(normal, right, damping) {
  const damped = normal.slice();
  for (let k = 0; k < MOVED; k++) {
    const at = k * (MOVED + 1);
    damped[at] += k === 0 ? 1e-9 : damping * (normal[at] + 0.01 * normal[0]) + 1e-9;
  }
  const [amplitude, ...slopes] = solve(damped, right);
  if (!(amplitude > 1e-6)) return slopes.map(() => 0);
  return slopes.map((slope) => Math.min(Math.max(slope / amplitude, -REACH), REACH));
}
