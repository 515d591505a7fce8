/** The page that sends: what is chosen, and what its buttons do. A worker makes the loop. */

import { wrap } from "comlink";
import { codeAuthenticate, senderCompact } from "../generated/constants.js";
import { framesNeeded } from "../port/link/code/framing.js";
import { InputError } from "../port/link/errors.js";
import { openFilm, openPicture, pixelsOf, sizeOf } from "../port/sender/picture.js";
import { addressOf, download, keepForOffline, load } from "./site.js";

/** @import { Remote } from "comlink" */
/** @import { SendPreset } from "../port/sender/loop.js" */
/** @import { Sending } from "./sending.js" */

const { EMBEDDED_BYTES } = senderCompact;
const { MIN_KEY_BYTES, MAX_KEY_BYTES, MAX_STAMP, STAMP_BYTES, TAG_BYTES } = codeAuthenticate;

/** @param {string} id @returns {any} */
const byId = (id) => document.getElementById(id);
/** @type {Remote<Sending>} */
const worker = wrap(new Worker(addressOf("sending.js"), { type: "module" }));
/** What is shown; each new one takes its place. */
let picture = drawn("noon");
/** Whether the visitor was asked whether what flickers may play, and agreed. */
let agreed = false;

/** @param {string} text - what is said to the visitor */
function say(text) {
  byId("status").textContent = text;
}

/** @param {unknown} error */
function sayError(error) {
  say(error instanceof InputError ? error.message : `This did not work: ${error}`);
}

/** @returns {SendPreset} */
function chosen() {
  return SENT.find(({ name }) => name === byId("preset").value);
}

// ---- The picture

/** A picture, or a film and its first picture. @typedef {{ still: ImageBitmap, film?: File,
 *   size?: number[] }} Carrier */

/** @param {string} name @returns {Promise<Carrier>} a picture that comes with the page */
async function drawn(name) {
  return { still: await openPicture(await (await load(`${name}.jpg`)).blob()) };
}

/** @param {File} file @returns {Promise<Carrier>} */
async function opened(file) {
  return file.type.startsWith("video/") ? openFilm(file) : { still: await openPicture(file) };
}

/** @param {Promise<Carrier>} next - what is shown from now on */
async function take(next) {
  const before = picture;
  const mine = (picture = next.catch(() => before));
  try {
    const { still: given } = await next;
    if (mine !== picture) return;
    const preview = byId("preview");
    [preview.width, preview.height] = [given.width, given.height];
    preview.getContext("2d").drawImage(given, 0, 0);
    say("");
  } catch (error) {
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
for (const name of ["dragover", "dragleave", "drop", "paste"]) {
  document.addEventListener(name, (event) => {
    const given = /** @type {any} */ (event)[name === "paste" ? "clipboardData" : "dataTransfer"];
    const [file] = given?.files ?? [];
    if (name !== "paste" || file) event.preventDefault(); // text goes where it is pasted
    byId("view").classList.toggle("over", name === "dragover");
    if (file && name !== "dragover") void take(opened(file));
  });
}

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

/** Say what the preset needs, and how long a loop lasts. */
function sayCost() {
  const { purpose, needs_fps, better_fps, seen, distance_m, longest_bytes, n_bits, loop } = chosen();
  const reader = chosen().read_by_page ? "" : " No page reads it, but python -m receiver does.";
  const size = length();
  const pairs = framesNeeded(Math.min(Math.max(size, 1), longest_bytes), n_bits);
  const [file] = byId("file").files;
  const message = file ? `The file “${file.name}”, sent in place of the text,` : "The message";
  const flicker = seen < 1 ? "stays below" : `is ${numberOf(seen)} times`;
  const better = better_fps > needs_fps ? `, better ${better_fps}` : "";
  byId("cost").textContent =
    `${purpose} Its flicker ${flicker} what is just seen from ${distance_m} m. ` +
    `It needs a camera of ${needs_fps} frames a second${better}.${reader} ` +
    `${message} has ${numberOf(size)} of at most ${numberOf(longest_bytes)} bytes, and comes ` +
    `round every ${numberOf((2 * pairs) / loop.state_hz)} s.`;
  byId("flicker").hidden = !loop.flicker;
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
  const counter = byId("counter").value;
  const stamp = counter === "" ? Math.floor(Date.now() / 1000) : Number(counter);
  if (!(Number.isInteger(stamp) && stamp >= 0 && stamp <= MAX_STAMP)) {
    throw new InputError(`The counter is a whole number from 0 to ${MAX_STAMP}.`);
  }
  if (!(file.size >= MIN_KEY_BYTES && file.size <= MAX_KEY_BYTES)) {
    throw new InputError(`This file is no key: a key has ${MIN_KEY_BYTES} to ${MAX_KEY_BYTES} bytes.`);
  }
  return { key: new Uint8Array(await file.arrayBuffer()), stamp };
}

/** @param {string} id - of a button @param {(loop: any) => unknown} use - is given the loop */
function onClick(id, use) {
  byId(id).addEventListener("click", async () => {
    for (const name of ["show", "save"]) byId(name).disabled = true;
    say("Preparing");
    try {
      const loop = await makeLoop();
      if (location.protocol === "https:") loop.reader = addressOf("./");
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
    Object.assign(loop.film, { type, data: await base64Of(file), file: undefined });
  }
  const text = await (await load("player.html")).text();
  const page = text.replace(senderCompact.PLACE, () => `>${JSON.stringify(loop)}<`);
  download(new Blob([page]), "player.html");
  say("The file is among your downloads. Open it on the display.");
});

/** @param {Blob} file @returns {Promise<string>} its bytes as base64 */
function base64Of(file) {
  const reader = new FileReader();
  return new Promise((resolve, reject) => {
    reader.onload = () => resolve(/** @type {string} */ (reader.result).split(",")[1]);
    reader.onerror = () => reject(new InputError("This film cannot be read any more."));
    reader.readAsDataURL(file);
  });
}

onClick("show", async (loop) => {
  if (agreed) loop.flicker = "";
  const frame = document.createElement("iframe");
  const allow = "autoplay; fullscreen; screen-wake-lock";
  Object.assign(frame, { src: "player.html", title: "The display", allow });
  // the player takes the loop from here, and says when it is to end
  Object.assign(window, { loop, endShow });
  byId("stage").replaceChildren(frame);
  showStage(true);
  frame.addEventListener("load", () => frame.contentWindow?.focus());
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
    agreed ||= /** @type {any} */ (window).loop.flicker !== "";
    const rate = `${player.rate.toFixed(1)} states a second, at ${stats.hz.toFixed(1)} refreshes`;
    say(`Shown with ${rate}; ${stats.dropped} refreshes were skipped.`);
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
void take(picture);
sayCost();
void keepForOffline();
