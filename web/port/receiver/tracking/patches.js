/**
 * Follow the display from frame to frame; find it again when it was lost.
 *
 * A part of the display may lie outside the image. A search for a lost display takes the time of
 * many frames, so it goes in steps (link/steps.js), of which each frame takes some. What it finds
 * in the frame with which it began is then looked for once more in the frame at hand.
 */

import { receiverTrackingPatches } from "../../../generated/constants.js";
import { resizeArea } from "../../image/shrink.js";
import { InputError } from "../../link/errors.js";
import { frameCorners } from "../../link/geometry.js";
import { matchPatches } from "../../link/ratex.js";
import { isAt, searchSteps } from "../locate/find.js";
import { imagePyramid, patchesInView, seenCorrelation } from "../locate/patches.js";
import { cornersOnPatches, neededCorrelation } from "../locate/refine.js";
import { Follower } from "./follow.js";

const {
  FOLLOWED_CORRELATION, QUICK_WORK, SLOW_WORK, SAVED_WORK, MOST_SAVED, THUMBNAIL_PX,
  CHANGED_LEVELS, CHANGED_SHARE, ASIDE_S,
} = receiverTrackingPatches;

/**
 * Units of work of a search in which the likeliest candidates are tried. The rest of it, which finds
 * displays without visible borders, takes long.
 */
const LIKELY_WORK = 100;
/**
 * Shares of a frame's time, before a camera that does not wait, of the likeliest candidates of the
 * first search, and of all else: pilots are looked for meanwhile.
 */
const [LIKELY_SHARE, LATER_SHARE] = [0.1, 0.05];
/** Distance, in pixels, of the image's rows and columns that thumbnails are made of. */
const THUMBNAIL_STEP = 4;

/**
 * The display in one camera frame: its corners in pixels of the frame, in corner order, and its
 * rectified image, of the layout's size. `anew` says that the display was just found at a place of
 * which nothing is known from the frames before: by its pilots, or elsewhere than what was followed.
 * `before` has frames before this one in which the display lies, too: their times, in seconds, and
 * the display in them; of one that was just found by its pilots. `clock` says when it shows which
 * state, where its pilots' code told it.
 *
 * @typedef {{
 *   corners: Point[],
 *   rectified: BytePlane,
 *   anew?: boolean,
 *   before?: { time: number, seen: Tracked }[],
 *   clock?: DisplayClock | null,
 * }} Tracked
 */

/**
 * Finds a display, and follows it from frame to frame. `layout` is that of the display that was
 * found last. `follow` takes the next frame, its time in seconds, and when the work on it began, in
 * milliseconds of `performance.now`; it gives the display, or null where it is not in view. `correct` moves the display within its rectified image, from the next
 * frame on. `setAside` has it look elsewhere, too, with the next frame, because what is followed does
 * not toggle, and is followed no more where another display was found. `isIdle` says that it may pass over the next frames: it
 * follows no display, and no search would be cut off.
 *
 * @typedef {object} DisplayTracker
 * @property {Layout} layout
 * @property {boolean} isIdle
 * @property {(image: BytePlane, time: number, begun?: number) => Tracked | null} follow
 * @property {(HOldFromNew: Float64Array) => void} correct
 * @property {(time: number, forget: boolean) => void} setAside
 */

/** Finds a display by its ratex patches, and follows it as long as these are seen. */
export class Tracker {
  #follower;
  #frameMs;
  /** @type {ReturnType<typeof searchSteps> | null} */
  #search = null;
  /** Units of work of the search so far. */
  #done = 0;
  /** Time by which steps took longer than allowed, which later frames make up for, milliseconds. */
  #owed = 0;
  #searchedWidth = 0;
  #searchedHeight = 0;
  /** Whether the search is the first one since the display was lost or the image has changed. */
  #isQuick = true;
  /** Units of work that are saved for quick searches. */
  #saved = MOST_SAVED;
  /** @type {Uint8Array | null} */
  #thumbnail = null;
  /** @type {{ time: number, corners: Point[] }[]} */
  #aside = [];
  #elsewhere = false;

  /**
   * @param {Layout} layout - with at least one ratex patch
   * @param {number} [frameMs] - time, in milliseconds, after which a search begins no further step
   *   with a frame, for a camera that does not wait
   */
  constructor(layout, frameMs = Infinity) {
    if (layout.ratex.length === 0) {
      throw new InputError("a receiver needs ratex patches to find and follow the display");
    }
    this.layout = layout;
    this.#follower = new Follower(layout);
    this.#frameMs = frameMs;
  }

  /** Whether no display is followed; a search can wait for its next frame. */
  get isIdle() {
    return this.#follower.corners === null;
  }

  /** Do nothing: the patches are seen in each frame, and say where the display lies. */
  correct() {}

  /**
   * Look elsewhere, too, with the next frame, because what is followed does not toggle.
   *
   * @param {number} time - of the frame, seconds
   * @param {boolean} forget - whether it is followed no more, because another display was found
   */
  setAside(time, forget) {
    const { corners } = this.#follower;
    if (corners !== null) {
      this.#aside = this.#aside.filter((place) => !isAt(corners, [place.corners]));
      this.#aside.push({ time, corners });
      this.#elsewhere = true;
      this.#isQuick = false;
    }
    if (forget) this.#forget();
  }

