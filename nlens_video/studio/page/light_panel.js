// The controls of the light: sun, light from around, strength of the shadow.

import { field, one, onSlide, setUnlessTyping } from "./elements.js";
import { SunHandles } from "./sun.js";

/** @typedef {import("./sun.js").Sun} Sun */

const SUN = ["azimuth", "elevation", "strength"];
const GUESS = [60, 40]; // of the sun, where the plate tells none
const STRENGTH = 2;

export class LightPanel {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {string[]} environments names of the maps that there are
   * @param {(kind: string) => void} changed
   * @param {() => void} onRelease a slider is let go
   */
  constructor(shot, environments, changed, onRelease) {
    this.shot = shot;
    this.changed = changed;
    /** @type {number[] | null} azimuth and height of the plate's sun, as the last picture has it */
    this.found = null;
    this.handles = new SunHandles((sun, done) => this.put(sun, done));
    one("around").append(...[...new Set([...environments, this.environment])].filter(Boolean)
      .map((name) => new Option(name, name)));
    field("sun").addEventListener("change", () => {
      shot.set("light", { sun: field("sun").checked ? [...(this.found ?? GUESS), STRENGTH] : undefined });
      changed("rest");
    });
    SUN.forEach((id, at) => onSlide(id, (value, done) => {
      const [azimuth, height, strength = STRENGTH] = this.given ?? []; // whose sliders may show it rounded
      const sun = [azimuth, height, strength];
      sun[at] = value;
      this.put(/** @type {Sun} */ (sun), done);
    }));
    field("around").addEventListener("change", () => {
      const map = field("around").value || undefined;
      const turn = map && shot.get("light", "env-rotation");
      shot.set("light", { "env-map": map, env: undefined, "env-rotation": turn });
      changed("rest");
    });
    onSlide("around-turn", (degrees, done) => {
      shot.hold();
      shot.set("light", { "env-rotation": degrees || undefined });
      if (done) shot.release();
      if (done) onRelease();
      else changed("rest");
    });
    field("shadow").addEventListener("change", () => {
      const value = field("shadow").value;
      shot.set("light", { "shadow-strength": value === "" ? undefined : Number(value) });
      changed("rest");
    });
  }

  /** The map of the light from around that the shot names, empty for the plate's own. @returns {string} */
  get environment() {
    const named = this.shot.get("light", "env-map") ?? this.shot.get("light", "env") ?? "plate";
    return named === "plate" ? "" : named;
  }

  /** The sun that the shot gives. @returns {number[] | undefined} */
  get given() {
    const told = this.shot.get("light", "sun");
    return told === "none" ? undefined : told;
  }

  /** Show what the shot says. */
  show() {
    const sun = this.given;
    field("sun").checked = sun !== undefined;
    one("sun-rows").hidden = sun === undefined;
    if (sun) SUN.forEach((id, at) => setUnlessTyping(id, sun[at] ?? STRENGTH));
    const around = this.environment;
    field("around").value = around;
    one("around-row").hidden = !around;
    if (around) setUnlessTyping("around-turn", this.shot.get("light", "env-rotation") ?? 0);
    field("shadow").value = String(this.shot.get("light", "shadow-strength") ?? "");
  }

  /** Draw the sun's handles. @param {boolean} visible @param {import("./sun.js").ShadowGuides | null} guides */
  draw(visible, guides) {
    this.handles.draw(visible, this.shot.get("light", "sun"), guides);
  }

  /** @param {Sun} sun @param {boolean} done */
  put(sun, done) {
    this.shot.hold();
    this.shot.set("light", { sun });
    if (done) this.shot.release();
    this.changed(done ? "rest" : "light");
  }
}
