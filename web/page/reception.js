/**
 * The page's end of the worker: gives it frames one at a time. Of those that come meanwhile the
 * newest waits, so that the worker need not wait for the camera; the others are dropped.
 */

import { transfer } from "comlink";
import { rateOf } from "./frames.js";
import { checkVersion } from "./site.js";
import { startWorker } from "./workers.js";

/** @import { Remote } from "comlink" */
/** @import { Pixels } from "./frames.js" */
/** @import { Step } from "./protocol.js" */
/** @import { Reading } from "./worker.js" */

/** Number of frames from whose times the rate of a camera is measured. */
const PROBED = 16;

/**
 * Callbacks by which the page learns what the worker does.
 *
 * @typedef {object} Listener
 * @property {() => void} loaded - the worker's programs are loaded, and it gets ready to read
 * @property {() => void} ready - the worker can read
 * @property {(reason: string) => void} failed - the worker cannot go on
 * @property {(step: Step) => void} step - a frame was taken
 * @property {(share: number) => void} kept - a frame was kept for the recording
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
    /** Resolves when the worker is done with what it does now; null where it waits. */
    this.busy = /** @type {Promise<void> | null} */ (null);
    /** The newest frame that came while the worker was busy, and its time in seconds. */
    this.waiting = /** @type {{ pixels: Pixels, time: number } | null} */ (null);
    /** @type {Remote<Reading>} */
    this.worker = startWorker("worker.js", (error) => this.fail(error));
    this.prepare().catch((error) => this.fail(error));
  }

  /** Have the worker's programs loaded, and run once before frames come. */
  async prepare() {
    await this.worker.load();
    await checkVersion();
    this.isLoaded = true;
    this.listener.loaded();
    await this.worker.warm();
    this.isReady = true;
    this.listener.ready();
  }

  /** Take no more answers on the film or camera that was read. */
  end() {
    this.session++;
    this.times = [];
    this.letGo();
    this.taken = this.dropped = 0;
    this.fps = null;
  }

  /**
   * Begin a new film or camera.
   *
   * @param {number | null} fps - frames a second, or null where they are to be measured
   * @param {boolean} [isCamera] - whether frames come from a camera, and not from a film
   */
  begin(fps, isCamera = false) {
    this.end();
    this.fps = fps;
    if (fps === null) return;
    const { key, maxAgeS } = this;
    this.worker.start(fps, key, key && maxAgeS, isCamera).catch((error) => this.fail(error));
  }

  /**
   * Give a frame to the worker. While the worker is busy, the frame waits in place of one before;
   * before the worker is ready, it is dropped.
   *
   * @param {Pixels} pixels - belong to the worker from now on
   * @param {number} time - in seconds
   * @returns {Promise<void> | null} resolves when the worker is done; null where it does not read
   *   the frame, or not yet
   */
  offer(pixels, time) {
    if (!this.isReady || this.fps === null) {
      if (this.fps === null) this.measure(time);
      pixels.frame?.close();
      return null;
    }
    if (!this.busy) return this.give(pixels, time);
    if (this.waiting) this.dropped++;
    this.letGo();
    this.waiting = { pixels, time };
    return null;
  }

  /** Drop the frame that waits. */
  letGo() {
    this.waiting?.pixels.frame?.close();
    this.waiting = null;
  }

  /**
   * Have the worker read a frame.
   *
   * @param {Pixels} pixels
   * @param {number} time - in seconds
   * @returns {Promise<void>} resolves when the worker is done
   */
  give(pixels, time) {
    this.taken++;
    const moved = pixels.frame ?? pixels.rgba?.data.buffer;
    return this.hear(this.worker.take(transfer(pixels, moved ? [moved] : []), time));
  }

  /** Measure the rate from the times of the first frames. */
  measure(/** @type {number} */ time) {
    this.times.push(time);
    if (this.times.length >= PROBED) this.begin(rateOf(this.times), true);
  }

  /** Say that the film has ended, once the last frame is read. */
  async finish() {
    await this.whenIdle();
    await this.hear(this.worker.finish());
  }

  /**
   * Keep the next frames in place of reading them. What was kept before becomes a recording.
   *
   * @param {number} frames - how many, at most; 0 to keep none any more
   * @param {Record<string, unknown>} about - what is written beside them
   * @returns {Promise<Blob | null>} the recording when it has ended; null where it has no frames
   */
  record(frames, about) {
    return this.worker.record(frames, about);
  }

  /** Wait until the worker has answered. */
  async whenIdle() {
    while (this.busy) await this.busy;
  }

  /**
   * Hear what became of a frame, or of the film's end.
   *
   * @param {Promise<Step | { kept: number }>} answer
   * @returns {Promise<void>} resolves when it was heard
   */
  hear(answer) {
    const { session } = this;
    this.busy = answer.then(
      (step) => {
        this.busy = null;
        if ("kept" in step) this.listener.kept(step.kept);
        else if (session === this.session) this.listener.step(step);
        const next = this.waiting; // unless the listener wants no more
        this.waiting = null;
        if (next) void this.give(next.pixels, next.time);
      },
      (error) => {
        this.busy = null;
        this.fail(error);
      },
    );
    return this.busy;
  }

  /** @param {unknown} error - why the worker cannot go on */
  fail(error) {
    console.error(error);
    const reason = error instanceof Error ? error.message : String(error);
    if (!this.isReady) this.failure = reason;
    this.listener.failed(reason);
  }
}
