/**
 * From camera frames to the message: find the display, follow it, and read it.
 *
 * `Receiver.push` takes one camera frame through all stages. What the display shows need not be
 * known beforehand: the receiver looks for the layouts of all its decoders, and goes on with the
 * one that it finds (reader.js). Frames are gray. Two single images, which Python's receiver
 * decodes too, are left out.
 */

import { images, receiverTrackingJudge } from "../../generated/constants.js";
import { DisplayReader } from "./reading/reader.js";
import { Repeats } from "./repeats.js";
import { Rests } from "./rests.js";
import { Sight, StageTimes } from "./sight.js";
import { Tracker } from "./tracking/patches.js";
import { PilotTracker } from "./tracking/pilots.js";

/** @typedef {import("../export/filmGraph.js").WindowDecoder} WindowDecoder */
/** @typedef {import("./reading/pairs.js").PairDecoder} PairDecoder */
/** @typedef {import("./reading/reader.js").Reading} Reading */
/** @typedef {import("./reading/reader.js").Tracked} Tracked */
/** @typedef {import("./tracking/patches.js").DisplayTracker} DisplayTracker */

export const { MIN_SIDE_PX } = images;
export const { STILL_S, STILL_FRAMES, AMISS_PAIRS } = receiverTrackingJudge;

/**
 * What one camera frame brought: the display, or null where it was not found, frame pairs that
 * could be decoded with this frame, and the message where it became whole with this frame.
 *
 * @typedef {{ tracked: Tracked | null } & Reading} ReceiverStep
 */

/** Reads a message from the frames of a camera that films the display. */
export class Receiver {
  #fps;
  #repeats = new Repeats();
  #rests;
  #sight = new Sight();
  /** @type {Tracked | null} */
  #tracked = null;
  #trackers;
  /** @type {Map<Layout, DisplayReader>} */
  #readers;
  /** @type {DisplayReader} */
  #reader;
  /** @type {DisplayTracker | null} */
  #following = null;
  /** When what is followed was last found or read; frames and frame pairs until then. */
  #toggled = { time: 0, frames: 0, decoded: 0 };

