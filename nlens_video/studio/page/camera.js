// Guides of the plate's camera: the horizon, the lines that its solve found, and lines by hand.

/** @typedef {[number, number]} Point */
/** @typedef {[number, number, number, number]} Line */
/** @typedef {number[]} Found x0, y0, x1, y1 and the number of its direction */

import { lineOf, one, onDrag, shape } from "./elements.js";
import { rollOf } from "./ground.js";

const VERTICAL = 0;
const CLUTTER = -1;
const LEFT_OUT = -2;
const SAME = 0.002; // between ends of one line, of the frame

/** Lines of a shot, four numbers each. @param {number[]} numbers @returns {Line[]} */
export function linesOf(numbers) {
  return numbers.flatMap((_, at) => (at % 4 ? [] : [/** @type {Line} */ (numbers.slice(at, at + 4))]));
}

export class PlateLines {
  /**
   * @param {(numbers: number[]) => void} onIgnored takes the lines that the solve leaves out
   * @param {() => void} onChosen another line is marked
   */
  constructor(onIgnored, onChosen) {
    this.onIgnored = onIgnored;
    this.onChosen = onChosen;
    /** @type {Found[]} */
    this.found = [];
    /** @type {Line[]} */
    this.ignored = [];
    this.shown = false;
    /** @type {Line | null} */
    this.chosen = null;
    one("all-lines").addEventListener("click", () => {
      one("show-found").focus(); // the button goes away
      this.onIgnored([]);
    });
    one("line").addEventListener("change", () => this.choose());
    one("toggle-line").addEventListener("click", () => {
      if (this.chosen) this.toggle([this.chosen]);
    });
  }

  /** Draw them, and list their directions. @param {boolean} visible */
  draw(visible) {
    const held = one("found-lines");
    held.replaceChildren();
    one("all-lines").toggleAttribute("hidden", !this.ignored.length);
    one("directions").toggleAttribute("hidden", !this.shown);
    this.list();
    this.listLines();
    if (!visible || !this.shown) return;
    for (const line of this.all) {
      const chosen = this.chosen && alike(this.chosen, line) ? " chosen" : "";
      const drawn = shape("g", { class: `found ${nameOf(line[4] ?? CLUTTER)}${chosen}` });
      drawn.append(lineOf(line, "touch"), lineOf(line, "seen"));
      drawn.addEventListener("click", () => this.toggle([/** @type {Line} */ (line.slice(0, 4))]));
      held.append(drawn);
    }
  }

  list() {
    const focused = document.activeElement?.id;
    const groups = [...new Set(this.found.map((line) => line[4] ?? CLUTTER))].sort((a, b) => (a < 0 ? 99 : a) - (b < 0 ? 99 : b));
    one("directions").replaceChildren(...groups.map((group) => {
      const row = document.createElement("li");
      const label = document.createElement("label");
      const box = document.createElement("input");
      const lines = this.found.filter((line) => line[4] === group).map((line) => /** @type {Line} */ (line.slice(0, 4)));
      label.className = `check ${nameOf(group)}`;
      box.type = "checkbox";
      box.checked = true;
      box.id = `direction-${group}`;
      box.addEventListener("change", () => this.toggle(lines));
      const mark = document.createElement("i");
      label.append(box, mark, ` ${wordsOf(group)}: ${lines.length} lines`);
      row.append(label);
      return row;
    }));
    if (this.ignored.length) {
      const row = document.createElement("li");
      row.className = "quiet";
      row.textContent = `${this.ignored.length} left out; click on one to take it again.`;
      one("directions").append(row);
    }
    if (focused?.startsWith("direction-")) document.getElementById(focused)?.focus();
  }

  /** Those that the solve found and, after them, those that it leaves out. @returns {Found[]} */
  get all() {
    return [...this.found, ...this.ignored.map((ends) => [...ends, LEFT_OUT])];
  }

