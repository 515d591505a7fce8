/** The code by which a display changes the order of its two states from frame pair to frame pair. */

/** Signs of successive frame pairs, which come again and again. */
export class PilotCode {
  /** @param {number[]} signs - 1 where the original frame comes first, -1 where it comes last */
  constructor(signs) {
    this.signs = Float64Array.from(signs);
    /** Number of frame pairs after which the code comes again. */
    this.period = signs.length;
    /** Whether all frame pairs show their original first. */
    this.isPlain = signs.length === 1;
  }

  /**
   * Give the sign of a frame pair.
   *
   * @param {number} pair - its number, which may be negative
   */
  sign(pair) {
    const at = (pair | 0) % this.period;
    return this.signs[at < 0 ? at + this.period : at];
  }

  /**
   * Give the numbers of the states that show a pair's original and its embedded frame.
   *
   * @param {number} pair
   * @returns {[number, number]}
   */
  statesOf(pair) {
    return this.sign(pair) > 0 ? [2 * pair, 2 * pair + 1] : [2 * pair + 1, 2 * pair];
  }
}

/** No code. */
export const PLAIN = new PilotCode([1]);
