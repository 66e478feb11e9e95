// The page: joins shot, picture, panel and server.

import { CameraPanel } from "./camera_panel.js";
import { field, isTyping, one, setUnlessTyping } from "./elements.js";
import { Film } from "./film.js";
import { FIRST_PLACE, movedTo, rounded } from "./ground.js";
import { LightPanel } from "./light_panel.js";
import { Live, QUICK } from "./live.js";
import { busy, refused, trouble } from "./messages.js";
import { Objects } from "./objects.js";
import { showEffects, showFocus, showNotes, showTimes, switched } from "./panel.js";
import { RegionPanel } from "./region.js";
import { showRender } from "./render.js";
import { asked, request } from "./server.js";
import { Shot } from "./shot.js";
import { ShotFile } from "./shot_file.js";
import { Stage } from "./stage.js";
import { connectViews } from "./views.js";

/** @typedef {import("./ground.js").Place} Place */

const about = await request("shot").catch((error) => {
  trouble(error.message);
  throw error;
});
/** @type {import("./film.js").Plate} */
const plate = about.plate;
const shot = new Shot(about.tables);
const file = new ShotFile(shot, about, fill, replaced);
const film = new Film(plate, () => {
  stage.pictures = {};
  shot.release();
  objects.stale ||= !!stage.guides?.moving || objects.list.some((table) => table["key"]);
  fill();
  stage.overlay();
  void showPlate();
  ask("rest");
});
const stage = new Stage(place, onPlace, (row, done, roll) => camera.put(row, done, roll), (visible) => {
  camera.draw(visible);
  light.draw(visible && stage.view !== "plate", stage.guides?.shadow ?? null);
});
stage.shape(plate.aspect);
const objects = new Objects(shot, {
  frame: () => film.frame,
  rate: plate.rate,
  files: about.objects,
  moving: () => stage.guides?.moving ?? false,
  place,
  changed: () => {
    const shown = objects.guides[objects.selected];
    if (shown && stage.guides) Object.assign(stage.guides, shown);
    changed("rest");
  },
  replaced,
  go: (number) => film.go(number),
});
stage.more = (lines) => objects.draw(lines);
const camera = new CameraPanel(shot, objects, stage, changed);
const light = new LightPanel(shot, about.environments, changed, fill);
const region = new RegionPanel(shot, changed);
connectViews(stage, () => ask("rest"));
/** @type {string[]} kinds of pictures that are still to be asked for */
let pending = [];
const live = new Live(onPicture, onTold, (connected) => {
  one("lost").hidden = connected;
  document.body.dataset["server"] = connected ? "here" : "lost";
  if (!connected) busy("");
  else refresh();
});

/** Where the object stands, as the shot says or else as the picture shows; null until one does. @returns {Place | null} */
function place() {
  const guides = stage.guides;
  if (!guides?.placed || !guides.at) return null;
  const { at, size, yaw } = objects.table;
  const constant = !guides.moving && !objects.keys.length;
  if (constant && at && size) return { at, size, yaw: yaw ?? 0 };
  if (objects.stale) return null;
  if (!constant) return { at: guides.at, size: guides.size, yaw: guides.yaw ?? yaw ?? 0 };
  return { at: at ?? guides.at, size: size ?? guides.size, yaw: yaw ?? 0 };
}

/** @param {Place} wanted @param {boolean} done */
function onPlace(wanted, done) {
  const before = place();
  const known = before || !stage.guides?.placed; // else a hand still drags what another frame shows
  if (known && !done) shot.hold();
  if (known) objects.put(before, wanted);
  if (done) shot.release();
  if (!known) return;
  seen({ ...wanted, placed: true });
  changed(done ? "rest" : "drag");
}

/** The object that is edited is seen so from now on. @param {Partial<import("./objects.js").ObjectGuides>} changes */
function seen(changes) {
  objects.see(changes);
  if (stage.guides) Object.assign(stage.guides, changes);
}

/** @param {string} kind of the picture to ask for */
function changed(kind) {
  refused("");
  region.wrong("");
  fill();
  stage.overlay();
  ask(kind);
}

/** @param {string} kind */
function ask(kind) {
  const { view } = stage;
  if (QUICK.includes(kind)) {
    if (view === "final" || view === "sharp") live.ask(shot.tables, film.frame, kind);
    return;
  }
  live.drop();
  const [, other] = stage.compared;
  const sharp = view === "sharp" || other === "sharp";
  pending = [...(sharp ? ["sharp"] : []), ...{ focus: ["focus"], plate: [] }[view] ?? ["rest"]];
  busy(pending.length && live.connected ? "Drawing …" : "");
  askNext();
}

function askNext() {
  const next = pending.shift();
  if (next) live.ask(shot.tables, film.frame, next);
}

/** @param {import("./live.js").About} said @param {Blob | null} data */
async function onPicture(said, data) {
  const quick = QUICK.includes(said.kind);
  if (!quick && !pending.length) busy("");
  if (said.error !== undefined || !data) {
    trouble(said.error ?? "there is no picture");
    stage.pictures = { plate: stage.pictures["plate"] ?? null };
    stage.draw();
    return;
  }
  const picture = await createImageBitmap(data);
  if (!live.wants(said)) return;
  trouble("");
  if (quick) stage.pictures["sharp"] = null;
  stage.pictures[{ focus: "focus", sharp: "sharp" }[said.kind] ?? "final"] = picture;
  if (said.kind === "focus") {
    trouble(said.no_lens ? `A render stops here: ${said.no_lens}` : "");
    showFocus(said, stage.view === "focus");
  } else {
    light.found = said.sun ?? null;
    const { horizon } = stage.guides ?? {};
    const { at, size, yaw, sizes } = objects.guides[objects.selected] ?? {};
    take(said["guides"]);
    if (shot.held !== null && at && horizon && stage.guides) {
      seen({ at, size, yaw, sizes });
      stage.guides.horizon = horizon;
    }
    if (said.kind === "rest") describe(said);
  }
  stage.draw();
  stage.overlay();
  if (said.kind !== "drag") askNext();
  document.body.dataset["drawn"] = String(said.number);
  document.body.dataset["kind"] = said.kind;
  document.body.dataset["took"] = String(Math.round(said["took_ms"]));
}