  /** The lines one by one, for those who do not point. */
  listLines() {
    one("one-line").toggleAttribute("hidden", !this.shown);
    const select = /** @type {HTMLSelectElement} */ (one("line"));
    const options = this.all.map((line, at) => new Option(`${at + 1} ${wordsOf(line[4] ?? CLUTTER)}, ${whereIs(line)}`, String(at)));
    select.replaceChildren(new Option("One line …", ""), ...options);
    const at = this.all.findIndex((line) => this.chosen && alike(this.chosen, line));
    select.value = at < 0 ? "" : String(at);
    const button = /** @type {HTMLButtonElement} */ (one("toggle-line"));
    button.disabled = !this.chosen; // also while a line that is taken again is not found yet: it keeps the focus
    button.textContent = at >= this.found.length ? "Take again" : "Leave out";
  }

  /** Mark the line of the list in the picture. */
  choose() {
    const { value } = /** @type {HTMLSelectElement} */ (one("line"));
    this.chosen = value === "" ? null : /** @type {Line} */ (this.all[Number(value)]?.slice(0, 4));
    this.onChosen();
  }

  /** Leave lines out, or take them again. @param {Line[]} lines */
  toggle(lines) {
    const again = this.ignored.filter((other) => lines.some((line) => alike(line, other)));
    const kept = this.ignored.filter((other) => !again.includes(other));
    this.found = this.found.filter((one) => !lines.some((line) => alike(line, one)));
    this.onIgnored(again.length ? kept.flat() : [...kept, ...lines].flat());
  }
}

/** @param {Line} one @param {number[]} other */
function alike(one, other) {
  return one.every((value, at) => Math.abs(value - (other[at] ?? 0)) < SAME);
}

/** @param {number} group */
function nameOf(group) {
  return { [VERTICAL]: "upright", [CLUTTER]: "clutter", [LEFT_OUT]: "left-out" }[group] ?? `level-${group}`;
}

/** Where the middle of a line is, in words. @param {number[]} line */
function whereIs([x0 = 0, y0 = 0, x1 = 0, y1 = 0]) {
  const [x, y] = [(x0 + x1) / 2, (y0 + y1) / 2].map((value) => Math.min(2, Math.floor(3 * value)));
  const row = ["upper", "", "lower"][y ?? 1];
  const column = ["left", "", "right"][x ?? 1];
  return `${[row, column].filter(Boolean).join(" ") || "middle"}, ${Math.round(100 * (x0 + x1) / 2)} % across and ${Math.round(100 * (y0 + y1) / 2)} % down`;
}

/** @param {number} group */
function wordsOf(group) {
  return { [VERTICAL]: "upright", [CLUTTER]: "of no direction", [LEFT_OUT]: "left out" }[group] ?? `level, direction ${group}`;
}

/**
 * Row of the horizon in the middle of the frame, its roll, and the field of view, from two pairs of
 * lines that are level and at right angles to each other in the scene.
 * @param {Line[]} pairs four lines, two of each direction
 * @param {number} aspect width by height of the frame
 * @returns {{horizon: number, roll: number, fov: number | null} | null} null where lines of a pair are parallel
 */
export function cameraOfPairs(pairs, aspect) {
  const [a, b, c, d] = pairs;
  if (!a || !b || !c || !d) return null;
  const first = meeting(a, b);
  const second = meeting(c, d);
  if (!first || !second || Math.abs(first[0] - second[0]) < 1e-6) return null;
  const slope = (second[1] - first[1]) / (second[0] - first[0]);
  const horizon = first[1] + slope * (0.5 - first[0]);
  // at right angles: (v1 - c) · (v2 - c) = -f², in units of the frame's width
  const across = (first[0] - 0.5) * (second[0] - 0.5);
  const down = ((first[1] - 0.5) * (second[1] - 0.5)) / aspect ** 2;
  const square = -(across + down);
  const fov = square > 0 ? (360 / Math.PI) * Math.atan(0.5 / Math.sqrt(square)) : null;
  const roll = rollOf([horizon - slope / 2, horizon + slope / 2], aspect);
  return { horizon, roll, fov: fov !== null && fov > 1 && fov < 170 ? fov : null };
}

