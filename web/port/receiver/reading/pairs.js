/** Score frame pairs one by one: each has two states, put together from camera frames. */

import { modelsPairwise } from "../../../generated/constants.js";
import { Occlusion } from "./occlusion.js";
import { blockPurity } from "./states.js";
import { fillUnseen, unseenBlocks } from "./unseen.js";

/** @typedef {import("../sight.js").StageTimes} StageTimes */
/** @typedef {import("./states.js").DisplayState} DisplayState */

export const { PURE_FROM, PURE_TO } = modelsPairwise;

/**
 * What decodes frame pairs of one layout, such as a `Decoder`. It may be loaded beforehand.
 *
 * @typedef {object} PairDecoder
 * @property {Layout} layout
 * @property {(original: BytePlane, embedded: BytePlane) => Promise<{ scores: ArrayLike<number> }>}
 *   decode
 * @property {() => Promise<void>} [load]
 */

/**
 * A frame pair that is over on the display and waits to be decoded, with `moved` of its frames.
 *
 * @typedef {{
 *   number: number,
 *   original: DisplayState,
 *   embedded: DisplayState,
 *   moved: (Float64Array | null)[],
 * }} ComposedPair
 */

/** Scores the frame pairs of one display by their two states. */
export class PairScorer {
  #decoder;
  #timing;
  #occlusion;

  /**
   * @param {PairDecoder} decoder - of the display's layout
   * @param {StageTimes} timing - takes the time spent in decoding
   */
  constructor(decoder, timing) {
    this.#decoder = decoder;
    this.#timing = timing;
    this.#occlusion = new Occlusion(decoder.layout);
  }

  /**
   * Decode the two states of a pair, and erase what is covered or impure.
   *
   * @param {ComposedPair} pair
   */
  async score(pair) {
    return this.withoutCovered(pair, await this.scoreStates(pair));
  }

  /**
   * Decode the two states of a pair, whatever covers them, and erase what is impure.
   *
   * @param {ComposedPair} pair
   * @returns {Promise<Float64Array>} (nBits,) scores
   */
  async scoreStates(pair) {
    const start = performance.now();
    const { layout } = this.#decoder;
    const images = [pair.original.image, pair.embedded.image];
    const unseen = unseenBlocks(purityOf(pair), layout);
    const [first, second] = fillUnseen(images, unseen, layout);
    const soft = await this.#decoder.decode(first, second);
    const scores = this.trust(pair).map((trust, bit) => soft.scores[bit] * trust);
    this.#timing.add("decode", start);
    return scores;
  }

  /**
   * Say how far each block's states are pure enough to be told apart.
   *
   * @param {ComposedPair} pair
   * @returns {Float64Array} (nBits,) in [0, 1]
   */
  trust(pair) {
    return blockPurity(purityOf(pair), this.#decoder.layout).map((pure) =>
      Math.min(Math.max((pure - PURE_FROM) / (PURE_TO - PURE_FROM), 0), 1),
    );
  }

  /**
   * Erase what something in front of the display covers; a pair is asked about once.
   *
   * @param {ComposedPair} pair
   * @param {Float32Array | Float64Array} scores
   */
  withoutCovered({ original }, scores) {
    const covered = this.#occlusion.covered(original.image);
    return Float64Array.from(scores, (score, bit) => (covered[bit] ? 0 : score));
  }
}

/** @param {ComposedPair} pair */
function purityOf({ original, embedded }) {
  return original.purity.map((share, at) => Math.min(share, embedded.purity[at]));
}
