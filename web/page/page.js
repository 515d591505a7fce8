/** The page: what is shown, and what its buttons do. Reading happens in the worker. */

import { codeAuthenticate } from "../generated/constants.js";
import { textOf, utf8Of } from "../port/link/code/message.js";
import { adviceFor, barOf, cameraTrouble, failureOf, isOfSite, stateOf } from "./advice.js";
import { LONG } from "../port/receiver/diagnosis.js";
import { cameraControls, listCameras, openCamera, shortenExposure } from "./camera.js";
import { filmFrames } from "./films.js";
import { cameraFrames } from "./frames.js";
import { Overlay } from "./overlay.js";
import { Reception } from "./reception.js";
import { download, keepForOffline, remember, remembered, started, takeFiles } from "./site.js";
import { linkOf, noteOf, sentence } from "./text.js";

/** @import { Viewer } from "./films.js" */
/** @import { Arrival, Step } from "./protocol.js" */

/** Seconds of a recording of what the camera sees. */
const RECORDED_S = 4;
/** Milliseconds for which the page says why it refused a message, whatever it sees meanwhile. */
const REFUSAL_MS = 4000;
/** Milliseconds without a picture after which the page says that the camera sends none. */
const SILENT_MS = 2500;
/** Milliseconds in vain after which the page says what else may help. */
const VAIN_MS = 10_000;
/** Name by which the choice of a camera is remembered. */
const CAMERA = "camera";

const { MIN_KEY_BYTES, MAX_KEY_BYTES, MAX_STAMP } = codeAuthenticate;

/** Advice where a film shows a display, and not for long or well enough. */
const FILM_LONGER = "Film longer, closer, or with a steadier hand.";

/** Advice for a film in which no display is found. */
const MIRRORED = "A mirrored film, as front cameras may make it, is not read: flip it.";

/** @param {string} id @returns {any} */
const byId = (id) => document.getElementById(id);

/** @type {HTMLVideoElement} */
const video = byId("video");
/** @type {HTMLCanvasElement} */
const picture = byId("picture");
/** @type {HTMLElement} */
const view = byId("view");
const overlay = new Overlay(view);

/**
 * Controller of what is read now, a film or the camera; aborted when something else is to be read.
 */
let running = new AbortController();
/** Message that is shown, or null. @type {Uint8Array | null} */
let shown = null;
/** State that is shown, and since when, in milliseconds of the page. */
const state = { text: "", since: 0 };
/** The message that was refused last, as it is said; empty before. */
const refusal = { text: "", advice: "", until: 0 };
/** @type {Step | null} */
let lastStep = null;
/** Reads the film or the camera that was read last once more. */
let readAgain = () => {};
/** Whether the camera was read last, and not a film. */
let fromCamera = true;
/** Whether the camera was told to expose for a shorter time; once is enough. */
let shortened = false;
/** @type {{ release(): Promise<void> } | null} */
let awake = null;
/** When the camera's last frame came, and when reading last began or found a display. */
const times = { frame: 0, hope: 0 };

/** Texts while the receiver's programs are loaded, and while they run for the first time. */
const [LOADING, GETTING_READY] = ["Loading the receiver", "Getting ready"];
const WAIT = "It takes a moment. Point the camera at the display.";

const reception = new Reception({
  loaded() {
    if (byId("status").textContent === LOADING) say(GETTING_READY, WAIT);
  },
  ready() {
    byId("record").disabled = false;
    void keepForOffline();
  },
  failed(reason) {
    stop();
    if (isOfSite(reason)) say(...failureOf(reason));
    else if (!sayFailure()) say("The receiver has stopped", sentence(reason));
  },
  step: showStep,
  kept(share) {
    if (running.signal.aborted) return;
    say("Saving what the camera sees", `${Math.round(100 * share)} %`);
  },
});

/**
 * Show what is going on.
 *
 * @param {string} text - the state, in a few words
 * @param {string} [advice]
 */
function say(text, advice = "") {
  if (text !== state.text) [state.text, state.since] = [text, performance.now()];
  if (byId("status").textContent !== text) byId("status").textContent = text;
  if (byId("advice").textContent !== advice) byId("advice").textContent = advice;
}

