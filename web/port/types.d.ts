/** Types that most modules use; each is named once, here, and needs no import. */

/** Samples of some type, with the image's width and height in pixels. */
type Plane<Samples = any> = import("./image/opencv.js").Plane<Samples>;
/** Gray levels of [0, 255], with the image's width and height in pixels. */
type BytePlane = Plane<Uint8Array>;
/** Real gray levels, with the image's width and height in pixels. */
type FloatPlane = Plane<Float32Array>;
/** Nine numbers of a 3 x 3 matrix, row by row, that maps points of one plane to another. */
type Homography = import("./link/geometry.js").Homography;
/** What the display shows: its grid, and its pilots or patches. */
type Layout = import("./link/layout.js").Layout;
/** Position x, y in pixels. */
type Point = import("./link/geometry.js").Point;
/** Corners of a quadrilateral in order. */
type Quad = import("./receiver/locate/quads.js").Quad;
/**
 * A search in steps, so that one who follows a stream can spread it over many frames.
 *
 * It yields after each step the units of work that the step took, and returns what it found. A unit
 * is about a millisecond of one core, in Python at 1280 x 720; JavaScript takes two or three. Steps
 * are finer than Python's, and no step takes long.
 */
type Steps<Result> = Generator<number, Result, void>;
/** When the display shows which state. */
type DisplayClock = import("./link/clock.js").DisplayClock;
/** The code of the order in which a display shows its states. */
type PilotCode = import("./link/pilotCode.js").PilotCode;
