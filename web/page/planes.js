/**
 * Gray frames from what browsers give: luma, from 0 for black to 255 for white.
 *
 * Browsers turn frames into RGB with rounding, clipping, and now and then the wrong range. So the
 * luma is taken from the planes as the camera or the film has them, and only its range is changed.
 */

/** Formats of a `VideoFrame` whose first plane is luma with 8 bits a pixel. */
const LUMA_FORMATS = ["I420", "I420A", "I422", "I422A", "I444", "I444A", "NV12"];

/** Levels of black and of white in limited range. */
const BLACK = 16;
const WHITE = 235;

/** Luma in full range by luma in limited range. */
const FULL_OF_LIMITED = Uint8Array.from({ length: 256 }, (_, level) =>
  Math.min(255, Math.max(0, Math.round(((level - BLACK) * 255) / (WHITE - BLACK)))),
);

/** Pixels as the canvas gives them: red, green, blue and opacity, a byte each, row by row.
 *
 * @typedef {{ width: number, height: number, data: Uint8Array | Uint8ClampedArray }} RgbaImage
 */

/**
 * Stretch luma from limited to full range, in place.
 *
 * @param {Uint8Array} luma - black is 16 and white is 235
 * @returns {Uint8Array} the same array; black is 0 and white is 255
 */
function stretchRange(luma) {
  for (let i = 0; i < luma.length; i++) luma[i] = FULL_OF_LIMITED[luma[i]];
  return luma;
}

/**
 * Take the luma of an image in colour, with the weights of ITU-R BT.601, as OpenCV does.
 *
 * @param {RgbaImage} image
 * @returns {Plane}
 */
export function planeOfRgba({ width, height, data }) {
  const luma = new Uint8Array(width * height);
  for (let i = 0, j = 0; i < luma.length; i++, j += 4) {
    luma[i] = (data[j] * 9798 + data[j + 1] * 19235 + data[j + 2] * 3735 + 16384) >> 15;
  }
  return { width, height, data: luma };
}

/**
 * Take the colours of a frame. Browsers that know no conversion copy the planes as they are, which
 * their number and size tells; then a canvas draws the frame.
 *
 * @param {VideoFrame} frame
 * @param {DOMRectReadOnly} box - of the frame that is shown
 */
async function coloursOf(frame, box) {
  const { width, height } = box;
  /** @type {any} */
  const options = { rect: box, format: "RGBA" }; // newer than the types that tsc knows
  try {
    const data = new Uint8Array(frame.allocationSize(options));
    const planes = await frame.copyTo(data, options);
    if (planes.length === 1 && data.length === 4 * width * height) return data;
  } catch {
    // drawn below
  }
  const context = new OffscreenCanvas(width, height).getContext("2d", { alpha: false });
  if (!context) throw new Error("the browser gives no canvas");
  context.drawImage(frame, 0, 0, width, height);
  return context.getImageData(0, 0, width, height).data;
}

/**
 * Take the luma of a frame of a camera or a film, and close the frame.
 *
 * The frame's colour space says its range. Where it says nothing, luma stays as it is, which loses
 * nothing: at worst black is 16 and white 235, and the picture has a little less contrast.
 *
 * @param {VideoFrame} frame
 * @returns {Promise<Plane>}
 */
export async function planeOfFrame(frame) {
  try {
    const box = frame.visibleRect;
    if (!box) throw new Error("the frame is closed already");
    const { width, height } = box;
    if (!LUMA_FORMATS.includes(frame.format ?? "")) {
      return planeOfRgba({ width, height, data: await coloursOf(frame, box) });
    }
    const data = new Uint8Array(frame.allocationSize({ rect: box }));
    await frame.copyTo(data, { rect: box }); // luma comes first, and rows without gaps
    const luma = data.subarray(0, width * height);
    return { width, height, data: frame.colorSpace.fullRange === false ? stretchRange(luma) : luma };
  } finally {
    frame.close();
  }
}
