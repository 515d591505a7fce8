/**
 * Quadrilaterals from the ratex patches alone, for a picture whose border shows no edges.
 *
 * A dark picture in a dark bezel, or one on a page of its own colour, has no edges around it, and
 * its patches stand out all the more. Where the image is steep at a patch's size, a bank of turned
 * and foreshortened patches is correlated; patches that fit together make a quadrilateral.
 */

import { receiverLocateSpots } from "../../../generated/constants.js";
import { scaled } from "../../image/shrink.js";
import { distance, homographyFromPoints, inImage, transform } from "../../link/geometry.js";
import { determinant, inverse, multiply3 } from "../../link/linear.js";
import { SEEN_PX, WINDOW_PX, bankOf, compare } from "./bank.js";
import { patchCentres } from "./patches.js";
import { distinct, isSound } from "./quads.js";
import { steepestPlaces } from "./steep.js";

export const { MAX_OUTSIDE } = receiverLocateSpots;
const {
  PATCH_PX, SPOTS, KEPT, MAX_TURN_DEG, MAX_RATIO, MISSING, SUPPORT, BEND,
  LEAST_DEPTH, SAME_WHOLE_PX, SAME_PARTIAL_PX,
} = receiverLocateSpots;

/** Number of places that are compared in one step. */
const STEP_SPOTS = 5;
/** Smallest distance of two matches of a patch, in its sides. */
const MATCHES_APART = 0.4;
/** Largest difference, in radians, of a match's direction from what the quadrilateral has there. */
const MAX_TURN = (MAX_TURN_DEG * Math.PI) / 180;
/**
 * Units of work of drawing templates, of resizing, of finding steep places, of comparing places, and
 * of one combination.
 */
const DRAW_WORK = 10;
const RESIZE_WORK = 1;
const STEEP_WORK = 3;
const COMPARE_WORK = 0.75;
const COMBINE_WORK = 2;

/**
 * A place where a patch may be: its centre and side in pixels of the small image, the direction of
 * the display's x axis in radians, and the correlation with the drawn patch.
 *
 * @typedef {{ at: Point, turn: number, size: number, match: number }} Match
 */

/**
 * Find where each patch of a layout may be.
 *
 * @param {BytePlane} gray
 * @param {Layout} layout - with patches
 * @returns {Steps<Match[][]>} the matches of each patch, the best first
 */
export function* spotSteps(gray, layout) {
  /** @type {Match[][]} */
  const found = layout.ratex.map(() => []);
  const bank = bankOf(layout);
  yield DRAW_WORK;
  for (const size of PATCH_PX) yield* matchesOfSize(gray, bank, size, found);
  return found.map(bestApart);
}

/**
 * Compare an image with all templates at one size.
 *
 * @param {BytePlane} gray
 * @param {number} bank - its number
 * @param {number} size - side of a patch, pixels
 * @param {Match[][]} found - takes the matches of each patch
 */
function* matchesOfSize(gray, bank, size, found) {
  const factor = SEEN_PX / size;
  const image = scaled(gray, factor);
  if (Math.min(image.width, image.height) < 3 * WINDOW_PX) return;
  yield RESIZE_WORK;
  const spots = steepestPlaces(image, WINDOW_PX, SPOTS);
  yield STEEP_WORK;
  const half = WINDOW_PX >> 1;
  const toImage = (/** @type {number} */ start) => (start + half + 0.5) / factor - 0.5;
  for (let first = 0; first < spots.length; first += STEP_SPOTS) {
    for (const best of compare(bank, found.length, image, spots.slice(first, first + STEP_SPOTS))) {
      best.forEach((place, patch) => {
        if (place === null) return;
        const { left, top, turn, match } = place;
        found[patch].push({ at: [toImage(left), toImage(top)], turn, size, match });
      });
    }
    yield COMPARE_WORK;
  }
}

/**
 * Keep the best matches of a patch that are not at one place.
 *
 * @param {Match[]} matches
 */
