/**
 * Robust least squares: a few wrong measurements must not pull a fit away from the many right ones.
 *
 * Iteratively reweighted least squares (Holland & Welsch 1977) solves a weighted problem, looks at
 * the residuals, gives large ones less weight, and solves again.
 */

import { robust } from "../../generated/constants.js";
import { solve as solveLinear } from "./linear.js";

/** @typedef {import("./linear.js").Numbers} Numbers */

export const { MAD_TO_SIGMA } = robust;

/**
 * Minimise sum(weights * (b - A x)**2) + x' ridge x - 2 pull' x by the normal equations.
 *
 * @param {Numbers} A - (N, P), a row for each measurement
 * @param {Numbers} b - (N,) measurements
 * @param {Numbers} weights - (N,) weights, 0 or more
 * @param {Numbers} ridge - (P, P) positive semidefinite matrix that holds the solution where
 *   measurements do not determine it
 * @param {Numbers | null} [pull] - (P,) ridge times the solution that is expected beforehand; 0
 *   where absent
 * @returns {Float64Array} (P,)
 */
export function ridgeSolution(A, b, weights, ridge, pull = null) {
  const P = Math.round(Math.sqrt(ridge.length));
  const normal = Float64Array.from(ridge);
  const right = pull ? Float64Array.from(pull) : new Float64Array(P);
  for (let n = 0, start = 0; n < b.length; n++, start += P) {
    for (let i = 0; i < P; i++) {
      const weighed = weights[n] * A[start + i];
      if (weighed === 0) continue;
      right[i] += weighed * b[n];
      for (let j = i; j < P; j++) normal[i * P + j] += weighed * A[start + j];
    }
  }
  // only the upper half was added to; the lower half has the ridge's share alone
  for (let i = 0; i < P; i++) {
    for (let j = 0; j < i; j++) {
      normal[i * P + j] += normal[j * P + i] - ridge[j * P + i];
    }
  }
  return solveLinear(normal, right);
}

/**
 * Solve a least-squares problem again and again, with less weight on what fits badly.
 *
 * @template Solution
 * @param {object} problem
 * @param {(weights: Float64Array) => Solution} problem.solve - (N,) weights to the solution of
 *   the weighted problem
 * @param {(solution: Solution) => Float64Array} problem.residualsOf - a solution to the (N,)
 *   absolute residuals that it leaves
 * @param {(residuals: Float64Array) => number} problem.scaleOf - (N,) residuals to the residual
 *   that keeps half its weight (Cauchy's distribution), greater than 0
 * @param {number} problem.rounds - number of solutions, at least 1
 * @param {Float64Array} problem.weights - (N,) weights of the first round
 * @returns {{ solution: Solution, weights: Float64Array }} the last solution, and the (N,)
 *   weights that its residuals give
 */
export function reweighted({ solve, residualsOf, scaleOf, rounds, weights }) {
  for (let round = 1; ; round++) {
    const solution = solve(weights);
    const residuals = residualsOf(solution);
    const scale = scaleOf(residuals);
    weights = residuals.map((value) => 1 / (1 + (value / scale) ** 2));
    if (round >= rounds) return { solution, weights };
  }
}
