/**
 * The page's end of the worker: gives it frames one at a time, and drops those that come meanwhile.
 */

import { rateOf } from "./frames.js";

/** @import { Pixels } from "./frames.js" */
/** @import { Answer, Request, Step } from "./protocol.js" */

/** Number of frames from whose times the rate of a camera is measured. */
const PROBED = 16;

/**
 * What the page is told.
 *
 * @typedef {object} Listener
 * @property {() => void} loaded - the worker's programs are loaded, and it gets ready to read
 * @property {() => void} ready - the worker can read
 * @property {(reason: string) => void} failed - the worker cannot go on
 * @property {(step: Step) => void} step - a frame was taken
 * @property {(share: number) => void} kept - a frame was kept for the recording
 * @property {(file: Blob | null) => void} recording - the recording has ended; null where it has no
 *   frames
 */

/** Hands frames to the worker. */
export class Reception {
  /** @param {Listener} listener */
  constructor(listener) {
    this.listener = listener;
    /** Number of frames that the worker took since the film or the camera began. */
    this.taken = 0;
    /** Number of frames that came while the worker was busy. */
    this.dropped = 0;
    /** Nominal number of frames a second, or null while it is measured. @type {number | null} */
    this.fps = null;
    /** Key of the messages that are shown, or null for all. @type {Uint8Array | null} */
    this.key = null;
    /** Largest age of a message with a key, in seconds, or null for any. @type {number | null} */
    this.maxAgeS = null;
    /** Whether the worker's programs are loaded. */
    this.isLoaded = false;
    /** Whether the worker can read. */
    this.isReady = false;
    /** Why the worker will never be able to read, or null. @type {string | null} */
    this.failure = null;
    /** Number of the film or camera that is read, so that late answers on others do not count. */
    this.session = 0;
    /** @type {number[]} */
    this.times = [];
    /** @type {((value: unknown) => void) | null} */
    this.answered = null;
    this.worker = new Worker(new URL("worker.js", document.baseURI), { type: "module" });
    this.worker.onmessage = ({ data }) => this.hear(data);
    this.worker.onerror = (event) => {
      event.preventDefault();
      this.fail(event.message || "its program could not be loaded");
    };
  }

  /** Take no more answers on the film or camera that was read. */
  end() {
    this.session++;
    this.times = [];
    this.taken = this.dropped = 0;
    this.fps = null;
  }

  /**
   * Begin a new film or camera.
   *
   * @param {number | null} fps - frames a second, or null where they are to be measured
   */
  begin(fps) {
    this.end();
    this.fps = fps;
    if (fps === null) return;
    const { session, key, maxAgeS } = this;
    this.send({ type: "start", session, fps, key, maxAgeS: key && maxAgeS });
  }

  /**
   * Give a frame to the worker, or drop it where the worker is not ready for it.
   *
   * @param {Pixels | (() => Pixels)} frame - belongs to the worker from now on; a function makes
   *   it, and is called only where the frame is not dropped
   * @param {number} time - in seconds
   * @returns {Promise<unknown> | null} resolves when the worker is done; null where it was dropped
   */
  offer(frame, time) {
    if (!this.isReady || this.fps === null || this.answered) {
      if (this.fps === null) this.measure(time);
      else if (this.answered) this.dropped++;
      if (typeof frame === "object") frame.frame?.close();
      return null;
    }
    this.taken++;
    const pixels = typeof frame === "object" ? frame : frame();
    const buffer = pixels.rgba?.data.buffer ?? pixels.plane?.data.buffer;
    const moved = pixels.frame ?? buffer;
    return this.ask({ type: "frame", time, ...pixels }, moved ? [moved] : []);
  }

  /** Measure the rate from the times of the first frames. */
  measure(/** @type {number} */ time) {
    this.times.push(time);
    if (this.times.length >= PROBED) this.begin(rateOf(this.times));
  }

  /** Say that the film has ended, once the last frame is read. */
  async finish() {
    await this.whenIdle();
    await this.ask({ type: "finish" }, []);
  }

  /**
   * Keep the next frames in place of reading them. What was kept before becomes a recording.
   *
   * @param {number} frames - how many, at most; 0 to keep none any more
   * @param {Record<string, unknown>} about - what is written beside them
   */
  record(frames, about) {
    this.send({ type: "record", frames, about });
  }

  /** Wait until the worker has answered. */
  async whenIdle() {
    while (this.answered) await new Promise((resolve) => setTimeout(resolve, 10));
  }

  /** @param {Request} request @param {Transferable[]} moved */
  ask(request, moved) {
    return new Promise((resolve) => {
      this.answered = resolve;
      this.send(request, moved);
    });
  }

  /** @param {Request} request @param {Transferable[]} [moved] */
  send(request, moved = []) {
    this.worker.postMessage(request, moved);
  }

  /** @param {Answer} answer */
  hear(answer) {
    const { listener, answered } = this;
    if (answer.type === "loaded") {
      this.isLoaded = true;
      return listener.loaded();
    }
    if (answer.type === "ready") {
      this.isLoaded = true;
      this.isReady = true;
      return listener.ready();
    }
    if (answer.type === "recording") return listener.recording(answer.file);
    this.answered = null;
    if (answer.type === "failed") this.fail(answer.reason);
    else if (answer.type === "kept") listener.kept(answer.share);
    else if (answer.session === this.session) listener.step(answer);
    answered?.(undefined);
  }

  /** @param {string} reason - why the worker cannot go on */
  fail(reason) {
    if (!this.isReady) this.failure = reason;
    this.listener.failed(reason);
  }
}
