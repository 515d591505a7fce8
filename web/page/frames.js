/**
 * The frames of a camera with their own times, and the rate that times tell.
 *
 * A camera does not wait for what becomes of its frames.
 */

import { imagesVideo } from "../generated/constants.js";

/** @import { RgbaImage } from "./planes.js" */

/** Smallest number of frames a second that is believed. */
const MIN_FPS = 1;
const { DEFAULT_FPS, MAX_FPS } = imagesVideo;

/**
 * A frame: as the browser has it, with the degrees by which it is to be turned clockwise; or as
 * pixels of a canvas.
 *
 * @typedef {{ frame?: VideoFrame, rotation?: number, rgba?: RgbaImage }} Pixels
 */

/**
 * Takes a frame, which is its own from then on, and the frame's time in seconds.
 *
 * @typedef {(pixels: Pixels, time: number) => unknown} Take
 */

/**
 * Take the frames of a camera, by their planes where the browser gives these.
 *
 * @param {MediaStream} stream
 * @param {HTMLVideoElement} video - plays the stream
 * @param {Take} take
 * @param {AbortSignal} signal - ends it
 * @returns {Promise<void>} resolves when the camera is gone or the signal came
 */
export async function cameraFrames(stream, video, take, signal) {
  const [track] = stream.getVideoTracks();
  if (typeof MediaStreamTrackProcessor === "undefined") {
    track.addEventListener("ended", () => video.dispatchEvent(new Event("ended")));
    return videoFrames(video, take, signal);
  }
  /** @type {any} */
  const init = { track }; // newer than the types that tsc knows
  /** @type {ReadableStream<VideoFrame>} */
  const frames = new MediaStreamTrackProcessor(init).readable;
  const reader = frames.getReader();
  signal.addEventListener("abort", () => void reader.cancel());
  for (;;) {
    const { value: frame, done } = await reader.read();
    if (done || !frame) return;
    if (signal.aborted) return frame.close();
    take({ frame }, frame.timestamp / 1e6);
  }
}

/**
 * Take the frames that a video element shows.
 *
 * @param {HTMLVideoElement} video
 * @param {Take} take
 * @param {AbortSignal} signal - ends it
 * @returns {Promise<void>} resolves when the video has ended or the signal came
 */
function videoFrames(video, take, signal) {
  const canvas = document.createElement("canvas");
  let last = -1;
  let isOver = false;
  return new Promise((resolve) => {
    /** @param {number} time - of the frame, in seconds */
    const shown = (time) => {
      if (signal.aborted || isOver) return;
      ask();
      if (!video.videoWidth || time === last) return;
      last = time;
      const timestamp = Math.round(1e6 * time);
      const isKnown = typeof VideoFrame !== "undefined";
      take(isKnown ? { frame: new VideoFrame(video, { timestamp }) } : pixelsOf(video, canvas), time);
    };
    const ask = () =>
      void video.requestVideoFrameCallback((_, { captureTime, mediaTime }) =>
        shown(captureTime === undefined ? mediaTime : captureTime / 1e3),
      );
    const end = () => {
      isOver = true;
      resolve(undefined);
    };
    signal.addEventListener("abort", end);
    video.addEventListener("ended", end, { signal });
    ask();
  });
}

/**
 * Take what a video element shows now, where the browser does not give its frames.
 *
 * @param {HTMLVideoElement} video
 * @param {HTMLCanvasElement} canvas - is drawn on
 * @returns {Pixels}
 */
function pixelsOf(video, canvas) {
  const [width, height] = [video.videoWidth, video.videoHeight];
  if (canvas.width !== width || canvas.height !== height) {
    [canvas.width, canvas.height] = [width, height];
  }
  const context = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
  if (!context) throw new Error("the browser gives no canvas");
  context.drawImage(video, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  return { rgba: { width, height, data } };
}

/**
 * Tell the rate of a camera or a film from the times of some frames; gaps count as the frames that
 * they lack.
 *
 * @param {number[]} times - in seconds, rising
 * @returns {number} frames a second; a usual number where the times tell none that a camera has
 */
export function rateOf(times) {
  const gaps = times.slice(1).map((next, i) => next - times[i]);
  const usual = [...gaps].sort((a, b) => a - b)[gaps.length >> 1];
  const frames = gaps.reduce((sum, gap) => sum + Math.max(1, Math.round(gap / usual)), 0);
  const rate = frames / gaps.reduce((sum, gap) => sum + gap, 0);
  return rate >= MIN_FPS && rate <= MAX_FPS ? rate : DEFAULT_FPS;
}
