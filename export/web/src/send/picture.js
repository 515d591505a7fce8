/** Pictures that carry the message: a file of the visitor's, or one that is drawn here. */

import { images, placement } from "../generated/constants.js";
import { roundHalfEven } from "../image/round.js";
import { InputError } from "../link/errors.js";

/** @import { Picture } from "../link/strength.js" */

const { BYTES_PER_PIXEL, MAX_MEGAPIXELS, MIN_SIDE_PX, SPARE_BYTES } = images;
const { MAX_ASPECT, USUAL_DISPLAY } = placement;
const MAX_BYTES = 1e6 * MAX_MEGAPIXELS * BYTES_PER_PIXEL + SPARE_BYTES;

/** By the name of a drawn picture the colours of its sky from top to bottom, its sun and its hills. */
export const DRAWN = {
  Morning: ["#7fa3c7", "#f2d9c0", "#fff3d6", "#8aa06a"],
  Noon: ["#4f8fd0", "#cfe4f2", "#fff8c8", "#6fae5c"],
  Evening: ["#6b5f9e", "#f0a878", "#ffd9a0", "#7b6a72"],
};
const DRAWN_SIZE = [1440, 1080];

/**
 * Draw hills under a sun.
 *
 * @param {keyof typeof DRAWN} name
 * @returns {HTMLCanvasElement}
 */
export function drawnPicture(name) {
  const [high, low, sun, hill] = DRAWN[name];
  const { canvas, context } = canvasOf(DRAWN_SIZE[0], DRAWN_SIZE[1]);
  const { width, height } = canvas;
  const sky = context.createLinearGradient(0, 0, 0, height);
  [high, low].forEach((colour, at) => sky.addColorStop(at, colour));
  context.fillStyle = sky;
  context.fillRect(0, 0, width, height);
  context.fillStyle = sun;
  context.beginPath();
  context.arc(0.7 * width, 0.32 * height, 0.09 * height, 0, 2 * Math.PI);
  context.fill();
  for (let row = 0; row < 4; row++) {
    context.fillStyle = `color-mix(in srgb, ${hill} ${40 + 20 * row}%, ${low})`;
    context.beginPath();
    context.moveTo(0, height);
    for (let x = 0; x <= width; x += 4) {
      const wave = Math.sin(x / (210 - 30 * row) + 2 * row) + Math.sin(x / 67 + 5 * row) / 4;
      context.lineTo(x, height * (0.55 + 0.11 * row - 0.05 * wave));
    }
    context.lineTo(width, height);
    context.fill();
  }
  return canvas;
}

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
    if (width * height > 1e6 * MAX_MEGAPIXELS) {
      const size = `${Math.round((width * height) / 1e6)} million pixels`;
      throw new InputError(`This picture has ${size}, and ${MAX_MEGAPIXELS} are the most.`);
    }
    if (Math.min(width, height) < MIN_SIDE_PX) throw new InputError("This picture is too small.");
    if (Math.max(width, height) > MAX_ASPECT * Math.min(width, height)) {
      throw new InputError(`This picture is longer than ${MAX_ASPECT} to 1. Crop it.`);
    }
    return await createImageBitmap(file, { colorSpaceConversion: "none" }); // as Python reads it
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError("This file is no picture that this browser can read.");
  } finally {
    URL.revokeObjectURL(image.src);
  }
}

/**
 * Take the pixels of a picture, at the size that `usual_size` of link/placement.py chooses.
 *
 * @param {ImageBitmap | HTMLCanvasElement} given
 * @param {number[]} least - width and height of the preset's layout
 * @returns {Picture}
 */
export function pixelsOf(given, least) {
  const [short, long] = [given.width, given.height].sort((a, b) => a - b);
  const enough = Math.max(Math.max(...least) / long, Math.min(...least) / short);
  const scale = Math.max(enough, Math.min(1, USUAL_DISPLAY[0] / long, USUAL_DISPLAY[1] / short));
  const size = [given.width, given.height].map((side) => 2 * roundHalfEven((scale * side) / 2));
  const { canvas, context } = canvasOf(size[0], size[1]);
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

/** @param {number} width @param {number} height */
function canvasOf(width, height) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d", { willReadFrequently: true, colorSpace: "srgb" });
  if (!context) throw new Error("the browser gives no canvas");
  return { canvas, context };
}
