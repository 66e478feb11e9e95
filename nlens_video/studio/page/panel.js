// What the panel beside the picture says: effects, the plate's blur, times and notes.

import { one } from "./elements.js";

const LEAST_MS = 1; // of a node that has a bar of its own

/**
 * The effects with the planner's reasons.
 * @param {{name: string, on: boolean, reason: string}[]} effects
 * @param {(name: string, on: boolean) => void} onSwitch
 */
export function showEffects(effects, onSwitch) {
  const focused = document.activeElement?.id;
  one("effects").replaceChildren(...effects.map((effect) => {
    const row = document.createElement("li");
    const label = document.createElement("label");
    label.className = "check";
    const box = document.createElement("input");
    box.type = "checkbox";
    box.id = `effect-${effect.name}`;
    box.checked = effect.on;
    box.setAttribute("aria-describedby", `why-${effect.name}`);
    box.addEventListener("change", () => onSwitch(effect.name, box.checked));
    label.append(box, ` ${effect.name.replaceAll("-", " ")}`);
    const why = document.createElement("small");
    why.id = `why-${effect.name}`;
    why.textContent = effect.reason;
    row.append(label, why);
    return row;
  }));
  if (focused?.startsWith("effect-")) document.getElementById(focused)?.focus();
}

/**
 * `auto` with an effect on or off.
 * @param {string} given as the shot has it
 * @param {string} name
 * @param {boolean} on
 */
export function switched(given, name, on) {
  const words = given.split(",").filter((word) => word.replace(/^[+-]/, "") !== name);
  if (["auto", "all", "none"].includes(words[0] ?? "")) return [...words, `${on ? "+" : "-"}${name}`].join(",");
  if (on) words.push(name);
  return words.filter(Boolean).join(",") || "none";
}

/** @param {any} said of the plate's blur @param {boolean} shown it is what the picture shows */
export function showFocus(said, shown) {
  one("lens").textContent = said.lens || "no lens is found";
  one("plot").innerHTML = said.plot;
  one("plot-figure").hidden = !said.plot || !shown;
  one("ramp").replaceChildren(...said.ramp.map((/** @type {number[]} */ color) => {
    const part = document.createElement("i");
    part.style.background = `rgb(${color.join(" ")})`;
    return part;
  }));
  one("top").textContent = `${said.top_px.toFixed(1)} px and more`;
}

/**
 * Time of each node, the longest bar being the budget or what is longer.
 * @param {{name: string, once: boolean, ms: number}[]} nodes
 * @param {number} budget_ms
 */
export function showTimes(nodes, budget_ms) {
  const frame = nodes.filter((node) => !node.once);
  const sum = frame.reduce((all, node) => all + node.ms, 0);
  const longest = Math.max(budget_ms, sum);
  one("time-section").hidden = !nodes.length;
  one("time-sum").textContent = `${sum.toFixed(0)} ms; the budget of a frame is ${budget_ms.toFixed(0)} ms`;
  one("time-sum").classList.toggle("over", sum > budget_ms);
  const named = nodes.filter((node) => node.ms >= LEAST_MS);
  const rest = nodes.filter((node) => node.ms < LEAST_MS && !node.once).reduce((all, node) => all + node.ms, 0);
  const rows = [
    { name: "all nodes of a frame", ms: sum, once: false },
    ...named.filter((node) => !node.once),
    { name: "others", ms: rest, once: false },
    ...named.filter((node) => node.once),
  ];
  one("times").replaceChildren(...rows.map((node, at) => {
    const row = document.createElement("li");
    const name = document.createElement("span");
    const bar = document.createElement("i");
    const ms = document.createElement("span");
    name.textContent = node.once ? `${node.name.replaceAll("-", " ")}, once a shot` : node.name.replaceAll("-", " ");
    bar.style.setProperty("--part", `${Math.min(100, (100 * node.ms) / longest)}%`);
    if (!at) bar.style.setProperty("--budget", `${(100 * budget_ms) / longest}%`);
    bar.className = node.once ? "once" : at ? "" : sum > budget_ms ? "sum over" : "sum";
    ms.textContent = ` ${node.ms < 10 ? node.ms.toFixed(1) : node.ms.toFixed(0)} ms`;
    row.append(name, ms, bar);
    return row;
  }));
}

/** @param {string[]} notes */
export function showNotes(notes) {
  one("notes-section").hidden = !notes.length;
  one("notes").replaceChildren(...notes.map((note) => {
    const row = document.createElement("li");
    row.textContent = note;
    return row;
  }));
}
