/**
 * Authentication says who sent a message: a stamp and a tag that only a holder of the key can make.
 *
 *     signed message   message | stamp (4 bytes) | tag (8 bytes)
 *     tag              first 8 bytes of HMAC-SHA256(key, context | stamp | message)   (RFC 2104)
 *
 * The stamp is a whole number that a receiver expects to rise: the seconds since 1970 at which the
 * message was made, or a counter (link/code/authenticate.py).
 */

import { codeAuthenticate } from "../../../generated/constants.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";

import { InputError } from "../errors.js";
import { equalBytes } from "./bits.js";

export const { MIN_KEY_BYTES, MAX_KEY_BYTES } = codeAuthenticate;
const { STAMP_BYTES, TAG_BYTES, MAX_STAMP, MAX_CLOCK_SKEW_S } = codeAuthenticate;

/** Bytes that begin what a tag protects, so that a tag made for another purpose never fits. */
const CONTEXT = new TextEncoder().encode("oorc signed message 1\0");

/**
 * A message whose tag fits: the bytes that were sent, and the stamp.
 *
 * @typedef {{ data: Uint8Array, stamp: number }} SignedMessage
 */

/**
 * What a `Verifier` thinks of a message: the message, or null where its tag does not fit; why it is
 * not to be delivered, or null where it is; and whether the tag fits but the stamp is too old, as
 * it is where a recording is shown again.
 *
 * @typedef {{ signed: SignedMessage | null, refused: string | null, stale: boolean }} Judgement
 */

/**
 * Throw an `InputError` where a key is too short or too long.
 *
 * @param {Uint8Array} key
 */
export function checkKey(key) {
  if (key.length < MIN_KEY_BYTES || key.length > MAX_KEY_BYTES) {
    throw new InputError(
      `need ${MIN_KEY_BYTES} to ${MAX_KEY_BYTES} random bytes, got ${key.length}; ` +
        "make a key with: head -c 32 /dev/urandom > FILE",
    );
  }
}

/**
 * Append stamp and tag to a message.
 *
 * @param {Uint8Array} message - at least 1 byte
 * @param {Uint8Array} key - 16 to 4096 bytes that sender and receiver share
 * @param {number} stamp - seconds since 1970, or a counter, from 0 to 2 ** 32 - 1
 * @returns {Uint8Array} the signed message, 12 bytes longer
 */
export function sign(message, key, stamp) {
  checkKey(key);
  const signed = new Uint8Array(message.length + STAMP_BYTES + TAG_BYTES);
  signed.set(message);
  new DataView(signed.buffer).setUint32(message.length, stamp);
  signed.set(tagOf(signed.subarray(0, -TAG_BYTES), key), message.length + STAMP_BYTES);
  return signed;
}

/**
 * Make the tag of a stamped message: stamp before message, as the stamp has one length, so that no
 * two pairs of them read alike.
 *
 * @param {Uint8Array} stamped - the message, and after it the stamp
 * @param {Uint8Array} key
 */
function tagOf(stamped, key) {
  const [data, stamp] = [stamped.subarray(0, -STAMP_BYTES), stamped.subarray(-STAMP_BYTES)];
  const tag = hmac.create(sha256, key).update(CONTEXT).update(stamp).update(data).digest();
  return tag.subarray(0, TAG_BYTES);
}

/**
 * Take a signed message apart where its tag fits.
 *
 * @param {Uint8Array} signed - any bytes
 * @param {Uint8Array} key - 16 to 4096 bytes that sender and receiver share
 * @returns {SignedMessage | null} null where the tag does not fit
 */
export function verify(signed, key) {
  checkKey(key);
  const data = unchecked(signed);
  if (data.length === 0) return null;
  const stamped = signed.slice(0, -TAG_BYTES);
  if (!equalBytes(tagOf(stamped, key), signed.subarray(-TAG_BYTES))) return null;
  return { data, stamp: new DataView(stamped.buffer).getUint32(data.length) };
}

/**
 * Take stamp and tag off a signed message, for one who has no key to check it with.
 *
 * @param {Uint8Array} signed
 */
export function unchecked(signed) {
  return signed.slice(0, -STAMP_BYTES - TAG_BYTES);
}

/** Judges messages one after another: delivered are those that verify and are not stale. */
export class Verifier {
  #key;
  #maxAgeS;

  /**
   * @param {Uint8Array} key - 16 to 4096 bytes that sender and receiver share
   * @param {number | null} [maxAgeS] - largest age of a message in seconds, where stamps are
   *   seconds since 1970; null for any age
   */
  constructor(key, maxAgeS = null) {
    checkKey(key);
    if (maxAgeS !== null && !(maxAgeS > 0 && maxAgeS <= MAX_STAMP)) {
      throw new InputError(
        `maxAgeS: need more than 0 and at most ${MAX_STAMP} seconds, got ${maxAgeS}`,
      );
    }
    this.#key = key;
    this.#maxAgeS = maxAgeS;
    /** Largest stamp of a message that was to be delivered. @type {number | null} */
    this.newest = null;
  }

  /**
   * Judge the next message.
   *
   * @param {Uint8Array} message - the bytes that were received, any
   * @param {number} now - seconds since 1970; they count where there is a largest age
   * @returns {Judgement}
   */
  judge(message, now) {
    const signed = verify(message, this.#key);
    if (signed === null) {
      const refused = "the tag does not fit; made without the key, or with another one";
      return { signed, refused, stale: false };
    }
    const age = now - signed.stamp;
    if (this.newest !== null && signed.stamp < this.newest) {
      const refused =
        `stale: its stamp ${signed.stamp} is older than ${this.newest}, ` +
        "which was delivered before";
      return { signed, refused, stale: true };
    }
    if (this.#maxAgeS !== null && age > this.#maxAgeS) {
      const made = `made ${age.toFixed(0)} s ago`;
      const refused = `stale: ${made}, and the largest age is ${this.#maxAgeS} s`;
      return { signed, refused, stale: true };
    }
    if (this.#maxAgeS !== null && age < -MAX_CLOCK_SKEW_S) {
      const ahead = `made ${(-age).toFixed(0)} s ahead of this machine's clock`;
      return { signed, refused: `${ahead}; are both clocks right?`, stale: false };
    }
    this.newest = signed.stamp;
    return { signed, refused: null, stale: false };
  }
}
