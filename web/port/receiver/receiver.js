/**
 * From camera frames to the message: find the display, follow it, and read it.
 *
 * `Receiver.push` takes one camera frame through all stages. What the display shows need not be
 * known beforehand: the receiver looks for several layouts, and goes on with the one that it finds
 * (reader.js). Frames are gray. All layouts have pilots: displays with ratex patches, and two single
 * images, are read by Python's receiver alone.
 */

import { images, receiverTrackingJudge } from "../../generated/constants.js";
import { DisplayReader } from "./reading/reader.js";
import { Repeats } from "./repeats.js";
import { Sight, StageTimes } from "./sight.js";
import { PilotTracker } from "./tracking/pilots.js";

/**
 * What a receiver has graphs for: to decode windows of film, and to map where displays toggle.
 *
 * @typedef {object} Graphs
 * @property {import("../export/filmGraph.js").WindowDecoder} film
 * @property {import("../export/regionGraph.js").RegionMapper} region
 */
/** @typedef {import("./reading/reader.js").Reading} Reading */
/** @typedef {import("./tracking/pilots.js").Tracked} Tracked */

export const { MIN_SIDE_PX } = images;
export const { AMISS_PAIRS } = receiverTrackingJudge;

/**
 * What one camera frame brought: the display, or null where it was not found, frame pairs that
 * could be decoded with this frame, and the message where it became whole with this frame.
 *
 * @typedef {{ tracked: Tracked | null } & Reading} ReceiverStep
 */

/** Reads a message from the frames of a camera that films the display. */
export class Receiver {
  #film;
  #fps;
  #repeats = new Repeats();
  #sight = new Sight();
  /** @type {Tracked | null} */
  #tracked = null;
  #tracker;
  /** @type {Map<Layout, DisplayReader>} */
  #readers;
  /** @type {DisplayReader} */
  #reader;
  /** Why a map could not be made, until that is told. @type {unknown} */
  #unmapped = null;
  /** Whether a display is followed. */
  #isFollowing = false;
  /** Number of frame pairs decoded when information of a message last came. */
  #toggled = 0;

  /**
   * @param {Layout[]} layouts - that are looked for
   * @param {Graphs} graphs
   * @param {number} [fps] - nominal number of frames of the camera in a second
   * @param {number} [frameMs] - time, in milliseconds, after which a search begins no step with a
   *   frame, for a camera that does not wait
   */
  constructor(layouts, { film, region }, fps = 30, frameMs = Infinity) {
    if (layouts.length === 0) throw new Error("layouts: need at least one");
    /** Time spent in each stage so far. */
    this.timing = new StageTimes();
    /** Number of frames in which the display was found. */
    this.found = 0;
    /** Number of frames taken. */
    this.frames = 0;
    this.#film = film;
    this.#fps = fps;
    /** @type {Graphs["region"]} */
    const mapper = {
      logOdds: (stills) =>
        region.logOdds(stills).catch((error) => {
          this.#unmapped = error;
          return new Float32Array(0); // the search goes on without regions
        }),
    };
    this.#tracker = new PilotTracker(layouts, mapper, fps, frameMs);
    const readers = layouts.map(
      (layout) => new DisplayReader(layout, film, fps, this.timing, this.#sight),
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
      progress: this.progress,
    };
  }

  /**
   * Take the next camera frame, once the one before is done with. The promise is rejected, and the
   * frame not looked at, where a map of an earlier one could not be made.
   *
   * @param {BytePlane} frame - gray; a search may keep it, so it must not change afterwards
   * @param {number} time - of the frame, seconds; rising from frame to frame
   * @returns {Promise<ReceiverStep>}
   */
  async push(frame, time) {
    this.#tell();
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
    if (shift !== null) this.#tracker.correct(shift);
    return { tracked, ...reading };
  }

  /** Throw why a map could not be made, once. */
  #tell() {
    const unmapped = this.#unmapped;
    this.#unmapped = null;
    if (unmapped) throw unmapped;
  }

  /**
   * Follow the display, or look for all layouts until one is found.
   *
   * A display that is followed in vain is looked for anew: it may be another one.
   *
   * @param {BytePlane} frame
   * @param {number} time
   * @param {number} begun - when the work on the frame began, milliseconds of `performance.now`
   */
  #find(frame, time, begun) {
    const isFollowed = this.#isFollowing;
    const isInVain = isFollowed && this.#isInVain();
    if (isInVain) this.#tracker.forget();
    const tracked = this.#tracker.follow(frame, time, begun);
    this.#isFollowing = tracked !== null;
    if (tracked === null || (isFollowed && !isInVain)) return tracked;
    this.#toggled = this.decoded;
    const reader = /** @type {DisplayReader} */ (this.#readers.get(this.#tracker.layout));
    if (reader !== this.#reader || isInVain) {
      this.#reader = reader;
      reader.restart();
    }
    // what fails here fails again, and is told, when a pair is decoded
    this.#film.load?.().catch(() => {});
    return tracked;
  }

  /** Tell whether many frame pairs of the display that is followed gave nothing of a message. */
  #isInVain() {
    if (this.synchronised && this.progress > 0) this.#toggled = this.decoded;
    return this.decoded - this.#toggled > AMISS_PAIRS;
  }

  /**
   * Decode what is left when the frames have ended.
   *
   * @returns {Promise<ReceiverStep>}
   */
  async finish() {
    this.#tell();
    return { tracked: null, ...(await this.#reader.finish()) };
  }
}