function bestApart(matches) {
  /** @type {Match[]} */
  const kept = [];
  for (const match of matches.sort((one, other) => other.match - one.match)) {
    if (kept.length === KEPT) break;
    if (kept.every(({ at, size }) => distance(match.at, at) > MATCHES_APART * size)) {
      kept.push(match);
    }
  }
  return kept;
}

/**
 * List which patches lie in the four corners, in corner order.
 *
 * @param {Layout} layout
 * @returns {number[]} empty where one has none
 */
export function cornerCells(layout) {
  const [bottom, right] = [layout.rows - 1, layout.cols - 1];
  const cells = [
    [0, 0],
    [0, right],
    [bottom, right],
    [bottom, 0],
  ].map(([row, col]) => layout.ratex.findIndex((cell) => cell[0] === row && cell[1] === col));
  return cells.includes(-1) ? [] : cells;
}

/**
 * Make quadrilaterals that lie in the image of the patches in the four corners, or of three.
 *
 * @param {Match[][]} found - matches of each patch, from `spotSteps`
 * @param {Layout} layout - with patches in the four corners; else nothing is found
 * @param {BytePlane} gray - the image
 * @param {number} limit - largest number returned
 * @returns {Steps<Quad[]>} top-left of the displayed picture first; the likeliest one first
 */
export function* wholeSteps(found, layout, gray, limit) {
  const corners = cornerCells(layout);
  /** @type {Quad[]} */
  const quads = [];
  /** @type {number[]} */
  const ranks = [];
  for (const missing of [-1, 0, 1, 2, 3]) {
    const lists = corners.map((patch, i) => (i === missing ? [null] : found[patch]));
    if (lists.length && lists.every((list) => list.length)) {
      combine(lists, missing, layout, gray, quads, ranks);
    }
    yield COMBINE_WORK;
  }
  const centres = patchCentres(layout);
  const inner = corners.map((patch) => centres[patch]);
  return distinct(quads, ranks, limit, SAME_WHOLE_PX).map((at) =>
    transform(homographyFromPoints(inner, quads[at]), SQUARE),
  );
}

/** Corners of the display, in display units. */
const SQUARE = /** @type {Quad} */ ([
  [0, 0],
  [1, 0],
  [1, 1],
  [0, 1],
]);

/**
 * Put matches of the four corners together where they fit.
 *
 * @param {(Match | null)[][]} lists - matches of each corner; null for the one that is missing
 * @param {number} missing - number of that corner, or -1
 * @param {Layout} layout
 * @param {BytePlane} gray
 * @param {Quad[]} quads - takes the centres of the patches
 * @param {number[]} ranks - takes how well they match
 */
function combine(lists, missing, layout, gray, quads, ranks) {
  // the top side has the direction of both of its patches, and the bottom side, too
  const tops = pairsAlong(lists[0], lists[1]);
  const bottoms = pairsAlong(lists[3], lists[2]);
  for (const [first, second] of tops) {
    for (const [fourth, third] of bottoms) {
      const matches = [first, second, third, fourth];
      const points = matches.map((match) => match?.at ?? /** @type {Point} */ ([0, 0]));
      if (missing >= 0) {
        const [one, two, three] = [1, 2, 3].map((k) => points[(missing + k) % 4]);
        points[missing] = [one[0] - two[0] + three[0], one[1] - two[1] + three[1]];
      }
      if (!isSound(points, gray.width, gray.height)) continue;
      const { sizes, turns } = expected(points, layout);
      if (!matches.every((match, i) => !match || isAlike(match, sizes[i], turns[i]))) continue;
      quads.push(points);
      ranks.push(matches.reduce((sum, match) => sum + (match?.match ?? MISSING), 0));
    }
  }
}

/**
 * List the pairs of matches that have about the direction from one to the other.
 *
 * @param {(Match | null)[]} left
 * @param {(Match | null)[]} right
 */
