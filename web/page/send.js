/** The page that sends: what is chosen, and what its buttons do. A worker makes the loop. */

import { encodeQR } from "qr";
import { codeAuthenticate, senderCarrying, senderCompact } from "../generated/constants.js";
import { framesNeeded } from "../port/link/code/framing.js";
import { InputError } from "../port/link/errors.js";
import { failureOf, isOfSite } from "./advice.js";
import { toBase64 } from "../port/sender/base64.js";
import { carriedShare, openFilm, openPicture, pixelsOf, sizeOf } from "../port/sender/picture.js";
import {
  checkVersion, download, keepForOffline, load, remember, remembered, started, takeFiles,
} from "./site.js";
import { linkOf } from "./text.js";
import { startWorker } from "./workers.js";

/** @import { Remote } from "comlink" */
/** @import { SendPreset } from "../port/sender/loop.js" */
/** @import { Sending } from "./sending.js" */

const { EMBEDDED_BYTES } = senderCompact;
const { MIN_KEY_BYTES, MAX_KEY_BYTES, MAX_STAMP, STAMP_BYTES, TAG_BYTES } = codeAuthenticate;

/** @param {string} id @returns {any} */
const byId = (id) => document.getElementById(id);
/** @type {Remote<Sending>} */
let worker;
/** Is rejected where the worker's program does not run. @type {Promise<never>} */
const broken = new Promise((_, reject) => {
  worker = startWorker("sending.js", reject);
});
broken.catch(() => {}); // it is said where a loop is wanted
/** The chosen picture or film; each choice replaces the one before. */
let picture = drawn("noon");
/** Whether the preview shows the first picture of a film, which tells nothing of the others. */
let isFilm = false;
/** The worst that the visitor was warned of before it played, and agreed to; else empty. */
let agreed = "";
/** Share of refreshes that a display may skip without a word. */
const FEW_SKIPPED = 0.05;
/** Advice for a dark picture, over which few bits come through. */
const DARK =
  "This picture is dark, so that it is read late or not at all. Take a brighter one, or choose “To reach every camera”.";
/** Modules of white around a QR code (ISO/IEC 18004). */
const QUIET = 4;
/** Name by which the address of the page that reads is remembered. */
const READER = "reader";

/** @param {string} text - what is said to the visitor @param {boolean} [isError] */
function say(text, isError = false) {
  byId("status").textContent = text;
  byId("status").classList.toggle("error", isError);
}

/**
 * Advice that the server's Content-Security-Policy forbids pictures, once it has; it then stays.
 * Empty before.
 */
let forbidden = "";
document.addEventListener("securitypolicyviolation", ({ effectiveDirective: part }) => {
  if (!/^(img|media)-src/.test(part)) return;
  forbidden = `This page's server forbids pictures. Who runs it adds ${part} 'self' blob: to its Content-Security-Policy.`;
  say(forbidden, true);
});

/** @param {unknown} error */
function sayError(error) {
  if (forbidden) return say(forbidden, true);
  const why = error instanceof Error ? error.message : String(error);
  const unknown = isOfSite(why) ? failureOf(why).join(": ") : `This did not work: ${why}`;
  say(error instanceof InputError ? why : unknown, true);
}

/** @returns {SendPreset} */
function chosen() {
  return SENT.find(({ name }) => name === byId("preset").value);
}

// ---- The picture

/** A picture, or a film and its first picture, and what is to be said of it. @typedef {{
 *   still: ImageBitmap, note?: string, film?: File, size?: number[] }} Carrier */

/** @param {string} name @returns {Promise<Carrier>} a picture that comes with the page */
async function drawn(name) {
  return openPicture(await (await load(`${name}.jpg`)).blob(), [0, 0]);
}

/** @param {File} file @returns {Promise<Carrier>} */
async function opened(file) {
  return file.type.startsWith("video/") ? openFilm(file) : openPicture(file, chosen().size);
}

/** @param {Promise<Carrier>} next - what is shown from now on */
async function take(next) {
  const before = picture;
  const mine = (picture = next.catch(() => before));
  say("");
  try {
    const { still: given, note = "", film } = await next;
    if (mine !== picture) return;
    isFilm = Boolean(film);
    const preview = byId("preview");
    [preview.width, preview.height] = [given.width, given.height];
    preview.getContext("2d").drawImage(given, 0, 0);
    sayCost(); // which depends on the picture, too
    if (note) say(note); // else what was said meanwhile stays, as that a program is missing
  } catch (error) {
    for (const id of ["picture", "camera"]) byId(id).value = ""; // which is not what is shown
    sayError(error);
  }
}

