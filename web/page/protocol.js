/** What the worker says to the page of each frame. */

/** @import { Seen } from "./advice.js" */

/**
 * A message that arrived, and what was thought of it.
 *
 * @typedef {object} Arrival
 * @property {Uint8Array} data - the bytes that were sent
 * @property {boolean} signed - whether it came with stamp and tag, which may not be checked
 * @property {string | null} refused - why the message is not to be shown, or null
 * @property {boolean} stale - whether it is authentic but too old, as in a recording shown again
 * @property {number | null} stamp - of a message with a key, seconds since 1970 or a counter
 */

/**
 * Result of one frame, or of the film's end.
 *
 * @typedef {object} StepValues
 * @property {boolean} last - whether the film has ended
 * @property {number} width - of the frames, in pixels
 * @property {number} height - of the frames, in pixels
 * @property {Plane | null} bits - those that were read last, a pixel for each block, or null
 * @property {string | null} preset - name of what the display shows, or null
 * @property {string} explanation - why there is no message yet, in the words of receiver
 * @property {Arrival | null} arrival
 * @typedef {StepValues & Seen} Step
 */

export {};
