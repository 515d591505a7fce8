/**
 * Outline displays in a map of where they toggle, which gives the log-odds that a cell shows a part of
 * a display. Of independent cells, the display would be the quadrilateral within which their sum is
 * largest (receiver/pilots/search/regions.py).
 */

import { geometry, receiverPilotsSearchRegions } from "../../../../generated/constants.js";
import { inImage, sideLengths, signedArea } from "../../../link/geometry.js";
import { dot } from "../../../link/linear.js";
import { distinct, isNested, rolled, upright } from "../../locate/quads.js";

const {
  REGIONS, LEAST_CELLS, MOST_ODDS, BEYOND_CELLS, BEYOND_ODDS, LEAVING_ODDS, STEPS,
  SURELY_LYING, MOST_MOVES, MOVES, PICTURE_SHARES, PORTRAITS, PORTRAIT_PART, PORTRAIT_SHAPE,
  FOCAL_SHARE, SAME_CELLS,
} = receiverPilotsSearchRegions;
const { UNIT_SQUARE } = geometry;

/**
 * Sums of the cells to the left in each row of a map with margins of `BEYOND_CELLS`, and how many there
 * are in a row.
 *
 * @typedef {{ sums: Float32Array, cols: number }} Sums
 */

/**
 * Outline the displays of a map.
 *
 * @param {Float32Array} logOdds - natural log-odds of each cell
 * @param {number} width - of the map, cells
 * @returns {Point[][]} quadrilaterals in cells, where (0, 0) is the corner of the first cell; clockwise,
 *   the likeliest first. They may reach beyond the map.
 */
export function outlineRegions(logOdds, width) {
  const sums = sumsOf(logOdds, width);
  return partsOf(logOdds, width)
    .slice(0, REGIONS)
    .filter((part) => part.length >= LEAST_CELLS)
    .map((part) => climbed(rectangleOf(part, width), sums))
    .sort((one, other) => other.likelihood - one.likelihood)
    .map(({ outline }) => outline);
}

/**
 * Choose the quadrilaterals that are likeliest and differ from one another.
 *
 * @param {Point[][]} quads - in cells, upright
 * @param {Float32Array} logOdds - natural log-odds of each cell
 * @param {number} width - of the map, cells
 * @param {number} limit - largest number chosen
 * @returns {number[]} indices, the likeliest first
 */
export function likeliest(quads, logOdds, width, limit) {
  const sums = sumsOf(logOdds, width);
  return distinct(quads, quads.map((quad) => within(quad, sums)), limit, SAME_CELLS);
}

/**
 * Choose quadrilaterals that may be a display which leaves the image, if one does.
 *
 * @param {Point[][]} quads - in cells, upright, which edges propose
 * @param {Float32Array} logOdds - natural log-odds of each cell
 * @param {number} width - of the map, cells
 * @returns {Point[][]} none where the outline of the likeliest cells keeps off the image's border; else
 *   the likeliest of `quads`, if there are any, and this outline
 */
export function leavingRegions(quads, logOdds, width) {
  const odds = leaning(logOdds);
  const outlines = outlineRegions(odds, width).slice(0, 1);
  const height = logOdds.length / width;
  const isLeaving = outlines.some((outline) =>
    outline.some(([x, y]) => Math.min(x, y) <= 1 || x >= width - 1 || y >= height - 1),
  );
  if (!isLeaving) return [];
  return [...likeliest(quads, odds, width, 1).map((at) => quads[at]), ...outlines];
}

/**
 * Make all cells of a map likelier, as where a display may leave the image.
 *
 * @param {Float32Array} logOdds - natural log-odds of each cell
 */
export const leaning = (logOdds) => logOdds.map((odds) => odds + LEAVING_ODDS);

/**
 * Make the outline of what has the same middle as another in the plane of a display. It may be narrower,
 * where a picture is dark along its sides, or higher, where bars above and below a film belong to it.
 *
 * @param {Point[]} outline - of a panel or a film, clockwise
 * @param {number} across - width of what is sought, as a share of the outline's longer side
 * @param {number} down - its height, as a share of the outline's shorter side
 * @returns {Point[]} what is sought, of which the first corner is the top left if the outline is upright,
 *   or turned to the left
 */
export function aboutMiddle(outline, across, down) {
  const places = UNIT_SQUARE.map(([x, y]) => [0.5 + (x - 0.5) * across, 0.5 + (y - 0.5) * down]);
  return onQuad(lying(outline), places);
}

