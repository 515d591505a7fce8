/** Layouts with pilots: which blocks of the display carry message bits, and which are known. */

import { PilotCode } from "./pilotCode.js";

/**
 * A grid of blocks over the display, as `web/host/tables.py` describes it.
 *
 * Blocks are numbered row by row from the top left.
 */
export class Layout {
  /** @param {any} table - the result of `layout_table` of web/host/tables.py */
  constructor(table) {
    /** Number of blocks from top to bottom. @type {number} */
    this.rows = table.rows;
    /** Number of blocks from left to right. @type {number} */
    this.cols = table.cols;
    /** Width of the displayed frame, in pixels. @type {number} */
    this.width = table.width;
    /** Height of the displayed frame, in pixels. @type {number} */
    this.height = table.height;
    /** Code of the order in which the two states of frame pairs are shown. */
    this.code = new PilotCode(table.code_signs);
    /** Numbers of the blocks that are pilots. */
    this.pilotBlocks = Int32Array.from(table.pilot_blocks);
    /** Known bits of the pilots, 0 or 1. */
    this.pilotBits = Uint8Array.from(table.pilot_bits);
    /** Part of the display in which each pilot lies (`PilotToggles`). */
    this.parts = Int32Array.from(table.parts);
    /** (P, 2) x and y of these parts on the display, in [0, 1]. */
    this.partPlaces = Float64Array.from(table.part_places);
    /** Width and height of the maps of what toggles. @type {[number, number]} */
    this.mapSize = table.map_size;
    /** `inner` and `margin` of the maps in which all blocks are fitted. @type {[number, number][]} */
    this.blockMaps = table.block_maps;
    /** 1 where a block carries a message bit, else 0. */
    this.messageMask = new Uint8Array(this.rows * this.cols).fill(1);
    for (const block of this.pilotBlocks) this.messageMask[block] = 0;
    /** Numbers of the blocks that carry message bits, in order. */
    this.messageBlocks = Int32Array.from(
      [...this.messageMask.keys()].filter((block) => this.messageMask[block]),
    );
  }

  /** Number of message bits in one frame. */
  get nBits() {
    return this.messageBlocks.length;
  }
}