for (const button of byId("drawn").children) {
  button.addEventListener("click", () => void take(drawn(button.value)));
}
for (const id of ["picture", "camera"]) {
  byId(id).addEventListener("change", () => {
    const [file] = byId(id).files;
    if (file) void take(opened(file));
  });
}
takeFiles(["dragover", "dragleave", "drop", "paste"], byId("view"), (file) => void take(opened(file)));

// ---- What it costs

/** Number of bytes of the message, with stamp and tag where it is signed. */
function length() {
  const [file] = byId("file").files;
  const own = file ? file.size : new TextEncoder().encode(byId("text").value).length;
  return own + (byId("key").files.length ? STAMP_BYTES + TAG_BYTES : 0);
}

/** @param {number} number @returns {string} as it is read */
function numberOf(number) {
  return number.toLocaleString("en", { maximumFractionDigits: 1 });
}

/** Say what the preset needs, and how long a loop lasts: in a few words, and in numbers. */
function sayCost() {
  const { name, purpose, needs_fps, better_fps, seen, distance_m, longest_bytes, n_bits, loop } =
    chosen();
  const size = length();
  const share = isFilm ? null : carriedShare(byId("preview"), name);
  const rate = Number(((share ?? 0) * n_bits * (loop.state_hz / 2)).toPrecision(2));
  const pairs = framesNeeded(Math.min(Math.max(size, 1), longest_bytes), n_bits);
  const [file] = byId("file").files;
  const seconds = numberOf(Math.max(1, Math.round((2 * pairs) / loop.state_hz)));
  byId("cost").textContent = [
    seen < 1
      ? `Nobody sees the message from ${numberOf(distance_m)} m away.`
      : "People see that it flickers.",
    !chosen().read_by_page
      ? "No page reads it, but python -m receiver does."
      : better_fps > 60
        ? "Phones read it, best with many frames a second."
        : "Any phone reads it.",
    `It comes round every ${seconds === "1" ? "second" : `${seconds} seconds`}.`,
    share !== null && share < senderCarrying.DIM ? DARK : "",
    file ? `The file “${file.name}” is sent in place of the text.` : "",
    size > longest_bytes ? "The message is too long for this choice." : "",
  ].join(" ");
  const flicker = seen < 1 ? "stays below" : `is ${numberOf(seen)} times`;
  const better = better_fps > needs_fps ? `, better ${better_fps}` : "";
  byId("numbers").textContent =
    `${purpose} Its flicker ${flicker} what is just seen from ${distance_m} m. ` +
    `It needs a camera of ${needs_fps} frames a second${better}. ` +
    `The message has ${numberOf(size)} of at most ${numberOf(longest_bytes)} bytes, and comes ` +
    `round every ${numberOf((2 * pairs) / loop.state_hz)} s.` +
    (share === null ? "" : ` Over this picture about ${numberOf(rate)} bits a second come through.`);
  byId("flicker").hidden = !loop.flicker[0][1];
}

byId("text").addEventListener("input", () => (byId("file").value = "")); // the later choice counts
for (const id of ["text", "file", "key", "preset"]) byId(id).addEventListener("input", sayCost);

// ---- The loop

/**
 * Make the loop of what is chosen.
 *
 * @throws {InputError} something chosen is no good
 */
async function makeLoop() {
  const preset = chosen();
  const [file] = byId("file").files;
  if (length() > preset.longest_bytes) {
    const most = `it can have ${preset.longest_bytes} bytes`;
    throw new InputError(`The message is too long; with this choice ${most}.`);
  }
  const text = new TextEncoder().encode(byId("text").value);
  const message = file ? new Uint8Array(await file.arrayBuffer()) : text;
  if (!message.length) throw new InputError("The message is empty. Type a text, or choose a file.");
  const signature = await signatureOf(byId("key").files[0]);
  const { still, film, size } = await picture;
  if (!film || !size) return worker.make(preset, message, signature, pixelsOf(still, preset.size));
  const shown = sizeOf({ width: size[0], height: size[1] }, preset.size);
  const loop = await worker.makeOverFilm(preset, message, signature, { size, shown });
  loop.film.file = film; // which the player plays from here
  return loop;
}

/**
 * Read what signs the message.
 *
 * @param {File | undefined} file - the key
 */
async function signatureOf(file) {
  if (!file) return null;
  const { value: counter, validity } = byId("counter");
  const isEmpty = counter === "" && !validity.badInput; // as of "e"
  const stamp = isEmpty ? Math.floor(Date.now() / 1000) : Number(counter);
  if (validity.badInput || !(Number.isInteger(stamp) && stamp >= 0 && stamp <= MAX_STAMP)) {
    throw new InputError(`The counter is a whole number from 0 to ${MAX_STAMP}.`);
  }
  if (!(file.size >= MIN_KEY_BYTES && file.size <= MAX_KEY_BYTES)) {
    throw new InputError(`This file is no key: a key has ${MIN_KEY_BYTES} to ${MAX_KEY_BYTES} bytes.`);
  }
  return { key: new Uint8Array(await file.arrayBuffer()), stamp };
}

