/** Pictures that carry the message. */

import {
  images, placement, senderCarrying, senderCompact, senderPictures,
} from "../../generated/constants.js";
import { interpolated } from "../image/interpolated.js";
import { roundHalfEven } from "../image/round.js";
import { InputError } from "../link/errors.js";

/** @import { Picture } from "../link/strength.js" */

const { BYTES_PER_PIXEL, MAX_MEGAPIXELS, MIN_SIDE_PX, SPARE_BYTES } = images;
const { MAX_ASPECT, USUAL_DISPLAY } = placement;
const { MAX_FILM_BYTES } = senderCompact;
/** Gray levels by which a pixel may come back otherwise than it was drawn: some browsers add noise. */
const NOISE = 2;
const MAX_BYTES = 1e6 * MAX_MEGAPIXELS * BYTES_PER_PIXEL + SPARE_BYTES;

/**
 * Open a file as a picture, in the colours of sRGB.
 *
 * @param {Blob} file
 * @param {number[]} least - width and height of the preset's layout
 * @returns {Promise<{ still: ImageBitmap, note: string }>} the picture, and what is to be said of it
 * @throws {InputError} it is no picture that can be shown
 */
export async function openPicture(file, least) {
  if (file.size > MAX_BYTES) throw new InputError("This file is too large for a picture.");
  if (/svg|xml/.test(file.type)) throw new InputError("Drawings (SVG) are not read. Save it as PNG.");
  const image = new Image();
  return opened(file, image, "onload", "This file is no picture that this browser can read.", async () => {
    const { naturalWidth: width, naturalHeight: height } = image; // known before pixels are decoded
    check(width, height);
    const coarse = sizeOf({ width, height }, least)[0] / width >= senderPictures.COARSE;
    const notes = [
      (await isAnimated(file)) ? "Only the first picture of this animation is shown." : "",
      coarse ? "This picture is small, and looks coarse." : "",
    ];
    const still = await shrunk(await createImageBitmap(file));
    return { still, note: notes.filter(Boolean).join(" ") };
  });
}

/**
 * Have the browser open a file in an element, and take from it what is wanted.
 *
 * @template Result
 * @param {Blob} file
 * @param {HTMLImageElement | HTMLVideoElement} element
 * @param {"onload" | "onloadeddata"} event - tells that it is open
 * @param {string} refusal - is said where the browser cannot open it
 * @param {() => Promise<Result>} take
 * @returns {Promise<Result>}
 */
async function opened(file, element, event, refusal, take) {
  element.src = URL.createObjectURL(file);
  try {
    await new Promise((resolve, reject) => Object.assign(element, { [event]: resolve, onerror: reject }));
    return await take();
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError(refusal);
  } finally {
    URL.revokeObjectURL(element.src);
  }
}

/** @param {Blob} file @returns {Promise<boolean>} whether it is an animated GIF, PNG, WebP or AVIF */
async function isAnimated(file) {
  const text = new TextDecoder("latin1").decode(await file.slice(0, 2 ** 23).arrayBuffer());
  const kind = /^(?:GIF8|.PNG|RIFF....WEBP|....ftypavis)/s.exec(text)?.[0] ?? "";
  if (kind === "GIF8") return (text.match(/\x21\xf9\x04....\0[\x21\x2c]/gs) ?? []).length > 1;
  return /PNG/.test(kind) ? text.includes("acTL") : /WEBP/.test(kind) ? text.includes("ANIM") : kind !== "";
}

/**
 * Open a file as a film.
 *
 * @param {File} film
 * @returns {Promise<{ film: File, size: number[], still: ImageBitmap }>} the film, its width and
 *   height in pixels, and its first picture
 * @throws {InputError} it is no film that can be shown
 */
export async function openFilm(film) {
  if (film.size > MAX_FILM_BYTES) throw new InputError("This file is too large for a film.");
  const video = document.createElement("video");
  Object.assign(video, { muted: true, preload: "auto" });
  return opened(film, video, "onloadeddata", "This file is no film that this browser can play.", async () => {
    const size = [video.videoWidth, video.videoHeight];
    check(size[0], size[1]);
    return { film, size, still: await createImageBitmap(video) };
  });
}

