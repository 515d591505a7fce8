/** A receiver in a worker of its own, so that neither the page nor its camera waits for it. */

import { coded, InputError } from "./errors.js";

/** @typedef {import("../generated/events.js").FilmEvent} FilmEvent */
/** @typedef {import("./index.js").Frame} Frame */
/** @typedef {import("./index.js").Options} Options */

export { InputError };

/**
 * Reads frames in a worker. Where they come faster than they are read, the newest waits and older
 * ones are passed over, which costs no more than a slower camera.
 */
export class LiveReceiver {
  #worker;
  #onEvent;
  /** Answers that are waited for, in order. @type {{ resolve: Function, reject: Function }[]} */
  #asked = [];
  /** @type {{ frame: Frame, time: number } | null} */
  #waiting = null;
  /** Resolves when all frames that were taken are read. @type {Promise<void>} */
  #reading;
  /** Whether frames are read, or the package is loaded; the next frame waits. */
  isBusy = true;
  /** @type {InputError | null} */
  #failed = null;
  /**
   * Explanation that the worker's `Receiver` gave when it ended, or null before.
   * @type {string | null}
   */
  #explained = null;
  /** Number of frames that were not read because newer ones had come. */
  passedOver = 0;

  /**
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {(event: FilmEvent) => unknown} onEvent - is called with each event
   * @param {Options & { folder?: string | URL, worker?: Worker }} [options] - those of `Receiver`; the
   *   folder that `load` takes; and a worker that runs this package's worker.js, in place of one
   *   that is started here
   * @throws {InputError} an argument is of a wrong type; those of `Receiver` are looked at in the worker
   */
  constructor(fps, onEvent, options = {}) {
    const { folder, worker, ...others } = options ?? {};
    const sound = typeof onEvent === "function" && options !== null && typeof options === "object";
    if (!sound || (worker !== undefined && typeof worker.postMessage !== "function")) {
      throw new InputError("argument", "give a function that takes events, and options, whose worker is a Worker");
    }
    const address = coded("argument", () => folder && new URL(folder, globalThis.location?.href).href);
    this.#onEvent = onEvent;
    this.#worker = worker ?? new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
    this.#worker.onmessage = ({ data: { result, error } }) => {
      const asked = this.#asked.shift();
      if (error) asked?.reject(new InputError(error.code, error.message));
      else asked?.resolve(result);
    };
    this.#worker.onerror = (event) => {
      const error = new InputError("load", event.message || "worker.js could not be loaded");
      for (const asked of this.#asked.splice(0)) asked.reject(error);
    };
    this.#reading = this.#run(this.#ask("start", [fps, others, address]).then(() => []));
  }

  /**
   * Hand over the next camera frame, and return at once. A `VideoFrame` is closed.
   *
   * @param {Frame} frame - must not change before the next one is handed over
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @throws {InputError} that of an earlier frame, or of loading, or it comes after `finish` or `close`
   */
  push(frame, time) {
    if (this.#failed) throw this.#failed;
    this.#drop();
    this.#waiting = { frame, time };
    if (!this.isBusy) this.#reading = this.#run(Promise.resolve([]));
  }

  /**
   * Read the frame that waits and all else, as `Receiver.finish`, and end the worker.
   *
   * @returns {Promise<void>} rejected with the error of an earlier frame
   */
  async finish() {
    await this.#reading;
    if (!this.#failed) await this.#run(this.#ask("finish", []));
    const failed = this.#failed;
    if (!failed) this.#explained = await this.explanation();
    this.close();
    if (failed) throw failed;
  }

  /** @returns {Promise<string>} what `Receiver.explanation` says, or why a frame could not be read */
  async explanation() {
    return this.#explained ?? this.#failed?.message ?? this.#ask("explanation", []);
  }

  /** End the worker, whatever it reads. */
  close() {
    this.#drop();
    this.#worker.terminate();
    this.#failed ??= new InputError("finished", "this receiver has finished; make a new one");
    for (const asked of this.#asked.splice(0)) asked.reject(this.#failed);
  }

  /** Let go of the frame that waits. */
  #drop() {
    if (!this.#waiting) return;
    if (isClosed(this.#waiting.frame)) this.#waiting.frame.close();
    this.#waiting = null;
    this.passedOver++;
  }

  /** @param {Promise<FilmEvent[]>} answer - is waited for before the frames that wait are read */
  async #run(answer) {
    this.isBusy = true;
    try {
      for (;;) {
        for (const event of await answer) this.#onEvent(event);
        if (!this.#waiting) break;
        const { frame, time } = this.#waiting;
        this.#waiting = null;
        answer = this.#ask("push", [frame, time], isClosed(frame) ? [frame] : []);
      }
    } catch (error) {
      const why = error instanceof Error ? error.message : String(error);
      this.#failed = error instanceof InputError ? error : new InputError("frame", why);
      this.#drop();
    }
    this.isBusy = false;
  }

  /**
   * @param {string} name - of a function of the worker
   * @param {unknown[]} given
   * @param {Transferable[]} [moved]
   * @returns {Promise<any>} its answer
   */
  #ask(name, given, moved = []) {
    return new Promise((resolve, reject) => {
      this.#worker.postMessage({ name, given }, moved);
      this.#asked.push({ resolve, reject });
    });
  }
}

/** @param {Frame} frame @returns {frame is VideoFrame} whether it is one that must be closed */
function isClosed(frame) {
  return typeof (/** @type {any} */ (frame)?.close) === "function";
}
