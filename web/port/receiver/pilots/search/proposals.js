/** Where a display may be, what it may show, and how surely its pilots toggle there. */

import {
  modelsRegion, receiverPilotsSearchProposals, receiverPilotsSearchWatch,
} from "../../../../generated/constants.js";
import { blurred } from "../../../image/blur.js";
import { equalised, withoutDetails } from "../../../image/levels.js";
import { planeLike } from "../../../image/opencv.js";
import { roundHalfEven } from "../../../image/round.js";
import { contourArea } from "../../../link/geometry.js";
import { candidateSteps, leavingSteps } from "../../locate/candidates.js";
import { snapToEdges } from "../../locate/edges.js";
import { rolled, upright } from "../../locate/quads.js";
import { movedCorners } from "../motion.js";
import { expectedChanges, picked, pilotValues, standingOut } from "../../../link/pilots.js";
import { Wave, findToggling } from "../toggling.js";
import { COARSE_SIZE, coarseShift, roughSeries, shiftedTogglings } from "./parts.js";
import { leaning, leavingRegions, likeliest, outlineRegions, portraitParts } from "./regions.js";

/** @typedef {import("../../../export/regionGraph.js").RegionMapper} RegionMapper */
/** @typedef {import("../toggling.js").Toggling} Toggling */
/** @typedef {import("./film.js").HeldFrame} HeldFrame */
/** @typedef {import("./watch.js").Watch} Watch */

const { CELL_PX, LEAST_PX } = modelsRegion;
export const { LEAVING, STRONGEST, PROMISING, ANY_TURN } = receiverPilotsSearchProposals;
const {
  VIEW_SIZE, EDGES, PARTLY_SEEN, BRIGHT_PX, DARK_PX, STATES_HZ, MAPPED,
  SNAP_SHARE, SNAP_STEP_PX, EDGE_BLUR_PX, LOG_LEVELS,
} = receiverPilotsSearchProposals;

export const { NEXT_FRAME } = receiverPilotsSearchWatch;
/** Units of work of one frame's view of a display, and of weighing it coarsely. */
export const VIEW_WORK = 0.6;
export const COARSE_WORK = 10;
/** Units of work of a layout's fit, and of rough maps. */
const FIT_WORK = 4;
const ROUGH_WORK = 2;
/** Units of work of outlining what a map shows. */
const OUTLINE_WORK = 8;
/** Units of work of choosing portrait pictures. */
const PORTRAIT_WORK = 15;
/** Units of work of moving the sides of a region to edges. */
const SNAP_WORK = 12;

/**
 * Where a display may be: corners in the reference frame, the displayed picture's top left first;
 * what it may show; and how it may toggle.
 *
 * @typedef {{ corners: Point[], layout: Layout, toggling: Toggling }} Proposal
 */

/**
 * The likeliest proposal of a quadrilateral, and its evidence before the number of proposals tried
 * is allowed for.
 *
 * @typedef {{ evidence: number, proposal: Proposal }} Weighed
 */

/**
 * Values of each layout's pilots in each frame, upright and upside down.
 *
 * @typedef {Float32Array[][]} PilotsSeen
 */

/**
 * Weigh a proposal by frames in full, step by step.
 *
 * @param {Proposal} proposal
 * @param {readonly HeldFrame[]} frames
 * @param {number} fps - nominal number of frames of the camera in a second
 * @param {Map<HeldFrame, Float32Array>} [known] - values of the proposal's pilots in frames by which
 *   it was weighed before; takes those of the others
 * @returns {Steps<{ evidence: number, toggling: Toggling }>} the evidence, before it pays for what
 *   was tried, 0 where corners are not sound; and how the pilots toggle in the frames
 */
export function* weighSteps({ corners, layout, toggling }, frames, fps, known = new Map()) {
  const values = [];
  for (const frame of frames) {
    let shown = known.get(frame);
    if (shown === undefined) {
      const view = frame.view(corners, layout.width >> 1, layout.height >> 1);
      if (view === null) return { evidence: 0, toggling };
      shown = pilotValues(view, layout);
      known.set(frame, shown);
      yield VIEW_WORK;
    }
    values.push(shown);
  }
  return findToggling(values, layout, positions(frames), fps);
}

