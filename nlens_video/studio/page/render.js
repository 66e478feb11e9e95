// The render of the shot: how far it is, and its result.

import { one } from "./elements.js";
import { attempt } from "./messages.js";
import { request } from "./server.js";

one("cancel").addEventListener("click", () => void attempt(() => request("render", { method: "DELETE" })));

/** @param {any} said @param {boolean} still the plate is one picture */
export function showRender(said, still) {
  const running = said.render === "running";
  const [shown, other] = running ? [one("cancel"), one("render")] : [one("render"), one("cancel")];
  shown.hidden = false;
  if (document.activeElement === other) shown.focus(); // a hidden button holds no focus
  other.hidden = true;
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
  showResult(said.render === "done" ? said.output : "", still);
}

/** Show the result, where a browser can. @param {string} name of its file, empty for none @param {boolean} still */
function showResult(name, still) {
  const [video, picture] = [/** @type {HTMLVideoElement} */ (one("result")), /** @type {HTMLImageElement} */ (one("result-picture"))];
  video.hidden = picture.hidden = true;
  video.onloadedmetadata = () => { video.hidden = false; };
  picture.onload = () => { picture.hidden = false; };
  const now = `result?${Date.now()}`; // else a browser may show the last one
  if (/\.(mp4|webm|m4v|mov)$/i.test(name)) video.src = now;
  if (/\.(png|jpe?g|webp)$/i.test(name) && still) picture.src = now;
}
