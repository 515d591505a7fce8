/** Errors of an application's input, with the codes of the Python package. */

/**
 * What is wrong, in a word for programs: `argument` is of a wrong type or out of range; `frame` is no
 * image that is read; `time` is no finite number of seconds, does not rise, or is in milliseconds;
 * `finished` comes after finish(); `load` did not load a file, or was not awaited; `failed` is a
 * graph that could not be run.
 *
 * @typedef {"argument" | "frame" | "time" | "finished" | "load" | "failed"} Code
 */

/** All that this package throws: one line, and a code. */
export class InputError extends Error {
  /** @param {Code} code @param {string} message */
  constructor(code, message) {
    super(message);
    this.name = "InputError";
    this.code = code;
  }
}

/**
 * Do something, and give its errors a code.
 *
 * @template Result
 * @param {Code} code
 * @param {() => Result} task
 * @returns {Result} what the task gives; where that is a promise, its errors get the code, too
 */
export function coded(code, task) {
  /** @param {unknown} error @returns {never} */
  const fail = (error) => {
    if (error instanceof InputError) throw error;
    throw new InputError(code, error instanceof Error ? error.message : String(error));
  };
  try {
    const result = task();
    return result instanceof Promise ? /** @type {any} */ (result.catch(fail)) : result;
  } catch (error) {
    return fail(error);
  }
}