/**
 * Choose portrait pictures in quadrilaterals of which three sides bound one, if any does. The fourth side
 * is then that of the display beyond a black bar; which side it is nobody knows.
 *
 * @param {Point[][]} quads - in cells, clockwise
 * @param {Float32Array[]} maps - natural log-odds of each cell, each
 * @param {number} width - of the maps, cells
 * @returns {Point[][]} for each map, at most `PORTRAITS` pictures that differ, in cells, upright; the
 *   likeliest first
 */
export function portraitParts(quads, maps, width) {
  const atLeft = UNIT_SQUARE.map(([x, y]) => [x * PORTRAIT_PART, y]);
  const parts = quads.flatMap((quad) =>
    quad.map((_, side) => upright(onQuad(rolled(quad, side), atLeft))),
  );
  return maps.flatMap((odds) => likeliest(parts, odds, width, PORTRAITS).map((at) => parts[at]));
}

/**
 * Place what is not seen of a picture or panel that leaves the image, by its shape: three sides of a
 * rectangle tell how it lies in space, and one length the others.
 *
 * @param {Point[]} quad - pixels, clockwise from the top left; a side of which both corners are outside
 *   the image is taken for a guess, and the others for right
 * @param {readonly number[]} shapes - widths over heights that it may have
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 * @returns {Point[][]} for each side that is outside and each shape, the quadrilateral with this side
 *   where a rectangle of the shape has it before a camera of `FOCAL_SHARE`
 */
export function reachingBeyond(quad, shapes, width, height) {
  const middle = [(width - 1) / 2, (height - 1) / 2];
  const focal = FOCAL_SHARE * Math.max(width, height);
  const ray = (/** @type {Point} */ point) => [
    ...point.map((place, axis) => (place - middle[axis]) / focal), 1,
  ];
  const seen = (/** @type {number[]} */ [x, y, z]) =>
    /** @type {Point} */ ([x, y].map((place, axis) => (place / z) * focal + middle[axis]));
  const found = [];
  for (const side of quad.keys()) {
    const turned = rolled(quad, side); // from the side that may be outside on
    if (inImage(turned.slice(0, 2), width, height).some(Boolean)) continue;
    const [a, b, c, d] = turned.map(ray); // to the corners
    const along = cross(cross(d, a), cross(c, b)); // where both other sides go to
    const across = cross(cross(d, c), along);
    const [cSide, dSide] = [cross(c, across), cross(d, across)];
    const far = dot(cSide, dSide) / dot(cSide, cSide);
    const corner = c.map((part) => far * part); // so far away that it is beside d
    const sign = Math.sign(dot(along, a) - dot(along, d)) / Math.hypot(...along);
    const length = sign * Math.hypot(...corner.map((part, k) => part - d[k]));
    for (const shape of shapes) {
      const long = length * (side % 2 ? shape : 1 / shape);
      const ends = [d, corner].map((end) => end.map((part, k) => part + long * along[k]));
      if (!ends.every((end) => end[2] > 0)) continue; // behind the camera
      found.push(rolled([...ends.map(seen), turned[2], turned[3]], 4 - side));
    }
  }
  return found;
}

/**
 * Place the ends of a portrait picture that is longer than the image, as `reachingBeyond` does.
 *
 * @param {Point[]} part
 * @param {number} width - of the image, pixels
 * @param {number} height - of the image, pixels
 */
export function portraitBeyond(part, width, height) {
  const [top, right, bottom, left] = sideLengths(part);
  const shape = right + left > top + bottom ? PORTRAIT_SHAPE : 1 / PORTRAIT_SHAPE;
  return reachingBeyond(part, [shape], width, height);
}

/**
 * Multiply two vectors in space.
 *
 * @param {number[]} one
 * @param {number[]} other
 */
function cross([x, y, z], [u, v, w]) {
  return [y * w - z * v, z * u - x * w, x * v - y * u];
}

/**
 * Choose what may be the whole of a panel: the outline of strongest edges, and one within it.
 *
 * @param {Point[][]} quads - outlines, clockwise, the strongest first
 * @returns {Point[][]} the strongest, and the strongest of those that lie within it at a bezel's
 *   distance
 */
export function panelsOf(quads) {
  const within = quads.slice(1).filter((quad) => isNested(quad, quads[0]));
  return [...quads.slice(0, 1), ...within.slice(0, 1)];
}

