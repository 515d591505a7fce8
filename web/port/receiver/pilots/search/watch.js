/** Watch a film from a reference frame on: what a search for a display by its pilots looks at. */

import { receiverPilotsSearchWatch } from "../../../../generated/constants.js";
import { roundHalfEven } from "../../../image/round.js";
import { inImage, transform } from "../../../link/geometry.js";
import { identity, inverse } from "../../../link/linear.js";
import { Compensator } from "../compensate.js";
import { Stabiliser } from "../stabilise.js";
import { position } from "../waves.js";
import { HeldFrame, MovingOutline, surroundingsOf } from "./film.js";
import { Stills } from "./stills.js";

const { WINDOW_S, LEAST_WINDOW, MOST_WINDOW, IN_VIEW, CHECKED, HELD_S, LEAST_HELD } =
  receiverPilotsSearchWatch;

/** Holds the frames of a film still against the camera's motion since a reference frame. */
export class Watch {
  #stabiliser;
  #compensator;
  #most;
  /**
   * Places of corners that follow their own motion, by corners; the second were found since their
   * picture was seen to move. @type {Map<Point[], Point[][]>[]}
   */
  #own = [new Map(), new Map()];
  /** Quadrilaterals that are followed by what surrounds them. @type {MovingOutline[]} */
  #outlines = [];
  /** Frames watched so far, the reference among them. @type {HeldFrame[]} */
  frames = [];
  /** Number of frames after the reference. */
  seen = 0;

  /**
   * @param {BytePlane} reference - the reference frame
   * @param {number} time - when it was taken, seconds
   * @param {number} fps - nominal number of frames of the camera in a second
   * @param {boolean} pictureMoves - whether pictures are taken to move: the room alone is held still,
   *   and what has only moved is taken off the frames before pilots are sought in them
   * @param {number} [longer] - number of times the usual number of frames that are watched
   */
  constructor(reference, time, fps, pictureMoves, longer = 1) {
    this.reference = reference;
    this.pictureMoves = pictureMoves;
    this.start = time;
    this.fps = fps;
    this.#stabiliser = new Stabiliser(reference, pictureMoves);
    const { width, height } = this.#stabiliser.reference;
    /** Small copies of the frames watched, held still. */
    this.stills = new Stills(width, height);
    const usual = Math.min(MOST_WINDOW, Math.max(LEAST_WINDOW, roundHalfEven(WINDOW_S * fps)));
    /** Number of frames that are watched. */
    this.window = longer * usual;
    /** Number of frames after which they are looked at first. */
    this.soon = Math.floor(usual / 2);
    /** Number of later frames that must agree with what is not certain. */
    this.confirming = Math.floor((2 * this.window) / 3);
    this.#most = Math.max(LEAST_HELD, roundHalfEven(HELD_S * fps), this.confirming);
    this.#compensator = pictureMoves ? new Compensator(fps) : null;
    const changes = this.#changes(reference);
    /** The newest frames of all. */
    this.held = [new HeldFrame(reference, identity(3), 0, time, null, [], changes)];
  }

  /** The frames watched, and of those that came later the newest. */
  get all() {
    const last = this.frames[this.frames.length - 1].at;
    return [...this.frames, ...this.held.filter(({ at }) => at > last)];
  }

  /** The newest frame. */
  get newest() {
    return this.held[this.held.length - 1];
  }

  /** Whether all frames have come that are watched. */
  get isFull() {
    return this.frames.length >= this.window;
  }

