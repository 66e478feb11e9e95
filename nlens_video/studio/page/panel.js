// What the panel beside the picture says: effects and notes.

/** @param {string} id @returns {HTMLElement} */
const one = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

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

/** @param {string[]} notes */
export function showNotes(notes) {
  one("notes-section").hidden = !notes.length;
  one("notes").replaceChildren(...notes.map((note) => {
    const row = document.createElement("li");
    row.textContent = note;
    return row;
  }));
}
