// The picture, the lines over it, and the handles that move, scale and turn the object.

import { lineOf, listed, one, onDrag, put } from "./elements.js";
import { atDistance, clampSize, horizonAt, movedTo, rollOf } from "./ground.js";
import { corners } from "./region.js";

/** @typedef {import("./ground.js").Place} Place */
/** @typedef {{at: [number, number] | null, size: number, yaw: number | null, outline: number[] | null, shadow: import("./sun.js").ShadowGuides | null, horizon: [number, number] | null, grid: number[][], placed: boolean, sizes: number[], keyed: boolean, moving: boolean}} Guides */

const HANDLES = ["move", "scale", "turn"];
const TURN_DEG = 0.5; // a pixel of a drag
const HORIZON_COLUMN = 0.05; // of the horizon's handle
const ROLL_COLUMN = 0.7; // of the one that tilts it about the middle of the frame
const WHEEL = 0.0012; // logarithm of the distance by a unit of the wheel
const WHEEL_REST_MS = 250; // after which a step of the wheel ends

export class Stage {
  /**
   * @param {() => Place | null} place where the object stands
   * @param {(place: Place, done: boolean) => void} onPlace
   * @param {(row: number, done: boolean, roll?: number) => void} onHorizon
   * @param {(visible: boolean) => void} onOverlay draws further guides
   */
  constructor(place, onPlace, onHorizon, onOverlay) {
    this.onHorizon = onHorizon;
    this.onOverlay = onOverlay;
    this.place = place;
    this.onPlace = onPlace;
    /** @type {HTMLElement} */
    this.element = one("stage");
    /** @type {HTMLCanvasElement} */
    this.canvas = one("picture");
    /** @type {SVGElement} */
    this.lines = one("drawn");
    /** @type {Guides | null} */
    this.guides = null;
    /** @type {{[view: string]: ImageBitmap | null}} */
    this.pictures = {};
    this.view = "final";
    /** @type {string} `wipe` or `beside`, and the view that is compared; empty for none */
    this.compare = "";
    this.wipe = 0.5;
    /** @type {number[] | null} on whose ground the lens is fitted */
    this.region = null;
    this.shown = true;
    this.focused = ""; // a handle that had the focus when all were hidden
    /** @type {(lines: SVGElement) => void} draws more over the picture */
    this.more = () => {};
    /** @type {number | undefined} */
    this.wheelTimer = undefined;
    this.drag(one("grip"), this.moving.bind(this));
    this.drag(one("move"), this.moving.bind(this));
    this.drag(one("scale"), this.scaling.bind(this));
    this.drag(one("turn"), this.turning.bind(this));
    this.aspect = 1;
    this.dragHorizon(one("horizon-handle"), (row, down) => [row + down]);
    this.dragHorizon(one("roll-handle"), (row, down, roll) => {
      const lever = (ROLL_COLUMN - 0.5) * this.aspect;
      const steep = Math.tan((roll * Math.PI) / 180) + down / lever;
      return [row, Math.max(-45, Math.min(45, (Math.atan(steep) * 180) / Math.PI))];
    });
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    for (const kind of ["keydown", "pointerdown"]) { // before what these do, such as undo
      window.addEventListener(kind, () => this.endWheel(), { capture: true });
    }
    for (const id of HANDLES) {
      one(id).addEventListener("keydown", (event) => this.key(/** @type {KeyboardEvent} */ (event), id));
    }
  }

  /** @param {number} aspect width by height of the frame */
  shape(aspect) {
    this.aspect = aspect;
    one("pair").style.setProperty("--aspect", String(aspect));
  }

  /** How the picture is compared and with what; empty where it is not. @returns {string[]} */
  get compared() {
    const [how = "", what = ""] = this.compare.split(" ");
    return how && what !== this.view ? [how, what] : ["", ""];
  }

  /** What there is of a view: without one that is not drawn yet, another. @param {string} view */
  picture(view) {
    const { plate = null, final = null } = this.pictures;
    if (view === "plate") return plate;
    return this.pictures[view] ?? (view === "focus" ? null : final) ?? plate;
  }

