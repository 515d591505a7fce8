/** What the receiver notes: the time spent in each stage, and sums of what the frames show. */

import { CLIPPED, CUT } from "./diagnosis.js";

/** Time that the receiver has spent in each of its stages. */
export class StageTimes {
  /** Seconds spent in each stage, by its name. @type {Record<string, number>} */
  spent = {};
  /** Number of times that each stage ran, by its name. @type {Record<string, number>} */
  count = {};

  /**
   * Add the time since a beginning to a stage.
   *
   * @param {string} stage
   * @param {number} since - of `performance.now`
   */
  add(stage, since) {
    this.spent[stage] = (this.spent[stage] ?? 0) + (performance.now() - since) / 1000;
    this.count[stage] = (this.count[stage] ?? 0) + 1;
  }
}

/** Sums of what the frames show, for the reason why no message came. */
export class Sight {
  /** Whether the display was found; until then whole frames are measured, then it alone. */
  found = false;
  /** Number of frames measured. */
  measured = 0;
  /** Sum of the mean gray levels of what was measured. */
  level = 0;
  /** Sum of the shares of pixels at the camera's limit. */
  clipped = 0;
  /** Number of frames with a part of the display outside the image. */
  cut = 0;
  /** Time of the first frame with the display, seconds. */
  first = 0;
  /** Time of the last frame with the display, seconds. */
  last = 0;
  /** States a second by the clock that was known last, or null. @type {number | null} */
  stateHz = null;
  /** Length of an exposure by that clock, in states. */
  exposed = 0;

  /**
   * Take a frame in which the display was not found.
   *
   * @param {BytePlane} frame
   */
  miss(frame) {
    if (!this.found) this.#measure(frame);
  }

  /**
   * Take a frame in which the display was found.
   *
   * @param {BytePlane} rectified
   * @param {number} time - seconds
   * @param {Uint8Array | null} inView - which points of the display lie within the frame
   */
  see(rectified, time, inView) {
    if (!this.found) {
      this.found = true;
      this.first = time;
      this.measured = this.level = this.clipped = 0;
    }
    this.last = time;
    if (inView !== null) {
      const seen = inView.reduce((sum, value) => sum + value, 0);
      if (seen / inView.length < CUT) this.cut++;
    }
    this.#measure(rectified);
  }

  /** @param {BytePlane} image */
  #measure({ width, height, data }) {
    let [sum, clipped, count] = [0, 0, 0];
    for (let y = 0; y < height; y += 8) {
      for (let at = y * width; at < (y + 1) * width; at += 8) {
        sum += data[at];
        if (data[at] >= CLIPPED) clipped++;
        count++;
      }
    }
    this.measured++;
    this.level += sum / count;
    this.clipped += clipped / count;
  }
}
