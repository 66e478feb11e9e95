// The objects of the shot: which of them is edited, their list, their keys and their ways.

import { listed, one, shape } from "./elements.js";
import { rounded } from "./ground.js";
import { cleaned, inherited, taller, written } from "./object_tables.js";

/** @typedef {import("./ground.js").Place} Place */
/** @typedef {import("./shot.js").Table} Table */
/** @typedef {{at: [number, number] | null, size: number, yaw: number | null, outline: number[] | null, placed: boolean, path: number[][], stops: number[][], sizes: number[], shadow: import("./sun.js").ShadowGuides | null}} ObjectGuides */

const BESIDE = 0.2; // of the frame's width, between an object and one that is added

export class Objects {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {{frame: () => number, rate: number, files: string[], moving: () => boolean, place: () => Place | null, changed: () => void, replaced: () => void, go: (frame: number) => void}} page
   */
  constructor(shot, page) {
    this.shot = shot;
    this.page = page;
    this.selected = 0;
    /** @type {ObjectGuides[]} of the last picture */
    this.guides = [];
    this.stale = false; // whether that was of another frame, or of a shot in which they stood elsewhere
    one("add-object").append(...page.files.map((name) => new Option(name, name)));
    one("add-object").addEventListener("change", () => this.add());
    one("remove-object").addEventListener("click", () => this.remove());
    one("earlier").addEventListener("click", () => this.reorder(-1));
    one("later").addEventListener("click", () => this.reorder(1));
    one("set-key").addEventListener("click", () => this.setKey());
    one("delete-key").addEventListener("click", () => this.deleteKey());
    one("interpolation").addEventListener("change", () => {
      const { value } = /** @type {HTMLSelectElement} */ (one("interpolation"));
      this.write({ interpolation: value === "smooth" ? undefined : value });
      page.replaced();
    });
  }

  /** All objects, each with what the shot says of it. @returns {Table[]} */
  get list() {
    const { tables } = this.shot;
    const listed = tables["object"];
    return Array.isArray(listed) ? listed : [{ ...listed, ...tables["place"] }];
  }

  /** The one that is edited. @returns {Table} */
  get table() {
    return this.list[this.selected] ?? {};
  }

  /** @param {string} name `at`, `size` or `yaw` @returns {boolean} */
  keyed(name) {
    const names = name === "size" ? ["size", "height"] : [name];
    return this.keys.some((key) => names.some((one) => key[one] !== undefined));
  }

  /** @returns {Table[]} */
  get keys() {
    return this.table["key"] ?? [];
  }

  /** Change keys of the object that is edited; undefined takes one away. @param {Table} changes */
  write(changes) {
    if (!Array.isArray(this.shot.tables["object"]) && !changes["key"] && changes["interpolation"] === undefined) {
      const { tables } = this.shot;
      this.shot.replace({ ...tables, place: cleaned({ ...tables["place"], ...changes }) });
    } else {
      this.writeAll(this.list.map((table, at) => (at === this.selected ? { ...table, ...changes } : table)));
    }
  }

  /** @param {Table[]} list */
  writeAll(list) {
    const { place, ...tables } = this.shot.tables;
    this.shot.replace({ ...tables, object: list.map(cleaned) });
  }

