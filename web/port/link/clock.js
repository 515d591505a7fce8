/**
 * The display's clock as the camera sees it, and which share of an exposure fell into which state.
 *
 * The display shows states 0, 1, 2 ..., each for `period` seconds: even ones original frames and odd
 * ones embedded frames, or as the layout's code orders those of a frame pair. The place (x, y) of
 * the display, each in [0, 1], is exposed during [t + delay, t + delay + shutter] of a frame at time
 * t, with delay = x delayX + y delayY.
 */

import { filled } from "../image/opencv.js";
import { PLAIN } from "./pilotCode.js";

/** When the display shows which state: state n begins at `start` + n `period`. */
export class DisplayClock {
  /**
   * All values are seconds of the camera's clock.
   *
   * @param {number} period - time for which the display shows each state
   * @param {number} start - time at which state 0 begins
   * @param {number} delayX - time by which the right side is exposed after the left side
   * @param {number} delayY - time by which the bottom is exposed after the top
   * @param {number} shutter - time for which each place is exposed
   */
  constructor(period, start, delayX, delayY, shutter) {
    this.period = period;
    this.start = start;
    this.delayX = delayX;
    this.delayY = delayY;
    this.shutter = shutter;
  }

  /** Period, start, both delays and shutter. */
  get numbers() {
    const { period, start, delayX, delayY, shutter } = this;
    return Float64Array.of(period, start, delayX, delayY, shutter);
  }

  /**
   * Make the same clock with another time at which state 0 begins.
   *
   * @param {number} start - seconds
   */
  startingAt(start) {
    return new DisplayClock(this.period, start, this.delayX, this.delayY, this.shutter);
  }

  /**
   * Say which state the display shows at a time; the fraction says how far it has come.
   *
   * @param {number} time - seconds
   */
  number(time) {
    return (time - this.start) / this.period;
  }

  /** Time from a frame's own to the end of the last place's exposure, seconds. */
  get latest() {
    return Math.max(this.delayX, 0) + Math.max(this.delayY, 0) + this.shutter;
  }

  /** Time from a frame's own to the beginning of the first place's exposure; 0 or negative. */
  get earliest() {
    return Math.min(this.delayX, 0) + Math.min(this.delayY, 0);
  }

  /** Time from a frame's own to the middle of the exposure of the display's centre, seconds. */
  get centre() {
    return (this.delayX + this.delayY + this.shutter) / 2;
  }
}

/** Number of numbers that describe a clock: period, start, both delays and shutter. */
export const CLOCK_NUMBERS = 5;

/**
 * Work out the share that embedded frames have of exposures.
 *
 * @param {Float64Array} clock - period, start, both delays and shutter, as in `DisplayClock`
 * @param {Float64Array} times - (n,) seconds
 * @param {Float64Array} places - (P, 2) x and y on the display, in [0, 1]
 * @param {PilotCode} [code] - says in which order the states of each frame pair are shown
 * @returns {Float64Array} (P, n) in [0, 1]
 */
export function embeddedShare(clock, times, places, code = PLAIN) {
  const shares = new Float64Array((places.length / 2) * times.length);
  return filled("embeddedShare", [clock, times, places, code.signs], shares);
}