  draw() {
    const [how, what] = this.compared;
    const other = what ? this.picture(what) : null;
    const beside = /** @type {HTMLCanvasElement} */ (one("beside"));
    beside.hidden = how !== "beside";
    one("wipe").toggleAttribute("hidden", how !== "wipe");
    one("pair").classList.toggle("two", how === "beside");
    const picture = this.picture(this.view);
    if (!picture) return;
    const { canvas } = this;
    const pen = fitted(canvas, picture);
    pen.drawImage(picture, 0, 0);
    if (how === "beside" && other) {
      fitted(beside, other).drawImage(other, 0, 0);
      beside.setAttribute("aria-label", what === "plate" ? "The plate" : "The object without lens");
    } else if (how === "wipe" && other) {
      const edge = Math.round(canvas.width * this.wipe);
      if (edge > 0) pen.drawImage(other, 0, 0, (other.width * edge) / canvas.width, other.height, 0, 0, edge, canvas.height);
      pen.fillStyle = "#fff";
      pen.fillRect(edge - 1, 0, 2, canvas.height);
    }
  }

  overlay() {
    this.lines.replaceChildren();
    const guides = this.guides;
    const seen = this.shown && (this.view === "final" || this.view === "sharp");
    const region = this.shown && this.region ? corners(this.region) : [];
    one("region-shape").setAttribute("points", listed(region));
    const row = seen && guides?.horizon ? (guides.horizon[0] + guides.horizon[1]) / 2 : null;
    one("horizon-handle").toggleAttribute("hidden", row === null);
    one("roll-handle").toggleAttribute("hidden", row === null);
    if (row !== null && guides?.horizon) {
      put(one("horizon-handle"), HORIZON_COLUMN, horizonAt(guides.horizon, HORIZON_COLUMN));
      put(one("roll-handle"), ROLL_COLUMN, horizonAt(guides.horizon, ROLL_COLUMN));
      one("horizon-handle").setAttribute("aria-valuenow", String(Math.round(100 * row)));
      one("roll-handle").setAttribute("aria-valuenow", rollOf(guides.horizon, this.aspect).toFixed(1));
    }
    this.onOverlay(this.shown && this.view !== "focus");
    const place = this.place();
    const handles = seen && place !== null && guides?.keyed;
    for (const id of HANDLES) {
      if (!handles && document.activeElement === one(id)) this.focused = id;
      one(id).toggleAttribute("hidden", !handles);
    }
    if (handles) {
      if (this.focused && document.activeElement === document.body) one(this.focused).focus();
      this.focused = "";
    }
    const grip = /** @type {HTMLElement} */ (one("grip"));
    grip.hidden = !(handles && guides?.outline);
    if (!seen || !guides) return;
    if (guides.placed) this.lines.append(...guides.grid.map((line) => lineOf(line, "")));
    if (guides.horizon) this.lines.append(lineOf([0, guides.horizon[0], 1, guides.horizon[1]], "horizon"));
    this.more(this.lines);
    if (!handles || !place) return;
    put(one("move"), place.at[0], place.at[1]);
    put(one("scale"), place.at[0], place.at[1] - place.size);
    put(one("turn"), place.at[0] + 0.6 * place.size, place.at[1]);
    if (guides.outline) {
      const [left, top, right, bottom] = guides.outline;
      Object.assign(grip.style, {
        left: `${100 * left}%`, top: `${100 * top}%`,
        width: `${100 * (right - left)}%`, height: `${100 * (bottom - top)}%`,
      });
    }
  }

  /**
   * @param {HTMLElement} element
   * @param {(start: Place, dx: number, dy: number) => Place} change by a way in pixels
   */
  drag(element, change) {
    /** @type {Place | null} */
    let last = null;
    onDrag(element, (down) => {
      const start = this.place();
      last = start;
      return start && ((event) => {
        last = change(start, event.clientX - down.clientX, event.clientY - down.clientY);
        this.onPlace(last, false);
      });
    }, () => last && this.onPlace(last, true));
  }

