/** Say why no message came: what was seen, and what to try, in one line. */

import { receiveDiagnosis } from "../generated/constants.js";
import { MIN_FRAMES, MIN_TOGGLE } from "./timing/synchronise.js";

export const {
  DARK, BRIGHT, CLIPPED, NOISE_STRENGTH, TOO_FAST, MIXED, CUT, OFTEN, WORDS,
} = receiveDiagnosis;

/**
 * What a receiver has seen of a film from which no message came.
 *
 * @typedef {object} Observations
 * @property {number} fps - nominal number of frames of the camera in a second
 * @property {number} frames - number of frames taken
 * @property {number} found - number of frames in which the display was found
 * @property {number} seconds - time from the first to the last frame with the display, seconds
 * @property {number | null} level - mean gray level in [0, 255] of the display, or of all frames
 *   where it was never found; null before the first frame
 * @property {number} clipped - share of the pixels measured for `level` at the camera's limit
 * @property {number} cut - number of frames in which a part of the display lay outside the image
 * @property {import("./timing/synchronise.js").Toggling | null} toggling - the strongest toggling
 *   that was found, or null where no clock was looked for
 * @property {number | null} stateHz - states a second by the clock found last, or null
 * @property {number} decoded - number of frame pairs decoded
 * @property {number} mixed - share of the blocks' scores that exposures over two states have cost
 * @property {number} progress - information received, as a share of what is needed
 * @property {number} [refused] - number of messages that were refused
 */

/**
 * Say in one line what was seen, why there is no message, and what to try.
 *
 * @param {Observations} seen
 * @returns {string}
 */
export function explainSilence(seen) {
  const { toggling } = seen;
  /** @type {Record<string, number | null | undefined>} */
  const values = {
    frames: seen.frames,
    found: seen.found,
    seconds: seen.seconds,
    level: seen.level,
    clipped: seen.clipped,
    cut: seen.cut,
    decoded: seen.decoded,
    progress: seen.progress,
    refused: seen.refused,
    fps: seen.fps,
    half_fps: seen.fps / 2,
    state_hz: seen.stateHz,
    least_frames: MIN_FRAMES,
    least_toggle: MIN_TOGGLE,
    strength: toggling?.strength,
    amplitude: toggling?.amplitude,
    toggle_hz: toggling?.stateHz,
  };
  const line = reasons(seen)
    .map((part) => WORDS.get(part))
    .join("");
  return line
    .replace(/\{(\w+):?([^}]*)\}/g, (_, name, form) => written(values[name] ?? NaN, form))
    .replaceAll(" --", " "); // the page has no flags
}

/**
 * Find what explains that no message came.
 *
 * @param {Observations} seen
 * @returns {string[]} keys of `WORDS`, in the order of the line
 */
function reasons(seen) {
  const dark = seen.level !== null && seen.level < DARK;
  const bright = seen.clipped > BRIGHT;
  if (seen.refused) return ["refused"];
  if (seen.found === 0) {
    return ["nothing", dark ? "nothing, dark" : bright ? "nothing, bright" : "nothing, else"];
  }
  const parts = ["view"];
  if (dark) parts.push("dark");
  if (bright) parts.push("bright");
  if (seen.cut > OFTEN * seen.found) parts.push("cut");
  const { toggling, stateHz } = seen;
  if (seen.decoded > 0) {
    const mixed = stateHz !== null && stateHz > TOO_FAST * seen.fps && seen.mixed > MIXED;
    return [...parts, "pairs", mixed ? "too fast" : "too little"];
  }
  if (stateHz !== null) return [...parts, "no pair"];
  if (toggling === null) return [...parts, "short"];
  if (toggling.deviation < MIN_TOGGLE) return [...parts, "still"];
  return [...parts, toggling.strength < NOISE_STRENGTH ? "noise" : "weak"];
}

/**
 * Write a number as Python's `str.format` does.
 *
 * @param {number} value
 * @param {string} form - ".1f" for one decimal, ".0%" for per cent, "g" for six digits at most
 */
function written(value, form) {
  if (form.endsWith("%")) return `${(100 * value).toFixed(0)}%`;
  if (form.endsWith("f")) return value.toFixed(Number(form.slice(1, -1)));
  return String(form === "g" ? Number(value.toPrecision(6)) : value);
}