/** @param {number} width - in pixels @param {number} height */
function check(width, height) {
  if (width * height > 1e6 * MAX_MEGAPIXELS) {
    const size = `${Math.round((width * height) / 1e6)} million pixels`;
    throw new InputError(`This picture has ${size}, and ${MAX_MEGAPIXELS} are the most.`);
  }
  if (Math.min(width, height) < MIN_SIDE_PX) throw new InputError("This picture is too small.");
  if (Math.max(width, height) > MAX_ASPECT * Math.min(width, height)) {
    throw new InputError(`This picture is longer than ${MAX_ASPECT} to 1. Crop it.`);
  }
}

/**
 * Shrink a picture once that is larger than the usual display, as no more of it is shown.
 *
 * @param {ImageBitmap} given
 */
async function shrunk(given) {
  const [width, height] = sizeOf(given, [0, 0]);
  if (width >= given.width - 1 && height >= given.height - 1) return given; // but for odd sides
  const size = { resizeWidth: width, resizeHeight: height };
  return createImageBitmap(given, { ...size, resizeQuality: "high" }).finally(() => given.close());
}

/**
 * Choose the size of a picture as `usual_size` of link/placement.py does.
 *
 * @param {{ width: number, height: number }} given
 * @param {number[]} least - width and height of the preset's layout
 */
export function sizeOf({ width, height }, least) {
  const [short, long] = [width, height].sort((a, b) => a - b);
  const enough = Math.max(Math.max(...least) / long, Math.min(...least) / short);
  const scale = Math.max(enough, Math.min(1, USUAL_DISPLAY[0] / long, USUAL_DISPLAY[1] / short));
  return [width, height].map((side) => 2 * roundHalfEven((scale * side) / 2));
}

/**
 * Make sure that a canvas gives what was drawn on it. Browsers that guard against fingerprints may
 * give white or noise.
 *
 * @param {CanvasRenderingContext2D} context
 * @throws {InputError} it gives something else
 */
function checkCanvas(context) {
  const colours = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [40, 90, 160], [0, 0, 0], [200, 120, 30]];
  colours.forEach((colour, x) => {
    context.fillStyle = `rgb(${colour})`;
    context.fillRect(x, 0, 1, 1);
  });
  const refused = new InputError(
    "This browser gives pages other pixels than those of a picture, to guard against being " +
      "recognised. Allow this page to read canvases, or take another browser.",
  );
  let given;
  try {
    given = context.getImageData(0, 0, colours.length, 1).data;
  } catch {
    throw refused;
  }
  const isTrue = colours.flat().every((level, i) => Math.abs(given[4 * Math.floor(i / 3) + (i % 3)] - level) <= NOISE);
  if (!isTrue) throw refused;
}

/**
 * Work out which share of a frame pair's bits comes through over a picture (sender/carrying.py).
 *
 * @param {CanvasImageSource} given
 * @param {string} preset
 * @returns {number | null} 0 to 1; null for a preset of which it is not known
 */
export function carriedShare(given, preset) {
  const table = senderCarrying.CARRIED.get(preset);
  if (!table) return null;
  const { data } = pixelsAt(given, senderCarrying.SHRUNK_PX, false);
  let sum = 0;
  for (let at = 0; at < data.length; at += 3) {
    const gray = images.LUMA.reduce((luma, share, i) => luma + share * data[at + i], 0);
    sum += interpolated(gray, [...table.keys()], [...table.values()]);
  }
  return (3 * sum) / data.length;
}

/**
 * Take the pixels of a picture, at the size at which it is shown.
 *
 * @param {ImageBitmap} given
 * @param {number[]} least - width and height of the preset's layout
 * @returns {Picture}
 */
export function pixelsOf(given, least) {
  return pixelsAt(given, sizeOf(given, least), true);
}

/**
 * @param {CanvasImageSource} given
 * @param {number[]} size - width and height
 * @param {boolean} isChecked - whether the browser has to give the pixels as they are
 * @returns {Picture}
 */
function pixelsAt(given, size, isChecked) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = size;
  const context = canvas.getContext("2d", { willReadFrequently: true, colorSpace: "srgb" });
  if (!context) throw new Error("the browser gives no canvas");
  if (isChecked) checkCanvas(context);
  context.fillStyle = "#fff"; // shows where the picture is transparent
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.imageSmoothingQuality = "high";
  context.drawImage(given, 0, 0, canvas.width, canvas.height);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  return {
    width: canvas.width,
    height: canvas.height,
    data: Uint8Array.from(data.filter((_, at) => at % 4 < 3)),
  };
}
