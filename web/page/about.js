/** The page about it all: reads the film that comes with it, and shows what presets look like. */

import { keepForOffline, started } from "./site.js";

/**
 * Put frames in the place of a button once it is pressed: their titles by their addresses.
 *
 * @type {(id: string, pages: Record<string, string>) => void}
 */
function opens(id, pages) {
  const button = /** @type {HTMLButtonElement} */ (document.getElementById(id));
  button.addEventListener("click", () => {
    const frames = Object.entries(pages).map(([src, title]) =>
      Object.assign(document.createElement("iframe"), { src, title }),
    );
    button.replaceWith(...frames);
    frames[0].focus();
    frames[0].scrollIntoView({ block: "end" });
  });
}

opens("read", { "./?film=demo.mkv": "The receiver reads the film" });
opens("look", { "look-robust.html": "The preset robust", "look-hidden.html": "The preset hidden" });
started();
void keepForOffline();
