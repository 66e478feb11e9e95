// The sun: on a disc over the picture, and by the end of the shadow that it casts on the ground.

import { listed, one, onDrag, onSlide, put, shape } from "./elements.js";

/** @typedef {[number, number, number]} Triple */
/** @typedef {Triple} Sun azimuth and height in degrees, strength */
/** @typedef {{seen: number[][], body: Triple[]}} ShadowGuides */
/** @typedef {[number, number]} Point */

const LOWEST = 2; // degrees
const STRENGTH = { usual: 2, least: 0.25, most: 8, step: 0.25 }; // as of the option and the sliders
const BEYOND = 3; // of the object's height, that the ray goes on above its top

export class SunHandles {
  /** @param {(sun: Sun, done: boolean) => void} onSun */
  constructor(onSun) {
    this.onSun = onSun;
    /** @type {Sun | null} */
    this.sun = null;
    /** @type {ShadowGuides | null} */
    this.guides = null;
    this.held = false;
    this.drag(one("sun-handle"), (x, y) => this.onSky(x, y));
    this.drag(/** @type {SVGElement} */ (one("sky").querySelector("svg")), (x, y) => this.onSky(x, y));
    this.drag(one("shadow-tip"), (x, y) => this.onGround(x, y));
    for (const id of ["sun-handle", "shadow-tip"]) {
      /** @type {HTMLElement} */ (one(id)).addEventListener("keydown", (event) => this.key(event, id));
    }
    onSlide("sun-strength", (strength, done) => {
      if (this.sun) this.onSun([this.sun[0], this.sun[1], strength], done);
    });
  }

  /**
   * @param {boolean} visible
   * @param {number[] | "none" | undefined} given as the shot has it
   * @param {ShadowGuides | null} guides of the object that is edited
   */
  draw(visible, given, guides) {
    const held = one("sunlight");
    held.replaceChildren();
    this.sun = Array.isArray(given) ? [given[0] ?? 0, given[1] ?? 45, given[2] ?? STRENGTH.usual] : null;
    this.guides = guides;
    const shown = visible && this.sun !== null;
    one("sun-dial").toggleAttribute("hidden", !shown);
    const tip = shown && this.sun && guides ? onPicture(guides, shadowOf([0, 1, 0], this.sun)) : null;
    one("shadow-tip").toggleAttribute("hidden", !tip);
    if (!shown || !this.sun) return;
    this.show(this.sun);
    const foot = guides && onPicture(guides, [0, 0, 0]);
    if (!guides || !foot) return;
    if (this.held) held.append(drawn("polygon", hull(this.shadow(guides, this.sun)), "shade"));
    const [top, far] = [0, BEYOND].map((way) => onPicture(guides, along([0, 1, 0], toward(this.sun ?? [0, 0, 0]), way)));
    if (tip) held.append(drawn("polyline", [foot, tip], "cast"));
    const ray = [tip, top, far].filter((point) => point !== null && point !== undefined);
    if (ray.length > 1) held.append(drawn("polyline", ray, "ray"));
    if (tip) put(one("shadow-tip"), ...tip);
  }

  /** @param {Sun} sun */
  show([azimuth, height, strength]) {
    const handle = /** @type {HTMLElement} */ (one("sun-handle"));
    const out = 0.5 * (1 - height / 90);
    handle.style.left = `${100 * (0.5 + out * Math.sin(radians(azimuth)))}%`;
    handle.style.top = `${100 * (0.5 - out * Math.cos(radians(azimuth)))}%`;
    handle.setAttribute("aria-valuenow", String(azimuth));
    handle.setAttribute("aria-valuetext", `${Math.abs(azimuth)} degrees ${azimuth < 0 ? "to the left" : "to the right"} of the view, ${height} high, strength ${strength}`);
    const input = /** @type {HTMLInputElement} */ (one("sun-strength"));
    if (document.activeElement !== input) input.value = String(strength);
  }

  /** Points of the object's shadow in the picture. @param {ShadowGuides} guides @param {Sun} sun @returns {Point[]} */
  shadow(guides, sun) {
    return guides.body.map((point) => onPicture(guides, shadowOf(point, sun))).filter((point) => point !== null);
  }

  /** The sun at a point of the disc. @param {number} x @param {number} y @returns {Sun | null} */
  onSky(x, y) {
    const sky = one("sky").getBoundingClientRect();
    const [right, ahead] = [(2 * (x - sky.left)) / sky.width - 1, 1 - (2 * (y - sky.top)) / sky.height];
    return this.sun && given(right, ahead, 90 * (1 - Math.hypot(right, ahead)), this.sun);
  }

  /** The sun whose shadow ends at a point of the picture. @param {number} x @param {number} y @returns {Sun | null} */
  onGround(x, y) {
    const frame = one("stage").getBoundingClientRect();
    const { guides, sun } = this;
    if (!guides || !sun) return null;
    const end = fromPicture(guides, [(x - frame.left) / frame.width, (y - frame.top) / frame.height]);
    return end && given(-end[0], -end[1], degrees(Math.atan2(1, Math.hypot(...end))), sun);
  }

