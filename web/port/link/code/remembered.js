/** Results of functions that are kept, because they take long and depend on few numbers. */

/** Number of results that are kept of each function; the oldest is dropped first. */
const RESULTS = 16;

/**
 * Make a function that keeps its results.
 *
 * @template {number[]} Numbers
 * @template Result
 * @param {(...numbers: Numbers) => Result} work - a function of whole numbers
 * @returns {(...numbers: Numbers) => Result}
 */
export function remembered(work) {
  /** @type {Map<string, Result>} */
  const results = new Map();
  return (...numbers) => {
    const key = numbers.join();
    let result = results.get(key);
    if (result === undefined) {
      result = work(...numbers);
      const oldest = results.keys().next();
      if (results.size >= RESULTS && !oldest.done) results.delete(oldest.value);
      results.set(key, result);
    }
    return result;
  };
}
