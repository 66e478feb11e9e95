// The objects of the shot: which of them is edited, their list, their keys and their ways.

import { listed, one, shape } from "./elements.js";
import { rounded } from "./ground.js";

/** @typedef {import("./ground.js").Place} Place */
/** @typedef {import("./shot.js").Table} Table */
/** @typedef {{at: [number, number] | null, size: number, yaw: number | null, outline: number[] | null, placed: boolean, path: number[][], stops: number[][], shadow: import("./sun.js").ShadowGuides | null}} ObjectGuides */

const OF_THE_SHOT = ["layers", "footprint", "footprint-node"]; // keys of the first object, whichever that is
const BESIDE = 0.2; // of the frame's width, between an object and one that is added

export class Objects {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {{frame: () => number, rate: number, files: string[], changed: () => void, go: (frame: number) => void}} page
   */
  constructor(shot, page) {
    this.shot = shot;
    this.page = page;
    this.selected = 0;
    /** @type {ObjectGuides[]} of the last picture */
    this.guides = [];
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
      page.changed();
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
   * @param {Place} before
   * @param {Place} wanted
   * @param {boolean} moving whether the camera moves
   */
  put(before, wanted, moving) {
    const frame = this.page.frame();
    const moved = wanted.at[0] !== before.at[0] || wanted.at[1] !== before.at[1];
    const at = [rounded(wanted.at[0], 4), rounded(wanted.at[1], 4)];
    const [size, yaw] = [rounded(wanted.size, 4), rounded(wanted.yaw, 2)];
    /** @type {Table} */
    const whole = {};
    /** @type {Table} */
    const key = {};
    if (!this.keyed("at")) {
      whole["at"] = at;
      whole["at-frame"] = moving && frame ? frame : undefined;
    } else if (moved) key["at"] = at;
    if (this.keyed("size")) {
      if (!moved) key["size"] = size;
    } else if (!this.keyed("at")) {
      whole["size"] = size;
      whole["height"] = undefined;
    } else if (!moved && this.table["size"] && before.size > 0) {
      // what no key gives holds where the way begins, not here
      whole["size"] = rounded((this.table["size"] * wanted.size) / before.size, 4);
    }
    if (!this.keyed("yaw")) whole["yaw"] = yaw;
    else if (wanted.yaw !== before.yaw) key["yaw"] = yaw;
    if (Object.keys(key).length) whole["key"] = this.withKey(key);
    this.write(whole);
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
    const guides = this.guides[this.selected];
    if (!guides?.at) return;
    const at = [rounded(guides.at[0], 4), rounded(guides.at[1], 4)];
    const yaw = rounded(guides.yaw ?? this.table["yaw"] ?? 0, 2);
    /** @type {Table} */
    const key = { at, yaw };
    if (this.keyed("size")) key["size"] = rounded(guides.size, 4);
    const sized = this.keyed("size") || this.table["size"] !== undefined || this.table["height"] !== undefined;
    this.write({
      key: this.withKey(key), at: undefined, "at-frame": undefined, yaw: undefined,
      ...(sized ? {} : { size: rounded(guides.size, 4) }),
    });
    this.page.changed();
  }

  /** With the last key its place and turn hold for all of the shot. */
  deleteKey() {
    const { here } = this;
    if (here < 0) return;
    const [gone] = this.keys.slice(here, here + 1);
    const left = this.keys.filter((_, at) => at !== here);
    /** @type {Table} */
    const whole = { key: left.length ? left : undefined };
    for (const name of ["at", "size", "yaw"]) {
      const last = gone?.[name] !== undefined && !left.some((key) => key[name] !== undefined);
      if (last) whole[name] = gone[name];
    }
    this.writeAll(this.list.map((table, at) => (at === this.selected ? { ...table, ...whole } : table)));
    this.page.changed();
  }

  add() {
    const select = /** @type {HTMLSelectElement} */ (one("add-object"));
    const file = select.value;
    select.value = "";
    const near = this.guides[0];
    if (!file || !near?.at) return;
    const [x, y] = near.at;
    const at = [rounded(x + (x > 0.5 ? -BESIDE : BESIDE), 4), rounded(Math.min(y, 0.95), 4)];
    const list = [...this.list, { file, at, size: rounded(Math.min(0.9, Math.max(0.02, near.size)), 4) }];
    this.writeAll(list);
    this.selected = list.length - 1;
    this.page.changed();
  }

  remove() {
    const { list } = this;
    if (list.length < 2) return;
    this.writeAll(inherited(list, list.filter((_, at) => at !== this.selected)));
    this.selected = Math.max(0, this.selected - 1);
    this.page.changed();
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
    this.page.changed();
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
    disable("delete-key", here < 0);
    disable("set-key", !this.guides[this.selected]?.placed);
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

/** A table without keys that are undefined. @param {Table} table @returns {Table} */
function cleaned(table) {
  return Object.fromEntries(Object.entries(table).filter(([, value]) => value !== undefined));
}

/** What the first object holds for the shot goes to the one that is first now. @param {Table[]} before @param {Table[]} after @returns {Table[]} */
function inherited(before, after) {
  const [first] = before;
  const [next] = after;
  if (!first || first === next) return after;
  const shared = Object.fromEntries(OF_THE_SHOT.filter((key) => first[key] !== undefined).map((key) => [key, first[key]]));
  return after.map((table, at) => {
    const own = Object.entries(table).filter(([key]) => !OF_THE_SHOT.includes(key) && key !== "camera");
    return { ...Object.fromEntries(own), ...(at ? {} : shared) };
  });
}

/** @param {string} id @param {boolean} off */
function disable(id, off) {
  /** @type {HTMLButtonElement} */ (one(id)).disabled = off;
}

/** @param {number[][]} points @param {string} name */
function way(points, name) {
  return shape("polyline", { points: listed(points), class: name });
}
