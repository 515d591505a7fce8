/** Messages are delivered and refused as in Python. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Verifier } from "../src/link/code/authenticate.js";
import { Message } from "../src/link/code/message.js";
import { Inbox } from "../src/receive/inbox.js";
import { readFixture } from "./fixtures.js";

test("the inbox", () => {
  const { key, now, taken } = readFixture("inbox");
  const inbox = new Inbox(key && new Verifier(key.data));
  for (const { data, changed, delivered, last, last_changed, refused } of taken) {
    const delivery = inbox.take(new Message(data.data, 4, 3, 0.9, changed), now);
    assert.equal(delivery.refused === null, delivered);
    assert.deepEqual(inbox.last?.data, last.data);
    assert.equal(inbox.last?.changed, last_changed);
    assert.equal(inbox.refused, refused);
    if (delivered) assert.equal(delivery.message, inbox.last);
  }
});
