/**
 * OpenCV as WebAssembly, with just the functions that the receiver needs (web/host/opencv/opencv.cpp).
 *
 * The library has a memory of its own. `call` copies arguments into it, and results out of it; so
 * all that others see of it are planes and lists of numbers, which are ordinary arrays.
 */

/** @typedef {Uint8Array | Int32Array | Float32Array | Float64Array} Numbers */

/**
 * One channel of an image, row by row.
 *
 * @template {Numbers} [Samples=Uint8Array]
 * @typedef {{ width: number, height: number, data: Samples }} Plane
 */

/** OpenCV's numbers of the types of samples. @type {Map<Function, number>} */
const TYPES = new Map([
  /** @type {[Function, number]} */ ([Uint8Array, 0]),
  [Int32Array, 4],
  [Float32Array, 5],
  [Float64Array, 6],
]);
/** Size of what is written before the samples of an argument, in bytes, and unit of its size. */
const UNIT = 16;
/**
 * System calls that the library imports. The clock stands still. There are no files: every other
 * call returns WASI's error code 8, for a file number that is unknown.
 */
const SYSTEM = new Proxy({}, { get: (_, name) => () => (name === "clock_time_get" ? 0 : 8) });

/** @type {any} */
let library = null;

/**
 * Load OpenCV; every function that handles images needs it.
 *
 * @param {Response | Uint8Array<ArrayBuffer>} wasm - the file opencv.wasm
 * @returns {Promise<void>}
 */
export async function loadOpenCv(wasm) {
  if (library) return;
  const needed = { env: SYSTEM, wasi_snapshot_preview1: SYSTEM };
  // compiled while it comes, and kept compiled, where the host says what it is
  const { instance } =
    wasm instanceof Response && wasm.headers.get("Content-Type") === "application/wasm"
      ? await WebAssembly.instantiateStreaming(wasm, needed)
      : await WebAssembly.instantiate(
          wasm instanceof Response ? await wasm.arrayBuffer() : wasm,
          needed,
        );
  library = instance.exports;
  library._initialize();
}

/**
 * Call a function of opencv.cpp.
 *
 * @param {string} name
 * @param {(number | null | Numbers | Plane<Numbers>)[]} given - all that it takes but its results
 * @param {(Numbers | Plane<Numbers>)[]} [results] - are filled; what they held is not seen
 * @returns {number} what it returns
 */
export function call(name, given, results = []) {
  const planes = [...given, ...results].map((value) =>
    ArrayBuffer.isView(value) ? { width: value.length, height: 1, data: value } : value,
  );
  const sizes = planes.map((plane) =>
    isNumber(plane) ? 0 : UNIT * (1 + Math.ceil(plane.data.byteLength / UNIT)),
  );
  let free = library.room(sizes.reduce((sum, size) => sum + size, 0));
  const { buffer } = library.memory;
  const places = planes.map((plane, i) => {
    if (isNumber(plane)) return plane;
    const place = free;
    const { width, height, data } = plane;
    const type = TYPES.get(data.constructor);
    new Int32Array(buffer, place, 4).set([place + UNIT, Number(type), width, height]);
    if (i < given.length) new Uint8Array(buffer, place + UNIT, data.byteLength).set(bytesOf(data));
    free += sizes[i];
    return place;
  });
  const answer = library[name](...places);
  planes.forEach((plane, i) => {
    if (i < given.length || isNumber(plane)) return;
    const { data } = plane;
    const { buffer } = library.memory; // it may have grown
    bytesOf(data).set(new Uint8Array(buffer, Number(places[i]) + UNIT, data.byteLength));
  });
  return answer;
}

/**
 * Call a function of opencv.cpp that has one result.
 *
 * @template {Numbers | Plane<Numbers>} Result
 * @param {string} name
 * @param {(number | null | Numbers | Plane<Numbers>)[]} given - all that it takes but its result
 * @param {Result} result - is filled; what it held is not seen
 * @returns {Result} the same
 */
export function filled(name, given, result) {
  call(name, given, [result]);
  return result;
}

/** @param {number | null | Plane<Numbers>} value */
function isNumber(value) {
  return value === null || typeof value === "number";
}

/** @param {Numbers} data */
function bytesOf({ buffer, byteOffset, byteLength }) {
  return new Uint8Array(buffer, byteOffset, byteLength);
}

/**
 * Make a plane of 32-bit floats, all 0.
 *
 * @param {number} width
 * @param {number} height
 * @returns {Plane<Float32Array<ArrayBuffer>>}
 */
export function floatPlane(width, height) {
  return { width, height, data: new Float32Array(width * height) };
}

/**
 * Make a plane of bytes, all 0.
 *
 * @param {number} width
 * @param {number} height
 * @returns {Plane<Uint8Array<ArrayBuffer>>}
 */
export function bytePlane(width, height) {
  return { width, height, data: new Uint8Array(width * height) };
}

/**
 * Make a plane whose samples are of another's type, all 0.
 *
 * @template {Uint8Array | Float32Array} Samples
 * @param {Plane<Samples>} plane
 * @param {number} width
 * @param {number} height
 * @returns {Plane<Samples>}
 */
export function planeLike({ data }, width, height) {
  const make = data instanceof Uint8Array ? bytePlane : floatPlane;
  return /** @type {any} */ (make(width, height));
}

/**
 * Write arrays one below the other.
 *
 * @template {Numbers} [Samples=Float32Array<ArrayBuffer>]
 * @param {readonly ArrayLike<number>[]} arrays - of one length
 * @param {new (length: number) => Samples} [Type] - of the samples
 * @returns {Plane<Samples>} a row for each
 */
export function rowsOf(arrays, Type = /** @type {any} */ (Float32Array)) {
  const width = arrays[0].length;
  const height = arrays.length;
  const data = new Type(width * height);
  arrays.forEach((values, i) => data.set(values, i * width));
  return { width, height, data };
}

/**
 * Take the rows of a plane, as `rowsOf` writes them.
 *
 * @param {Plane<Float32Array>} plane - whose samples the rows share
 * @returns {Float32Array[]}
 */
export function arraysOf({ width, height, data }) {
  return Array.from({ length: height }, (_, y) => data.subarray(y * width, (y + 1) * width));
}
