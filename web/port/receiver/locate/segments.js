/** Straight segments of an image (LSD, Grompone von Gioi et al. 2010). */

import { receiverLocateQuads } from "../../../generated/constants.js";
import { call } from "../../image/opencv.js";

/**
 * A segment from (x1, y1) to (x2, y2), pixels; which side is bright follows from its direction.
 *
 * @typedef {[number, number, number, number]} Segment
 */

const { MIN_SEGMENT_PX, MAX_SEGMENTS } = receiverLocateQuads;

/** Largest number of segments, long and short ones, that the detector may find. */
const ROOM = 1 << 14;

/**
 * Find the longest straight segments of an image.
 *
 * @param {BytePlane} gray
 * @returns {Segment[]}
 */
export function longestSegments(gray) {
  const ends = new Float32Array(4 * ROOM);
  const count = call("segments", [gray], [ends]);
  const found = Array.from({ length: count }, (_, i) => {
    const [x1, y1, x2, y2] = ends.subarray(4 * i, 4 * i + 4);
    return { segment: /** @type {Segment} */ ([x1, y1, x2, y2]), length: Math.hypot(x2 - x1, y2 - y1) };
  });
  found.sort((one, other) => other.length - one.length);
  const long = found.slice(0, MAX_SEGMENTS).filter(({ length }) => length >= MIN_SEGMENT_PX);
  return long.map(({ segment }) => segment);
}
