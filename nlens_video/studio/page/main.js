// The page: joins shot, picture, panel and server.

import { HandLines, PlateLines, cameraOfPairs, linesOf } from "./camera.js";
import { one } from "./elements.js";
import { horizonOf, rollOf, rounded } from "./ground.js";
import { Live, QUICK } from "./live.js";
import { Objects } from "./objects.js";
import { showEffects, showNotes, showTimes, switched } from "./panel.js";
import { RegionPen } from "./region.js";
import { Refusal, asked, post, request } from "./server.js";
import { Shot, toToml } from "./shot.js";
import { Stage } from "./stage.js";
import { SunHandles } from "./sun.js";

/** @typedef {import("./ground.js").Place} Place */

/** @param {string} id */
const field = (id) => /** @type {HTMLInputElement} */ (one(id));

const THUMBNAILS = 12;
const LEAST_BELOW = 0.03; // of the object below the horizon
const about = await request("shot").catch((error) => {
  trouble(error.message);
  throw error;
});
const shot = new Shot(about.tables);
let { revision } = about; // of the shot file, as it was read or saved last; empty where there is none
if (!revision) shot.saved = "";
const fovBefore = shot.get("camera", "fov"); // lines by hand give another
let frame = 0;
/** @type {any} of the last picture */
let last = null;

const found = new PlateLines((numbers) => {
  shot.set("camera", { "ignore-lines": numbers.length ? numbers : undefined });
  changed("rest");
}, () => stage.overlay());
const hand = new HandLines(onHandLines);
const stage = new Stage(place, onPlace, onHorizon, (visible) => {
  found.draw(visible);
  hand.draw(visible);
  sunlight.draw(visible && stage.view !== "plate", shot.get("light", "sun"), stage.guides?.shadow ?? null);
});
const sunlight = new SunHandles(onSun);
const objects = new Objects(shot, {
  frame: () => frame,
  rate: about.plate.rate,
  files: about.objects,
  changed: () => {
    const shown = objects.guides[objects.selected];
    if (shown && stage.guides) Object.assign(stage.guides, shown);
    changed("rest");
  },
  go,
});
stage.more = (lines) => objects.draw(lines);
const live = new Live(onPicture, onTold, (connected) => {
  one("lost").hidden = connected;
  document.body.dataset["server"] = connected ? "here" : "lost";
  if (!connected) busy("");
  else refresh();
});

/** Where the object stands, as the shot says or else as the picture shows. @returns {Place | null} */
function place() {
  const guides = stage.guides;
  if (!guides?.placed || !guides.at) return null;
  const given = objects.table;
  const shown = guides.moving || objects.keyed("at");
  return {
    at: (shown ? undefined : given["at"]) ?? guides.at,
    size: (shown ? undefined : given["size"]) ?? guides.size,
    yaw: guides.yaw ?? given["yaw"] ?? 0,
  };
}

/** @param {Place} wanted @param {boolean} done */
function onPlace(wanted, done) {
  if (!done) shot.hold();
  const guides = stage.guides;
  objects.put(place() ?? wanted, wanted, guides?.moving ?? false);
  if (done) shot.release();
  if (guides) Object.assign(guides, { at: wanted.at, size: wanted.size, yaw: objects.keyed("yaw") ? wanted.yaw : null });
  changed(done ? "rest" : "drag");
}

/** @param {string} kind of the picture to ask for */
function changed(kind) {
  refused("");
  wrongRegion("");
  fill();
  stage.overlay();
  ask(kind);
}

/** @type {string[]} kinds of pictures that are still to be asked for */
let wanted = [];

/** @param {string} kind */
function ask(kind) {
  const { view } = stage;
  if (QUICK.includes(kind)) {
    if (view === "final" || view === "sharp") live.ask(shot.tables, frame, kind);
    return;
  }
  const [, other] = stage.compared;
  const sharp = view === "sharp" || other === "sharp";
  wanted = [...(sharp ? ["sharp"] : []), ...{ focus: ["focus"], plate: [] }[view] ?? ["rest"]];
  busy(wanted.length && live.connected ? "Drawing …" : "");
  askNext();
}

function askNext() {
  const next = wanted.shift();
  if (next) live.ask(shot.tables, frame, next);
}

/** @param {string} words */
function busy(words) {
  one("busy").textContent = words;
}

/** Why there is no picture, or no render of it. @param {string} words */
function trouble(words) {
  one("trouble").textContent = words;
  one("trouble").hidden = !words;
}

/**
 * What the server refused to do, said until the next attempt or change.
 * @param {string} words
 * @param {(() => void) | null} [overwrite] where another page or program changed the shot file
 */
