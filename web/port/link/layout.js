/** Layouts: which blocks of the display carry message bits, and which are known. */

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
    /** Row and column of the blocks that are ratex patches. @type {[number, number][]} */
    this.ratex = table.ratex;
    /** Name of the modulation: "on_off" or "antipodal". @type {string} */
    this.modulation = table.modulation ?? "on_off";
    /** Whether the film decoder reads it. @type {boolean} */
    this.readsFilms = table.reads_films;
    /** Code of the order in which the two states of frame pairs are shown. */
    this.code = new PilotCode(table.code_signs);
    /** Numbers of the blocks that are pilots. */
    this.pilotBlocks = Int32Array.from(table.pilot_blocks);
    /** Known bits of the pilots, 0 or 1. */
    this.pilotBits = Uint8Array.from(table.pilot_bits);
    /** Intensities of each patch's 16 tiles in the darker frame. @type {number[][]} */
    this.tileLevels = table.tile_levels.map((/** @type {number[][]} */ tiles) => tiles.flat());
    /** Intensities of each patch's 16 tiles where tiles toggle. @type {number[][]} */
    this.tileLevelsToggled = table.tile_levels_toggled.map((/** @type {number[][]} */ tiles) =>
      tiles.flat(),
    );
    /** Labels, 0 or 1, of each patch's 16 tiles. @type {number[][]} */
    this.tileLabels = table.tile_labels.map((/** @type {number[][]} */ tiles) => tiles.flat());
    const directions = Uint8Array.from(atob(table.bank_directions), (byte) => byte.charCodeAt(0));
    /** (LEADING, WINDOW_AREA) directions along which the templates of patches vary most. */
    this.bankDirections = new Float32Array(directions.buffer);
    const taken = new Uint8Array(this.rows * this.cols);
    for (const [row, col] of this.ratex) taken[row * this.cols + col] = 1;
    for (const block of this.pilotBlocks) taken[block] = 1;
    /** 1 where a block carries a message bit, else 0. */
    this.messageMask = taken.map((value) => 1 - value);
    /** Numbers of the blocks that carry message bits, in order. */
    this.messageBlocks = Int32Array.from(
      [...taken.keys()].filter((block) => this.messageMask[block]),
    );
  }

  /** Number of message bits in one frame. */
  get nBits() {
    return this.messageBlocks.length;
  }

  /**
   * Find the pixels of a block: top, bottom, left and right; bottom and right are exclusive.
   *
   * @param {number} row
   * @param {number} col
   * @returns {[number, number, number, number]}
   */
  cellBox(row, col) {
    return [
      Math.ceil((row * this.height) / this.rows),
      Math.ceil(((row + 1) * this.height) / this.rows),
      Math.ceil((col * this.width) / this.cols),
      Math.ceil(((col + 1) * this.width) / this.cols),
    ];
  }
}