/**
 * Say why the receiver will never be able to read, where that is so.
 *
 * @returns {boolean} whether it is so
 */
function sayFailure() {
  const { failure } = reception;
  if (failure === null) return false;
  say(...failureOf(failure));
  showHelp(false);
  return true;
}

/**
 * Show what became of a frame.
 *
 * @param {Step} step
 */
function showStep(step) {
  if (running.signal.aborted) return;
  lastStep = step;
  overlay.resize(step.width, step.height);
  overlay.show(step.corners, step.synchronised);
  byId("progress").value = barOf(step);
  byId("percent").textContent = `${Math.floor(100 * barOf(step))} %`;
  byId("received").hidden = false;
  byId("bits").hidden = !step.bits;
  if (step.bits) drawBits(step.bits);
  if (step.corners) times.hope = performance.now();
  showHelp(fromCamera && !step.corners && !step.progress);
  byId("details").textContent = detailsOf(step);
  exposeForShorter(step);
  if (step.arrival && step.arrival.refused === null) {
    stop();
    showMessage(step.arrival);
  } else if (step.arrival) {
    refusal.text = `A ${step.arrival.stale ? "stale " : ""}message was refused`;
    refusal.advice = sentence(step.arrival.refused ?? "");
    refusal.until = performance.now() + REFUSAL_MS;
    say(refusal.text, refusal.advice);
    if (step.last) stop();
  } else if (step.last) {
    stop();
    if (refusal.text) say(refusal.text, refusal.advice);
    else if (step.preset) say("The film ended before the message was whole", FILM_LONGER);
    else say("No display found in this film", `${adviceFor(step, Infinity, step)} ${MIRRORED}`);
  } else if (performance.now() > refusal.until) {
    const text = stateOf(step);
    const waiting = text === state.text ? (performance.now() - state.since) / 1000 : 0;
    say(text, fromCamera ? adviceFor(step, waiting, step) : "");
  }
}

/** @param {boolean} on - whether a display is looked for, so that the visitor may need help */
function showHelp(on) {
  const isVain = on && performance.now() - times.hope > VAIN_MS;
  byId("how").hidden = !on || isVain;
  byId("vain").hidden = !isVain;
}

/** @param {Plane} bits */
function drawBits({ width, height, data }) {
  const image = new ImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < data.length; i++) pixels[i] = 0xff000000 | (data[i] * 0x010101);
  Object.assign(byId("bits"), { width, height });
  byId("bits").getContext("2d").putImageData(image, 0, 0);
}

/** @param {Step} step @returns {string} */
function detailsOf({ preset, explanation, width, height, arrival }) {
  const rate = reception.fps === null ? "" : `, ${reception.fps.toFixed(1)} frames a second`;
  const counts = `${reception.taken} frames read, ${reception.dropped} skipped`;
  const seen = `${width} × ${height} pixels${rate}; ${counts}; preset ${preset ?? "unknown"}.`;
  return arrival && arrival.refused === null ? seen : `${seen} ${sentence(explanation)}`;
}

/** @param {Arrival} arrival */
function showMessage({ data, signed, stamp }) {
  shown = data;
  const text = textOf(data);
  byId("message").textContent = text;
  byId("seal").hidden = stamp === null && !signed;
  byId("seal").textContent =
    stamp === null
      ? "It is signed, not checked: that needs its key."
      : `It was sent with your key; stamp ${stamp}.`;
  const note = noteOf(data, text);
  byId("note").hidden = note === "";
  byId("note").textContent = note;
  const link = linkOf(text);
  byId("open").hidden = link === null;
  if (link) {
    byId("open").href = link.href;
    byId("open").textContent = `Open ${link.host}`;
  } else byId("open").removeAttribute("href");
  byId("share").hidden = !navigator.share;
  byId("letter").hidden = false;
  byId("start").hidden = fromCamera; // where "Read again" does the same
  byId("progress").value = 1;
  byId("percent").textContent = "100 %";
  byId("received").hidden = false;
  say("Message received");
  showHelp(false);
  navigator.vibrate?.(80);
}

