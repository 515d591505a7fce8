/**
 * Find a display by its pilots, over some frames of a film: nothing visible marks it.
 *
 * A search looks at a window of some tenths of a second (`windowSearch.js`). While it does, the frames
 * of the next window are watched, so that a display which comes late need not wait for its end.
 *
 * The first window takes pictures to stand still, the next one takes them to move, as a video does, and
 * so on by turns. Where they are taken to move, frames are held still by the room alone, and what has
 * only moved is taken off them (compensate.js).
 *
 * The work is cut into steps finer than Python's (`types.d.ts`): no frame takes long.
 */

import { receiverPilotsSearchPilotSearch } from "../../../../generated/constants.js";
import { NEXT_FRAME } from "./proposals.js";
import { Watch } from "./watch.js";
import { WindowSearch } from "./windowSearch.js";

/** @typedef {import("./film.js").HeldFrame} HeldFrame */
/** @typedef {import("./settle.js").Detection} Detection */

const { WINDOWS } = receiverPilotsSearchPilotSearch;

/**
 * Units of work (`types.d.ts`) from which on a frame from a file has had its share: while the display is
 * looked for, and while a proposal is being verified. What is proposed late takes half of them.
 */
export const [FRAME_WORK, SETTLING_WORK] = [24, 88];
/**
 * Time, in milliseconds, after which a frame of a camera that does not wait has had its share.
 */
export const FRAME_MS = 200;
/**
 * Share of the time from one frame to the next in which all work on a frame of such a camera is to
 * be done while others are still to be watched, and nothing is being verified, or while a proposal
 * waits for others: what is missed then cannot be watched any more.
 */
const SPARE = 0.8;

/**
 * A display that its pilots have given away: the layout that it shows, one of those that were
 * looked for; its corners in the newest frame, from the top left of the displayed picture on; its
 * corners in the frame with which the search began; the coefficient of the lens; when it shows which
 * state, where its code tells; whether its picture was taken, or seen, to move by itself; and the frames
 * before the newest one, from the oldest on, of those that are kept.
 *
 * @typedef {{
 *   layout: Layout,
 *   corners: Point[],
 *   firstCorners: Point[],
 *   k: number,
 *   clock: DisplayClock | null,
 *   pictureMoves: boolean,
 *   held: HeldFrame[],
 * }} PilotDisplay
 */

/** Looks for a display that shows one of several layouts with pilots. */
export class PilotSearch {
  /** Whether the picture of the display that was found last was taken, or seen, to move. */
  pictureMoves = false;
  /** Number of the next window, from the last display on. */
  #begun = 0;
  /** @type {WindowSearch[]} */
  #windows = [];

  /**
   * @param {readonly Layout[]} layouts - those that are looked for, at least one, each with pilots
   * @param {import("./proposals.js").RegionMapper} mapper - maps where displays toggle
   * @param {number} [fps] - nominal number of frames of the camera in a second; some may be missing
   * @param {number} [frameMs] - time after which no step is begun with a frame of a camera that does
   *   not wait, milliseconds, such as `FRAME_MS`
   */
  constructor(layouts, mapper, fps = 30, frameMs = Infinity) {
    if (layouts.length === 0 || layouts.some((layout) => layout.pilotBlocks.length === 0)) {
      throw new Error("layouts: need at least one, each with pilots");
    }
    this.layouts = [...layouts];
    this.mapper = mapper;
    this.fps = fps;
    this.frameMs = frameMs;
  }

  /** Whether frames come from a camera, which does not wait for the search. */
  get #isLive() {
    return this.frameMs < Infinity;
  }

  /**
   * Take the next frame.
   *
   * @param {BytePlane} gray - it may be kept, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @param {number} [begun] - when the work on the frame began, milliseconds of `performance.now`
   * @returns {PilotDisplay | null} the display once it is sure
   */
  push(gray, time, begun = performance.now()) {
    this.#windows = this.#windows.filter(({ watch }) => {
      if (watch.take(gray, time)) return true;
      if (watch.frames.length === 0) this.#begun--; // what began with a blank frame does not count
      return false;
    });
    if (this.#windows.length < WINDOWS && this.#windows.every(({ hasLooked }) => hasLooked)) {
      this.#begin(gray, time);
    }
    const isSettling = this.#windows.some((window) => window.isSettling);
    const isWatching = !isSettling && this.#windows.some(({ watch }) => !watch.isFull);
    const isWaiting = this.#windows.some((window) => window.isWaiting);
    const isSpare = this.#isLive && (isWatching || isWaiting);
    const until = begun + (isSpare ? (SPARE * 1000) / this.fps : this.frameMs);
    const order = [...this.#windows].sort((one, other) => rankOf(one) - rankOf(other));
    let left = this.#isLive ? Infinity : isSettling ? SETTLING_WORK : FRAME_WORK;
    for (const window of order) {
      if (window.isLate && !window.isSettling) left /= 2;
      if (left <= 0) break;
      do {
        const step = window.steps.next();
        if (step.done) return this.#ended(step.value, window);
        if (step.value === NEXT_FRAME) break;
        left -= step.value;
      } while (left > 0 && performance.now() < until);
    }
    return null;
  }

  /**
   * Take pictures to move in the next window if they were not, and to stand still if they were: the
   * display that was found last has been lost, perhaps because this was wrong.
   */
  doubtPicture() {
    this.#begun = Number(!this.pictureMoves);
  }

  /**
   * Begin a window with a frame. By turns, windows take pictures to stand still and to move. After the
   * first one, windows are longer.
   *
   * @param {BytePlane} gray
   * @param {number} time
   */
  #begin(gray, time) {
    const number = this.#begun++;
    const watch = new Watch(gray, time, this.fps, number % 2 === 1, number > 0 ? 2 : 1);
    this.#windows.push(new WindowSearch(watch, this.layouts, this.mapper));
  }

  /**
   * Say what was found in a window, and choose how the next one begins.
   *
   * @param {Detection | null} detection
   * @param {WindowSearch} window
   * @returns {PilotDisplay | null}
   */
  #ended(detection, window) {
    if (detection === null) {
      this.#windows = this.#windows.filter((each) => each !== window);
      return null;
    }
    const { watch } = window;
    this.#begun = 0;
    this.#windows = [];
    const { proposal, k } = detection;
    const { layout, corners, toggling } = proposal;
    this.pictureMoves = watch.pictureMoves || watch.moves(corners);
    const newest = watch.newest.corners(corners);
    const clock = toggling.clockInSeconds(this.fps, watch.start);
    const { pictureMoves } = this;
    const held = watch.held.slice(0, -1);
    return { layout, corners: newest, firstCorners: corners, k, clock, pictureMoves, held };
  }
}

/**
 * Tell when a window has its turn, the smaller the sooner: what is being verified comes first, then what
 * is not late, and of the late ones those with something that waits.
 *
 * @param {WindowSearch} window
 */
function rankOf(window) {
  if (window.isSettling) return 0;
  return window.isLate ? 3 - Number(window.isWaiting) : 1;
}