/** Take what a picture says of its objects. @param {any} said */
function take(said) {
  objects.guides = said.objects;
  objects.stale = false;
  stage.guides = { ...said, ...said.objects[Math.min(objects.selected, said.objects.length - 1)] };
}

/** @param {any} said of a picture at rest */
function describe(said) {
  trouble(said.no_lens ? `A render stops here: ${said.no_lens}` : "");
  one("lens").textContent = said.lens || "the object is out of view";
  showEffects(said.effects, (name, on) => {
    shot.set("effects", { effects: switched(shot.get("effects", "effects") ?? "auto", name, on) });
    changed("rest");
  });
  showNotes(said.notes);
  showTimes(said.nodes, said.budget_ms);
  camera.take(said.lines);
  one("picture").setAttribute("aria-label", `Frame ${film.frame} with the object`);
  fill();
}

/** @param {any} said of the server by itself */
function onTold(said) {
  if (said.progress) busy(`${said.progress}: ${said.done}${said.of ? ` of ${said.of}` : ""} frames`);
  if (said.render) showRender(said, plate.frames === 1);
}

async function showPlate() {
  const number = film.frame;
  const answer = await asked(`frame/${number}`).catch(() => null); // asked for again with the next connection
  if (!answer?.ok || number !== film.frame) return;
  stage.pictures["plate"] = await createImageBitmap(await answer.blob());
  stage.draw();
}

function refresh() {
  void showPlate();
  fill();
  ask("rest");
}

/** Show in the controls what the shot says. */
function fill() {
  objects.show();
  const now = place();
  one("of-file").hidden = !stage.guides || stage.guides.placed;
  one("place").hidden = !now && !(objects.stale && stage.guides?.placed);
  for (const id of ["at-x", "at-y", "size", "yaw"]) field(id).disabled = !now;
  if (now) {
    setUnlessTyping("at-x", rounded(now.at[0], 4));
    setUnlessTyping("at-y", rounded(now.at[1], 4));
    setUnlessTyping("size", rounded(now.size, 4));
    setUnlessTyping("yaw", rounded(now.yaw, 2));
  }
  camera.show();
  light.show();
  field("preset").value = shot.get("quality", "preset") ?? "standard";
  region.show();
  stage.region = region.region;
  setUnlessTyping("output", shot.get("output", "file") ?? "");
  const focused = document.activeElement?.id;
  field("undo").disabled = !shot.past.length;
  field("redo").disabled = !shot.future.length;
  if (focused === "undo" && !shot.past.length) field("redo").focus(); // a disabled button holds no focus
  if (focused === "redo" && !shot.future.length) field("undo").focus();
  one("saved").textContent = shot.unsaved ? "· not saved" : "· saved";
}

// --- the controls

for (const id of ["at-x", "at-y", "size", "yaw"]) {
  field(id).addEventListener("change", () => {
    const now = place();
    const value = field(id).valueAsNumber;
    if (!now || !Number.isFinite(value)) return;
    const [x, y] = now.at;
    if (id === "size") onPlace({ ...now, size: value }, true);
    else if (id === "yaw") onPlace({ ...now, yaw: value }, true);
    else onPlace(moved(now, id === "at-x" ? [value, y] : [x, value]), true);
  });
}

/** A place with other numbers: on a way the real height stays, else what is seen. @param {Place} now @param {[number, number]} at @returns {Place} */
function moved(now, at) {
  return objects.keyed("at") ? movedTo(now, at, stage.guides?.horizon ?? null) : { ...now, at };
}

one("take").addEventListener("click", () => {
  const guides = stage.guides;
  if (!guides) return;
  const at = guides.at ?? FIRST_PLACE.at;
  onPlace({ at, size: guides.size > 0 ? guides.size : FIRST_PLACE.size, yaw: 0 }, true);
});
field("preset").addEventListener("change", () => {
  const value = field("preset").value;
  shot.set("quality", { preset: value === "standard" ? undefined : value });
  changed("rest");
});
field("output").addEventListener("change", () => {
  const value = field("output").value.trim();
  if (value) shot.set("output", { file: value });
  changed("rest");
});
one("undo").addEventListener("click", () => step("undo"));
one("redo").addEventListener("click", () => step("redo"));

/** @param {"undo" | "redo"} way */
function step(way) {
  shot[way]();
  replaced();
}

/** Show other tables. */
function replaced() {
  objects.stale = true;
  changed("rest");
}

document.addEventListener("keydown", (event) => {
  if (isTyping(event.target) || !(event.ctrlKey || event.metaKey)) return;
  const key = event.key.toLowerCase();
  if (key === "z") step(event.shiftKey ? "redo" : "undo");
  else if (key === "y") step("redo");
  else if (key === "s") void file.keep("save");
  else return;
  event.preventDefault();
});

refresh();