/** Take the message away that is shown. */
function clearMessage() {
  shown = null;
  byId("letter").hidden = true;
  byId("message").textContent = "";
  byId("progress").value = 0;
  byId("percent").textContent = "";
  byId("received").hidden = byId("bits").hidden = true;
  byId("details").textContent = "";
  lastStep = null;
  Object.assign(refusal, { text: "", advice: "", until: 0 });
}

/** End what is read now, and give the camera back; its last picture stays. */
function stop() {
  if (!running.signal.aborted && video.classList.contains("live") && video.videoWidth) {
    [picture.width, picture.height] = [video.videoWidth, video.videoHeight];
    picture.getContext("2d")?.drawImage(video, 0, 0);
    [picture.hidden, video.hidden] = [false, true];
  }
  running.abort();
  reception.letGo();
  if (reception.isReady) void reception.record(0, {});
  for (const track of streamOf(video)?.getTracks() ?? []) track.stop();
  video.pause();
  overlay.guide.toggleAttribute("hidden", true);
  byId("controls").replaceChildren();
  byId("start").hidden = false;
  byId("start").textContent = "Start the camera";
  void awake?.release();
  awake = null;
}

/** @param {HTMLVideoElement} element @returns {MediaStream | null} */
function streamOf(element) {
  return element.srcObject instanceof MediaStream ? element.srcObject : null;
}

/**
 * Make the page ready for something else to read.
 *
 * @param {boolean} isCamera
 * @param {() => void} again - reads it once more
 * @returns {AbortSignal} says when it is to end
 */
function prepare(isCamera, again) {
  stop();
  reception.end();
  clearMessage();
  readAgain = again;
  fromCamera = isCamera;
  shortened = false;
  running = new AbortController();
  times.hope = performance.now();
  showHelp(isCamera);
  byId("start").hidden = true;
  video.srcObject = null;
  video.classList.remove("live");
  overlay.show(null, false);
  picture.hidden = true;
  video.hidden = false;
  return running.signal;
}

// ---- The camera

/**
 * Read what a camera sees: the one that was chosen last, where one was.
 */
async function readCamera() {
  if (sayFailure()) return;
  const signal = prepare(true, () => void readCamera());
  say("Asking for the camera", "The browser asks whether this page may use it.");
  try {
    const stream = await openCamera(remembered(CAMERA));
    if (signal.aborted) return void stream.getTracks().forEach((track) => track.stop());
    video.srcObject = stream;
    video.classList.add("live");
    watchCamera(stream.getVideoTracks()[0], signal); // one that sends no picture at all never plays
    await video.play();
    if (signal.aborted) return;
    overlay.resize(video.videoWidth, video.videoHeight);
    overlay.show(null, false);
    if (!reception.isLoaded) say(LOADING, "It takes 5 MB, once.");
    else if (!reception.isReady) say(GETTING_READY, WAIT);
    showControls(stream.getVideoTracks()[0], signal).catch(() => {}); // they are left out
    void stayAwake();
    reception.begin(null);
    /** @type {import("./frames.js").Take} */
    const take = (pixels, time) => {
      times.frame = performance.now();
      return reception.offer(pixels, time);
    };
    await cameraFrames(stream, video, take, signal);
    if (!signal.aborted) {
      stop();
      say("The camera has stopped", "Is it still connected? Start it again.");
    }
  } catch (error) {
    if (signal.aborted) return;
    stop();
    byId("start").textContent = "Try the camera again";
    say("No camera", cameraTrouble(error));
  }
}

/**
 * Say where the camera sends no pictures, until it sends some.
 *
 * @param {MediaStreamTrack} track
 * @param {AbortSignal} signal - ends it
 */