  /**
   * Put the object that is edited where a hand has put it; its key of this frame, where it has keys.
   * What the hand has left as it was is not written.
   * @param {Place | null} before null where the shot does not place it
   * @param {Place} wanted
   */
  put(before, wanted) {
    const moved = wanted.at[0] !== before?.at[0] || wanted.at[1] !== before?.at[1];
    const turned = wanted.yaw !== before?.yaw;
    const factor = before && before.size > 0 ? wanted.size / before.size : 1;
    const sized = factor !== 1 || !before;
    if (!moved && !turned && !sized) return;
    const { at, size, yaw } = written(wanted);
    const { table } = this;
    const here = this.keys[this.here] ?? {};
    // what is given for all of the shot is so on one frame: together, or not at all
    const whole = !before || !table["at"] || table["at-frame"] !== this.atFrame;
    /** @type {Table} */
    const changes = {};
    /** @type {Table} */
    const key = {};
    if (this.keyed("at")) {
      if (moved) key["at"] = at;
    } else if (moved || whole) Object.assign(changes, { at, "at-frame": this.atFrame });
    const scaled = sized && !moved; // on the ground the real height stays
    if (this.keyed("size")) {
      if (here["height"] !== undefined) Object.assign(key, scaled ? { height: taller(here["height"], factor) } : {});
      else if (scaled || (sized && here["size"] !== undefined)) key["size"] = size;
    } else if (table["height"] !== undefined) {
      if (scaled) changes["height"] = taller(table["height"], factor);
    } else if (!this.keyed("at")) {
      if (sized || whole || table["size"] === undefined) changes["size"] = size;
    } else if (moved) Object.assign(changes, this.begins ? { size } : {});
    else if (scaled && table["size"] !== undefined) changes["size"] = rounded(table["size"] * factor, 4);
    if (scaled) this.see({ sizes: this.guides[this.selected]?.sizes.map((one) => one * factor) ?? [] });
    if (this.keyed("yaw")) Object.assign(key, turned ? { yaw } : {});
    else if (!this.keyed("at")) Object.assign(changes, turned || whole ? { yaw } : {});
    else if (turned) changes["yaw"] = rounded((table["yaw"] ?? 0) + wanted.yaw - (before?.yaw ?? 0), 2);
    if (Object.keys(key).length) changes["key"] = this.withKey(key);
    this.write(changes);
  }

  /** The object that is edited is seen so from now on. @param {Partial<ObjectGuides>} changes */
  see(changes) {
    Object.assign(this.guides[this.selected] ?? {}, changes);
  }

  /** Of a place that holds for all of the shot and is seen on this frame. @returns {number | undefined} */
  get atFrame() {
    return (this.page.moving() && this.page.frame()) || undefined;
  }

  /** Whether the way begins at the key of this frame, once there is one. */
  get begins() {
    const frame = this.page.frame();
    return !this.keys.some((key) => key["at"] !== undefined && this.frameOf(key) < frame);
  }

  /** The number of the key of this frame, -1 for none. */
  get here() {
    const frame = this.page.frame();
    return this.keys.findIndex((key) => this.frameOf(key) === frame);
  }

  /** @param {Table} key @returns {number} */
  frameOf(key) {
    return key["frame"] ?? Math.round(key["time"] * this.page.rate);
  }

  /** The keys, with that of this frame changed or made, in the order of time. @param {Table} changes @returns {Table[]} */
  withKey(changes) {
    const keys = [...this.keys];
    const { here } = this;
    const frame = this.page.frame();
    const timed = keys.some((key) => key["time"] !== undefined) || !this.page.rate;
    const moment = timed ? { time: this.page.rate ? rounded(frame / this.page.rate, 4) : 0 } : { frame };
    if (here < 0) keys.push({ ...moment, ...changes });
    else keys[here] = cleaned({ ...keys[here], ...changes });
    return keys.sort((a, b) => this.frameOf(a) - this.frameOf(b));
  }

  /** Keep place and turn of this frame; what held for all of the shot becomes a key's. */
  setKey() {
    const place = this.page.place();
    if (!place) return;
    const { at, size, yaw } = written(place);
    const tall = this.keys[this.here]?.["height"] !== undefined;
    const key = this.withKey({ at, yaw, ...(this.keyed("size") && !tall ? { size } : {}) });
    const sized = this.begins && !this.keyed("size") && this.table["height"] === undefined;
    this.write({ key, at: undefined, "at-frame": undefined, yaw: undefined, ...(sized ? { size } : {}) });
    this.page.changed();
  }

  /** What no key is left for holds for all of the shot, as it is seen on this frame. */
  deleteKey() {
    const gone = this.keys[this.here];
    const place = this.page.place();
    if (!gone || !place) return;
    const left = this.keys.filter((key) => key !== gone);
    const free = (/** @type {string[]} */ ...names) => !left.some((key) => names.some((name) => key[name] !== undefined));
    const { at, size, yaw } = written(place);
    const sized = free("size", "height") && this.table["height"] === undefined && gone["height"] === undefined;
    const first = this.begins && gone["at"] !== undefined;
    /** @type {Table} */
    const changes = { key: left.length ? left : undefined };
    if (gone["height"] !== undefined && free("size", "height")) changes["height"] = gone["height"];
    if (free("yaw") && (gone["yaw"] !== undefined || free("at"))) changes["yaw"] = yaw;
    if (free("at")) Object.assign(changes, { at, "at-frame": this.atFrame }, sized ? { size } : {});
    else if (sized && (first || gone["size"] !== undefined)) {
      const next = this.guides[this.selected]?.sizes[first ? 1 : 0]; // where the way begins then
      if (next) changes["size"] = rounded(next, 4);
    }
    this.writeAll(this.list.map((one, at) => (at === this.selected ? { ...one, ...changes } : one)));
    this.page.replaced();
  }

