/** Say why no message came: what was seen, and what to try, in one line. */

import { receiverDiagnosis } from "../../generated/constants.js";
import { MAX_STATES } from "./timing/fit.js";
import { MIN_FRAMES, MIN_TOGGLE } from "./timing/synchronise.js";

export const {
  DARK, BRIGHT, CLIPPED, NOISE_STRENGTH, TOO_FAST, LONG, CUT, DIMMED, OFTEN, PRESET_HZ, LEAST_FPS,
  PRESET_FPS, WORDS, ENOUGH,
} = receiverDiagnosis;

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
 * @property {number} exposed - length of an exposure by that clock, in states of the display
 * @property {number} decoded - number of frame pairs decoded
 * @property {number} progress - information received, as a share of what is needed
 * @property {number} [refused] - number of messages that were refused
 * @property {string[]} [presets] - names of those that are looked for, or of the one alone that was
 *   found last
 */

/**
 * Say in one line what was seen, why there is no message, and what to try.
 *
 * @param {Observations} seen
 * @returns {string}
 */
export function explainSilence(seen) {
  const { toggling } = seen;
  const fast = tooFast(seen) ?? "";
  /** @type {Record<string, any>} */
  const values = {
    ...seen,
    half_fps: seen.fps / 2,
    fast,
    fast_hz: PRESET_HZ.get(fast),
    needed_fps: PRESET_FPS.get(fast)?.[0],
    better_fps: PRESET_FPS.get(fast)?.[1],
    state_hz: seen.stateHz,
    least_frames: MIN_FRAMES,
    least_toggle: MIN_TOGGLE,
    strength: toggling?.strength,
    amplitude: toggling?.amplitude,
    toggle_hz: toggling?.stateHz,
  };
  return reasons(seen)
    .map((part) => WORDS.get(part))
    .join("")
    .replace(/\{(\w+):?([^}]*)\}/g, (_, name, form) => written(values[name], form))
    .replaceAll(" --", " "); // the page has no flags
}

/**
 * Say how many frames a second a camera needs at least where this one has too few.
 *
 * @param {Observations} seen
 * @returns {number} 0 where it has enough
 */
export function neededFps(seen) {
  return PRESET_FPS.get(tooFast(seen) ?? "")?.[0] ?? 0;
}

/**
 * Name the preset that needs the quickest camera, where this one is too slow for it.
 *
 * @param {Observations} seen
 */
function tooFast({ presets = [], fps }) {
  const rateOf = (/** @type {string} */ name) => LEAST_FPS.get(name) ?? 0;
  const [fast] = [...presets].sort((one, other) => rateOf(other) - rateOf(one));
  return fast && rateOf(fast) > MAX_STATES * fps ? fast : null;
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
  const slow = tooFast(seen) ? ["slow"] : [];
  if (seen.found === 0) {
    const cause = dark ? "nothing, dark" : bright ? "nothing, bright" : "nothing, else";
    return ["nothing", cause, ...slow];
  }
  const causes = causesOf(seen, slow);
  const parts = ["view"];
  if (dark && DIMMED.includes(/** @type {string} */ (causes.at(-1)))) parts.push("dark");
  if (bright) parts.push("bright");
  if (seen.cut > OFTEN * seen.found) parts.push("cut");
  return [...parts, ...causes];
}

/**
 * Find why a display that was found brought no message.
 *
 * @param {Observations} seen
 * @param {string[]} slow - as in `reasons`
 */
function causesOf(seen, slow) {
  const { presets = [], toggling, stateHz } = seen;
  const isCoded = presets.some((name) => (LEAST_FPS.get(name) ?? 0) < (PRESET_HZ.get(name) ?? 0));
  if (seen.decoded > 0) {
    if (seen.exposed > LONG) return ["pairs", "long"];
    if (slow.length || isCoded || stateHz === null || stateHz <= TOO_FAST * seen.fps) {
      return ["pairs", ...(slow.length ? slow : [seen.progress > ENOUGH ? "wrong" : "too little"])];
    }
    return ["pairs", "many states"];
  }
  if (slow.length) return slow;
  if (stateHz !== null) return ["no pair"];
  if (toggling === null) return ["short"];
  if (toggling.deviation < MIN_TOGGLE) return ["still"];
  return [toggling.strength < NOISE_STRENGTH ? "noise" : "weak"];
}

/**
 * Write a number as Python's `str.format` does.
 *
 * @param {number | string | null | undefined} given
 * @param {string} form - ".1f" for one decimal, ".0%" for per cent, "g" for six digits at most
 */
function written(given, form) {
  const value = Number(given);
  if (form.endsWith("%")) return `${(100 * value).toFixed(0)}%`;
  if (form.endsWith("f")) return value.toFixed(Number(form.slice(1, -1)));
  return String(form === "g" ? Number(value.toPrecision(6)) : given);
}
