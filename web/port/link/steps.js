/**
 * A search in steps, so that one who follows a stream can spread it over many frames.
 *
 * A search is a generator. It yields after each step the units of work that the step took, and
 * returns what it found. A unit is about a millisecond of one core, in Python at 1280 x 720;
 * JavaScript takes two or three. Steps are finer than Python's, and no step takes long.
 */

/**
 * A search that yields units of work and returns a result.
 *
 * @template Result
 * @typedef {Generator<number, Result, void>} Steps
 */

/**
 * Take all steps of a search at once.
 *
 * @template Result
 * @param {Steps<Result>} steps
 * @returns {Result} what the search found
 */
export function runToEnd(steps) {
  for (;;) {
    const step = steps.next();
    if (step.done) return step.value;
  }
}
