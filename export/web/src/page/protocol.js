/**
 * What the page and its worker say to each other.
 *
 * The page sends one frame at a time, and the next one only after the worker's answer.
 */

/** @import { Pixels } from "./frames.js" */
/** @import { Sight } from "./advice.js" */

/**
 * From the page: a new film or camera, a session, with the key of its messages or null, and their
 * largest age in seconds or null; its next frame; its end; the wish to keep frames, as many as given, in place of reading them.
 *
 * @typedef {{ type: "start", session: number, fps: number, key: Uint8Array | null,
 *     maxAgeS: number | null }
 *   | ({ type: "frame", time: number } & Pixels)
 *   | { type: "finish" }
 *   | { type: "record", frames: number, about: Record<string, unknown> }} Request
 */

/**
 * A message that arrived, and what was thought of it.
 *
 * @typedef {object} Arrival
 * @property {Uint8Array} data - the bytes that were sent
 * @property {string | null} refused - why the message is not to be shown, or null
 * @property {boolean} stale - whether it is authentic but too old, as in a recording shown again
 * @property {number | null} stamp - of a message with a key, seconds since 1970 or a counter
 */

/**
 * What became of a frame, or of the film's end.
 *
 * @typedef {object} StepValues
 * @property {"step"} type
 * @property {number} session - to which it belongs
 * @property {boolean} last - whether the film has ended
 * @property {number} width - of the frames, in pixels
 * @property {number} height - of the frames, in pixels
 * @property {string | null} preset - name of what the display shows, or null
 * @property {string} explanation - why there is no message yet, in the words of export.receive
 * @property {Arrival | null} arrival
 * @typedef {StepValues & Sight} Step
 */

/**
 * From the worker: its programs are loaded, and run once before frames come; it can read; it cannot,
 * and why; what became of a frame; how many frames are kept; the file of all that were kept.
 *
 * @typedef {{ type: "loaded" }
 *   | { type: "ready" }
 *   | { type: "failed", reason: string }
 *   | Step
 *   | { type: "kept", share: number }
 *   | { type: "recording", file: Blob | null }} Answer
 */

export {};
