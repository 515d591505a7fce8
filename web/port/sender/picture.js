/** Pictures that carry the message. */

import { images, placement, senderCompact } from "../../generated/constants.js";
import { roundHalfEven } from "../image/round.js";
import { InputError } from "../link/errors.js";

/** @import { Picture } from "../link/strength.js" */

const { BYTES_PER_PIXEL, MAX_MEGAPIXELS, MIN_SIDE_PX, SPARE_BYTES } = images;
const { MAX_ASPECT, USUAL_DISPLAY } = placement;
const { MAX_FILM_BYTES } = senderCompact;
const MAX_BYTES = 1e6 * MAX_MEGAPIXELS * BYTES_PER_PIXEL + SPARE_BYTES;

/**
 * Open a file as a picture.
 *
 * @param {Blob} file
 * @returns {Promise<ImageBitmap>}
 * @throws {InputError} it is no picture that can be shown
 */
export async function openPicture(file) {
  if (file.size > MAX_BYTES) throw new InputError("This file is too large for a picture.");
  if (/svg|xml/.test(file.type)) throw new InputError("Drawings (SVG) are not read. Save it as PNG.");
  const image = new Image();
  image.src = URL.createObjectURL(file);
  try {
    await new Promise((resolve, reject) => Object.assign(image, { onload: resolve, onerror: reject }));
    const { naturalWidth: width, naturalHeight: height } = image; // known before pixels are decoded
    check(width, height);
    return shrunk(await createImageBitmap(file, { colorSpaceConversion: "none" })); // as Python reads
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError("This file is no picture that this browser can read.");
  } finally {
    URL.revokeObjectURL(image.src);
  }
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
  Object.assign(video, { muted: true, preload: "auto", src: URL.createObjectURL(film) });
  try {
    await new Promise((resolve, reject) =>
      Object.assign(video, { onloadeddata: resolve, onerror: reject }),
    );
    const size = [video.videoWidth, video.videoHeight];
    check(size[0], size[1]);
    return { film, size, still: await createImageBitmap(video) };
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError("This file is no film that this browser can play.");
  } finally {
    URL.revokeObjectURL(video.src);
  }
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
 * Take the pixels of a picture, at the size at which it is shown.
 *
 * @param {ImageBitmap} given
 * @param {number[]} least - width and height of the preset's layout
 * @returns {Picture}
 */
export function pixelsOf(given, least) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = sizeOf(given, least);
  const context = canvas.getContext("2d", { willReadFrequently: true, colorSpace: "srgb" });
  if (!context) throw new Error("the browser gives no canvas");
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
