/**
 * Find the picture within the black bars of a display: films are letterboxed, photographs upright.
 *
 * The edge between a dark part of a picture and a black bar is faint, while that of the panel is
 * strong. But a whole row or column of a bar is flat, and one of the picture hardly ever is. A bar that
 * reflects a lamp is flat but for a glow without details, as the sky of a picture may be, so both are
 * proposed: the picture of what is not flat, and that of what has details.
 */

import { receiverPilotsSearchBars } from "../../../../generated/constants.js";
import { blurred } from "../../../image/blur.js";
import { warped } from "../../../image/warp.js";
import { homographyFromCorners, transform } from "../../../link/geometry.js";
import { spreadOf } from "../../../link/order.js";

const {
  SIDE_PX, SMOOTH_PX, FLAT, GLOW_PX, MARGIN, LEAST_BAR, LEAST_PICTURE,
} = receiverPilotsSearchBars;

/**
 * Find the picture within a quadrilateral that has bars along some of its sides.
 *
 * @param {BytePlane} gray
 * @param {Point[]} quad - pixels of it, the outline of a panel or of its bezel
 * @returns {Point[][]} where bars are flat and where they may glow; none where there are no bars, or
 *   nothing else
 */
export function withoutBars(gray, quad) {
  const H = homographyFromCorners(quad, SIDE_PX, SIDE_PX);
  const { data } = blurred(warped(gray, H, SIDE_PX, SIDE_PX), SMOOTH_PX);
  const margin = Math.floor(MARGIN * SIDE_PX);
  return [false, true].flatMap((glows) => {
    const rows = seen((y, x) => data[y * SIDE_PX + x], margin, SIDE_PX - margin, glows);
    const columns = rows && seen((x, y) => data[y * SIDE_PX + x], ...rows, glows);
    if (!rows || !columns) return [];
    const [[top, bottom], [left, right]] = [rows, columns];
    if (Math.max(top, left, SIDE_PX - bottom, SIDE_PX - right) < LEAST_BAR) return [];
    if ((bottom - top) * (right - left) < LEAST_PICTURE * SIDE_PX ** 2) return [];
    const [x, y] = [[left, right], [top, bottom]].map((ends) => ends.map((end) => end - 0.5));
    return [transform(H, [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])];
  });
}

/**
 * Give the first line in which something is seen, and the one after the last of them.
 *
 * A single line counts for nothing: it may be the edge of the panel.
 *
 * @param {(line: number, at: number) => number} level - of a line's pixel
 * @param {number} from - first pixel of each line that counts
 * @param {number} to - pixel after the last one
 * @param {boolean} glows - whether only details count
 * @returns {[number, number] | null}
 */
function seen(level, from, to, glows) {
  const isSeen = Array.from({ length: SIDE_PX }, (_, line) => {
    const levels = Array.from({ length: to - from }, (_, at) => level(line, from + at));
    if (!glows) return spreadOf(levels)[1] > FLAT;
    const row = { width: levels.length, height: 1, data: Float32Array.from(levels) };
    const glow = blurred(row, GLOW_PX).data;
    return spreadOf(levels.map((each, at) => each - glow[at]))[1] > FLAT;
  });
  const both = isSeen.flatMap((now, line) => (now && isSeen[line + 1] ? [line] : []));
  return both.length > 0 ? [both[0], both[both.length - 1] + 2] : null;
}
