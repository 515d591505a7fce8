/**
 * OpenCV for JavaScript, and the memory of its matrices.
 *
 * OpenCV's matrices live in the memory of WebAssembly, which no garbage collector frees. So
 * they live within `withMats` only; functions take and return planes, which are ordinary arrays.
 */

import opencv from "@techstark/opencv-js";

/**
 * One channel of an image, row by row.
 *
 * @template {Uint8Array | Float32Array} [Samples=Uint8Array]
 * @typedef {{ width: number, height: number, data: Samples }} Plane
 */

/**
 * The library; it is there once `loadOpenCv` has resolved.
 *
 * @type {any}
 */
export let cv;

/**
 * Load OpenCV; every function that handles images needs it.
 *
 * @returns {Promise<void>}
 */
export async function loadOpenCv() {
  if (cv) return;
  // the library has a method `then`, and to wait for it as for a promise would never end
  await new Promise((resolve) => {
    /** @type {any} */ (opencv).then(() => resolve(undefined));
  });
  cv = opencv;
}

/**
 * Run some work, and free the matrices that it kept.
 *
 * @template Result
 * @param {(keep: <Kept extends { delete(): void }>(mat: Kept) => Kept) => Result} work - takes a
 *   function to which it hands each matrix (or vector of matrices) that it makes
 * @returns {Result}
 */
export function withMats(work) {
  /** @type {{ delete(): void }[]} */
  const kept = [];
  try {
    return work((mat) => {
      kept.push(mat);
      return mat;
    });
  } finally {
    for (const mat of kept) mat.delete();
  }
}

/**
 * Copy a plane into a new matrix, which the caller frees.
 *
 * @param {Plane<Uint8Array | Float32Array>} plane
 * @returns {any} a matrix of one channel, of 8 bits or of 32-bit floats
 */
export function matOf(plane) {
  const type = plane.data instanceof Uint8Array ? cv.CV_8UC1 : cv.CV_32FC1;
  const mat = new cv.Mat(plane.height, plane.width, type);
  (plane.data instanceof Uint8Array ? mat.data : mat.data32F).set(plane.data);
  return mat;
}

/**
 * Copy a matrix of 8 bits and one channel.
 *
 * @param {any} mat
 * @returns {Plane<Uint8Array>}
 */
export function bytePlane(mat) {
  return { width: mat.cols, height: mat.rows, data: new Uint8Array(mat.data) };
}

/**
 * Copy a matrix of 32-bit floats and one channel.
 *
 * @param {any} mat
 * @returns {Plane<Float32Array>}
 */
export function floatPlane(mat) {
  return { width: mat.cols, height: mat.rows, data: new Float32Array(mat.data32F) };
}
