// The plate's frames: which one is shown, and the strip of thumbnails.

import { field, one } from "./elements.js";

const THUMBNAILS = 12;

/** @typedef {{name: string, frames: number, rate: number, width: number, height: number, shown: number[], reduced: boolean, aspect: number}} Plate */

export class Film {
  /** @param {Plate} plate @param {() => void} onFrame another frame is to be shown */
  constructor(plate, onFrame) {
    this.plate = plate;
    this.onFrame = onFrame;
    this.frame = 0;
    field("frame").max = String(plate.frames - 1);
    field("frame").addEventListener("input", () => this.go(field("frame").valueAsNumber));
    one("film").hidden = plate.frames < 2;
    one("plate-name").textContent = plate.name.split("/").pop() ?? "";
    one("reduced").hidden = !plate.reduced;
    one("reduced").textContent = `The plate has ${plate.width}×${plate.height}; it is shown at ${plate.shown.join("×")}, and rendered whole.`;
    const many = Math.min(THUMBNAILS, plate.frames);
    one("thumbnails").append(...Array.from({ length: many }, (_, at) => {
      const image = document.createElement("img");
      image.alt = "";
      image.loading = "lazy";
      image.src = `thumbnail/${Math.round((at * (plate.frames - 1)) / Math.max(1, many - 1))}`;
      return image;
    }));
  }

  /** @param {number} number of the frame to show */
  go(number) {
    this.frame = Math.min(number, this.plate.frames - 1);
    field("frame").value = String(this.frame);
    one("frame-number").textContent = String(this.frame);
    this.onFrame();
  }
}
