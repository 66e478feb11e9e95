// A box or a polygon drawn on the picture: the part of the frame on whose ground the lens is fitted.

import { field, listed, one, setUnlessTyping } from "./elements.js";

/** @typedef {[number, number]} Point */

const DRAGGED_PX = 6; // a shorter way is a click, which sets a corner
const CLOSING_PX = 14; // a click so near to the first corner closes the polygon
const DIGITS = 3;
const LEAST_AREA = 1e-7; // of the frame: less than corners of that many digits have

class RegionPen {
  /** @param {(numbers: number[] | null) => void} onRegion takes the drawn region, null where drawing was given up */
  constructor(onRegion) {
    this.onRegion = onRegion;
    /** @type {HTMLElement} */
    this.pen = one("pen");
    /** @type {SVGPolygonElement} */
    this.sketch = one("sketch");
    /** @type {Point[]} */
    this.corners = [];
    /** @type {{x: number, y: number} | null} */
    this.down = null;
    this.pen.addEventListener("pointerdown", (event) => this.press(event));
    this.pen.addEventListener("pointermove", (event) => this.move(event));
    this.pen.addEventListener("pointerup", (event) => this.lift(event));
    this.pen.addEventListener("dblclick", () => this.close());
    document.addEventListener("keydown", (event) => {
      if (this.pen.hidden) return;
      if (event.key === "Escape") this.end(null);
      else if (event.key === "Enter" && this.close()) event.preventDefault(); // else the button begins anew
    });
  }

  start() {
    this.corners = [];
    this.down = null;
    this.pen.hidden = false;
    this.show([]);
  }

  /** @param {number[] | null} numbers */
  end(numbers) {
    this.pen.hidden = true;
    this.show([]);
    this.onRegion(numbers);
  }

  /** End with the corners where they have an area. @returns {boolean} whether they do */
  close() {
    const closed = spread(this.corners);
    if (closed) this.end(this.corners.flat());
    return closed;
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button) return;
    this.pen.setPointerCapture(event.pointerId);
    this.down = { x: event.clientX, y: event.clientY };
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { down } = this;
    if (down && !this.corners.length && away(down, event) > DRAGGED_PX) {
      this.show(corners(this.box(down, event)));
    } else if (this.corners.length) {
      this.show([...this.corners, this.at(event)]);
    }
  }

  /** @param {PointerEvent} event */
  lift(event) {
    const { down } = this;
    this.down = null;
    if (!down) return;
    if (!this.corners.length && away(down, event) > DRAGGED_PX) {
      const box = this.box(down, event);
      if ((box[0] ?? 0) < (box[2] ?? 0) && (box[1] ?? 0) < (box[3] ?? 0)) this.end(box);
      return;
    }
    const point = this.at(event);
    if (this.near(this.corners[0], point, CLOSING_PX)) {
      this.close();
      return;
    }
    if (this.near(this.corners.at(-1), point, DRAGGED_PX)) return; // the second click of two
    this.corners.push(point);
    this.show(this.corners);
  }

  /** @param {Point | undefined} corner @param {Point} point @param {number} pixels */
  near(corner, point, pixels) {
    const frame = this.pen.getBoundingClientRect();
    return corner && Math.hypot((corner[0] - point[0]) * frame.width, (corner[1] - point[1]) * frame.height) < pixels;
  }

  /** Fractions of the frame. @param {{clientX: number, clientY: number}} event @returns {Point} */
  at(event) {
    const frame = this.pen.getBoundingClientRect();
    return [part((event.clientX - frame.left) / frame.width), part((event.clientY - frame.top) / frame.height)];
  }

  /** @param {{x: number, y: number}} down @param {PointerEvent} event @returns {number[]} */
  box(down, event) {
    const [x0, y0] = this.at({ clientX: down.x, clientY: down.y });
    const [x1, y1] = this.at(event);
    return [Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)];
  }

  /** @param {Point[]} points */
  show(points) {
    this.sketch.setAttribute("points", listed(points));
  }
}

/** The region's controls: drawn with the pen, or typed. */
export class RegionPanel {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {(kind: string) => void} changed
   */
  constructor(shot, changed) {
    this.shot = shot;
    this.changed = changed;
    this.pen = new RegionPen((numbers) => {
      this.say(false);
      if (numbers) this.set(numbers);
    });
    one("draw-region").addEventListener("click", () => this.draw());
    one("clear-region").addEventListener("click", () => {
      one("draw-region").focus(); // the button goes away
      this.set(undefined);
    });
    field("region").addEventListener("change", () => this.read());
  }

  /** @type {number[] | null} as the shot says */
  get region() {
    return this.shot.get("lens", "fit-region") ?? null;
  }

  /** Show what the shot says. */
  show() {
    setUnlessTyping("region", this.region?.join(", ") ?? "");
    one("clear-region").hidden = !this.region;
  }

  /** Begin to draw, or give it up. */
  draw() {
    const on = one("draw-region").getAttribute("aria-pressed") !== "true";
    if (!on) {
      this.pen.end(null);
      return;
    }
    this.say(true);
    this.pen.start();
    one("stage").scrollIntoView({ block: "nearest" });
  }

  read() {
    const words = field("region").value.split(/[\s,;]+/).filter(Boolean);
    const wrong = words.find((word) => !Number.isFinite(Number(word)));
    if (wrong === undefined) this.set(words.length ? words.map(Number) : undefined);
    else this.wrong(`${wrong} is no number; the region is left as it was`);
  }

  /** @param {number[] | undefined} numbers */
  set(numbers) {
    this.shot.set("lens", { "fit-region": numbers });
    this.changed("rest");
  }

  /** @param {boolean} on whether a region is being drawn */
  say(on) {
    one("draw-region").setAttribute("aria-pressed", String(on));
    one("drawing").textContent = on ? "Drag a box over the ground, or click the corners of a polygon and then its first one again. Escape gives up." : "";
  }

  /** @param {string} words */
  wrong(words) {
    one("region-wrong").textContent = words;
    one("region-wrong").hidden = !words;
  }
}

/** The corners of a region as the shot has it. @param {number[]} numbers @returns {Point[]} */
export function corners(numbers) {
  const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = numbers;
  if (numbers.length === 4) return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
  return numbers.flatMap((x, at) => (at % 2 ? [] : [/** @type {Point} */ ([x, numbers[at + 1] ?? 0])]));
}

/** Whether corners do not all lie on one line. @param {Point[]} corners */
function spread([first, second, ...rest]) {
  if (!first || !second) return false;
  const [x, y] = [second[0] - first[0], second[1] - first[1]];
  return rest.some((corner) => Math.abs(x * (corner[1] - first[1]) - y * (corner[0] - first[0])) > LEAST_AREA);
}

/** @param {number} value */
function part(value) {
  return Number(Math.min(1, Math.max(0, value)).toFixed(DIGITS));
}

/** @param {{x: number, y: number}} down @param {PointerEvent} event */
function away(down, event) {
  return Math.hypot(event.clientX - down.x, event.clientY - down.y);
}
