/** The clock, its fits and its synchroniser, beside what Python computed. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { DisplayClock, embeddedShare } from "../src/receive/timing/clock.js";
import { ToggleWindow } from "../src/receive/timing/fit.js";
import { Layout } from "../src/link/layout.js";
import { Synchroniser, neededEvidence } from "../src/receive/timing/synchronise.js";
import { PatchToggles } from "../src/receive/timing/toggles.js";
import { close } from "./comparison.js";
import { readFixture, rowsOf } from "./fixtures.js";

/** @param {ArrayLike<number>} numbers */
function clockOf(numbers) {
  const [period, start, delayX, delayY, shutter] = Array.from(numbers);
  return new DisplayClock(period, start, delayX, delayY, shutter);
}

/** @param {DisplayClock} clock */
function numbersOf(clock) {
  return [clock.period, clock.start, clock.delayX, clock.delayY, clock.shutter];
}

test("shares of exposures", () => {
  const known = readFixture("shares");
  const clock = clockOf(known.clock.data);
  const places = known.places.data;
  const shares = [0, 1, 2].flatMap((state) => [...clock.shares(0.08, places, state)]);
  close(shares, known.shares.data, 1e-12);
  const times = Float64Array.from({ length: 9 }, (_, k) => k / 7);
  const embedded = embeddedShare(known.clock.data, times, places);
  close(embedded, known.embedded.data, 1e-12);
  const numbers = [clock.number(0.3), clock.latest, clock.earliest, clock.centre];
  close(numbers, known.numbers, 1e-12);
  const needed = [neededEvidence(1, 30), neededEvidence(4, 30), neededEvidence(4, 240)];
  close(needed, known.needed, 1e-9);
});

test("fits of clocks to windows", () => {
  for (const known of readFixture("windows")) {
    const toggles = rowsOf(known.toggles);
    const window = new ToggleWindow(known.times.data, toggles, known.places.data, known.fps);
    assert.equal(window.placesSeen, known.places_seen);
    close(window.deviation, known.deviation.data, 1e-9);
    const fits = { search: window.search(), follow: window.follow(clockOf(known.start.data)) };
    for (const [name, fit] of Object.entries(fits)) {
      const expected = known[name];
      const period = expected.clock.data[0];
      close(numbersOf(fit.clock), expected.clock.data, 1e-6 * period);
      close([fit.evidence], [expected.evidence], 1e-3);
      close([fit.amplitude, fit.r2], [expected.amplitude, expected.r2], 1e-6);
      close(fit.noise.deviation, expected.deviation.data, 1e-6);
      close(fit.noise.correlation, expected.correlation.data, 1e-6);
      close(fit.covariance, expected.covariance.data, 1e-6 * period ** 2);
      close([fit.phaseError(1.5)], [expected.phase_error], 1e-5);
    }
  }
});

test("a synchroniser finds the clock, holds it and keeps its numbers", () => {
  const known = readFixture("run");
  const sync = new Synchroniser(known.fps, new PatchToggles(new Layout(known.layout)));
  const [clocks, states] = [rowsOf(known.clocks), rowsOf(known.states)];
  rowsOf(known.toggles).forEach((toggles, k) => {
    const time = known.times.data[k];
    sync.add(time, toggles);
    if (clocks[k][0] < 0) {
      assert.equal(sync.clock, null, `clock at ${time}`);
    } else {
      assert.ok(sync.clock !== null, `no clock at ${time}`);
      close(numbersOf(sync.clock), clocks[k], 1e-6);
    }
    const error = Math.min(sync.phaseError(time), 1e9);
    close([sync.slips, sync.r2, Number(sync.held), error], states[k], 1e-5);
  });
  const { strength, amplitude, stateHz, deviation } = /** @type {any} */ (sync.best);
  close([strength, amplitude, stateHz, deviation], known.best, 1e-5);
});