function pairsAlong(left, right) {
  /** @type {[Match | null, Match | null][]} */
  const pairs = [];
  for (const one of left) {
    for (const other of right) {
      if (one && other) {
        const turn = Math.atan2(other.at[1] - one.at[1], other.at[0] - one.at[0]);
        if (angleApart(one.turn, turn) >= MAX_TURN) continue;
        if (angleApart(other.turn, turn) >= MAX_TURN) continue;
      }
      pairs.push([one, other]);
    }
  }
  return pairs;
}

/**
 * @param {number} one - radians
 * @param {number} other - radians
 */
function angleApart(one, other) {
  const off = Math.abs(one - other) % (2 * Math.PI);
  return Math.min(off, 2 * Math.PI - off);
}

/**
 * Tell whether a match has about the side and turn that are expected of it.
 *
 * @param {Match} match
 * @param {number} side - pixels
 * @param {number} turn - radians
 */
function isAlike(match, side, turn) {
  const ratio = match.size / side;
  if (!(ratio < MAX_RATIO && ratio > 1 / MAX_RATIO)) return false;
  return angleApart(match.turn, turn) < MAX_TURN;
}

/**
 * Tell whether there is a side and a turn that two matches are both like.
 *
 * @param {Match} one
 * @param {Match} other
 */
function mayAgree(one, other) {
  const ratio = one.size / other.size;
  if (!(ratio < MAX_RATIO ** 2 && ratio > MAX_RATIO ** -2)) return false;
  return angleApart(one.turn, other.turn) < 2 * MAX_TURN;
}

/**
 * Work out the sizes and turns of patches whose centres are given.
 *
 * By the homography of the unit square to the quadrilateral (Heckbert 1989): its area element
 * falls with the cube of w.
 *
 * @param {Quad} points
 * @param {Layout} layout
 */
function expected([p0, p1, p2, p3], layout) {
  const bend = [p0[0] - p1[0] + p2[0] - p3[0], p0[1] - p1[1] + p2[1] - p3[1]];
  const one = [p1[0] - p2[0], p1[1] - p2[1]];
  const two = [p3[0] - p2[0], p3[1] - p2[1]];
  const below = one[0] * two[1] - two[0] * one[1];
  const g = (bend[0] * two[1] - two[0] * bend[1]) / below;
  const h = (one[0] * bend[1] - bend[0] * one[1]) / below;
  const right = [p1[0] - p0[0] + g * p1[0], p1[1] - p0[1] + g * p1[1]];
  const down = [p3[0] - p0[0] + h * p3[0], p3[1] - p0[1] + h * p3[1]];
  const H = [right[0], down[0], p0[0], right[1], down[1], p0[1], g, h, 1];
  const area = Math.abs(determinant(H)) / ((layout.rows - 1) * (layout.cols - 1));
  const sizes = [1, 1 + g, 1 + g + h, 1 + h].map((w) =>
    Math.sqrt(area / Math.max(Math.abs(w), 1e-3) ** 3),
  );
  const top = Math.atan2(p1[1] - p0[1], p1[0] - p0[0]);
  const bottom = Math.atan2(p2[1] - p3[1], p2[0] - p3[0]);
  return { sizes, turns: [top, top, bottom, bottom] };
}

/**
 * Make quadrilaterals of three patches, for a display that is partly in view or covered.
 *
 * Three corners, or two neighbouring ones and a patch between, tell an affine map of the display;
 * what the other patches show where it puts them ranks it. Perspective is then guessed from the
 * sizes of the three, in nine ways: the homography of three points, and of their depths.
 *
 * @param {Match[][]} found - matches of each patch, from `spotSteps`
 * @param {Layout} layout - with patches in the four corners; else nothing is found
 * @param {BytePlane} gray - the image
 * @param {number} limit - largest number of triples
 * @returns {Steps<Quad[][]>} for each triple, nine quadrilaterals, top-left of the displayed
 *   picture first; corners behind the camera are not finite. The likeliest one comes first.
 */
