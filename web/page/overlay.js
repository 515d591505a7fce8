/** What is drawn over the picture: the frame to fit the display into, and the display's outline. */

/** Share of the picture's height or width that the guide frame fills. */
const FILLED = 0.8;

/** Width of the guide frame over its height: that of most displays. */
const ASPECT = 16 / 10;

/** Length of the guide frame's corners, as a share of its height. */
const CORNER = 0.16;

/** Draws over a picture, in the coordinates of its pixels. */
export class Overlay {
  /** @param {HTMLElement} view - holds the picture, and an <svg> with #guide and #outline */
  constructor(view) {
    this.view = view;
    this.svg = /** @type {SVGSVGElement} */ (view.querySelector("svg"));
    this.guide = /** @type {SVGPathElement} */ (view.querySelector("#guide"));
    this.outline = /** @type {SVGPolygonElement} */ (view.querySelector("#outline"));
    this.size = "";
  }

  /**
   * Fit the guide frame to pictures of a size.
   *
   * @param {number} width - in pixels
   * @param {number} height - in pixels
   */
  resize(width, height) {
    const size = `0 0 ${width} ${height}`;
    if (size === this.size || !width || !height) return;
    this.size = size;
    this.svg.setAttribute("viewBox", size);
    const tall = Math.min(FILLED * height, (FILLED * width) / ASPECT);
    const wide = tall * ASPECT;
    const [left, top] = [(width - wide) / 2, (height - tall) / 2];
    const arm = CORNER * tall;
    const path = [
      `M${left} ${top + arm}v${-arm}h${arm}`,
      `M${left + wide - arm} ${top}h${arm}v${arm}`,
      `M${left + wide} ${top + tall - arm}v${arm}h${-arm}`,
      `M${left + arm} ${top + tall}h${-arm}v${-arm}`,
    ];
    this.guide.setAttribute("d", path.join(""));
  }

  /**
   * Show where the display is, or the guide frame where it was not found.
   *
   * @param {number[][] | null} corners - in pixels of the picture
   * @param {boolean} locked - whether the display's clock is known
   */
  show(corners, locked) {
    this.outline.setAttribute("points", (corners ?? []).map((point) => point.join(",")).join(" "));
    this.guide.toggleAttribute("hidden", corners !== null);
    this.view.classList.toggle("locked", locked);
  }
}