  /**
   * Hold the next frame still, and keep it where it still shows enough of the reference.
   *
   * @param {BytePlane} gray
   * @param {number} time - seconds
   * @returns {boolean} whether it does, which a frame of another size does not
   */
  take(gray, time) {
    const { width, height } = this.reference;
    if (gray.width !== width || gray.height !== height) return false;
    let H = this.#stabiliser.follow(gray);
    let { tracks } = this.#stabiliser;
    let surrounded = null;
    if (!this.#showsEnough(H)) {
      // a cut in the picture has taken the points along, or a pan
      tracks = null;
      surrounded = this.#surrounded(gray, null);
      H = surrounded[0]?.motion ?? null;
    }
    if (H === null || !this.#showsEnough(H)) return false;
    surrounded ??= this.#surrounded(gray, tracks);
    const at = position(time - this.start, this.fps);
    if (this.frames.length === 0) this.#add(this.held[0]); // now the film can be held still
    this.held.push(new HeldFrame(gray, H, at, time, tracks, surrounded, this.#changes(gray)));
    if (this.held.length > this.#most) this.held.shift();
    if (!this.isFull) this.#add(this.newest);
    this.seen++;
    return true;
  }

  /**
   * Tell whether a frame, held still so, shows enough of the reference.
   *
   * @param {Homography | null} HImageFromReference
   */
  #showsEnough(HImageFromReference) {
    if (HImageFromReference === null) return false;
    const { width, height } = this.reference;
    const places = CHECKED.map(
      ([x, y]) => /** @type {Point} */ ([x * width - 0.5, y * height - 0.5]),
    );
    const inView = inImage(transform(HImageFromReference, places), width, height);
    return inView.filter(Boolean).length >= IN_VIEW * places.length;
  }

  /**
   * Follow quadrilaterals by what surrounds them, too, from the reference on.
   *
   * @param {Point[][]} quads - pixels of the reference
   */
  surround(quads) {
    this.#outlines = quads.map((quad) => new MovingOutline(this.reference, quad));
  }

  /**
   * Tell whether the picture that corners of the reference bound moves by itself.
   *
   * @param {Point[]} corners
   */
  moves(corners) {
    return surroundingsOf(corners, this.newest.surrounded)?.outline.pictureMoves ?? false;
  }

  /**
   * Follow what surrounds quadrilaterals in the newest frame.
   *
   * @param {BytePlane} gray - the frame
   * @param {import("../stabilise.js").Tracks | null} tracks - points that were found again in it
   */
  #surrounded(gray, tracks) {
    return this.#outlines.flatMap((outline) => {
      const shown = tracks?.motionWithin(outline.quad);
      return outline.take(gray, shown ? transform(shown, outline.quad) : null) ?? [];
    });
  }

  /** Watch a frame. @param {HeldFrame} frame */
  #add(frame) {
    this.frames.push(frame);
    const still = (/** @type {BytePlane} */ copy) =>
      this.#stabiliser.still(copy, frame.HFrameFromReference);
    this.stills.add(
      still(this.#stabiliser.copyOf(frame.gray)), frame.changes ? still(frame.changes) : undefined,
    );
  }

  /**
   * Find what a small copy of the next frame shows beyond what has moved; null where pictures stand
   * still.
   *
   * @param {BytePlane} gray
   */
  #changes(gray) {
    return this.#compensator?.take(this.#stabiliser.copyOf(gray)) ?? null;
  }

  /**
   * Show what corners in the reference bound in the frames watched.
   *
   * @param {Point[]} corners
   * @param {number} width - of the views, pixels
   * @param {number} height
   */
  views(corners, width, height) {
    return this.stills.views(this.places(corners, null), width, height);
  }

  /**
   * Find where corners in the reference lie in the stills.
   *
   * @param {Point[]} corners
   * @param {number | null} count - of the frames, from the first on, in which they follow their own
   *   motion: what is nearer than the wall behind it moves farther when the camera moves sideways;
   *   null for one place, the room being held still; but where their picture moves, they follow what
   *   surrounds them in all frames
   * @returns {Point[][]} pixels of the stills: for each of the frames, or once for all
   */
  places(corners, count) {
    const moves = this.moves(corners);
    if (count === null && !moves) return [this.#stabiliser.onCopy(corners)];
    const last = count ?? this.frames.length;
    const own = this.#own[Number(moves)];
    const places = own.get(corners) ?? [];
    for (const frame of this.frames.slice(places.length, last)) {
      const HReferenceFromFrame = inverse(frame.HFrameFromReference);
      const seen = transform(HReferenceFromFrame, frame.corners(corners));
      places.push(this.#stabiliser.onCopy(seen));
    }
    own.set(corners, places);
    return places.slice(0, last);
  }

  /**
   * Move points from the reference to the stills.
   *
   * @param {Point[]} points
   */
  onCopy(points) {
    return this.#stabiliser.onCopy(points);
  }

  /**
   * Move points from the stills to the reference.
   *
   * @param {Point[]} points
   */
  onImage(points) {
    return this.#stabiliser.onImage(points);
  }
}
