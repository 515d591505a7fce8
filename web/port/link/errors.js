/** Errors that a user can correct, each with a message of one line. */

/** Input from outside is wrong; the message says what, and what to do. */
export class InputError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(message);
    this.name = "InputError";
  }
}
