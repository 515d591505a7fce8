/** An image that is looked at coarsely. */

import { resizedHomography } from "../link/geometry.js";
import { inverse, multiply3 } from "../link/linear.js";
import { areaMeans } from "./shrink.js";
import { warpedFloats } from "./warp.js";

/** An image, and its copies that were averaged down by whole factors, without rounding. */
export class Copies {
  /** @type {Map<number, FloatPlane>} */
  #copies = new Map();

  /** @param {BytePlane} image - is kept */
  constructor(image) {
    this.image = image;
  }

  /**
   * Sample the image, averaged down, where a homography leads.
   *
   * @param {ArrayLike<number>} H - from pixels of the result to pixels of the image
   * @param {number} factor - whole, by which the image is averaged down; below 2 it is not
   * @param {number} width - of the result
   * @param {number} height - of the result
   */
  sampled(H, factor, width, height) {
    const { image } = this;
    if (factor < 2) return warpedFloats(image, H, width, height);
    const [across, down] = [image.width, image.height].map((side) => Math.floor(side / factor));
    const copy = this.#copies.get(factor) ?? areaMeans(image, across, down);
    this.#copies.set(factor, copy);
    const HImageFromCopy = resizedHomography(image.width / across, image.height / down);
    return warpedFloats(copy, multiply3(inverse(HImageFromCopy), H), width, height);
  }
}

/**
 * Make a function of an image that keeps its results as long as the image's pixels are there.
 *
 * @template Result
 * @param {(image: BytePlane) => Result} work
 * @returns {(image: BytePlane) => Result}
 */
export function keptWithImage(work) {
  return kept(work, ({ data }) => data);
}

/**
 * Make a function that keeps its results as long as a part of what it is given is there.
 *
 * @template Given, Result
 * @param {(given: Given) => Result} work
 * @param {(given: Given) => object} [part] - the whole of it where absent
 * @returns {(given: Given) => Result}
 */
export function kept(work, part = (given) => /** @type {object} */ (given)) {
  /** @type {WeakMap<object, { result: Result }>} */
  const known = new WeakMap();
  return (given) => {
    const found = known.get(part(given)) ?? { result: work(given) };
    known.set(part(given), found);
    return found.result;
  };
}