/**
 * Propose pictures between black bars to their left and right, in the middle of panels.
 *
 * @param {Point[][]} panels - outlines of displays of 16:9, clockwise, the likeliest first
 * @returns {Point[][]} as of `aboutMiddle`: pictures of the likeliest shape in each panel, then others
 */
export function picturesIn(panels) {
  return PICTURE_SHARES.flatMap((share) => panels.map((panel) => aboutMiddle(panel, share, 1)));
}

/**
 * Turn outlines in each way that is likely for a picture of such a shape, or in the other ways. Pictures
 * are taken to be wider than they are high, and not to stand upside down. What is about as wide as high
 * may be turned or not: seen from the side, it looks narrower than it is.
 *
 * @param {Point[][]} quads - outlines, clockwise from the corner nearest to the image's top left; the
 *   likeliest first
 * @param {boolean} [isLikely] - whether the likely ways are asked for, or all others
 * @returns {Generator<Point[]>} the outline from the picture's top left corner on; the likeliest way of
 *   each outline before the next one of any
 */
export function* waysUp(quads, isLikely = true) {
  const turns = quads.map((quad) => {
    const likely = likelyTurns(quad);
    return isLikely ? likely : [0, 1, 2, 3].filter((turn) => !likely.includes(turn));
  });
  for (let rank = 0; rank < 4; rank++) {
    for (const [at, quad] of quads.entries()) {
      if (rank < turns[at].length) yield rolled(quad, turns[at][rank]);
    }
  }
}

/**
 * List the quarter turns that are likely for an outline, as `waysUp` says.
 *
 * @param {Point[]} quad
 */
export function likelyTurns(quad) {
  const [top, right, bottom, left] = sideLengths(quad);
  if (top + bottom > SURELY_LYING * (right + left)) return [0];
  return right + left > SURELY_LYING * (top + bottom) ? [3, 1] : [0, 3, 1];
}

/**
 * Find where places of a rectangle are in its perspective picture. If each corner weighs as much as the
 * triangle of the other three has area, the picture of the rectangle's middle is the weighted mean of
 * the corners, and that of other places likewise.
 *
 * @param {Point[]} quad - picture of the rectangle, clockwise from the top left
 * @param {number[][]} places - which are 0 and 1 at the corners of the rectangle
 */
function onQuad(quad, places) {
  const areas = quad.map((_, at) => Math.abs(signedArea(rolled(quad, at + 1).slice(0, 3))));
  return places.map(([x, y]) => {
    const near = [(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y];
    const weights = near.map((share, at) => share * areas[at]);
    const [left, top] = [0, 1].map((axis) => dot(weights, quad.map((corner) => corner[axis])));
    const sum = dot(weights, [1, 1, 1, 1]);
    return /** @type {Point} */ ([left / sum, top / sum]);
  });
}

/**
 * Roll the corners of a quadrilateral until its longer sides are above and below.
 *
 * @param {Point[]} quad
 */
function lying(quad) {
  const [top, right, bottom, left] = sideLengths(quad);
  return top + bottom >= right + left ? quad : rolled(quad, 1);
}

/**
 * Add up each row of a map, with margins in which nothing is known.
 *
 * @param {Float32Array} logOdds
 * @param {number} width
 * @returns {Sums}
 */
function sumsOf(logOdds, width) {
  const height = logOdds.length / width;
  const cols = width + 2 * BEYOND_CELLS + 1;
  const sums = new Float32Array(cols * (height + 2 * BEYOND_CELLS));
  for (let at = 0; at < sums.length; at++) {
    const x = (at % cols) - 1 - BEYOND_CELLS;
    const y = Math.floor(at / cols) - BEYOND_CELLS;
    if (x < -BEYOND_CELLS) continue; // nothing is to the left
    const isKnown = x >= 0 && x < width && y >= 0 && y < height;
    const odds = isKnown ? logOdds[y * width + x] : Math.fround(BEYOND_ODDS);
    sums[at] = sums[at - 1] + Math.min(Math.max(odds, -MOST_ODDS), MOST_ODDS);
  }
  return { sums, cols };
}

/**
 * Collect the cells, each likelier than not, that are connected by their sides.
 *
 * @param {Float32Array} logOdds
 * @param {number} width
 * @returns {number[][]} the cells of each part, the largest part first
 */
function partsOf(logOdds, width) {
  const isFree = Array.from(logOdds, (odds) => odds > 0);
  const parts = [];
  for (let first = 0; first < isFree.length; first++) {
    if (!isFree[first]) continue;
    const part = [first];
    isFree[first] = false;
    for (const cell of part) {
      const x = cell % width;
      const beside = [x > 0 ? cell - 1 : -1, x < width - 1 ? cell + 1 : -1, cell - width, cell + width];
      for (const next of beside.filter((each) => isFree[each])) {
        isFree[next] = false;
        part.push(next); // whose neighbours this loop takes later
      }
    }
    parts.push(part);
  }
  return parts.sort((one, other) => other.length - one.length);
}

/**
 * Make the rectangle, clockwise, whose centre and moments are those of some cells.
 *
 * @param {number[]} part
 * @param {number} width - of the map
 * @returns {Point[]}
 */
function rectangleOf(part, width) {
  /** @param {(x: number, y: number) => number} of - what is added up over the cells */
  const sum = (of) => part.reduce((all, cell) => all + of(cell % width, Math.floor(cell / width)), 0);
  const [centreX, centreY] = [sum((x) => x) / part.length, sum((_, y) => y) / part.length];
  const [xx, xy, yy] = [
    sum((x) => (x - centreX) ** 2),
    sum((x, y) => (x - centreX) * (y - centreY)),
    sum((_, y) => (y - centreY) ** 2),
  ].map((moment) => moment / (part.length - 1));
  const spread = Math.hypot((xx - yy) / 2, xy);
  const mean = (xx + yy) / 2 + 1 / 12; // a cell is a square itself
  const angle = Math.atan2(2 * xy, xx - yy) / 2;
  const [long, short] = [mean + spread, mean - spread].map((variance) => Math.sqrt(3 * variance));
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([along, across]) => [
    centreX + 0.5 + along * long * cos - across * short * sin,
    centreY + 0.5 + along * long * sin + across * short * cos,
  ]);
}