function watchCamera(track, signal) {
  times.frame = performance.now();
  let wasSilent = false;
  const timer = setInterval(() => {
    if (signal.aborted) return clearInterval(timer);
    const now = performance.now();
    if (document.hidden) times.frame = now; // which nothing is asked for
    const isSilent = track.muted || now - times.frame > SILENT_MS;
    if (isSilent === wasSilent) return;
    wasSilent = isSilent;
    byId("start").hidden = !isSilent;
    if (!isSilent) return say(reception.isReady ? "Looking for the display" : GETTING_READY, WAIT);
    byId("start").textContent = "Start the camera again";
    showHelp(false);
    say(
      "The camera sends no pictures",
      "Another program may use it, a switch may be off, or the device was locked. Start it again.",
    );
  }, 250);
}

/**
 * Show what the camera offers: its settings, and the other cameras.
 *
 * @param {MediaStreamTrack} track
 * @param {AbortSignal} signal - ends it
 */
async function showControls(track, signal) {
  const rows = cameraControls(track).map((control) => {
    const { name, range, set } = control;
    if (!range) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      button.setAttribute("aria-pressed", "false");
      button.addEventListener("click", async () => {
        const on = button.getAttribute("aria-pressed") !== "true";
        if (await set(Number(on))) button.setAttribute("aria-pressed", String(on));
      });
      return button;
    }
    const slider = document.createElement("input");
    Object.assign(slider, { type: "range", ...range });
    slider.addEventListener("input", () => void set(slider.valueAsNumber));
    return labelled(name, slider);
  });
  const cameras = await listCameras();
  if (cameras.length > 1) {
    const choice = document.createElement("select");
    choice.append(...cameras.map(({ id, name }) => new Option(name, id)));
    choice.value = track.getSettings().deviceId ?? "";
    choice.addEventListener("change", () => {
      remember(CAMERA, choice.value);
      void readCamera();
    });
    rows.push(labelled("Camera", choice));
  }
  if (!signal.aborted) byId("controls").replaceChildren(...rows);
}

/**
 * Let the camera expose for one state of the display where it exposes for longer.
 *
 * @param {Step} step
 */
function exposeForShorter({ exposed }) {
  const track = streamOf(video)?.getVideoTracks()[0];
  if (shortened || !track || exposed <= LONG) return;
  shortened = true;
  void shortenExposure(track, 1 / exposed);
}

/** @param {string} name @param {HTMLElement} element */
function labelled(name, element) {
  const label = document.createElement("label");
  label.append(name, element);
  return label;
}

/** Keep the screen on while the camera is read. */
async function stayAwake() {
  try {
    awake = (await navigator.wakeLock?.request("screen")) ?? null;
  } catch {
    awake = null; // low battery, for one
  }
  if (running.signal.aborted) void awake?.release();
}

document.addEventListener("visibilitychange", () => {
  const isReading = !running.signal.aborted && streamOf(video) !== null;
  if (!document.hidden && isReading) void stayAwake(); // which hidden pages lose
});

// ---- Films

/**
 * Read a film.
 *
 * @param {Blob | URL} film - a file, or an address on the site of this page
 */
async function readFilm(film) {
  if (sayFailure()) return;
  const signal = prepare(false, () => void readFilm(film));
  say("Opening the film", reception.isReady ? "" : "The receiver is still being loaded.");
  try {
    await whenReady(signal);
    if (signal.aborted) return;
    [video.hidden, picture.hidden] = [true, false];
    await filmFrames(film, viewerOf(signal), signal);
    if (!signal.aborted) await reception.finish();
  } catch (error) {
    if (signal.aborted) return;
    if (reception.taken) await reception.finish(); // what there is may hold the message
    if (shown) return;
    stop();
    const why = error instanceof Error ? error.message : String(error);
    say("The film cannot be read", sentence(why));
  }
}

/**
 * Wait until the receiver can read.
 *
 * @param {AbortSignal} signal - ends it, as also a receiver does that fails
 */
