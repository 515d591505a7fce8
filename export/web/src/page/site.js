/** Files of the site, for its workers. */

/** @param {string} name @returns {string} address of a file of the site */
export function addressOf(name) {
  return new URL(name, self.location.href).href;
}

/**
 * Load a file of the site.
 *
 * @param {string} name
 * @returns {Promise<Response>}
 * @throws {Error} it is not there
 */
export async function load(name) {
  const response = await fetch(addressOf(name));
  if (!response.ok) throw new Error(`${name} is missing on the server`);
  return response;
}
