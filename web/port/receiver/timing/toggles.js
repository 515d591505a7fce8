/**
 * How much more the pilots of bit 1 stand out than those of bit 0, over the parts of a display.
 */

import { receiverTimingToggles } from "../../../generated/constants.js";
import { pilotSigns, pilotValues } from "../../link/pilots.js";

const { LEAST_VARIANCE } = receiverTimingToggles;

/**
 * Toggles of pilots, averaged over the parts of the display.
 *
 * Pilots whose blocks vary much, because the picture is steep there, weigh less. All frames of a
 * window get the same weights, and each pilot is taken less its mean. Otherwise what it shows of the
 * picture itself, which is far more than it toggles, would change with the weights.
 */
export class PilotToggles {
  #signs;

  /** @param {Layout} layout - of the display */
  constructor(layout) {
    this.layout = layout;
    /** (P, 2) x and y of the parts on the display, in [0, 1]. */
    this.places = layout.partPlaces;
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
    const { parts } = this.layout;
    const weights = new Float64Array(this.places.length / 2);
    const factors = new Float64Array(parts.length);
    const means = factors.map((_, pilot) => {
      const mean = values.reduce((sum, frame) => sum + frame[pilot], 0) / values.length;
      const square = values.reduce((sum, frame) => sum + (frame[pilot] - mean) ** 2, 0);
      const weight = 1 / (square / values.length + LEAST_VARIANCE);
      weights[parts[pilot]] += weight;
      factors[pilot] = 2 * this.#signs[pilot] * weight;
      return mean;
    });
    return values.map((frame) => {
      const sums = new Float64Array(weights.length);
      parts.forEach((part, pilot) => {
        sums[part] += factors[pilot] * (frame[pilot] - means[pilot]);
      });
      return sums.map((sum, part) => sum / weights[part]);
    });
  }
}
