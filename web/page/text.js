/** What is said of a message, links in it, and sentences. */

/** Number of bytes of a message that a note shows. */
const SHOWN_BYTES = 16;

/**
 * Say what cannot be seen in a message; empty where there is nothing to say.
 *
 * @param {Uint8Array} data - the message
 * @param {string} text - the same as text
 * @returns {string}
 */
export function noteOf(data, text) {
  if (!/[^\p{C}\p{Z}\s]/u.test(text)) {
    const shown = [...data.subarray(0, SHOWN_BYTES)];
    const bytes = shown.map((byte) => byte.toString(16).padStart(2, "0")).join(" ");
    const more = data.length > SHOWN_BYTES ? " …" : "";
    return `It holds nothing that can be seen; its bytes are ${bytes}${more}`;
  }
  const withoutUsual = text.replace(/[\n\r\t\u200d]/gu, ""); // \u200d joins emoji
  if (!/[\p{Cc}\p{Cf}]/u.test(withoutUsual)) return "";
  return "It holds characters that cannot be seen or that turn the direction of writing.";
}

/** @param {string} text @returns {string} with a capital letter first and a full stop last */
export function sentence(text) {
  return text && `${text[0].toUpperCase()}${text.slice(1)}.`;
}

/**
 * Find the address that a message is, where it is nothing else.
 *
 * @param {string} text
 * @returns {URL | null} null where the text is no address of a page on the web
 */
export function linkOf(text) {
  const word = text.trim();
  if (!/^https?:\/\/[^\s\\]+$/i.test(word) || /[\u0000-\u001f\u007f]/.test(word)) return null;
  try {
    const url = new URL(word);
    return url.username || url.password ? null : url; // user@host hides the host
  } catch {
    return null;
  }
}