  /** Follow nothing any more. */
  #forget() {
    this.#follower.forget();
    this.#search = null;
    this.#isQuick = true;
  }

  /**
   * Find the display in the next frame.
   *
   * @param {BytePlane} image - gray; a search may keep it, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {Tracked | null} the display, or null where it is not in view
   */
  follow(image, time) {
    const elsewhere = this.#elsewhere;
    this.#elsewhere = false;
    this.#aside = this.#aside.filter((place) => time - place.time < ASIDE_S);
    if (this.#follower.corners !== null) {
      const step = this.#follower.step(image);
      if (step !== null) this.#follower.advance(step.corners);
      const found = step && this.#accept(image, step.corners, step.fresh);
      if (found !== null) {
        const other = elsewhere ? this.#look(image) : null;
        return other ? { ...other, anew: true } : found;
      }
      this.#forget();
    }
    return this.#look(image);
  }

  /**
   * Take some steps of a search, and begin one where none is under way.
   *
   * @param {BytePlane} image
   */
  #look(image) {
    const start = performance.now();
    if (this.#searchedWidth !== image.width || this.#searchedHeight !== image.height) {
      this.#search = null;
    }
    const fresh = this.#search === null;
    if (fresh) {
      this.#searchedWidth = image.width;
      this.#searchedHeight = image.height;
      const whole = frameCorners(image.width, image.height); // a screenshot, or rectified
      const found = this.#isAside(whole) ? null : this.#accept(image, whole, true);
      if (found !== null) return found;
    }
    this.#search ??= this.#begun(image);
    const limit = this.#workLimit(image);
    const located = this.#searched(limit, start);
    if (located === null) return null;
    let { corners } = located;
    if (!fresh) {
      // the camera has moved since
      const found = cornersOnPatches(image, imagePyramid(image), corners, this.layout);
      if (found.seen < neededCorrelation(this.layout)) return null;
      ({ corners } = found);
    }
    return this.#isAside(corners) ? null : this.#accept(image, corners, true);
  }

  /**
   * Take the steps of the search that a frame has time for.
   *
   * @param {number} limit - units of work after which it takes no further step
   * @param {number} start - when the work on the frame began, milliseconds
   * @returns {import("../locate/candidates.js").Located | null} null where the search goes on, or
   *   has found nothing
   */
  #searched(limit, start) {
    const search = this.#search;
    const isLikely = () => this.#isQuick && this.#done < LIKELY_WORK;
    const allowed = () => (isLikely() ? LIKELY_SHARE : LATER_SHARE) * this.#frameMs;
    const spent = () => this.#owed + performance.now() - start;
    let located = null;
    for (let work = 0; search !== null && work < limit && spent() < allowed(); ) {
      const step = search.next();
      if (!step.done) {
        work += step.value;
        this.#done += step.value;
        continue;
      }
      this.#search = null;
      this.#isQuick = false;
      located = step.value;
      break;
    }
    this.#owed = Math.max(0, spent() - allowed());
    return located;
  }

  /**
   * Begin a search in a frame.
   *
   * @param {BytePlane} image
   */
  #begun(image) {
    this.#done = 0;
    return searchSteps(image, this.layout, this.#aside.map(({ corners }) => corners));
  }

  /**
   * Tell whether a place was set aside.
   *
   * @param {Point[]} corners
   */
  #isAside(corners) {
    return isAt(corners, this.#aside.map((place) => place.corners));
  }

  /**
   * Say after how many units of work this frame takes no further step of the search.
   *
   * @param {BytePlane} image
   */
  #workLimit(image) {
    this.#saved = Math.min(this.#saved + SAVED_WORK, MOST_SAVED);
    if (!this.#isQuick && this.#saved > 0 && this.#hasChanged(image)) {
      // what was looked at is no longer what is seen
      this.#search = this.#begun(image);
      this.#isQuick = true;
    }
    if (!this.#isQuick) return SLOW_WORK;
    this.#thumbnail = null;
    this.#saved -= QUICK_WORK;
    return QUICK_WORK;
  }

  /**
   * Tell whether a frame differs from the one with which the slow searches began.
   *
   * @param {BytePlane} image
   */
  #hasChanged(image) {
    const seen = thumbnailOf(image);
    const before = (this.#thumbnail ??= seen);
    const changed = seen.filter((level, at) => Math.abs(level - before[at]) > CHANGED_LEVELS);
    return changed.length / seen.length >= CHANGED_SHARE;
  }

  /**
   * Believe that the display is there if its patches are seen.
   *
   * @param {BytePlane} image
   * @param {Point[]} corners
   * @param {boolean} fresh - whether the frame becomes the reference
   */
  #accept(image, corners, fresh) {
    const rectified = this.#follower.rectified(image, corners);
    if (rectified === null) return null;
    const inView = patchesInView(corners, this.layout, image.width, image.height);
    const seen = seenCorrelation(matchPatches(rectified, this.layout).correlation, inView);
    if (seen < FOLLOWED_CORRELATION) return null;
    if (fresh) this.#follower.begin(image, corners, rectified);
    return { corners, rectified };
  }
}

/**
 * Shrink an image to a few pixels.
 *
 * @param {BytePlane} image
 */
function thumbnailOf({ width, height, data }) {
  const across = Math.ceil(width / THUMBNAIL_STEP);
  const down = Math.ceil(height / THUMBNAIL_STEP);
  const picked = new Uint8Array(across * down);
  for (let y = 0, to = 0; y < height; y += THUMBNAIL_STEP) {
    for (let x = 0; x < width; x += THUMBNAIL_STEP, to++) picked[to] = data[y * width + x];
  }
  const thinned = { width: across, height: down, data: picked };
  return resizeArea(thinned, THUMBNAIL_PX, THUMBNAIL_PX).data;
}