  /**
   * @param {PairDecoder[]} decoders - one for each layout that is looked for
   * @param {number} [fps] - nominal number of frames of the camera in a second
   * @param {number} [frameMs] - time, in milliseconds, after which a search begins no step with a
   *   frame, for a camera that does not wait
   * @param {WindowDecoder | null} [film] - decodes windows of film where the layout and the picture
   *   allow it; null where all is read by frame pairs
   * @param {boolean} [mayRest] - whether frames may be passed over where no display has been seen for
   *   long (`Rests`)
   */
  constructor(decoders, fps = 30, frameMs = Infinity, film = null, mayRest = false) {
    if (decoders.length === 0) throw new Error("decoders: need at least one");
    const layouts = decoders.map(({ layout }) => layout);
    /** Time spent in each stage so far. */
    this.timing = new StageTimes();
    /** Number of frames in which the display was found. */
    this.found = 0;
    /** Number of frames taken. */
    this.frames = 0;
    this.#fps = fps;
    this.#rests = mayRest ? new Rests() : null;
    this.#trackers = makeTrackers(layouts, fps, frameMs);
    const readers = decoders.map(
      (decoder) => new DisplayReader(decoder, fps, this.timing, this.#sight, film),
    );
    this.#readers = new Map(readers.map((reader) => [reader.layout, reader]));
    this.#reader = readers[0];
  }

  /** Layout of the display that was found last, or the first one that is looked for. */
  get layout() {
    return this.#reader.layout;
  }

  /** Number of frame pairs decoded. */
  get decoded() {
    return [...this.#readers.values()].reduce((sum, reader) => sum + reader.decoded, 0);
  }

  /** Information received, as a share of what is needed: about 1 when the message is whole. */
  get progress() {
    return this.#reader.collector.progress;
  }

  /** Whether the display's clock is known. */
  get synchronised() {
    return this.#reader.sync.clock !== null;
  }

  /** Number of states that the display shows in a second, or null while it is unknown. */
  get stateHz() {
    const { clock } = this.#reader.sync;
    return clock === null ? null : 1 / clock.period;
  }

  /**
   * What was seen so far, from which `explainSilence` tells why no message came.
   *
   * @returns {import("./diagnosis.js").Observations}
   */
  get observations() {
    const sight = this.#sight;
    const measured = Math.max(sight.measured, 1);
    return {
      fps: this.#fps,
      frames: this.frames,
      found: this.found,
      seconds: this.found > 0 ? sight.last - sight.first : 0,
      level: sight.measured > 0 ? sight.level / measured : null,
      clipped: sight.clipped / measured,
      cut: sight.cut,
      toggling: this.#reader.sync.best,
      stateHz: sight.stateHz,
      exposed: sight.exposed,
      decoded: this.decoded,
      mixed: sight.mixed / Math.max(this.decoded, 1),
      progress: this.progress,
    };
  }

  /**
   * Take the next camera frame, once the one before is done with.
   *
   * @param {BytePlane} frame - gray; a search may keep it, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {Promise<ReceiverStep>}
   */
  async push(frame, time) {
    if (Math.min(frame.width, frame.height) < MIN_SIDE_PX) {
      throw new Error(`frames must have ${MIN_SIDE_PX} px or more along each side`);
    }
    this.frames++;
    const start = performance.now();
    if (this.#repeats.isRepeat(frame)) {
      // it was not exposed at this time
      if (this.#tracked !== null) this.found++;
      return { tracked: this.#tracked, pairs: [], message: this.#reader.goOn() };
    }
    const tracked = (this.#tracked = this.#find(frame, time, start));
    this.timing.add("track", start);
    if (tracked === null) {
      this.#sight.miss(frame);
      return { tracked, pairs: [], message: this.#reader.goOn() };
    }
    this.found++;
    const reading = await this.#reader.take(tracked, time, frame.width, frame.height);
    const shift = this.#reader.shift();
    if (shift !== null) this.#following?.correct(shift);
    return { tracked, ...reading };
  }

  /**
   * Follow the display, or look for all layouts until one is found.
   *
   * What is followed and stands still comes last, so that it keeps no other from being found.
   *
   * @param {BytePlane} frame
   * @param {number} time
   * @param {number} begun - when the work on the frame began, milliseconds of `performance.now`
   */
  #find(frame, time, begun) {
    const followed = this.#following;
    if (followed !== null) this.#rests?.wake(time);
    else if (this.#rests !== null) {
      const isIdle = this.#trackers.every((tracker) => tracker.isIdle);
      if (this.#rests.passes(time, this.#repeats.change, isIdle)) return null;
    }
    this.#following = null;
    const isStill = followed !== null && this.#isInVain(followed, time);
    if (isStill) followed.setAside(time, false);
    const others = this.#trackers.filter((tracker) => tracker !== followed);
    const first = followed === null || isStill ? [] : [followed];
    for (const tracker of [...first, ...others, ...(isStill ? [followed] : [])]) {
      const tracked = tracker.follow(frame, time, begun);
      if (tracked === null) continue;
      this.#following = tracker;
      const reader = this.#readers.get(tracker.layout);
      if (reader === undefined) throw new Error("a tracker found a layout that has no decoder");
      if (tracker !== followed) followed?.setAside(time, true);
      const isElsewhere = isStill && tracked.anew === true;
      if (tracker !== followed || isElsewhere) this.#toggle(time);
      if (reader !== this.#reader || isElsewhere) {
        this.#reader = reader;
        reader.restart();
      }
      // what fails here fails again, and is told, when a pair is decoded
      if (tracker !== followed) reader.load().catch(() => {});
      return tracked;
    }
    return null;
  }

  /** @param {number} time - when what is followed was found, or gave something to read */
  #toggle(time) {
    this.#toggled = { time, frames: this.frames, decoded: this.decoded };
  }

  /**
   * Tell whether a display has been followed in vain for long.
   *
   * What toggles around a picture with patches may give it a clock, and then no bit of a message.
   *
   * @param {DisplayTracker} followed
   * @param {number} time - seconds
   */
  #isInVain(followed, time) {
    if (this.synchronised && this.progress > 0) this.#toggle(time);
    const since = this.#toggled;
    if (followed.layout.ratex.length === 0) return this.decoded - since.decoded > AMISS_PAIRS;
    return time - since.time > STILL_S && this.frames - since.frames > STILL_FRAMES;
  }

  /**
   * Decode what is left when the frames have ended.
   *
   * @returns {Promise<ReceiverStep>}
   */
  async finish() {
    return { tracked: null, ...(await this.#reader.finish()) };
  }
}

/**
 * Make what finds and follows the displays of some layouts.
 *
 * @param {Layout[]} layouts - those that are looked for, each with ratex patches or pilots
 * @param {number} fps - nominal number of frames of the camera in a second
 * @param {number} [frameMs] - time, in milliseconds, after which a search begins no step with a
 *   frame
 * @returns {DisplayTracker[]}
 */
export function makeTrackers(layouts, fps, frameMs = Infinity) {
  const withPilots = layouts.filter((layout) => layout.pilotBlocks.length > 0);
  const withPatches = layouts.filter((layout) => layout.pilotBlocks.length === 0);
  /** @type {DisplayTracker[]} */
  const trackers = withPatches.map((layout) => new Tracker(layout, frameMs));
  if (withPilots.length > 0) trackers.push(new PilotTracker(withPilots, fps, frameMs));
  return trackers;
}
