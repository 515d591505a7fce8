/** Decoders whose graphs run in another worker (decoding.js). */

/** @import { Plane } from "../image/opencv.js" */
/** @import { Layout } from "../link/layout.js" */

/**
 * To the other worker: load the graph of a preset, and decode a frame pair, where there is one. The
 * number is given back with the answer; it is 1 or more.
 *
 * @typedef {{ number: number, preset: number, pair: [Plane, Plane] | null }} DecodingRequest
 */

/**
 * From the other worker: the scores of a frame pair, if one was to be decoded; or why it failed.
 * The answer of number 0 comes first, unasked, when the worker can decode.
 *
 * @typedef {{ number: number, scores: Float32Array | null, reason: string | null }} DecodingAnswer
 */

/** The worker that runs the graphs. */
export class DecodingWorker {
  /** @type {Map<number, { resolve: (answer: DecodingAnswer) => void, reject: (e: Error) => void }>} */
  #waiting = new Map();
  #worker;
  #count = 0;
  /** @type {string | null} */
  #broken = null;

  /** @param {string} address - of its program */
  constructor(address) {
    this.#worker = new Worker(address, { type: "module" });
    this.#worker.onmessage = ({ data }) => this.#hear(data);
    this.#worker.onerror = (event) => {
      event.preventDefault();
      this.#broken = event.message || "the decoder's program could not be loaded";
      for (const { reject } of this.#waiting.values()) reject(new Error(this.#broken));
      this.#waiting.clear();
    };
    /** Resolves when the worker can decode; rejected where it cannot. @type {Promise<unknown>} */
    this.ready = this.#answerOf(0);
  }

  /**
   * Load the graph of a preset, and decode a frame pair, where there is one.
   *
   * @param {number} preset - number of the preset in presets.json
   * @param {[Plane, Plane] | null} pair - the rectified original and embedded frame
   * @returns {Promise<DecodingAnswer>}
   */
  ask(preset, pair) {
    const number = ++this.#count;
    const answer = this.#answerOf(number);
    this.#worker.postMessage(/** @type {DecodingRequest} */ ({ number, preset, pair }));
    return answer;
  }

  /** @param {number} number @returns {Promise<DecodingAnswer>} */
  #answerOf(number) {
    return new Promise((resolve, reject) => {
      if (this.#broken !== null) reject(new Error(this.#broken));
      else this.#waiting.set(number, { resolve, reject });
    });
  }

  /** @param {DecodingAnswer} answer */
  #hear(answer) {
    const waiting = this.#waiting.get(answer.number);
    this.#waiting.delete(answer.number);
    if (answer.reason === null) waiting?.resolve(answer);
    else waiting?.reject(new Error(answer.reason));
  }
}

/** A decoder of one layout, as a `Decoder` (../decoder.js). */
export class RemoteDecoder {
  /**
   * @param {Layout} layout - that it decodes
   * @param {number} preset - number of the preset in presets.json
   * @param {DecodingWorker} worker
   */
  constructor(layout, preset, worker) {
    this.layout = layout;
    this.preset = preset;
    this.worker = worker;
  }

  /** Load the graph, unless it is there. */
  async load() {
    await this.worker.ask(this.preset, null);
  }

  /**
   * Decode one frame pair.
   *
   * @param {Plane} original - rectified: the displayed picture fills it
   * @param {Plane} embedded - of the size of `original`
   * @returns {Promise<{ scores: Float32Array }>} (nBits,) scores
   */
  async decode(original, embedded) {
    const { scores } = await this.worker.ask(this.preset, [original, embedded]);
    if (scores === null) throw new Error("the decoder gave no scores");
    return { scores };
  }
}