/** Where two lines meet. @param {Line} one @param {Line} other @returns {Point | null} */
function meeting(one, other) {
  const [a, b, c] = through(one);
  const [d, e, f] = through(other);
  const scale = a * e - b * d;
  if (Math.abs(scale) < 1e-9) return null;
  return [(b * f - c * e) / scale, (c * d - a * f) / scale];
}

/** a x + b y + c = 0. @param {Line} line @returns {[number, number, number]} */
function through([x0, y0, x1, y1]) {
  return [y0 - y1, x1 - x0, x0 * y1 - x1 * y0];
}

const START = /** @type {Line[]} */ ([
  [0.3, 0.9, 0.42, 0.6], [0.75, 0.9, 0.6, 0.6],
  [0.15, 0.7, 0.85, 0.62], [0.1, 0.95, 0.9, 0.8],
]);

/** Two pairs of lines, the ends of which are dragged. */
export class HandLines {
  /** @param {(lines: Line[], done: boolean) => void} onLines */
  constructor(onLines) {
    this.onLines = onLines;
    /** @type {Line[]} */
    this.lines = START.map((line) => /** @type {Line} */ ([...line]));
    this.shown = false;
    /** @type {HTMLButtonElement[]} */
    this.ends = this.lines.flatMap((_, at) => [0, 1].map((end) => this.handle(at, end)));
    one("hand-ends").append(...this.ends);
  }

  /** @param {boolean} visible */
  draw(visible) {
    const held = one("hand-lines");
    held.replaceChildren();
    const shown = visible && this.shown;
    one("hand-ends").toggleAttribute("hidden", !shown);
    if (!shown) return;
    held.append(...this.lines.map((line, at) => lineOf(line, at < 2 ? "hand first" : "hand second")));
    this.ends.forEach((handle, at) => {
      const line = this.lines[at >> 1] ?? [0, 0, 0, 0];
      handle.style.left = `${100 * (line[2 * (at % 2)] ?? 0)}%`;
      handle.style.top = `${100 * (line[2 * (at % 2) + 1] ?? 0)}%`;
    });
  }

  /** @param {number} at of the line @param {number} end 0 or 1 */
  handle(at, end) {
    const handle = document.createElement("button");
    handle.type = "button";
    handle.className = `handle end ${at < 2 ? "first" : "second"}`;
    handle.setAttribute("aria-label", `End ${end + 1} of line ${1 + (at % 2)} of the ${at < 2 ? "first" : "second"} pair. Arrow keys move it, with Shift farther.`);
    onDrag(handle, (down) => {
      const [x = 0, y = 0] = this.lines[at]?.slice(2 * end) ?? [];
      return (event) => {
        const frame = one("stage").getBoundingClientRect();
        this.put(at, end, x + (event.clientX - down.clientX) / frame.width, y + (event.clientY - down.clientY) / frame.height, false);
      };
    }, () => this.onLines(this.lines, true));
    handle.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      const line = this.lines[at];
      if (!way || !line) return;
      event.preventDefault();
      const step = event.shiftKey ? 0.02 : 0.002;
      this.put(at, end, (line[2 * end] ?? 0) + step * (way[0] ?? 0), (line[2 * end + 1] ?? 0) + step * (way[1] ?? 0), true);
    });
    return handle;
  }

  /** @param {number} at @param {number} end @param {number} x @param {number} y @param {boolean} done */
  put(at, end, x, y, done) {
    const line = this.lines[at];
    if (!line) return;
    line[2 * end] = Math.min(1, Math.max(0, x));
    line[2 * end + 1] = Math.min(1, Math.max(0, y));
    this.onLines(this.lines, done);
  }
}