export function* partialSteps(found, layout, gray, limit) {
  const corners = cornerCells(layout);
  const inner = layout.ratex.map((_, patch) => patch).filter((patch) => !corners.includes(patch));
  const triples = [
    ...corners.map((_, i) => corners.filter((_, j) => j !== i)),
    ...corners.flatMap((patch, i) =>
      inner.slice(0, 1).map((third) => [patch, corners[(i + 1) % 4], third]),
    ),
  ];
  /** @type {{ quad: Quad, rank: number, chosen: Match[], triple: number[] }[]} */
  const every = [];
  for (const triple of triples) {
    for (const affine of affineQuads(triple, found, layout, gray)) every.push(affine);
    yield COMBINE_WORK;
  }
  const quads = every.map(({ quad }) => quad);
  const ranks = every.map(({ rank }) => rank);
  return distinct(quads, ranks, limit, SAME_PARTIAL_PX).map((at) =>
    bentQuads(every[at].triple, every[at].chosen, layout),
  );
}

/**
 * List the affine maps of the display that matches of three patches tell.
 *
 * @param {number[]} triple - numbers of the patches
 * @param {Match[][]} found
 * @param {Layout} layout
 * @param {BytePlane} gray
 */
function* affineQuads(triple, found, layout, gray) {
  const centres = patchCentres(layout);
  const fromCentres = inverse(triple.flatMap((patch) => [...centres[patch], 1]));
  const others = centres.map((_, patch) => patch).filter((patch) => !triple.includes(patch));
  const cells = layout.rows * layout.cols;
  for (const one of found[triple[0]]) {
    for (const two of found[triple[1]]) {
      if (!mayAgree(one, two)) continue;
      for (const three of found[triple[2]]) {
        if (!mayAgree(one, three) || !mayAgree(two, three)) continue;
        const chosen = [one, two, three];
        const map = multiply3(fromCentres, chosen.flatMap(({ at }) => [...at, 1]));
        const area = map[0] * map[4] - map[1] * map[3];
        if (!(area > 0)) continue;
        const side = Math.sqrt(Math.max(area, 1e-9) / cells);
        const turn = Math.atan2(map[1], map[0]);
        if (!chosen.every((match) => isAlike(match, side, turn))) continue;
        const put = (/** @type {Point} */ [x, y]) =>
          /** @type {Point} */ ([
            x * map[0] + y * map[3] + map[6],
            x * map[1] + y * map[4] + map[7],
          ]);
        const quad = SQUARE.map(put);
        if (!isSound(quad, gray.width, gray.height, MAX_OUTSIDE)) continue;
        let rank = one.match + two.match + three.match;
        const reach = SUPPORT * Math.sqrt(cells) * side;
        for (const patch of others) {
          const there = put(centres[patch]);
          if (!inImage([there], gray.width, gray.height)[0]) rank += MISSING;
          else {
            let support = 0;
            for (const { at, match } of found[patch]) {
              if (distance(at, there) < reach) support = Math.max(support, match);
            }
            rank += support;
          }
        }
        yield { quad, rank, chosen, triple };
      }
    }
  }
}

/**
 * Guess the perspective of a display of which three patches are seen.
 *
 * @param {number[]} triple - numbers of the patches
 * @param {Match[]} chosen - where they are
 * @param {Layout} layout
 * @returns {Quad[]} nine of them; corners behind the camera are not finite
 */
function bentQuads(triple, chosen, layout) {
  const centres = patchCentres(layout);
  const fromCentres = inverse(triple.flatMap((patch) => [...centres[patch], 1]));
  const bends = [-BEND, 0, BEND];
  return bends.flatMap((second) =>
    bends.map((third) => {
      const weighted = chosen.flatMap(({ at, size }, k) => {
        const depth = size ** (-2 / 3) * Math.exp([0, second, third][k]);
        return [at[0] * depth, at[1] * depth, depth];
      });
      const H = multiply3(fromCentres, weighted);
      return /** @type {Quad} */ (
        SQUARE.map(([x, y]) => {
          const w = x * H[2] + y * H[5] + H[8];
          const scale = w > LEAST_DEPTH ? 1 / w : NaN;
          return [
            (x * H[0] + y * H[3] + H[6]) * scale,
            (x * H[1] + y * H[4] + H[7]) * scale,
          ];
        })
      );
    }),
  );
}