  add() {
    const select = /** @type {HTMLSelectElement} */ (one("add-object"));
    const file = select.value;
    select.value = "";
    const near = this.guides[0];
    if (!file || !near?.at) return;
    const [x, y] = near.at;
    const at = [rounded(x + (x > 0.5 ? -BESIDE : BESIDE), 4), rounded(Math.min(y, 0.95), 4)];
    const size = rounded(Math.min(0.9, Math.max(0.02, near.size)), 4);
    const list = [...this.list, { file, at, "at-frame": this.atFrame, size }];
    this.writeAll(list);
    this.selected = list.length - 1;
    this.page.replaced();
  }

  remove() {
    const { list } = this;
    if (list.length < 2) return;
    this.writeAll(inherited(list, list.filter((_, at) => at !== this.selected)));
    this.selected = Math.max(0, this.selected - 1);
    this.page.replaced();
  }

  /** @param {number} by */
  reorder(by) {
    const { list } = this;
    const to = this.selected + by;
    if (to < 0 || to >= list.length) return;
    const next = [...list];
    const [moved] = next.splice(this.selected, 1);
    next.splice(to, 0, /** @type {Table} */ (moved));
    this.writeAll(inherited(list, next));
    this.selected = to;
    this.page.replaced();
  }

  /** Show the list and the keys. */
  show() {
    const { list } = this;
    this.selected = Math.min(this.selected, list.length - 1);
    const focused = document.activeElement?.id;
    one("objects").replaceChildren(...list.map((table, at) => {
      const label = document.createElement("label");
      const radio = document.createElement("input");
      radio.type = "radio";
      radio.name = "object";
      radio.id = `object-${at}`;
      radio.checked = at === this.selected;
      radio.addEventListener("change", () => {
        this.selected = at;
        this.page.changed();
      });
      label.className = "check";
      label.append(radio, ` ${at + 1} ${String(table["file"]).split("/").pop()}`);
      return label;
    }));
    if (focused?.startsWith("object-")) document.getElementById(focused)?.focus();
    disable("remove-object", list.length < 2);
    disable("earlier", this.selected === 0);
    disable("later", this.selected === list.length - 1);
    this.showKeys();
  }

  showKeys() {
    const { keys, here } = this;
    const focused = document.activeElement?.id;
    one("keys").replaceChildren(...keys.map((key, at) => {
      const row = document.createElement("li");
      const go = document.createElement("button");
      go.type = "button";
      go.id = `key-${at}`;
      const said = ["at", "size", "height", "yaw"].filter((name) => key[name] !== undefined);
      const words = said.map((name) => ({ at: "place", yaw: "turn" }[name] ?? "size")).join(", ");
      go.textContent = `Frame ${this.frameOf(key)}: ${words}`;
      if (at === here) go.setAttribute("aria-current", "true");
      go.addEventListener("click", () => this.page.go(this.frameOf(key)));
      row.append(go);
      return row;
    }));
    if (focused?.startsWith("key-")) document.getElementById(focused)?.focus();
    const placed = this.page.place() !== null;
    disable("delete-key", here < 0 || !placed);
    disable("set-key", !placed);
    disable("add-object", this.stale);
    one("interpolation-row").hidden = keys.length < 2;
    /** @type {HTMLSelectElement} */ (one("interpolation")).value = this.table["interpolation"] ?? "smooth";
  }

  /** Draw the ways on the ground, that of the object that is edited stronger. @param {Element} lines */
  draw(lines) {
    this.guides.forEach((guides, at) => {
      if (guides.path.length < 2) return;
      const name = at === this.selected ? "way" : "way other";
      lines.append(way(guides.path, name), ...guides.stops.map((stop) => way([stop, stop], `${name} stop`)));
    });
  }
}

/** @param {string} id @param {boolean} off */
function disable(id, off) {
  /** @type {HTMLButtonElement | HTMLSelectElement} */ (one(id)).disabled = off;
}

/** @param {number[][]} points @param {string} name */
function way(points, name) {
  return shape("polyline", { points: listed(points), class: name });
}
