/** What Python's tests cannot send to the page's solver: functions that it calls. */

import { median } from "../port/link/order.js";
import { reweighted, ridgeSolution } from "../port/link/robust.js";

/**
 * Solve for three unknowns with weights scaled by three median residuals.
 *
 * @param {Float64Array} A - three numbers for each equation
 * @param {Float64Array} b
 * @param {Float64Array} ridge - (3, 3)
 * @param {Float64Array} pull - (3,)
 * @param {number} rounds
 */
export function solvedRobustly(A, b, ridge, pull, rounds) {
  return reweighted({
    solve: (weights) => ridgeSolution(A, b, weights, ridge, pull),
    residualsOf: (x) =>
      b.map((value, i) =>
        Math.abs(value - A[3 * i] * x[0] - A[3 * i + 1] * x[1] - A[3 * i + 2] * x[2]),
      ),
    scaleOf: (residuals) => 3 * median(residuals),
    rounds,
    weights: new Float64Array(b.length).fill(1),
  });
}
