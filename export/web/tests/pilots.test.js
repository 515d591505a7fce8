/** Pilots are weighed, what toggles is mapped, frames are held still and corners move as in Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { loadOpenCv } from "../src/image/opencv.js";
import { transform } from "../src/link/geometry.js";
import { Layout } from "../src/link/layout.js";
import { BlockFit, BlockMaps, periodChangeSteps } from "../src/locate/pilots/allBlocks.js";
import { climbToPilots } from "../src/locate/pilots/climb.js";
import {
  coarseShift,
  expectedChanges,
  mapSize,
  movedCorners,
  withoutSlope,
} from "../src/locate/pilots/corners.js";
import {
  commonPhase,
  pilotEvidence,
  pilotSigns,
  pilotValues,
  standingOut,
} from "../src/locate/pilots/evidence.js";
import { median, quantile } from "../src/locate/pilots/order.js";
import { Stabiliser } from "../src/locate/pilots/stabilise.js";
import { ToggleMap } from "../src/locate/pilots/toggleMap.js";
import { position, spanOf, waves } from "../src/locate/pilots/waves.js";
import { runToEnd } from "../src/link/code/steps.js";
import { close, differences, planeOf, pointsOf } from "./comparison.js";
import { readFixture } from "./fixtures.js";

await loadOpenCv();

/**
 * Fail unless two homographies move all of an image's points alike.
 *
 * @param {ArrayLike<number> | null | undefined} found
 * @param {any} expected - a fixture of nine numbers
 * @param {[number, number]} size - of the image
 * @param {number} tolerance - pixels
 */
function sameMotion(found, expected, [width, height], tolerance) {
  assert.ok(found);
  /** @type {[number, number][]} */
  const points = [0, 1, 2].flatMap((x) =>
    [0, 1, 2].map((y) => /** @type {[number, number]} */ ([(x * width) / 2, (y * height) / 2])),
  );
  close(transform(found, points).flat(), transform(expected.data, points).flat(), tolerance);
}

test("medians and quantiles", () => {
  assert.equal(median([3, 1, 2]), 2);
  assert.equal(median(Float32Array.of(4, 1, 2, 2, 9, 3)), 2.5);
  const values = Float64Array.from({ length: 101 }, (_, i) => (i * 37) % 101);
  assert.equal(quantile(values, 0.98), 98);
  assert.ok(Math.abs(quantile(values, 0.123) - 12.3) < 1e-12);
});

test("evidence of pilots", () => {
  const { signs, cases, grays, ...fixture } = readFixture("evidence");
  const layout = new Layout(fixture.layout);
  assert.deepEqual(pilotSigns(layout), signs.data);
  for (const { values, at, found } of cases) {
    const [frames, pilots] = values.shape;
    const series = Array.from({ length: frames }, (_, t) =>
      values.data.subarray(t * pilots, (t + 1) * pilots),
    );
    const { evidence, frequency } = pilotEvidence(series, layout, [...at.data]);
    close([evidence, frequency], found, 1e-6);
  }
  for (const { real, imaginary, ...expected } of readFixture("phases")) {
    const { slope, phase } = commonPhase(real.data, imaginary.data, layout);
    close([...slope, phase], [...expected.slope.data, expected.phase], 1e-9);
  }
  for (const { gray, blocks, pilots, layout: table } of grays) {
    const shown = new Layout(table);
    close(standingOut(planeOf(gray), shown), blocks.data, 1e-4);
    close(pilotValues(planeOf(gray), shown), pilots.data, 1e-4);
  }
});

test("times of frames, and waves at them", () => {
  for (const { fps, seconds, at, span: expected, real, imaginary } of readFixture("times")) {
    const places = Array.from(seconds.data, (second) => position(second - seconds.data[0], fps));
    assert.deepEqual(places, at);
    const { span, fastest } = spanOf(places);
    assert.deepEqual([span, fastest], expected);
    const periods = Array.from({ length: fastest - 1 }, (_, i) => (2 + i) / span);
    const made = waves(places, periods, [0, 1 / span]);
    close(made.flatMap((wave) => [...wave.real]), real.data, 1e-9);
    close(made.flatMap((wave) => [...wave.imaginary]), imaginary.data, 1e-9);
  }
});

test("corners move by parts of a display", () => {
  const layout = new Layout(readFixture("evidence").layout);
  const blocks = expectedChanges(layout);
  for (const { real, imaginary, far, H, parts } of readFixture("coarse")) {
    const [height, width] = real.shape;
    const change = { width, height, real: real.data, imaginary: imaginary.data };
    const fit = coarseShift(change, blocks, layout, far);
    assert.equal(fit?.parts ?? null, parts);
    if (H !== null) sameMotion(fit?.HOldFromNew, H, [layout.width, layout.height], 0.1);
  }
});

test("maps without slope", () => {
  for (const { size, change, slopeless, ...fixture } of readFixture("slopeless")) {
    const layout = new Layout(fixture.layout);
    assert.deepEqual(mapSize(layout), size);
    const [width, height] = size;
    const flat = withoutSlope(planeOf(change), [width / layout.cols, height / layout.rows]);
    close(flat.data, slopeless.data, 1e-4);
  }
});