/** List the positions of frames. @type {(frames: readonly HeldFrame[]) => number[]} */
export const positions = (frames) => frames.map(({ at }) => at);

/**
 * Proposes where the display may be in a film, and what it may show. Quadrilaterals of edges in the
 * reference are weighed coarsely while frames are still being watched. Others are outlines of what
 * toggles, as they are and moved to edges, and what the pilots' fit makes of a display partly in view.
 */
export class Proposer {
  #watch;
  /**
   * Quadrilaterals of edges that may bound a display which is partly in view, those of the strongest
   * edges first; none before `edges` has ended. @type {Point[][]}
   */
  partlySeen = [];
  #layouts;
  #mapper;
  #viewSize;
  /** Frequencies at which displays may toggle, in periods for each nominal frame. */
  #frequencies;
  /**
   * Values of the pilots (`#pilotsSeen`) that are kept for later, by their quadrilaterals.
   * @type {Map<Point[], PilotsSeen[]>}
   */
  #kept = new Map();
  /** The newest map of what toggles. @type {Float32Array | null} */
  #logOdds = null;

  /**
   * @param {Watch} watch - the film
   * @param {readonly Layout[]} layouts - those that may be shown
   * @param {RegionMapper} mapper
   */
  constructor(watch, layouts, mapper) {
    this.#watch = watch;
    this.#layouts = layouts;
    this.#mapper = mapper;
    const grids = layouts.map(({ cols, rows }) => [cols, rows]);
    this.#viewSize = [VIEW_SIZE, ...grids].reduce((most, [cols, rows]) =>
      cols * rows > most[0] * most[1] ? [cols, rows] : most,
    );
    const periods = STATES_HZ.map((rate) => (rate / 2 / watch.fps) % 1);
    const folded = periods.map((period) => Math.min(period, 1 - period));
    this.#frequencies = [...new Set(folded)].filter((period) => period > 0).sort((a, b) => a - b);
  }

  /**
   * Propose quadrilaterals of edges in the reference.
   *
   * @returns {Steps<Point[][]>} the strongest first
   */
  *edges() {
    const { reference } = this.#watch;
    const found = yield* candidateSteps(reference, EDGES);
    this.partlySeen = yield* leavingSteps(reference, PARTLY_SEEN);
    return found;
  }

  /**
   * Propose quadrilaterals that bound what toggles. The map of it is awaited, whatever number of frames
   * that takes.
   *
   * @param {Point[][]} edges - quadrilaterals of edges, pixels of the reference frame
   * @returns {Steps<{ outlines: Point[][], leaving: Point[][], portraits: Point[][] }>} outlines of
   *   displays, whatever edges they have, to some blocks; what may bound a display which leaves the
   *   image, where what toggles reaches its border; and portrait pictures of which one side is not seen
   *   (`portraitParts`), the likeliest first. Where the display may leave the image, portrait pictures
   *   that leave it come first, and a map whose cells are all likelier chooses some, too.
   */
  *regions(edges) {
    const { frames, width, height } = this.#watch.stills;
    if (Math.min(width, height) < LEAST_PX) return { outlines: [], leaving: [], portraits: [] };
    let mapped = /** @type {Float32Array | null} */ (null);
    void this.#mapper.logOdds(frames.slice(-MAPPED)).then((found) => (mapped = found));
    while (mapped === null) yield NEXT_FRAME;
    const logOdds = (this.#logOdds = mapped);
    const columns = Math.floor(width / CELL_PX);
    const [whole, partly] = [edges, this.partlySeen].map((quads) =>
      quads.map((quad) => this.#onCells(quad)),
    );
    const leavingCells = leavingRegions(partly, logOdds, columns);
    yield OUTLINE_WORK;
    const outlineCells = outlineRegions(logOdds, columns);
    yield OUTLINE_WORK;
    const isLeaving = leavingCells.length > 0;
    const maps = isLeaving ? [leaning(logOdds), logOdds] : [logOdds];
    const portraitCells = [];
    for (const quads of isLeaving ? [partly, whole] : [whole]) {
      portraitCells.push(...portraitParts(quads, maps, columns));
      yield PORTRAIT_WORK;
    }
    const [outlines, leaving, portraits] = [outlineCells, leavingCells, portraitCells].map((quads) =>
      quads.map((quad) => this.#ofCells(quad)),
    );
    return { outlines, leaving, portraits };
  }

  /**
   * Choose the likeliest quadrilaterals of the reference frame by the newest map of what toggles.
   *
   * @param {Point[][]} quads
   * @param {number} limit - largest number chosen
   * @param {boolean} [lean] - whether all cells count as likelier (`leaning`)
   * @returns {Point[][]} the likeliest first; none before there is a map
   */
  likeliest(quads, limit, lean = false) {
    if (this.#logOdds === null) return [];
    const odds = lean ? leaning(this.#logOdds) : this.#logOdds;
    const cells = quads.map((quad) => this.#onCells(quad));
    const columns = Math.floor(this.#watch.stills.width / CELL_PX);
    return likeliest(cells, odds, columns, limit).map((at) => quads[at]);
  }

  /**
   * Move a quadrilateral of the reference frame into the cells of a map.
   *
   * @param {Point[]} quad
   * @returns {Point[]} upright
   */
  #onCells(quad) {
    const onCopy = this.#watch.onCopy(quad);
    return upright(onCopy.map(([x, y]) => [(x + 0.5) / CELL_PX, (y + 0.5) / CELL_PX]));
  }

  /**
   * Move a quadrilateral of cells of the map into the reference frame.
   *
   * @param {Point[]} quad
   * @returns {Point[]} upright
   */
  #ofCells(quad) {
    const onStill = quad.map(([x, y]) => /** @type {Point} */ ([CELL_PX * x - 0.5, CELL_PX * y - 0.5]));
    return this.#watch.onImage(upright(onStill));
  }

  /**
   * Move the sides of a region to edges: to those that are seen, and to those of what changes. A picture
   * that moves changes up to its border, even where it is as dark as what is around it.
   *
   * @param {Point[]} region - as `regions` proposes it
   * @returns {Steps<Point[][]>} two quadrilaterals
   */
  *snapped(region) {
    const stills = this.#watch.stills.frames.slice(-MAPPED);
    const quad = this.#watch.onCopy(region);
    const steps = roundHalfEven((SNAP_SHARE * Math.sqrt(contourArea(quad))) / SNAP_STEP_PX);
    const reach = SNAP_STEP_PX * Math.max(1, steps);
    const found = [];
    for (const levels of [stills[0], changeLevels(stills)]) {
      yield SNAP_WORK;
      found.push(this.#watch.onImage(snapToEdges(blurred(levels, EDGE_BLUR_PX), quad, reach)));
    }
    return found;
  }

  /**
   * Weigh a quadrilateral, upright and upside down, by small views of what toggles in it.
   *
   * @param {Point[]} quad
   * @param {number} turn - number of quarter turns after which it is seen upright
   * @param {number | null} [count] - of the frames, from the first on, in which it is followed by
   *   its own motion; null to look at all, held still as the room is, which is quicker
   * @returns {Weighed} what is surest
   */
  weighCoarsely(quad, turn, count = null) {
    return this.#surest(rolled(quad, turn), this.#pilotsSeen(quad, turn, count));
  }

  /**
   * Measure what may be pilots in small views of a quadrilateral. Of quadrilaterals that follow their
   * own motion, what is measured in a frame is kept, until their picture is seen to move.
   *
   * @param {Point[]} quad
   * @param {number} turn - number of quarter turns after which it is seen upright
   * @param {number | null} count - as `Watch.places` takes it
   * @returns {PilotsSeen}
   */
  #pilotsSeen(quad, turn, count) {
    const [width, height] = this.#viewSize;
    const kept = this.#kept.get(quad) ?? [[], [], [], []];
    if (count !== null) this.#kept.set(quad, kept);
    const values = kept[turn + 2 * Number(this.#watch.moves(quad))];
    const places = this.#watch.places(quad, count);
    const views = this.#watch.stills.views(places, width, height, turn, values.length);
    values.push(...pilotsIn(views, this.#layouts));
    return values;
  }

  /**
   * Choose the layout, either side up, that is surest in small views of corners.
   *
   * @param {Point[]} corners - in the reference frame
   */
  surestIn(corners) {
    const [width, height] = this.#viewSize;
    return this.#surest(corners, pilotsIn(this.#watch.views(corners, width, height), this.#layouts));
  }

  /**
   * Choose the layout, upright or upside down, whose pilots toggle most surely.
   *
   * @param {Point[]} corners - in the reference frame
   * @param {PilotsSeen} values - in the first frames
   * @returns {Weighed}
   */
  #surest(corners, values) {
    const at = positions(this.#watch.frames.slice(0, values.length));
    const ways = this.#layouts.flatMap((layout) => [0, 2].map((half) => ({ layout, half })));
    const found = ways.map(({ layout, half }, way) => {
      const shown = values.map((each) => each[way]);
      const { evidence, toggling } = findToggling(shown, layout, at, this.#watch.fps);
      return { evidence, proposal: { corners: rolled(corners, half), layout, toggling } };
    });
    return found.reduce((best, each) => (each.evidence > best.evidence ? each : best));
  }

  /**
   * Propose quadrilaterals in the mean of all frames, its histogram made even: as it is, and twice
   * without details, whose edges would hide those of the display.
   *
   * @returns {Generator<Steps<Point[][]>>} what finds those of each, the strongest first
   */
  *faintEdges() {
    const mean = this.#watch.stills.mean();
    yield this.#edgesOf(equalised(mean));
    yield this.#edgesOf(equalised(withoutDetails(mean, BRIGHT_PX, true)));
    yield this.#edgesOf(equalised(withoutDetails(mean, DARK_PX, false)));
  }

  /**
   * Propose quadrilaterals of edges in a still.
   *
   * @param {BytePlane} still
   */
  *#edgesOf(still) {
    const found = yield* candidateSteps(still, EDGES);
    return found.map((edge) => this.#watch.onImage(edge));
  }

  /**
   * Fit every layout to a quadrilateral that may be far off.
   *
   * @param {Point[]} quad - the displayed picture's top left first
   * @returns {Steps<Point[] | null>} its corners after the shift from far that fits best, or null where
   *   none does
   */
  *firstFit(quad) {
    const views = this.#watch.views(quad, ...COARSE_SIZE);
    yield COARSE_WORK;
    const at = positions(this.#watch.frames);
    let most = 0;
    let best = null;
    for (const layout of this.#layouts) {
      const series = roughSeries(views, layout);
      yield ROUGH_WORK;
      const blocks = expectedChanges(layout);
      const ways = layout.code.isPlain
        ? this.#frequencies.map((frequency) => new Wave(frequency))
        : yield* shiftedTogglings(series, blocks, layout, at, this.#watch.fps);
      for (const toggling of ways) {
        const line = toggling.amplitudes(series.frames, at, series.size);
        const fit = coarseShift(line, blocks, layout, true);
        yield FIT_WORK;
        if (fit === null || fit.parts <= most) continue;
        most = fit.parts;
        best = movedCorners(quad, fit.HOldFromNew, layout);
      }
    }
    return best;
  }
}

/**
 * Show by how much pixels change from still to still, as an image.
 *
 * @param {readonly BytePlane[]} stills - at least two
 * @returns {BytePlane} `LOG_LEVELS` times the natural logarithm of 1 plus the mean squared change, the
 *   change in gray levels; rounded down
 */
function changeLevels(stills) {
  const levels = planeLike(stills[0], stills[0].width, stills[0].height);
  levels.data.forEach((_, i) => {
    let power = 0;
    for (let at = 1; at < stills.length; at++) {
      power += (stills[at].data[i] - stills[at - 1].data[i]) ** 2;
    }
    levels.data[i] = LOG_LEVELS * Math.log(power / (stills.length - 1) + 1);
  });
  return levels;
}

/**
 * Measure the pilots of each layout in views, upright and upside down.
 *
 * @param {FloatPlane[]} views
 * @param {readonly Layout[]} layouts
 * @returns {PilotsSeen}
 */
function pilotsIn(views, layouts) {
  const ways = layouts.flatMap((layout) => {
    const last = layout.rows * layout.cols - 1;
    const pilots = [layout.pilotBlocks, layout.pilotBlocks.map((block) => last - block)];
    const blocks = standingOut(views, layout);
    return pilots.map((each) => blocks.map((shown) => picked(shown, each)));
  });
  return views.map((_, at) => ways.map((values) => values[at]));
}
