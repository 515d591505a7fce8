/** The page about it all: reads the film that comes with it, when it is asked to. */

import { keepForOffline } from "./site.js";

const button = /** @type {HTMLButtonElement} */ (document.getElementById("read"));
button.addEventListener("click", () => {
  const frame = document.createElement("iframe");
  Object.assign(frame, { src: "./?film=demo.mkv", title: "The receiver reads the film" });
  button.replaceWith(frame);
  frame.focus();
  frame.scrollIntoView({ block: "end" });
});
void keepForOffline();