test("corners move by all blocks", () => {
  for (const { views, at, frequency, changes, settled, H, ...fixture } of readFixture("all_blocks")) {
    const layout = new Layout(fixture.layout);
    const maps = new BlockMaps(layout);
    const [frames, height, width] = views.shape;
    assert.deepEqual(maps.size, [width, height]);
    const planes = Array.from({ length: frames }, (_, frame) => ({
      width,
      height,
      data: views.data.subarray(frame * width * height, (frame + 1) * width * height),
    }));
    const seen = runToEnd(periodChangeSteps(maps, planes, at, frequency));
    close(seen.flatMap(({ data }) => [...data]), changes.data, 2e-3);
    const fit = new BlockFit(maps, seen);
    const steps = settled.map(() => runToEnd(fit.moveSteps()));
    assert.deepEqual(steps, settled);
    sameMotion(fit.shift(), H, [layout.width, layout.height], 0.02);
  }
});

test("corners climb to the pilots", () => {
  const { real, imaginary, H, ...fixture } = readFixture("climb");
  const layout = new Layout(fixture.layout);
  const [height, width] = real.shape;
  const change = { width, height, real: real.data, imaginary: imaginary.data };
  const found = climbToPilots(change, layout);
  sameMotion(found, H, [layout.width, layout.height], 0.1);
});

test("corners of what lies elsewhere in its rectified image", () => {
  const { corners, H, layout, moved } = readFixture("moved");
  const found = movedCorners(pointsOf(corners), H.data, new Layout(layout));
  close(found.flat(), moved.data, 1e-3);
});

test("what toggles is mapped and outlined", () => {
  const { stills, logs, frequencies, outlines, quads, worths, views } = readFixture("toggling");
  const [frames, height, width] = stills.shape;
  const map = new ToggleMap(width, height);
  const size = width * height;
  for (let frame = 0; frame < frames; frame++) {
    if (frame < 10) assert.equal(map.outline(0.25), null);
    map.add({ width, height, data: stills.data.subarray(frame * size, (frame + 1) * size) }, frame);
  }
  assert.equal([...map.prepare(0.25)].length, 5);
  assert.equal([...map.prepare(0.25)].length, 0);
  [4, 12].forEach((number, i) => {
    const { most } = differences(map.logPower(number), logs[i]);
    assert.ok(most < 1e-4, `logarithms differ by ${most}`);
  });
  frequencies.forEach((/** @type {number} */ frequency, /** @type {number} */ i) => {
    const outline = map.outline(frequency);
    if (outlines[i] === null) assert.equal(outline, null);
    else close(outline?.flat() ?? [], outlines[i].data, 0.01);
  });
  close(map.worths(quads.map(pointsOf)), worths, 1e-2);
  const shown = map.views(pointsOf(quads[0]), 48, 48);
  assert.equal(shown.length, frames);
  views.forEach((/** @type {any} */ view, /** @type {number} */ i) => {
    const { mean } = differences(shown[i], view);
    assert.ok(mean < 3, `small views differ by ${mean} gray levels`); // the texture has 20
  });
});

test("of two motions that of the points that lie farther apart is chosen", () => {
  const { before, after, moved, picture, everything } = readFixture("two_motions");
  for (const outline of [picture, everything]) {
    const stabiliser = new Stabiliser();
    stabiliser.begin(planeOf(before), true, pointsOf(outline));
    const H = stabiliser.follow(planeOf(after));
    assert.ok(H);
    const [[x]] = transform(H, [[320, 320]]);
    assert.ok(Math.abs(x - 320) < 0.3, `the middle is at ${x}`);
    assert.equal(stabiliser.share > 0.97, outline === picture);
  }
  for (const farApart of [false, true]) {
    const stabiliser = new Stabiliser();
    stabiliser.begin(planeOf(before), farApart);
    const H = stabiliser.follow(planeOf(after));
    assert.ok(H);
    const [[x]] = transform(H, [[320, 320]]);
    assert.ok(Math.abs(x - 320 - (farApart ? 0 : moved)) < 0.3, `the middle is at ${x}`);
    assert.ok(stabiliser.share > 0 && stabiliser.share < 0.9);
  }
});

test("frames are held still", () => {
  const { frames, H, still, points } = readFixture("stabilising");
  const stabiliser = new Stabiliser();
  assert.equal(stabiliser.follow(planeOf(frames[0])), null);
  stabiliser.begin(planeOf(frames[0]));
  assert.deepEqual([stabiliser.height, stabiliser.width], still.shape);
  frames.forEach((/** @type {any} */ frame, /** @type {number} */ i) => {
    const found = stabiliser.follow(planeOf(frame));
    if (H[i] === null) assert.equal(found, null);
    else sameMotion(found, H[i], [960, 540], 0.1);
  });
  const { mean } = differences(stabiliser.still(planeOf(frames[1]), H[1].data), still);
  assert.ok(mean < 0.3, `still frames differ by ${mean}`);
  close(stabiliser.onImage([[0, 0], [100, 50]]).flat(), points.data, 1e-9);
  close(stabiliser.onCopy(pointsOf(points)).flat(), [0, 0, 100, 50], 1e-9);
  assert.equal(stabiliser.follow({ width: 4, height: 3, data: new Uint8Array(12) }), null);
  stabiliser.forget();
  assert.equal(stabiliser.follow(planeOf(frames[0])), null);
});
