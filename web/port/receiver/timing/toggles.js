/**
 * How much what is known to toggle differs from what is known not to, or to toggle the other way.
 *
 * Of ratex patches these are tiles of label 1 and their twins of label 0; of layouts without
 * patches these are pilots of bit 1 and of bit 0.
 */

import { receiverTimingToggles } from "../../../generated/constants.js";
import { CLEAR_MATCH, matchPatches } from "../../link/ratex.js";
import { pilotSigns, pilotValues } from "../../link/pilots.js";

export const { PARTS, LEAST_VARIANCE } = receiverTimingToggles;

/**
 * Measures the toggling at some places of the display, from which its clock is found: `places`
 * (P, 2) in [0, 1]; what a rectified frame shows of the toggling, (V,) values; and the toggles (P,)
 * of n frames, in gray levels, from their values.
 *
 * @typedef {{
 *   places: Float64Array,
 *   measure: (rectified: BytePlane) => Float64Array,
 *   overTime: (values: Float64Array[]) => Float64Array[],
 * }} Toggles
 */

/** Toggles of the ratex patches. */
export class PatchToggles {
  /** @param {Layout} layout - with at least one patch */
  constructor(layout) {
    this.layout = layout;
    /** (P, 2) x and y on the display, in [0, 1]. */
    this.places = Float64Array.from(
      layout.ratex.flatMap(([row, col]) => [(col + 0.5) / layout.cols, (row + 0.5) / layout.rows]),
    );
  }

  /**
   * Measure how much brighter tiles of label 1 are than their twins of label 0, in each patch.
   *
   * No change of exposure can mimic this, because both tiles of a pair of twins show the same
   * intensity.
   *
   * @param {BytePlane} rectified
   * @returns {Float64Array} (patches,) in displayed gray levels, as the patch's own contrast tells;
   *   NaN where something covers the patch
   */
  measure(rectified) {
    const { captured, shown, label, correlation } = matchPatches(rectified, this.layout);
    const tiles = captured.length / correlation.length;
    return correlation.map((like, patch) => {
      if (!(like > CLEAR_MATCH)) return NaN;
      let [both, drawn, toggled] = [0, 0, 0];
      for (let at = patch * tiles; at < (patch + 1) * tiles; at++) {
        both += captured[at] * shown[at];
        drawn += shown[at] ** 2;
        toggled += captured[at] * (2 * label[at] - 1);
      }
      return (2 * toggled) / tiles / (both / drawn);
    });
  }

  /**
   * Return the toggles of some frames as they are.
   *
   * @param {Float64Array[]} values
   */
  overTime(values) {
    return values;
  }
}

/**
 * Toggles of pilots, averaged over the parts of the display.
 *
 * Pilots whose blocks vary much, because the picture is steep there, weigh less. All frames of a
 * window get the same weights, and each pilot is taken less its mean. Otherwise what it shows of the
 * picture itself, which is far more than it toggles, would change with the weights.
 */
export class PilotToggles {
  #part;
  #signs;

  /** @param {Layout} layout - with pilots */
  constructor(layout) {
    this.layout = layout;
    const rows = Math.min(PARTS[0], layout.rows);
    const cols = Math.min(PARTS[1], layout.cols);
    const parts = Array.from(layout.pilotBlocks, (block) => {
      const row = Math.floor(block / layout.cols);
      const col = block % layout.cols;
      const across = Math.floor((col * cols) / layout.cols);
      return Math.floor((row * rows) / layout.rows) * cols + across;
    });
    const taken = [...new Set(parts)].sort((one, two) => one - two);
    this.#part = Int32Array.from(parts, (part) => taken.indexOf(part));
    /** (P, 2) x and y on the display, in [0, 1]. */
    this.places = Float64Array.from(
      taken.flatMap((part) => [
        ((part % cols) + 0.5) / cols,
        (Math.floor(part / cols) + 0.5) / rows,
      ]),
    );
    this.#signs = pilotSigns(layout);
  }

  /**
   * Measure how much each of the (pilots,) stands out in a rectified frame, in captured gray levels.
   *
   * @param {BytePlane} rectified
   */
  measure(rectified) {
    return Float64Array.from(pilotValues(rectified, this.layout));
  }

  /**
   * Average the values of n frames: n times (P,) toggles, in captured gray levels.
   *
   * @param {Float64Array[]} values - n times (pilots,)
   */
  overTime(values) {
    const weights = new Float64Array(this.places.length / 2);
    const factors = new Float64Array(this.#part.length);
    const means = factors.map((_, pilot) => {
      const mean = values.reduce((sum, frame) => sum + frame[pilot], 0) / values.length;
      const square = values.reduce((sum, frame) => sum + (frame[pilot] - mean) ** 2, 0);
      const weight = 1 / (square / values.length + LEAST_VARIANCE);
      weights[this.#part[pilot]] += weight;
      factors[pilot] = 2 * this.#signs[pilot] * weight;
      return mean;
    });
    return values.map((frame) => {
      const sums = new Float64Array(weights.length);
      this.#part.forEach((part, pilot) => {
        sums[part] += factors[pilot] * (frame[pilot] - means[pilot]);
      });
      return sums.map((sum, part) => sum / weights[part]);
    });
  }
}

/**
 * Make what measures the toggling of a layout with patches or pilots.
 *
 * @param {Layout} layout
 * @returns {Toggles}
 */
export function makeToggles(layout) {
  return layout.pilotBlocks.length > 0 ? new PilotToggles(layout) : new PatchToggles(layout);
}
