// The controls of the plate's camera: horizon, roll, and the lines that tell them.

import { HandLines, PlateLines, cameraOfPairs, linesOf } from "./camera.js";
import { field, one, onSlide, setUnlessTyping } from "./elements.js";
import { FIRST_PLACE, horizonOf, rollOf, rounded } from "./ground.js";

/** @typedef {import("./camera.js").Line} Line */

const LEAST_BELOW = 0.03; // of the object below the horizon
const MOST_ROLL = 45; // degrees
const FIRST_ROW = 0.45; // of a horizon that the picture does not tell

export class CameraPanel {
  /**
   * @param {import("./shot.js").Shot} shot
   * @param {import("./objects.js").Objects} objects
   * @param {import("./stage.js").Stage} stage
   * @param {(kind: string) => void} changed
   */
  constructor(shot, objects, stage, changed) {
    this.shot = shot;
    this.objects = objects;
    this.stage = stage;
    this.changed = changed;
    this.fovBefore = shot.get("camera", "fov"); // lines by hand give another
    this.found = new PlateLines((numbers) => {
      shot.set("camera", { "ignore-lines": numbers.length ? numbers : undefined });
      changed("rest");
    }, () => stage.overlay());
    this.hand = new HandLines((lines, done) => this.solve(lines, done));
    field("own-horizon").addEventListener("change", () => this.own(field("own-horizon").checked));
    onSlide("horizon", (row, done) => this.put(row, done));
    onSlide("roll", (steep, done) => this.put(shot.get("camera", "horizon"), done, steep));
    field("hand").addEventListener("change", () => {
      this.hand.shown = field("hand").checked;
      one("hand-help").hidden = !this.hand.shown;
      stage.overlay();
    });
    field("show-found").addEventListener("change", () => {
      this.found.shown = field("show-found").checked;
      stage.overlay();
    });
  }

  /** Show what the shot says. */
  show() {
    const horizon = this.shot.get("camera", "horizon");
    field("own-horizon").checked = horizon !== undefined;
    one("horizon-row").hidden = horizon === undefined;
    if (horizon !== undefined) setUnlessTyping("horizon", horizon);
    setUnlessTyping("roll", this.shot.get("camera", "roll") ?? 0);
    this.found.ignored = linesOf(this.shot.get("camera", "ignore-lines") ?? []);
  }

  /** Take the lines that the plate's solve found. @param {import("./camera.js").Found[]} lines */
  take(lines) {
    this.found.found = lines;
    one("found").hidden = !lines.length && !this.found.ignored.length;
  }

  /** @param {boolean} visible */
  draw(visible) {
    this.found.draw(visible);
    this.hand.draw(visible);
  }

  /** Give the shot a horizon of its own, or take it back. @param {boolean} wanted */
  own(wanted) {
    const known = this.stage.guides?.horizon;
    if (wanted) {
      this.put(known ? (known[0] + known[1]) / 2 : FIRST_ROW, true);
    } else {
      this.shot.set("camera", { horizon: undefined, roll: undefined, fov: this.fovBefore });
      this.changed("rest");
    }
  }

  /**
   * The horizon at a row, above the object; the object is placed then.
   * @param {number} row in the middle of the frame
   * @param {boolean} done
   * @param {number} [steep] its roll in degrees; without it as the shot or else the picture has it
   * @param {number} [fov]
   */
  put(row, done, steep, fov) {
    const { shot, objects, stage } = this;
    const { aspect } = stage;
    const now = stage.place();
    const known = stage.guides?.horizon;
    const at = (objects.keyed("at") ? null : objects.table["at"]) ?? now?.at ?? FIRST_PLACE.at;
    shot.hold();
    const { horizon: ownRow, roll: ownRoll = 0 } = shot.tables["camera"] ?? {};
    const wanted = steep ?? (known ? rollOf(known, aspect) : 0);
    const roll = steep === undefined && ownRow !== undefined ? ownRoll
      : rounded(Math.max(-MOST_ROLL, Math.min(MOST_ROLL, wanted)), 1);
    const [left, right] = horizonOf(0, roll, aspect);
    const lowest = at[1] - LEAST_BELOW - left - (right - left) * at[0];
    const above = Math.max(-0.5, Math.min(row, lowest));
    const horizon = above === ownRow ? ownRow : rounded(above, 3);
    const wider = fov === undefined ? {} : { fov: rounded(fov, 2) };
    shot.set("camera", { horizon, roll: roll || undefined, ...wider });
    if (!objects.keyed("at")) objects.write({ at });
    if (!objects.keyed("size")) objects.write({ size: objects.table["size"] ?? now?.size ?? FIRST_PLACE.size });
    if (done) shot.release();
    if (stage.guides) stage.guides.horizon = horizonOf(horizon, roll, aspect);
    this.changed(done ? "rest" : "drag");
  }

  /** Solve the camera by two pairs of lines. @param {Line[]} lines @param {boolean} done */
  solve(lines, done) {
    const solved = cameraOfPairs(lines, this.stage.aspect);
    const words = !solved ? "Lines of a pair must not be parallel here."
      : `Horizon at ${solved.horizon.toFixed(2)}, roll ${solved.roll.toFixed(1)} degrees, ${solved.fov === null ? "no field of view: the pairs are not at right angles" : `${solved.fov.toFixed(1)} degrees across`}.`;
    one("hand-found").textContent = words;
    if (solved) this.put(solved.horizon, done, solved.roll, solved.fov ?? undefined);
    else this.stage.overlay();
  }
}
