/** Find a display by its pilots, follow it, and notice when it is no longer the display. */

import { receiverTrackingJudge, receiverTrackingPilots } from "../../../generated/constants.js";
import { resizeArea } from "../../image/shrink.js";
import { identity, multiply3 } from "../../link/linear.js";
import { Compensator } from "../pilots/compensate.js";
import { movedCorners } from "../pilots/motion.js";
import { PilotSearch } from "../pilots/search/pilotSearch.js";
import { pilotValues } from "../../link/pilots.js";
import { findToggling } from "../pilots/toggling.js";
import { position } from "../pilots/waves.js";
import { Follower } from "./follow.js";

/**
 * The display in one camera frame: its corners in pixels of the frame, in corner order, and its
 * rectified image, of the layout's size. `anew` says that the display was just found by its pilots,
 * at a place of which nothing is known from the frames before. `before` then has frames before this
 * one in which the display lies, too: their times, in seconds, and the display in them. `clock` says
 * when it shows which state, where its pilots' code told it.
 *
 * @typedef {{
 *   corners: Point[],
 *   rectified: BytePlane,
 *   anew?: boolean,
 *   before?: { time: number, seen: Tracked }[],
 *   clock?: DisplayClock | null,
 * }} Tracked
 */

export const { WATCHED, CHECK_EVERY, LEAST_EVIDENCE, PATIENCE } = receiverTrackingJudge;
const { SOON } = receiverTrackingPilots;

/** Finds a display that shows one of several layouts with pilots, and follows it. */
export class PilotTracker {
  #search;
  #follower;
  /** @type {Homography} */
  #HFollowedFromShown = identity(3);
  /**
   * The newest frames: their positions since `#start`, the display, and the values of its pilots.
   * @type {{ at: number, rectified: BytePlane, values: Float32Array }[]}
   */
  #watched = [];
  #start = 0;
  #count = 0;
  #missed = 0;

  /**
   * @param {Layout[]} layouts - those that are looked for, at least one, each with pilots
   * @param {import("../pilots/search/proposals.js").RegionMapper} mapper - maps where displays toggle
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {number} [frameMs] - time after which the search begins no step (`PilotSearch`)
   */
  constructor(layouts, mapper, fps, frameMs) {
    this.#search = new PilotSearch(layouts, mapper, fps, frameMs);
    this.fps = fps;
    this.#follower = new Follower(layouts[0]);
  }

  /** Layout of the display that was found last. */
  get layout() {
    return this.#follower.layout;
  }

  /**
   * Move the display within its rectified image, from the next frame on.
   *
   * @param {Homography} HOldFromNew - in layout pixels; says where points of the display lie in
   *   the image rectified so far
   */
  correct(HOldFromNew) {
    const H = multiply3(this.#HFollowedFromShown, HOldFromNew);
    this.#HFollowedFromShown = H.map((value) => value / H[8]);
  }

  /** Look for the display anew, because what is followed gives nothing to read. */
  forget() {
    this.#follower.forget();
  }

  /**
   * Find the display in the next frame.
   *
   * @param {BytePlane} image - gray
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @param {number} [begun] - when the work on the frame began, milliseconds of `performance.now`
   * @returns {Tracked | null} the display, or null where it is not in view
   */
  follow(image, time, begun) {
    if (this.#follower.corners === null) return this.#look(image, time, begun);
    const step = this.#follower.step(image);
    const tracked = step === null ? null : this.#accept(image, step.corners, step.fresh);
    if (tracked !== null && this.#stillThere(tracked, time)) return tracked;
    const isFollowedAmiss = tracked !== null || this.#search.pictureMoves;
    if (isFollowedAmiss && this.#count <= SOON) this.#search.doubtPicture();
    this.#follower.forget();
    return null;
  }

  /**
   * @param {BytePlane} image
   * @param {number} time
   * @param {number} [begun]
   */
  #look(image, time, begun) {
    const found = this.#search.push(image, time, begun);
    if (found === null) return null;
    this.#follower = new Follower(found.layout, found.k, found.pictureMoves);
    this.#HFollowedFromShown = identity(3);
    this.#watched = [];
    this.#start = time;
    this.#count = this.#missed = 0;
    const tracked = this.#accept(image, found.corners, true);
    return tracked && { ...tracked, anew: true, before: this.#before(found), clock: found.clock };
  }

  /**
   * Show the display in the frames in which it was looked for.
   *
   * @param {import("../pilots/search/pilotSearch.js").PilotDisplay} found
   */
  #before({ firstCorners, held }) {
    /** @type {{ time: number, seen: Tracked }[]} */
    let shown = [];
    for (const frame of held) {
      const corners = frame.corners(firstCorners);
      const rectified = this.#follower.rectified(frame.gray, corners);
      if (rectified === null) shown = [];
      else shown.push({ time: frame.time, seen: { corners, rectified } });
    }
    return shown;
  }

  /**
   * Rectify the display where the motion of its points puts it.
   *
   * @param {BytePlane} image
   * @param {Point[]} corners
   * @param {boolean} fresh - whether the frame becomes the reference
   */
  #accept(image, corners, fresh) {
    const follower = this.#follower;
    const lens = follower.lens(image);
    const shown = movedCorners(corners, this.#HFollowedFromShown, follower.layout, lens);
    const rectified = follower.rectified(image, shown);
    if (rectified === null) return null;
    if (follower.corners !== null) follower.advance(corners);
    if (fresh) {
      const reference = follower.rectified(image, corners);
      if (reference === null) return null;
      follower.begin(image, corners, reference);
    }
    return { corners: shown, rectified };
  }

  /**
   * Look at the pilots from time to time, and tell whether they are still seen. Where a picture moves,
   * they may be seen only in what is left of the frames once what has only moved is taken off.
   *
   * @param {Tracked} tracked
   * @param {number} time
   */
  #stillThere({ rectified }, time) {
    const at = position(time - this.#start, this.fps);
    this.#watched.push({ at, rectified, values: pilotValues(rectified, this.layout) });
    if (this.#watched.length > WATCHED) this.#watched.shift();
    this.#count++;
    if (this.#count % CHECK_EVERY !== 0 || this.#watched.length < WATCHED) return true;
    const places = this.#watched.map((each) => each.at);
    const isSeen =
      this.#toggle(this.#watched.map(({ values }) => values), places) ||
      this.#toggle(this.#left(), places.slice(1));
    this.#missed = isSeen ? 0 : this.#missed + 1;
    return this.#missed < (this.#count > WATCHED ? PATIENCE : 1);
  }

  /**
   * Tell whether values of the pilots toggle.
   *
   * @param {Float32Array[]} values
   * @param {number[]} at - positions of their frames
   */
  #toggle(values, at) {
    return findToggling(values, this.layout, at, this.fps).evidence >= LEAST_EVIDENCE;
  }

  /** Measure the pilots in what is left of frames beyond motion, but for the first one. */
  #left() {
    const compensator = new Compensator(this.fps);
    const [width, height] = this.layout.mapSize;
    const left = this.#watched.map(({ rectified }) =>
      pilotValues(compensator.take(resizeArea(rectified, width, height)), this.layout),
    );
    return left.slice(1);
  }
}
