/**
 * Small linear algebra on flat arrays, row by row.
 *
 * @typedef {ArrayLike<number>} Numbers
 */

/**
 * Solve A x = b by Gaussian elimination with partial pivoting.
 *
 * @param {Numbers} A - (n, n)
 * @param {Numbers} b - (n,)
 * @returns {Float64Array} (n,); not finite where A is singular
 */
export function solve(A, b) {
  return eliminated(A, b, b.length, 1);
}

/**
 * Invert a matrix.
 *
 * @param {Numbers} A - (n, n)
 * @returns {Float64Array} (n, n); not finite where A is singular
 */
export function inverse(A) {
  const n = Math.round(Math.sqrt(A.length));
  return eliminated(A, identity(n), n, n);
}

/**
 * Make an identity matrix.
 *
 * @param {number} n
 * @returns {Float64Array} (n, n)
 */
export function identity(n) {
  const matrix = new Float64Array(n * n);
  for (let i = 0; i < n; i++) matrix[i * n + i] = 1;
  return matrix;
}

/**
 * Multiply two matrices of three rows and columns.
 *
 * @param {Numbers} A - (3, 3)
 * @param {Numbers} B - (3, 3)
 * @returns {Float64Array} (3, 3)
 */
export function multiply3(A, B) {
  const product = new Float64Array(9);
  for (let row = 0; row < 9; row += 3) {
    for (let col = 0; col < 3; col++) {
      product[row + col] = A[row] * B[col] + A[row + 1] * B[3 + col] + A[row + 2] * B[6 + col];
    }
  }
  return product;
}

/**
 * Bring a matrix to the identity, and do the same to right-hand sides.
 *
 * @param {Numbers} A - (n, n)
 * @param {Numbers} B - (n, m)
 * @param {number} n
 * @param {number} m
 */
function eliminated(A, B, n, m) {
  const left = Float64Array.from(A);
  const right = Float64Array.from(B);
  for (let at = 0; at < n; at++) {
    let pivot = at;
    for (let row = at + 1; row < n; row++) {
      if (Math.abs(left[row * n + at]) > Math.abs(left[pivot * n + at])) pivot = row;
    }
    if (pivot !== at) {
      swapRows(left, n, at, pivot);
      swapRows(right, m, at, pivot);
    }
    const top = left[at * n + at];
    for (let row = at + 1; row < n; row++) {
      const factor = left[row * n + at] / top;
      if (factor === 0) continue;
      for (let col = at; col < n; col++) left[row * n + col] -= factor * left[at * n + col];
      for (let col = 0; col < m; col++) right[row * m + col] -= factor * right[at * m + col];
    }
  }
  for (let at = n - 1; at >= 0; at--) {
    for (let col = 0; col < m; col++) {
      let sum = right[at * m + col];
      for (let k = at + 1; k < n; k++) sum -= left[at * n + k] * right[k * m + col];
      right[at * m + col] = sum / left[at * n + at];
    }
  }
  return right;
}

/**
 * @param {Float64Array} matrix
 * @param {number} cols
 * @param {number} one
 * @param {number} other
 */
function swapRows(matrix, cols, one, other) {
  for (let col = 0; col < cols; col++) {
    const kept = matrix[one * cols + col];
    matrix[one * cols + col] = matrix[other * cols + col];
    matrix[other * cols + col] = kept;
  }
}

/**
 * Add up the products of two arrays.
 *
 * @param {Numbers} a
 * @param {Numbers} b - of its length
 * @param {number} from - first index
 * @param {number} to - index after the last
 */
export function dot(a, b, from = 0, to = a.length) {
  // four sums, because each addition waits for the one before it
  let [one, two, three, four] = [0, 0, 0, 0];
  let at = from;
  for (; at + 3 < to; at += 4) {
    one += a[at] * b[at];
    two += a[at + 1] * b[at + 1];
    three += a[at + 2] * b[at + 2];
    four += a[at + 3] * b[at + 3];
  }
  for (; at < to; at++) one += a[at] * b[at];
  return one + two + (three + four);
}