async function whenReady(signal) {
  while (!reception.isReady && !signal.aborted) {
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  await reception.whenIdle();
}

/**
 * Show the frames of a film, and give them to the worker.
 *
 * @param {AbortSignal} signal
 * @returns {Viewer}
 */
function viewerOf(signal) {
  return {
    begin: (fps) => reception.begin(fps),
    show(width, height, draw) {
      if (picture.width !== width || picture.height !== height) {
        [picture.width, picture.height] = [width, height];
      }
      const context = picture.getContext("2d");
      if (context) draw(context);
    },
    async take(pixels, time) {
      await reception.whenIdle();
      if (signal.aborted) pixels.frame?.close();
      else await reception.offer(pixels, time);
    },
  };
}

/**
 * Read the film that the address of this page names.
 *
 * @returns {boolean} whether it names one
 */
function readNamedFilm() {
  const name = new URLSearchParams(location.search).get("film");
  if (name === null) return false;
  let url;
  try {
    url = new URL(name, document.baseURI);
  } catch {
    url = null;
  }
  if (url?.origin === location.origin) void readFilm(url);
  else {
    stop();
    say("The film cannot be read", "It must lie on the same site as this page.");
  }
  return true;
}

// ---- Buttons

byId("start").addEventListener("click", () => void readCamera());
byId("again").addEventListener("click", () => readAgain());
byId("copy").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText(byId("message").textContent);
    say("Message received", "Copied.");
  } catch {
    getSelection()?.selectAllChildren(byId("message"));
    say("Message received", "The text is selected; copy it by hand.");
  }
});
byId("share").addEventListener("click", () => {
  navigator.share({ text: byId("message").textContent }).catch(() => {}); // the user changed her mind
});
byId("keep").addEventListener("click", () => {
  if (!shown) return;
  const name = utf8Of(shown) === null ? "message.bin" : "message.txt";
  download(new Blob([new Uint8Array(shown)]), name);
});
for (const id of ["choose", "instead"]) byId(id).addEventListener("click", () => byId("film").click());
byId("film").addEventListener("change", () => {
  const [file] = byId("film").files;
  if (file) void readFilm(file);
});
byId("key").addEventListener("change", async () => {
  const [file] = byId("key").files;
  if (file && !(file.size >= MIN_KEY_BYTES && file.size <= MAX_KEY_BYTES)) {
    stop(); // an earlier key counts no more, and nothing is to be read without one unasked
    byId("key").value = "";
    reception.key = null;
    byId("age").disabled = true;
    const sizes = `A key has ${MIN_KEY_BYTES} to ${MAX_KEY_BYTES} bytes`;
    return say("This file is no key", `${sizes}, and this file has ${file.size}.`);
  }
  reception.key = file ? new Uint8Array(await file.arrayBuffer()) : null;
  byId("age").disabled = !file; // only a message with a key has an age
  readAgain();
});
byId("age").addEventListener("change", () => {
  const isEmpty = byId("age").value === "" && !byId("age").validity.badInput; // as of "1e"
  const age = isEmpty ? null : byId("age").valueAsNumber;
  if (age !== null && !(age > 0 && age <= MAX_STAMP)) {
    byId("age").value = reception.maxAgeS ?? "";
    return say("This is no age", `Need more than 0 and at most ${MAX_STAMP} seconds.`);
  }
  reception.maxAgeS = age;
  readAgain();
});
byId("record").addEventListener("click", async () => {
  if (running.signal.aborted) return say("Nothing to save", "Start the camera first.");
  byId("record").disabled = true;
  const fps = reception.fps ?? 30;
  const file = await reception.record(Math.ceil(RECORDED_S * fps), {
    versions: VERSIONS,
    browser: navigator.userAgent,
    camera: streamOf(video)?.getVideoTracks()[0]?.getSettings() ?? null,
    fps,
    taken: reception.taken,
    dropped: reception.dropped,
    lastStep,
  });
  byId("record").disabled = false;
  if (!file) return;
  download(file, `camera-${new Date().toISOString().replace(/[:.]/g, "-")}.tar`);
  if (!running.signal.aborted) say("Saved", "The file is among your downloads.");
});
takeFiles(["dragover", "dragleave", "drop"], view, (file) => void readFilm(file));

started();
document.querySelector("header")?.toggleAttribute("hidden", parent !== window); // within another page
if (!readNamedFilm()) void readCamera();