  /**
   * @param {HTMLElement} handle
   * @param {(row: number, down: number, roll: number) => [number, number?]} change row and, where that changes too, roll after a way down
   */
  dragHorizon(handle, change) {
    const known = () => {
      const horizon = this.guides?.horizon;
      return horizon ? /** @type {[number, number]} */ ([(horizon[0] + horizon[1]) / 2, rollOf(horizon, this.aspect)]) : null;
    };
    /** @type {[number, number?]} */
    let wanted = [0];
    onDrag(handle, (down) => {
      const start = known();
      if (start) wanted = change(start[0], 0, start[1]);
      return start && ((event) => {
        wanted = change(start[0], (event.clientY - down.clientY) / this.element.getBoundingClientRect().height, start[1]);
        this.onHorizon(wanted[0], false, wanted[1]);
      });
    }, () => this.onHorizon(wanted[0], true, wanted[1]));
    handle.addEventListener("keydown", (event) => {
      const start = known();
      const way = { ArrowUp: -1, ArrowDown: 1 }[event.key];
      if (!start || !way) return;
      event.preventDefault();
      const [row, roll] = change(start[0], way * (event.shiftKey ? 0.02 : 0.002), start[1]);
      this.onHorizon(row, true, roll);
    });
  }

  /** @param {Place} start @param {number} dx @param {number} dy */
  moving(start, dx, dy) {
    const box = this.element.getBoundingClientRect();
    const to = /** @type {[number, number]} */ ([start.at[0] + dx / box.width, start.at[1] + dy / box.height]);
    return movedTo(start, to, this.guides?.horizon ?? null);
  }

  /** @param {Place} start @param {number} _dx @param {number} dy */
  scaling(start, _dx, dy) {
    const box = this.element.getBoundingClientRect();
    return { ...start, size: clampSize(start.size - dy / box.height) };
  }

  /** @param {Place} start @param {number} dx */
  turning(start, dx) {
    return { ...start, yaw: start.yaw + TURN_DEG * dx };
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    const place = this.place();
    const movable = !one("move").hidden && one("pen").hidden; // as it is shown; else the page rolls
    if (!place || !this.guides || !movable || event.ctrlKey) return;
    event.preventDefault();
    const factor = Math.exp(WHEEL * event.deltaY * (event.deltaMode ? 30 : 1));
    this.onPlace(atDistance(place, factor, this.guides.horizon), false);
    window.clearTimeout(this.wheelTimer);
    this.wheelTimer = window.setTimeout(() => this.endWheel(), WHEEL_REST_MS);
  }

  /** End the step of the wheel, where one is not ended yet. */
  endWheel() {
    if (this.wheelTimer === undefined) return;
    window.clearTimeout(this.wheelTimer);
    this.wheelTimer = undefined;
    const rest = this.place();
    if (rest) this.onPlace(rest, true);
  }

  /** @param {KeyboardEvent} event @param {string} id */
  key(event, id) {
    const place = this.place();
    if (!place || event.ctrlKey || event.metaKey || event.altKey) return;
    const next = nudged(place, event.key, event.shiftKey ? 10 : 1, id, this.guides?.horizon ?? null);
    if (!next) return;
    event.preventDefault();
    this.onPlace(next, true);
  }
}

/**
 * @param {Place} place @param {string} key @param {number} many @param {string} id
 * @param {[number, number] | null} horizon
 * @returns {Place | null}
 */
function nudged(place, key, many, id, horizon) {
  const [x, y] = place.at;
  const step = 0.002 * many;
  const larger = 1.02 ** many;
  const turns = key === "," || (id === "turn" && key === "ArrowLeft") ? -many
    : key === "." || (id === "turn" && key === "ArrowRight") ? many : 0;
  if (turns) return { ...place, yaw: place.yaw + turns };
  if (key === "+" || key === "=" || (id === "scale" && key === "ArrowUp")) return { ...place, size: clampSize(place.size * larger) };
  if (key === "-" || (id === "scale" && key === "ArrowDown")) return { ...place, size: clampSize(place.size / larger) };
  if (id !== "move") return null;
  if (key === "ArrowLeft") return movedTo(place, [x - step, y], horizon);
  if (key === "ArrowRight") return movedTo(place, [x + step, y], horizon);
  if (key === "ArrowUp") return movedTo(place, [x, y - step], horizon);
  if (key === "ArrowDown") return movedTo(place, [x, y + step], horizon);
  return null;
}

/** @param {HTMLCanvasElement} canvas @param {ImageBitmap} picture */
function fitted(canvas, picture) {
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
}
