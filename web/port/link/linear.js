/**
 * Small linear algebra on flat arrays, row by row.
 *
 * @typedef {ArrayLike<number>} Numbers
 * @typedef {{ real: Numbers, imaginary: Numbers }} Complex - numbers of one length
 */

/** Share of a vector's length that must be new to those before it for it to count beside them. */
const NEW_SHARE = 1e-6;

/**
 * Solve A x = b by elimination with partial pivoting.
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
 * Eliminate the unknowns of A X = B (Gauss and Jordan).
 *
 * @param {Numbers} A - (n, n)
 * @param {Numbers} B - (n, m)
 * @param {number} n
 * @param {number} m
 * @returns {Float64Array} X (n, m)
 */
function eliminated(A, B, n, m) {
  const rows = Array.from({ length: n }, (_, row) =>
    Float64Array.from({ length: n + m }, (_, col) =>
      col < n ? A[row * n + col] : B[row * m + col - n],
    ),
  );
  for (let at = 0; at < n; at++) {
    let pivot = at;
    for (let row = at + 1; row < n; row++) {
      if (Math.abs(rows[row][at]) > Math.abs(rows[pivot][at])) pivot = row;
    }
    [rows[at], rows[pivot]] = [rows[pivot], rows[at]];
    rows.forEach((row, other) => {
      if (other !== at) takeOff(row, rows[at], row[at] / rows[at][at]);
    });
  }
  return Float64Array.from({ length: n * m }, (_, at) => {
    const row = Math.floor(at / m);
    return rows[row][n + (at % m)] / rows[row][row];
  });
}

/**
 * Add up the products of two arrays.
 *
 * @param {Numbers} a
 * @param {Numbers} b - of its length, or longer
 */
export function dot(a, b) {
  // four sums, because each addition waits for the one before it
  let [one, two, three, four] = [0, 0, 0, 0];
  let at = 0;
  for (; at + 3 < a.length; at += 4) {
    one += a[at] * b[at];
    two += a[at + 1] * b[at + 1];
    three += a[at + 2] * b[at + 2];
    four += a[at + 3] * b[at + 3];
  }
  for (; at < a.length; at++) one += a[at] * b[at];
  return one + two + (three + four);
}

/**
 * Add up the products of complex numbers.
 *
 * @param {Complex} a
 * @param {Complex} b - of their length
 * @returns {[number, number]} real and imaginary part
 */
export function complexDot(a, b) {
  return [
    dot(a.real, b.real) - dot(a.imaginary, b.imaginary),
    dot(a.real, b.imaginary) + dot(a.imaginary, b.real),
  ];
}

/**
 * Find the variance of a sum of numbers, each times a factor.
 *
 * @param {Float64Array} covariance - (n, n) of the numbers
 * @param {Float64Array} factors - (n,)
 */
export function varianceAlong(covariance, factors) {
  const n = factors.length;
  return factors.reduce((sum, factor, row) => {
    return sum + factor * dot(factors, covariance.subarray(row * n, (row + 1) * n));
  }, 0);
}

/**
 * Take a multiple of another vector off a vector, in place.
 *
 * @param {Float64Array} vector
 * @param {Float64Array} other
 * @param {number} factor
 */
export function takeOff(vector, other, factor) {
  for (let at = 0; at < vector.length; at++) vector[at] -= factor * other[at];
  return vector;
}

/**
 * Take off a vector, in place, what lies in the span of others.
 *
 * @param {Float64Array} vector
 * @param {Float64Array[]} basis - orthonormal
 */
export function takeOffBasis(vector, basis) {
  for (const other of basis) takeOff(vector, other, dot(vector, other));
  return vector;
}

/**
 * Find an orthonormal basis of the span of vectors (Gram and Schmidt).
 *
 * @param {Float64Array[]} vectors - are changed; what is hardly new in one after those before is
 *   left out
 */
export function orthonormal(vectors) {
  /** @type {Float64Array[]} */
  const basis = [];
  for (const vector of vectors) {
    const before = Math.hypot(...vector);
    // twice, because once leaves errors where vectors are nearly alike
    takeOffBasis(takeOffBasis(vector, basis), basis);
    const left = Math.hypot(...vector);
    if (left > NEW_SHARE * before) basis.push(vector.map((value) => value / left));
  }
  return basis;
}
