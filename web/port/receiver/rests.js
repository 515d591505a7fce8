/**
 * Rests between searches where no display has been seen for long, which spare a phone's battery.
 *
 * Before an empty room a camera's frames are searched for a third of the time. A search begins at
 * once where the image changes clearly more than in the rests before: the camera is turned elsewhere,
 * or something begins to toggle that fills a good part of the image. Else the next rest ends soon.
 */

/** Time without a display after which rests begin, seconds. */
export const AWAKE_S = 10;
/** Length of a rest, and least length of what is searched between two rests, seconds. */
export const [REST_S, LOOK_S] = [3, 1];
/** Number of changes that are averaged, and number of averages that must be known. */
const [AVERAGED, KNOWN] = [4, 30];
/** Ratio of a change to the greatest one of the rests so far from which on it ends a rest. */
const CLEARLY = 1.5;

/** Says which frames of a camera are passed over. */
export class Rests {
  /** Time since which no display has been seen, and nothing changed clearly, seconds. */
  #since = NaN;
  /** Time at which the rest began, or what is searched after it, seconds. */
  #began = NaN;
  #isResting = false;
  /** The newest changes in this rest. @type {number[]} */
  #changes = [];
  /** Greatest average of changes in all rests, and number of averages. */
  #greatest = 0;
  #known = 0;

  /** Search all frames again. */
  wake(/** @type {number} */ time) {
    this.#since = time;
    this.#isResting = false;
  }

  /**
   * Tell whether a frame in which no display is followed is passed over.
   *
   * @param {number} time - of the frame, seconds
   * @param {number} change - by how much it differs from the frame before (`Repeats.change`)
   * @param {boolean} isIdle - whether no search has begun
   */
  passes(time, change, isIdle) {
    if (Number.isNaN(this.#since)) this.wake(time);
    if (time - this.#since < AWAKE_S) return false;
    if (!this.#isResting) {
      if (!isIdle || time - this.#began < LOOK_S) return false;
      [this.#isResting, this.#began, this.#changes] = [true, time, []];
      return true;
    }
    this.#changes = [...this.#changes, change].slice(-AVERAGED);
    const average = this.#changes.reduce((sum, value) => sum + value, 0) / AVERAGED;
    if (this.#known++ > KNOWN && average > CLEARLY * this.#greatest) {
      this.wake(time);
      return false;
    }
    this.#greatest = Math.max(this.#greatest, average);
    if (time - this.#began > REST_S) [this.#isResting, this.#began] = [false, time];
    return this.#isResting;
  }
}