/**
 * Move corners and sides as long as the sum of the log-odds within grows.
 *
 * @param {Point[]} outline
 * @param {Sums} sums
 */
function climbed(outline, sums) {
  let likelihood = within(outline, sums);
  for (const step of STEPS) {
    for (let count = 0; count < MOST_MOVES; count++) {
      const quads = MOVES.map((move) => outline.map(([x, y], at) => /** @type {Point} */ ([
        x + step * move[at][0], y + step * move[at][1],
      ])));
      const likelihoods = quads.map((quad) => (isSound(quad, sums) ? within(quad, sums) : -Infinity));
      const most = Math.max(...likelihoods);
      if (!(most > likelihood)) break;
      likelihood = most;
      outline = quads[likelihoods.indexOf(most)];
    }
  }
  return { likelihood, outline };
}

/**
 * Tell whether a quadrilateral is convex, clockwise, and within the margins.
 *
 * @param {Point[]} quad
 * @param {Sums} sums
 */
function isSound(quad, { sums, cols }) {
  const [right, bottom] = [cols - 1 - BEYOND_CELLS, sums.length / cols - BEYOND_CELLS];
  return quad.every(([x, y], at) => {
    if (Math.min(x, y) < -BEYOND_CELLS || x > right || y > bottom) return false;
    const [[nextX, nextY], [lastX, lastY]] = [quad[(at + 1) & 3], quad[(at + 2) & 3]];
    return (nextX - x) * (lastY - nextY) - (nextY - y) * (lastX - nextX) > 0;
  });
}

/**
 * Add up a map within a quadrilateral, by the sums of each row up to its sides.
 *
 * @param {Point[]} quad - clockwise, in cells
 * @param {Sums} sums
 * @returns {number} the sum over the rows whose middle lies within; parts of cells count as such
 */
function within(quad, { sums, cols }) {
  const beyond = sums.length / cols - BEYOND_CELLS;
  let total = 0;
  quad.forEach(([x, y], corner) => {
    const [endX, endY] = quad[(corner + 1) & 3];
    const end = Math.min(Math.max(y, endY), beyond);
    let row = Math.max(Math.ceil(Math.min(y, endY) - 0.5), -BEYOND_CELLS);
    for (; row + 0.5 < end; row++) {
      const crossing = x + ((row + 0.5 - y) / (endY - y)) * (endX - x);
      const at = Math.min(Math.max(crossing + BEYOND_CELLS, 0), cols - 1);
      const left = Math.min(Math.floor(at), cols - 2);
      const first = (row + BEYOND_CELLS) * cols + left;
      const upTo = sums[first] + (sums[first + 1] - sums[first]) * (at - left);
      total += Math.sign(endY - y) * upTo;
    }
  });
  return total;
}
