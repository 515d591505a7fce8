/**
 * The frames of a film: all of them, each after the one before is read, however slow the device is.
 *
 * mediabunny finds the frames in the file, and the browser's decoder turns them into pictures; the
 * film is not played.
 */

import {
  BlobSource, EncodedPacketSink, Input, MATROSKA, MP4, QTFF, VideoSampleSink, WEBM,
} from "mediabunny";
import { imagesVideo } from "../generated/constants.js";
import { InputError } from "../port/link/errors.js";
import { rateOf } from "./frames.js";

/** @import { InputVideoTrack, VideoSample } from "mediabunny" */
/** @import { Pixels } from "./frames.js" */

/** Kinds of films that are read; cameras, phones and browsers write these. */
const KINDS = [MP4, QTFF, WEBM, MATROSKA];

/** Number of frames from whose times a film's rate is taken. */
const PROBED = 100;

const { MAX_FPS, MAX_GAP_S } = imagesVideo;
/** Smallest time, in seconds, from one frame to the next that is believed. */
const MIN_GAP_S = 0.5 / MAX_FPS;

/** Why a file is not read. */
const NO_FILM = "the file is no film, or none that this page reads (mp4, mov, webm, mkv)";

/**
 * Callbacks that take the frames of a film.
 *
 * @typedef {object} Viewer
 * @property {(fps: number) => void} begin - is told the film's frames a second, before the first
 * @property {(width: number, height: number, draw: Draw) => void} show - is given each frame, to be
 *   drawn on a canvas of this size
 * @property {(pixels: Pixels, time: number) => unknown} take - is given each frame and its time in
 *   seconds; the next one waits until this is done
 */

/** Draws a frame on a canvas. @typedef {(context: CanvasRenderingContext2D) => void} Draw */

/**
 * Read a film, frame by frame.
 *
 * @param {Blob | URL} film - a file, or an address on the site of this page
 * @param {Viewer} viewer
 * @param {AbortSignal} signal - ends it
 * @throws {InputError} there is no such film, it is damaged, or this browser cannot decode it
 */
export async function filmFrames(film, viewer, signal) {
  const file = film instanceof Blob ? film : await loaded(film, signal);
  if (!file.size) throw new InputError("the file is empty");
  const input = new Input({ source: new BlobSource(file), formats: KINDS });
  let count = 0;
  try {
    const track = await trackOf(input);
    const fps = rateOf(await firstTimes(track));
    const timeOf = risingTimes(fps);
    if (signal.aborted) return;
    viewer.begin(fps);
    for await (const sample of new VideoSampleSink(track).samples()) {
      await takeSample(sample, timeOf(sample.timestamp), viewer);
      count++;
      if (signal.aborted) return; // which closes the decoder
    }
  } catch (error) {
    if (error instanceof InputError) throw error;
    const why = error instanceof Error ? error.message : String(error); // of the browser or mediabunny
    throw new InputError(`it cannot be read on from frame ${count + 1} (${why.replace(/\.$/, "")})`);
  } finally {
    input.dispose();
  }
  if (!count) throw new InputError("the film has no frames, or was cut off");
}

/**
 * Make rising times of those that a film states, as `link.images.video.time_after` does; the first is 0.
 *
 * @param {number} fps - frames a second of the film
 * @returns {(stated: number) => number} takes the times of the frames in order, in seconds, which may
 *   be anything, and says when each is shown
 */
export function risingTimes(fps) {
  let offset = NaN;
  /** @type {number | null} */
  let last = null;
  return (stated) => {
    const usual = last === null ? 0 : last + 1 / fps;
    if (Number.isNaN(offset) && Number.isFinite(stated)) offset = stated - usual;
    const gap = last === null ? NaN : stated - offset - last;
    last = gap >= MIN_GAP_S && gap <= MAX_GAP_S ? stated - offset : usual;
    return last;
  };
}

/**
 * Load a film.
 *
 * @param {URL} address
 * @param {AbortSignal} signal
 * @returns {Promise<Blob>}
 * @throws {InputError} there is no such film
 */
async function loaded(address, signal) {
  const response = await fetch(address, { signal }).catch(() => null);
  signal.throwIfAborted();
  if (response?.ok) return response.blob();
  throw new InputError(`there is no film at ${address.pathname}`);
}

/** @param {InputVideoTrack} track @returns {Promise<number[]>} seconds, rising */
async function firstTimes(track) {
  const times = [];
  const packets = new EncodedPacketSink(track).packets(undefined, undefined, { metadataOnly: true });
  for await (const { timestamp } of packets) {
    if (times.push(timestamp) >= PROBED) break;
  }
  return times.sort((a, b) => a - b);
}

/** @param {Input} input @returns {Promise<InputVideoTrack>} */
async function trackOf(input) {
  if (!(await input.canRead().catch(() => false))) throw new InputError(NO_FILM);
  const track = await input.getPrimaryVideoTrack();
  if (!track) throw new InputError("the file has no picture, or was cut off");
  if (!(await track.canDecode())) {
    throw new InputError(`this browser cannot decode the film (${track.codec ?? "of unknown kind"})`);
  }
  return track;
}

/**
 * Show a frame, and have it taken.
 *
 * @param {VideoSample} sample - is closed
 * @param {number} time - in seconds
 * @param {Viewer} viewer
 */
async function takeSample(sample, time, viewer) {
  const { rotation } = sample;
  const frame = sample.toVideoFrame();
  const { width, height } = frame.visibleRect ?? { width: 0, height: 0 };
  const [wide, high] = rotation % 180 ? [height, width] : [width, height];
  try {
    viewer.show(wide, high, (context) => sample.draw(context, 0, 0, wide, high));
  } catch (error) {
    frame.close();
    throw error;
  } finally {
    sample.close();
  }
  await viewer.take({ frame, rotation }, time);
}
