/** Say why no message came: what was seen, and what to try, in one line. */

import { receiveDiagnosis } from "../generated/constants.js";
import { MIN_FRAMES, MIN_TOGGLE } from "./timing/synchronise.js";

export const {
  DARK, BRIGHT, CLIPPED, NOISE_STRENGTH, TOO_FAST, MIXED, CUT, OFTEN,
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
  if (seen.refused) {
    return `every message was refused (${seen.refused}); is it the sender's key?`;
  }
  if (seen.found === 0) return explainNothingFound(seen);
  const view = `the display is in view in ${seen.found} of ${seen.frames} frames`;
  return `${view}${lightAndCut(seen)}, ${explainSignal(seen)}`;
}

/** @param {Observations} seen */
function explainNothingFound(seen) {
  const nothing = `no display that is looked for in any of ${seen.frames} frames`;
  if (seen.level !== null && seen.level < DARK) {
    const dark = `which are dark (mean level ${seen.level.toFixed(0)} of 255)`;
    return `${nothing}, ${dark}: more light or a longer exposure`;
  }
  if (seen.clipped > BRIGHT) {
    const bright = `${percent(seen.clipped)} of whose pixels are at the camera's limit`;
    return `${nothing}, ${bright}: a shorter exposure`;
  }
  return (
    `${nothing}; check preset or model, focus, exposure, that most of the display is ` +
    "in view, and that the film is not mirrored"
  );
}

/**
 * Say what is wrong with the view of the display; empty where nothing is.
 *
 * @param {Observations} seen
 */
function lightAndCut(seen) {
  const faults = [];
  if (seen.level !== null && seen.level < DARK) {
    faults.push(`dark there (mean level ${seen.level.toFixed(0)} of 255; more light)`);
  }
  if (seen.clipped > BRIGHT) {
    faults.push(`${percent(seen.clipped)} of it at the camera's limit (a shorter exposure)`);
  }
  if (seen.cut > OFTEN * seen.found) {
    faults.push(`only in part in ${seen.cut} of them (move back or turn the camera)`);
  }
  return faults.map((fault) => `, ${fault}`).join("");
}

/**
 * Say what became of the toggling of the display's patches.
 *
 * @param {Observations} seen
 */
function explainSignal(seen) {
  const { toggling } = seen;
  if (seen.decoded > 0) return explainPairs(seen);
  if (seen.stateHz !== null) {
    return (
      `and its clock was found (${seen.stateHz.toFixed(1)} states a second), but the film ended ` +
      "before a frame pair was whole; film longer"
    );
  }
  if (toggling === null) {
    return (
      `for ${seen.seconds.toFixed(1)} s; to find the display's clock takes ${MIN_FRAMES} frames ` +
      "or more; film longer"
    );
  }
  if (toggling.deviation < MIN_TOGGLE) {
    return (
      `but its patches or pilots do not change (by less than ${MIN_TOGGLE} gray levels); ` +
      "is the sender playing, and are its states shown for a camera frame or longer?"
    );
  }
  if (toggling.strength < NOISE_STRENGTH) {
    return (
      "but its patches or pilots change no more regularly than noise " +
      `(${percent(toggling.strength)} of the evidence that a clock needs); is the sender ` +
      `playing, is fps right (${short(seen.fps)}), and does each of its states last a camera ` +
      "frame or longer? Film closer or steadier, or send with a larger kappa"
    );
  }
  return (
    `and its patches or pilots toggle weakly (by ${toggling.amplitude.toFixed(1)} gray levels at ` +
    `${toggling.stateHz.toFixed(1)} states a second, ${percent(toggling.strength)} of the ` +
    "evidence that a clock needs); film longer, closer or steadier, or send with a larger kappa"
  );
}

/**
 * Say why the frame pairs that were decoded gave no message.
 *
 * @param {Observations} seen
 */
function explainPairs(seen) {
  const share = percent(seen.progress);
  const pairs = `and ${seen.decoded} frame pairs gave ${share} of the information needed`;
  const rate = seen.stateHz;
  if (rate !== null && rate > TOO_FAST * seen.fps && seen.mixed > MIXED) {
    return (
      `${pairs}: the display shows ${rate.toFixed(1)} states a second and the camera takes ` +
      `${short(seen.fps)} frames, so most exposures mix two states; send at ` +
      `${short(seen.fps / 2)} states a second or film at a higher rate`
    );
  }
  return `${pairs}; film longer or closer, or send with a larger kappa`;
}

/** @param {number} share */
function percent(share) {
  return `${(100 * share).toFixed(0)}%`;
}

/** @param {number} value */
function short(value) {
  return String(Number(value.toPrecision(6)));
}
