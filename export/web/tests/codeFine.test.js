/** Words, terms, shapes and coded bits of fine grids are those of Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { ReadFrame, Shape, Terms } from "../src/link/code/fine.js";
import {
  codedBits, codedDecodingSteps, numberLikelihoods, readTerms,
} from "../src/link/code/fine.js";
import { runToEnd } from "../src/link/code/steps.js";
import { makeRateless } from "../src/link/code/rateless.js";
import { weighWord } from "../src/link/code/words.js";
import { close } from "./comparison.js";
import { readFixture } from "./fixtures.js";

const fixture = readFixture("fine");

test("words", () => {
  close(weighWord(fixture.word.scores.data), fixture.word.weights.data, 1e-4);
});

test("shapes and frames", () => {
  for (const grid of fixture.grids) {
    const shape = Shape.of(grid.n_bits);
    assert.equal(shape.shown, grid.shown);
    assert.deepEqual(Array.from(shape.head), Array.from(grid.head.data));
    assert.deepEqual(Array.from(shape.rest), Array.from(grid.rest.data));
    assert.deepEqual(shape.piecesShown(5), Array.from(grid.pieces.data));
    const white = shape.whitening(4095).map((word) => word & 1);
    shape.numberWhitening.forEach((bit, at) => (white[shape.head[at]] = bit));
    assert.deepEqual(Array.from(white), Array.from(grid.whitening.data));
    close(numberLikelihoods(grid.scores.data), grid.likelihoods.data, 1e-4);
    const { coded } = new ReadFrame(grid.scores.data, 4095);
    const expected = Array.from(shape.rest, (place) => (white[place] ? -1 : 1));
    assert.deepEqual(
      Array.from(coded),
      expected.map((sign, at) => sign * grid.scores.data[shape.rest[at]]),
    );
  }
});

test("terms", () => {
  for (const { terms: values, pieces, wrong, blocks, block_bytes, possible } of fixture.told) {
    const [nBytes, frames, mark] = values;
    const terms = new Terms(nBytes, frames, mark);
    assert.deepEqual(terms.pieces(), Array.from(pieces.data));
    assert.equal(terms.blocks, blocks);
    assert.equal(terms.blockBytes, block_bytes);
    [512, 11674].forEach((nBits, at) => {
      const expected = possible[at] ? terms : null;
      assert.deepEqual(readTerms(Array.from(pieces.data), nBits), expected);
      assert.equal(readTerms(Array.from(wrong.data), nBits), null);
    });
  }
});

test("graphs of rateless codes", () => {
  for (const { information, intermediate, precode } of fixture.codes) {
    const code = makeRateless(information);
    assert.equal(code.intermediate, intermediate);
    assert.deepEqual(code.precode.members, precode.data);
    assert.equal(code.precode.starts[1], precode.shape[1]);
  }
});

test("coded bits, and their message", () => {
  const [nBytes, frames, mark] = fixture.terms;
  const terms = new Terms(nBytes, frames, mark);
  const coded = codedBits(fixture.message.data, terms, fixture.n_bits);
  assert.deepEqual(coded, fixture.coded.data);
  const scores = Float32Array.from(coded, (bit) => 8 * bit - 4);
  assert.deepEqual(runToEnd(codedDecodingSteps(scores, terms)), fixture.message.data);
  assert.equal(runToEnd(codedDecodingSteps(scores, new Terms(nBytes, frames, mark ^ 1))), null);
  const other = codedBits(fixture.message.data.slice().fill(7), terms, fixture.n_bits);
  const wrong = Float32Array.from(other, (bit) => 8 * bit - 4);
  assert.equal(runToEnd(codedDecodingSteps(wrong, terms)), null);
});