function refused(words, overwrite = null) {
  one("refused-why").textContent = words;
  one("refused").hidden = !words;
  one("shot-changed").hidden = !overwrite;
  one("overwrite").onclick = overwrite;
  if (words) one("refused").scrollIntoView({ block: "nearest" });
}

/** @param {import("./live.js").About} said @param {Blob | null} data */
async function onPicture(said, data) {
  const quick = QUICK.includes(said.kind);
  if (!quick && !wanted.length) busy("");
  if (said.error !== undefined || !data) {
    trouble(said.error ?? "there is no picture");
    stage.pictures = { plate: stage.pictures["plate"] ?? null };
    stage.draw();
    return;
  }
  const picture = await createImageBitmap(data);
  trouble("");
  if (quick) stage.pictures["sharp"] = null;
  stage.pictures[{ focus: "focus", sharp: "sharp" }[said.kind] ?? "final"] = picture;
  if (said.kind === "focus") {
    showFocus(said);
  } else {
    last = said;
    const { at, size, yaw, horizon } = stage.guides ?? {};
    take(said["guides"]);
    if (shot.held !== null && at && horizon && stage.guides) Object.assign(stage.guides, { at, size, yaw, horizon });
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
  found.found = said.lines;
  one("found").hidden = !said.lines.length && !found.ignored.length;
  one("picture").setAttribute("aria-label", `Frame ${frame} with the object`);
  fill();
}

/** @param {any} said of the plate's blur */
function showFocus(said) {
  trouble(said.no_lens ? `A render stops here: ${said.no_lens}` : "");
  one("lens").textContent = said.lens || "no lens is found";
  one("plot").innerHTML = said.plot;
  one("plot-figure").hidden = !said.plot || stage.view !== "focus";
  one("ramp").replaceChildren(...said.ramp.map((/** @type {number[]} */ color) => {
    const part = document.createElement("i");
    part.style.background = `rgb(${color.join(" ")})`;
    return part;
  }));
  one("top").textContent = `${said.top_px.toFixed(1)} px and more`;
}

/** @param {any} said of the server by itself */
function onTold(said) {
  if (said.progress) busy(`${said.progress}: ${said.done}${said.of ? ` of ${said.of}` : ""} frames`);
  if (said.render) showRender(said);
}

/** @param {any} said */
function showRender(said) {
  const running = said.render === "running";
  one("render").hidden = running;
  one("cancel").hidden = !running;
  const bar = /** @type {HTMLProgressElement} */ (one("progress"));
  bar.hidden = !running;
  if (running && said.of) bar.value = said.frames / said.of;
  else bar.removeAttribute("value");
  const words = {
    none: "",
    running: `${said.what === "starting" ? "Starting" : said.what}${said.frames ? `: ${said.frames}${said.of ? ` of ${said.of}` : ""} frames` : " …"}`,
    done: `Rendered ${said.output}${said.frames > 1 ? `: ${said.frames} frames, ${said.fps?.toFixed(1)} a second` : ""}`,
    cancelled: "Cancelled; no result was written.",
    failed: `It failed: ${said.error}`,
  }[/** @type {"none" | "running" | "done" | "cancelled" | "failed"} */ (said.render)];
  one("rendered").textContent = words ?? "";
  document.body.dataset["render"] = said.render;
  showResult(said.render === "done" ? said.output : "");
}

/** Show the result, where a browser can. @param {string} name of its file, empty for none */
function showResult(name) {
  const [video, picture] = [/** @type {HTMLVideoElement} */ (one("result")), /** @type {HTMLImageElement} */ (one("result-picture"))];
  video.hidden = picture.hidden = true;
  video.onloadedmetadata = () => { video.hidden = false; };
  picture.onload = () => { picture.hidden = false; };
  const now = `result?${Date.now()}`; // else a browser may show the last one
  if (/\.(mp4|webm|m4v|mov)$/i.test(name)) video.src = now;
  if (/\.(png|jpe?g|webp)$/i.test(name) && plate.frames === 1) picture.src = now;
}

async function showPlate() {
  const number = frame;
  const answer = await asked(`frame/${number}`).catch(() => null); // asked for again with the next connection
  if (!answer?.ok || number !== frame) return;
  stage.pictures["plate"] = await createImageBitmap(await answer.blob());
  stage.draw();
}

function refresh() {
  void showPlate();
  fill();
  ask("rest");
}

/**
 * Do what the server may refuse, and say why.
 * @param {() => Promise<void>} act
 * @param {() => void} [overwrite] does the same where another page or program changed the shot file
 */
async function attempt(act, overwrite) {
  try {
    await act();
    refused("");
  } catch (error) {
    const other = error instanceof Refusal && error.changed;
    refused(error instanceof Error ? error.message : String(error), (other && overwrite) || null);
  }
}

/** Show in the controls what the shot says. */
function fill() {
  objects.show();
  const now = place();
  one("of-file").hidden = !stage.guides || stage.guides.placed;
  one("place").hidden = !now;
  if (now) {
    setUnlessTyping("at-x", rounded(now.at[0], 4));
    setUnlessTyping("at-y", rounded(now.at[1], 4));
    setUnlessTyping("size", rounded(now.size, 4));
    setUnlessTyping("yaw", rounded(now.yaw, 2));
  }
  const horizon = shot.get("camera", "horizon");
  field("own-horizon").checked = horizon !== undefined;
  one("horizon-row").hidden = horizon === undefined;
  if (horizon !== undefined) setUnlessTyping("horizon", horizon);
  setUnlessTyping("roll", shot.get("camera", "roll") ?? 0);
  found.ignored = linesOf(shot.get("camera", "ignore-lines") ?? []);
  const told = shot.get("light", "sun"), sun = told === "none" ? undefined : told;
  field("sun").checked = sun !== undefined;
  one("sun-rows").hidden = sun === undefined;
  if (sun) ["azimuth", "elevation", "strength"].forEach((id, at) => setUnlessTyping(id, sun[at] ?? 2));
  const around = environment();
  field("around").value = around;
  one("around-row").hidden = !around;
  if (around) setUnlessTyping("around-turn", shot.get("light", "env-rotation") ?? 0);
  field("shadow").value = String(shot.get("light", "shadow-strength") ?? "");
  field("preset").value = shot.get("quality", "preset") ?? "standard";
  const region = shot.get("lens", "fit-region") ?? null;
  stage.region = region;
  setUnlessTyping("region", region?.join(", ") ?? "");
  one("clear-region").hidden = !region;
  setUnlessTyping("output", shot.get("output", "file") ?? "");
  field("undo").disabled = !shot.past.length;
  field("redo").disabled = !shot.future.length;
  one("saved").textContent = shot.unsaved ? "· not saved" : "· saved";
}

/** The map of the light from around that the shot names, empty for the plate's own. @returns {string} */
function environment() {
  const named = shot.get("light", "env-map") ?? shot.get("light", "env") ?? "plate";
  return named === "plate" ? "" : named;
}

/** @param {string} id @param {string | number} value */
function setUnlessTyping(id, value) {
  const input = field(id);
  const typing = document.activeElement === input && (input.type === "number" || input.type === "text");
  if (!typing) input.value = String(value);
}

// --- the controls

for (const id of ["at-x", "at-y", "size", "yaw"]) {
  field(id).addEventListener("change", () => {
    const now = place();
    const value = field(id).valueAsNumber;
    if (!now || !Number.isFinite(value)) return;
    if (id === "at-x") now.at = [value, now.at[1]];
    else if (id === "at-y") now.at = [now.at[0], value];
    else if (id === "size") now.size = value;
    else now.yaw = value;
    onPlace(now, true);
  });
}
one("take").addEventListener("click", () => {
  const guides = stage.guides;
  if (!guides) return;
  const at = guides.at ?? [0.5, 0.8];
  guides.placed = true;
  onPlace({ at, size: guides.size > 0 ? guides.size : 0.35, yaw: 0 }, true);
});
field("own-horizon").addEventListener("change", () => {
  const known = stage.guides?.horizon;
  if (field("own-horizon").checked) {
    onHorizon(known ? (known[0] + known[1]) / 2 : 0.45, true);
  } else {
    shot.set("camera", { horizon: undefined, roll: undefined, fov: fovBefore });
    changed("rest");
  }
});
for (const id of ["horizon", "roll"]) {
  for (const kind of ["input", "change"]) {
    field(id).addEventListener(kind, () => onHorizon(field("horizon").valueAsNumber, kind === "change", field("roll").valueAsNumber));
  }
}

/**
 * The horizon at a row, above the object; the object is placed then.
 * @param {number} row in the middle of the frame
 * @param {boolean} done
 * @param {number} [steep] its roll in degrees; without it as it is
 * @param {number} [fov]
 */
function onHorizon(row, done, steep, fov) {
  const now = place();
  const known = stage.guides?.horizon;
  const at = (objects.keyed("at") ? null : objects.table["at"]) ?? now?.at ?? [0.5, 0.8];
  const { aspect } = about.plate;
  shot.hold();
  const roll = rounded(Math.max(-45, Math.min(45, steep ?? (known ? rollOf(known, aspect) : 0))), 1);
  const [left, right] = horizonOf(0, roll, aspect);
  const lowest = at[1] - LEAST_BELOW - left - (right - left) * at[0];
  const horizon = rounded(Math.max(-0.5, Math.min(row, lowest)), 3);
  const wider = fov === undefined ? {} : { fov: rounded(fov, 2) };
  shot.set("camera", { horizon, roll: roll || undefined, ...wider });
  if (!objects.keyed("at")) objects.write({ at });
  if (!objects.keyed("size")) objects.write({ size: objects.table["size"] ?? now?.size ?? 0.35 });
  if (done) shot.release();
  if (stage.guides) stage.guides.horizon = horizonOf(horizon, roll, aspect);
  changed(done ? "rest" : "drag");
}

/** @param {import("./camera.js").Line[]} lines @param {boolean} done */
function onHandLines(lines, done) {
  const found = cameraOfPairs(lines, about.plate.aspect);
  const words = !found ? "Lines of a pair must not be parallel here."
    : `Horizon at ${found.horizon.toFixed(2)}, roll ${found.roll.toFixed(1)} degrees, ${found.fov === null ? "no field of view: the pairs are not at right angles" : `${found.fov.toFixed(1)} degrees across`}.`;
  one("hand-found").textContent = words;
  if (found) onHorizon(found.horizon, done, found.roll, found.fov ?? undefined);
  else stage.overlay();
}
field("hand").addEventListener("change", () => {
  hand.shown = field("hand").checked;
  one("hand-help").hidden = !hand.shown;
  stage.overlay();
});
field("show-found").addEventListener("change", () => {
  found.shown = field("show-found").checked;
  stage.overlay();
});
field("sun").addEventListener("change", () => {
  shot.set("light", { sun: field("sun").checked ? [...(last?.sun ?? [60, 40]), 2] : undefined });
  changed("rest");
});
for (const id of ["azimuth", "elevation", "strength"]) {
  const given = () => /** @type {import("./sun.js").Sun} */ (["azimuth", "elevation", "strength"].map((one) => field(one).valueAsNumber));
  field(id).addEventListener("input", () => onSun(given(), false));
  field(id).addEventListener("change", () => onSun(given(), true));
}

/** @param {import("./sun.js").Sun} sun @param {boolean} done */
function onSun(sun, done) {
  shot.hold();
  shot.set("light", { sun });
  if (done) shot.release();
  changed(done ? "rest" : "light");
}
field("around").addEventListener("change", () => {
  const map = field("around").value || undefined;
  const turn = map && shot.get("light", "env-rotation");
  shot.set("light", { "env-map": map, env: undefined, "env-rotation": turn });
  changed("rest");
});
field("around-turn").addEventListener("input", () => {
  shot.hold();
  shot.set("light", { "env-rotation": field("around-turn").valueAsNumber || undefined });
  changed("rest");
});
field("around-turn").addEventListener("change", () => {
  shot.release();
  fill();
});
field("shadow").addEventListener("change", () => {
  const value = field("shadow").value;
  shot.set("light", { "shadow-strength": value === "" ? undefined : Number(value) });
  changed("rest");
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
const pen = new RegionPen((numbers) => {
  drawing(false);
  if (numbers) setRegion(numbers);
});

/** @param {boolean} on */
function drawing(on) {
  one("draw-region").setAttribute("aria-pressed", String(on));
  one("drawing").textContent = on ? "Drag a box over the ground, or click the corners of a polygon and then its first one again. Escape gives up." : "";
}

/** @param {string} words */
function wrongRegion(words) {
  one("region-wrong").textContent = words;
  one("region-wrong").hidden = !words;
}

/** @param {number[] | undefined} numbers */
function setRegion(numbers) {
  shot.set("lens", { "fit-region": numbers });
  changed("rest");
}
one("draw-region").addEventListener("click", () => {
  const on = one("draw-region").getAttribute("aria-pressed") !== "true";
  if (!on) {
    pen.end(null);
    return;
  }
  drawing(true);
  pen.start();
  one("stage").scrollIntoView({ block: "nearest" });
});
one("clear-region").addEventListener("click", () => setRegion(undefined));
field("region").addEventListener("change", () => {
  const words = field("region").value.split(/[\s,;]+/).filter(Boolean);
  const wrong = words.find((word) => !Number.isFinite(Number(word)));
  if (wrong === undefined) setRegion(words.length ? words.map(Number) : undefined);
  else wrongRegion(`${wrong} is no number; the region is left as it was`);
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
  const { at } = objects.table;
  if (stage.guides && at && !stage.guides.moving) stage.guides.at = at;
  changed("rest");
}

document.addEventListener("keydown", (event) => {
  const typing = event.target instanceof HTMLInputElement && ["text", "number"].includes(event.target.type);
  if (typing || !(event.ctrlKey || event.metaKey)) return;
  const key = event.key.toLowerCase();
  if (key === "z") step(event.shiftKey ? "redo" : "undo");
  else if (key === "y") step("redo");
  else if (key === "s") void keep("save");
  else return;
  event.preventDefault();
});

for (const radio of document.querySelectorAll('input[name="view"]')) {
  radio.addEventListener("change", () => {
    const { value } = /** @type {HTMLInputElement} */ (radio);
    stage.view = value;
    one("legend").hidden = stage.view !== "focus";
    one("plot-figure").hidden = stage.view !== "focus" || !one("plot").childElementCount;
    stage.draw();
    stage.overlay();
    ask("rest");
  });
}
field("compare").addEventListener("change", () => {
  stage.compare = field("compare").value;
  stage.draw();
  ask("rest");
});
field("wipe").addEventListener("input", () => {
  stage.wipe = field("wipe").valueAsNumber / 100;
  stage.draw();
});
field("show-guides").addEventListener("change", () => {
  stage.shown = field("show-guides").checked;
  stage.overlay();
});
field("frame").addEventListener("input", () => go(field("frame").valueAsNumber));

/** @param {number} number of the frame to show */
function go(number) {
  frame = Math.min(number, about.plate.frames - 1);
  field("frame").value = String(frame);
  one("frame-number").textContent = String(frame);
  stage.pictures = {};
  objects.showKeys();
  void showPlate();
  ask("rest");
}

/** @type {Promise<void>} ends with what was to be kept last: each needs the revision of the one before */
let kept = Promise.resolve();

/** Send the shot to be kept. @param {"save" | "render"} where @param {boolean} [over] whatever the shot file holds */
function keep(where, over = false) {
  kept = kept.then(() => attempt(async () => {
    const text = JSON.stringify(shot.tables);
    ({ revision } = await post(over ? where : `${where}?revision=${revision}`, shot.tables));
    shot.saved = text;
    fill();
  }, () => void keep(where, true)));
  return kept;
}
one("reload").addEventListener("click", () => void attempt(async () => {
  const now = await request("shot");
  ({ revision } = now);
  shot.replace(now.tables);
  shot.saved = JSON.stringify(now.tables);
  replaced();
}));
one("save").addEventListener("click", () => void keep("save"));
one("render").addEventListener("click", () => void keep("render"));
one("cancel").addEventListener("click", () => void attempt(() => request("render", { method: "DELETE" })));
one("copy").addEventListener("click", () => void attempt(async () => {
  const { command } = await post("command", shot.tables);
  field("command").value = command;
  try {
    await navigator.clipboard.writeText(command);
    one("saved").textContent = "· command copied";
  } catch { // browsers refuse it to a page of another machine, for that is unencrypted
    one("command-row").hidden = false;
    field("command").select();
  }
}));
one("keep").addEventListener("click", () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([toToml(shot.tables)], { type: "application/toml" }));
  link.download = about.path.split("/").pop();
  link.click();
  URL.revokeObjectURL(link.href);
});
window.addEventListener("beforeunload", (event) => {
  if (shot.unsaved && shot.past.length) event.preventDefault();
});

// --- what is shown first

const { plate } = about;
stage.shape(plate.aspect);
one("plate-name").textContent = plate.name.split("/").pop();
one("path").textContent = about.path;
field("frame").max = String(plate.frames - 1);
one("film").hidden = plate.frames < 2;
one("reduced").hidden = !plate.reduced;
one("reduced").textContent = `The plate has ${plate.width}×${plate.height}; it is shown at ${plate.shown.join("×")}, and rendered whole.`;
one("around").append(...[...new Set([...about.environments, environment()])].filter(Boolean)
  .map((/** @type {string} */ name) => new Option(name, name)));
const many = Math.min(THUMBNAILS, plate.frames);
one("thumbnails").append(...Array.from({ length: many }, (_, at) => {
  const image = document.createElement("img");
  image.alt = "";
  image.loading = "lazy";
  image.src = `thumbnail/${Math.round((at * (plate.frames - 1)) / Math.max(1, many - 1))}`;
  return image;
}));
refresh();