  /** @param {HTMLElement | SVGElement} handle @param {(x: number, y: number) => Sun | null} at the sun for a place of the window */
  drag(handle, at) {
    const button = handle instanceof HTMLElement; // which is grabbed where it is; the disc is pressed where the sun goes
    onDrag(handle, (down) => {
      if (!this.sun) return null;
      down.preventDefault();
      const box = handle.getBoundingClientRect();
      const [dx, dy] = button ? [box.left + box.width / 2 - down.clientX, box.top + box.height / 2 - down.clientY] : [0, 0];
      if (button) handle.focus();
      return (event) => {
        this.held = true;
        const sun = at(event.clientX + dx, event.clientY + dy);
        if (sun) this.onSun(sun, false);
      };
    }, () => {
      this.held = false;
      if (this.sun) this.onSun(this.sun, true);
    }, !button);
  }

  /** @param {KeyboardEvent} event @param {string} id */
  key(event, id) {
    if (!this.sun || event.ctrlKey || event.metaKey || event.altKey) return;
    const many = event.shiftKey ? 10 : 1;
    const up = id === "shadow-tip" ? -many : many;
    const [azimuth, height, strength] = this.sun;
    const next = /** @type {{[key: string]: Sun}} */ ({
      ArrowLeft: [turned(azimuth - many), height, strength],
      ArrowRight: [turned(azimuth + many), height, strength],
      ArrowUp: [azimuth, raised(height + up), strength],
      ArrowDown: [azimuth, raised(height - up), strength],
      "+": [azimuth, height, stronger(strength, 1)],
      "=": [azimuth, height, stronger(strength, 1)],
      "-": [azimuth, height, stronger(strength, -1)],
    })[event.key];
    if (!next) return;
    event.preventDefault();
    this.onSun(next, true);
  }
}

/** A sun in whole degrees; straight above, its direction is that of before. @param {number} right @param {number} ahead @param {number} height @param {Sun} before @returns {Sun} */
function given(right, ahead, height, before) {
  const azimuth = right || ahead ? turned(Math.round(degrees(Math.atan2(right, ahead)))) : before[0];
  return [azimuth, raised(Math.round(height)), before[2]];
}

/** Direction to the sun: right, up, ahead. @param {Sun} sun @returns {Triple} */
function toward([azimuth, height]) {
  const [a, h] = [radians(azimuth), radians(height)];
  return [Math.cos(h) * Math.sin(a), Math.sin(h), Math.cos(h) * Math.cos(a)];
}

/** @param {Triple} start @param {Triple} way @param {number} far @returns {Triple} */
function along([x, y, z], way, far) {
  return [x + far * way[0], y + far * way[1], z + far * way[2]];
}

/** Where a point's shadow falls on the ground. @param {Triple} point @param {Sun} sun @returns {Triple} */
function shadowOf(point, sun) {
  const way = toward(sun);
  return along(point, way, -Math.max(point[1], 0) / way[1]);
}

/** @param {ShadowGuides} guides @param {Triple} point @returns {Point | null} null behind the camera */
function onPicture({ seen }, [x, y, z]) {
  const [u = 0, v = 0, away = 0] = seen.map(([a = 0, b = 0, c = 0, d = 0]) => a * x + b * y + c * z + d);
  return away > 1e-6 ? [u / away, v / away] : null;
}

/** The point of the ground, to the right and ahead, that is seen at a place; null above the horizon. @param {ShadowGuides} guides @param {Point} place @returns {Point | null} */
function fromPicture({ seen }, [u, v]) {
  const rows = seen.map(([a = 0, , c = 0, d = 0]) => /** @type {Triple} */ ([a, c, d]));
  const [across, down, away] = /** @type {[Triple, Triple, Triple]} */ (rows);
  // a (x, z) of the ground has across = u away and down = v away
  const [a, b, c] = across.map((value, at) => value - u * (away[at] ?? 0));
  const [d, e, f] = down.map((value, at) => value - v * (away[at] ?? 0));
  const scale = (a ?? 0) * (e ?? 0) - (b ?? 0) * (d ?? 0);
  if (Math.abs(scale) < 1e-12) return null;
  const x = ((b ?? 0) * (f ?? 0) - (c ?? 0) * (e ?? 0)) / scale;
  const z = ((c ?? 0) * (d ?? 0) - (a ?? 0) * (f ?? 0)) / scale;
  return away[0] * x + away[1] * z + away[2] > 1e-6 ? [x, z] : null;
}

/** The corners of the convex hull, in order. @param {Point[]} points @returns {Point[]} */
function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  /** @param {Point[]} ordered */
  const half = (ordered) => {
    /** @type {Point[]} */
    const kept = [];
    for (const point of ordered) {
      while (kept.length > 1 && turn(/** @type {Point} */ (kept.at(-2)), /** @type {Point} */ (kept.at(-1)), point) <= 0) kept.pop();
      kept.push(point);
    }
    return kept.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/** @param {Point} a @param {Point} b @param {Point} c */
function turn(a, b, c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/** @param {number} azimuth */
function turned(azimuth) {
  return azimuth > 180 ? azimuth - 360 : azimuth < -180 ? azimuth + 360 : azimuth;
}

/** @param {number} height */
function raised(height) {
  return Math.min(90, Math.max(LOWEST, height));
}

/** @param {number} strength @param {number} steps */
function stronger(strength, steps) {
  return Math.min(STRENGTH.most, Math.max(STRENGTH.least, strength + steps * STRENGTH.step));
}

/** @param {number} value */
function radians(value) {
  return (value * Math.PI) / 180;
}

/** @param {number} value */
function degrees(value) {
  return (value * 180) / Math.PI;
}

/** @param {string} kind @param {Point[]} points @param {string} name */
function drawn(kind, points, name) {
  return shape(kind, { points: listed(points), class: name });
}
