/** Plain words for what the receiver sees, and for what to do about it. */

import { signedArea } from "../port/link/geometry.js";
import { BRIGHT, DARK, LONG } from "../port/receiver/diagnosis.js";
import { MIN_FRAMES } from "../port/receiver/timing/synchronise.js";
import { RENEWED } from "./site.js";
import { sentence } from "./text.js";

/** Seconds of vain search after which the page gives advice. */
export const PATIENCE_S = 4;
/** Share of the bar that is left to the frames which the display's clock is found in. */
const FINDING = 0.3;
/** Largest share of the bar before the message is there. */
const NEARLY = 0.99;

/**
 * Observations that the worker sends to the page after each frame that the receiver took.
 *
 * @typedef {object} Seen
 * @property {number[][] | null} corners - of the display in pixels, or null
 * @property {number} found - number of frames in which the display was found
 * @property {number} neededFps - frames a second of which the camera has too few, or 0
 * @property {number} exposed - length of an exposure, in states of the display; 0 if not known
 * @property {boolean} synchronised - whether the display's clock is known
 * @property {number} progress - share of the message that was received
 * @property {number | null} level - mean gray level of the display, else of all frames
 * @property {number} clipped - share of pixels at the camera's limit
 * @property {boolean} cut - whether a part of the display is often outside the image
 */

/**
 * Say what the receiver is doing, in a few words that change seldom.
 *
 * @param {Seen} sight
 * @returns {string}
 */
export function stateOf({ corners, synchronised, progress }) {
  if (!corners) return progress > 0 ? "Display lost, looking again" : "Looking for the display";
  if (synchronised) return "Receiving the message";
  return "Display found, hold still";
}

/**
 * Say how far reading has come: it counts frames of the display first, and then information.
 *
 * @param {Seen} sight
 * @returns {number} from 0 to less than 1
 */
export function barOf({ found, progress }) {
  const finding = FINDING * Math.min(1, found / MIN_FRAMES);
  return finding + (NEARLY - FINDING) * Math.min(1, progress);
}

/**
 * Say what would help; empty where nothing is wrong.
 *
 * @param {Seen} sight
 * @param {number} waiting - seconds since the state changed last
 * @param {{ width: number, height: number }} image - size of the frames, in pixels
 * @returns {string}
 */
export function adviceFor(sight, waiting, image) {
  if (waiting < PATIENCE_S) return "";
  const { corners, synchronised, level } = sight;
  const isDark = level !== null && level < DARK;
  if (sight.clipped > BRIGHT) {
    return "It is too bright. Avoid reflections, or lower the exposure.";
  }
  if (!corners) {
    return (
      "Fit the whole display into the frame, as large as you can, and hold the camera still. " +
      (isDark ? "It is dark: come closer, or turn the display brighter. " : "") +
      (sight.neededFps
        ? `Some displays need ${sight.neededFps} frames a second, and this camera gives fewer: add light.`
        : "If it is far away, come closer.")
    );
  }
  if (sight.cut) return "A part of the display is outside the picture. Move back a little.";
  if (shareOf(corners, image) < 0.06) return "The display is small in the picture. Come closer.";
  if (sight.exposed > LONG) {
    return "Each frame is exposed for too long. Add light, or choose a shorter exposure.";
  }
  if (isDark) return "It is too dark. Turn the display brighter, or take a brighter picture.";
  if (!synchronised) return "Hold the camera still. Is the display playing the message?";
  return waiting > 3 * PATIENCE_S ? "Hold still, or come closer: the message arrives slowly." : "";
}

/**
 * Work out which share of the image the display covers.
 *
 * @param {number[][]} corners
 * @param {{ width: number, height: number }} image
 * @returns {number} from 0 to 1
 */
export function shareOf(corners, { width, height }) {
  return Math.abs(signedArea(corners)) / (width * height);
}

/** What browsers and onnxruntime say of a file of the site that is gone, cut off, or another one. */
const DAMAGED = new RegExp(
  "missing on the server|SyntaxError|magic word|past end|unexpected end|not valid JSON" +
    "|dynamically imported|load model",
  "i",
);

/**
 * Tell whether a file of the site is at fault: it is newer than the page, missing or damaged.
 *
 * @param {string} reason - as the browser or the receiver says it
 */
export function isOfSite(reason) {
  return reason.includes(RENEWED) || DAMAGED.test(reason);
}

/**
 * Say why the receiver will never work, and what to do.
 *
 * @param {string} reason - as the browser or the receiver says it
 * @returns {[string, string]}
 */
export function failureOf(reason) {
  if (reason.includes(RENEWED)) {
    return ["This page was renewed", "Its server has a newer one. Reload this page."];
  }
  if (/content.security.policy|unsafe-eval|\bCSP\b/i.test(reason)) {
    return [
      "This page's server forbids the receiver",
      "It lets no page run WebAssembly. Who runs the server adds 'wasm-unsafe-eval' to script-src " +
        "in its Content-Security-Policy.",
    ];
  }
  if (DAMAGED.test(reason)) {
    return [
      "A part of this page is missing",
      "Its server lacks a file of this page, or has a damaged one. Reload it; if that does " +
        `not help, tell who runs the server: ${reason}`,
    ];
  }
  return ["The receiver cannot work in this browser", `${sentence(reason)} Try to reload this page, or a newer browser.`];
}

/**
 * Say why the camera could not be opened, and what to do.
 *
 * @param {unknown} error - what `getUserMedia` threw
 * @returns {string}
 */
export function cameraTrouble(error) {
  const name = error instanceof Error || error instanceof DOMException ? error.name : "";
  switch (name) {
    case "NotAllowedError":
    case "SecurityError":
      return (
        "This page may not use the camera. Allow it in the browser's settings for this page, " +
        "then start the camera again."
      );
    case "NotFoundError":
    case "OverconstrainedError":
      return "No camera was found. Connect one, or read a film instead.";
    case "NotReadableError":
    case "AbortError":
      return "The camera cannot be used now. Close other programs that use it, then start again.";
    case "InsecureContext":
      return (
        "Browsers give the camera only to pages with https:// in their address. " +
        "Open this page that way, or read a film instead."
      );
    default:
      return `The camera could not be started (${name || error}).`;
  }
}