/**
 * Say where people find the page that reads.
 *
 * @returns {{ reader?: string, code?: string[] }} the address, and the same as a QR code
 * @throws {InputError} what was given is no address
 */
function readerOf() {
  const given = byId("reader").value.trim();
  const reader = linkOf(given)?.href;
  if (!reader && (given || byId("reader").validity.badInput)) {
    throw new InputError("The address of the page that reads begins with https:// or http://.");
  }
  remember(READER, given);
  if (!reader) return {};
  if (!byId("code").checked) return { reader };
  const rows = encodeQR(reader, "raw", { border: QUIET });
  return { reader, code: rows.map((row) => row.map(Number).join("")) };
}

/** @param {string} id - of a button @param {(loop: any) => unknown} use - is given the loop */
function onClick(id, use) {
  byId(id).addEventListener("click", async () => {
    for (const name of ["show", "save"]) byId(name).disabled = true;
    say("Preparing");
    try {
      const reader = readerOf();
      await checkVersion();
      const loop = Object.assign(await Promise.race([makeLoop(), broken]), reader);
      say("");
      await use(loop);
    } catch (error) {
      sayError(error);
    }
    for (const name of ["show", "save"]) byId(name).disabled = false;
  });
}

onClick("save", async (loop) => {
  if (loop.film) {
    const { file } = loop.film;
    if (file.size > EMBEDDED_BYTES) {
      const most = `${EMBEDDED_BYTES >> 20} MiB`;
      throw new InputError(`A saved file holds films of up to ${most}. Show it from here.`);
    }
    const type = file.type === "video/quicktime" ? "video/mp4" : file.type;
    const bytes = await file.arrayBuffer().catch(() => {
      throw new InputError("This film cannot be read any more.");
    });
    Object.assign(loop.film, { type, data: toBase64(new Uint8Array(bytes)), file: undefined });
  }
  const text = await (await load("player.html")).text();
  const page = text.replace(senderCompact.PLACE, () => `>${JSON.stringify(loop)}<`);
  download(new Blob([page]), "player.html");
  say("The file is among your downloads. Open it on the display.");
});

onClick("show", async (loop) => {
  loop.agreed = agreed;
  const frame = document.createElement("iframe");
  const allow = "autoplay; fullscreen; screen-wake-lock";
  Object.assign(frame, { src: "player.html", title: "The display", allow });
  // the player takes the loop from here, and says when it is to end
  Object.assign(window, { loop, endShow });
  byId("stage").replaceChildren(frame);
  showStage(true);
  frame.addEventListener("load", () => {
    frame.contentWindow?.focus();
    if (/** @type {any} */ (frame.contentWindow)?.player) return;
    endShow();
    sayError(new Error("player.html is missing on the server"));
  });
  await byId("stage").requestFullscreen?.({ navigationUI: "hide" }).catch(() => {});
});

/** @param {boolean} on - whether the stage covers the page, where nothing else can be reached */
function showStage(on) {
  for (const part of /** @type {any} */ (document.body.children)) part.inert = on;
  Object.assign(byId("stage"), { inert: false, hidden: !on });
}

/** End what is shown, and say how it went. */
function endShow() {
  const [frame] = byId("stage").children;
  if (!frame) return;
  const { player, stats } = /** @type {any} */ (frame).contentWindow;
  if (player?.ready && player.agreed) {
    agreed = player.agreedTo;
    const skipped = stats.dropped / Math.max(1, stats.refreshes);
    const often = `It skipped ${Math.round(100 * skipped)} % of its refreshes, so it is read slowly.`;
    say(
      `Shown with ${player.rate.toFixed(1)} states a second.` +
        (skipped > FEW_SKIPPED ? ` ${often} Close other programs.` : ""),
    );
  }
  byId("stage").replaceChildren();
  showStage(false);
  if (document.fullscreenElement) void document.exitFullscreen();
  byId("show").focus();
}

document.addEventListener("fullscreenchange", () => {
  if (!document.fullscreenElement) endShow();
});

byId("preset").append(...SENT.map(({ name, purpose }) => new Option(purpose.split(":")[0], name)));
byId("preset").value = "hidden";
const isLocal = /^(localhost|127\.|\[::1\]|0\.0\.0\.0)/.test(location.hostname);
byId("reader").value = remembered(READER) || (isLocal ? "" : new URL("./", location.href).href);
byId("local").hidden = !isLocal;
started();
void take(picture);
sayCost();
void keepForOffline();
