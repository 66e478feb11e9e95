// The controls over the picture: which view is shown, with what it is compared, and the guides.

import { field, one } from "./elements.js";

/** @param {import("./stage.js").Stage} stage @param {() => void} ask for the pictures of the view */
export function connectViews(stage, ask) {
  for (const radio of document.querySelectorAll('input[name="view"]')) {
    radio.addEventListener("change", () => {
      stage.view = /** @type {HTMLInputElement} */ (radio).value;
      one("legend").hidden = stage.view !== "focus";
      one("plot-figure").hidden = stage.view !== "focus" || !one("plot").childElementCount;
      stage.draw();
      stage.overlay();
      ask();
    });
  }
  field("compare").addEventListener("change", () => {
    stage.compare = field("compare").value;
    stage.draw();
    ask();
  });
  field("wipe").addEventListener("input", () => {
    stage.wipe = field("wipe").valueAsNumber / 100;
    stage.draw();
  });
  field("show-guides").addEventListener("change", () => {
    stage.shown = field("show-guides").checked;
    stage.overlay();
  });
}
