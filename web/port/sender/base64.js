/** Bytes as text, as JSON holds them. */

/** Bytes of which letters are made at once; a function takes no more. */
const AT_ONCE = 2 ** 15;

/** @param {Uint8Array} bytes @returns {string} */
export function toBase64(bytes) {
  let letters = "";
  for (let at = 0; at < bytes.length; at += AT_ONCE) {
    letters += String.fromCharCode(...bytes.subarray(at, at + AT_ONCE));
  }
  return btoa(letters);
}

/** @param {string} text */
export function fromBase64(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}
