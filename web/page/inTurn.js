/** One task after another: a task takes time, and the next may be asked for meanwhile. */

/** Ends when the last task that was asked for has ended. @type {Promise<unknown>} */
let last = Promise.resolve();

/**
 * Do a task after all that were asked for before.
 *
 * @template Result
 * @param {() => Promise<Result> | Result} task
 * @returns {Promise<Result>} what the task gives, or its error
 */
export function inTurn(task) {
  const result = last.then(task);
  last = result.catch(() => {}); // whoever asked for the task hears of its error
  return result;
}
