// Lines for the user: what is being drawn, why there is no picture, what the server refused.

import { one } from "./elements.js";
import { Refusal } from "./server.js";

/** @param {string} words */
export function busy(words) {
  one("busy").textContent = words;
}

/** Why there is no picture, or no render of it. @param {string} words */
export function trouble(words) {
  one("trouble").textContent = words;
  one("trouble").hidden = !words;
}

/**
 * What the server refused to do, said until the next attempt or change.
 * @param {string} words
 * @param {"shot" | "result" | ""} [holds] the file that would be replaced
 * @param {(() => void) | null} [overwrite] replaces it
 */
export function refused(words, holds = "", overwrite = null) {
  one("refused-why").textContent = words;
  one("refused").hidden = !words;
  one("reload").hidden = holds !== "shot";
  one("overwrite").hidden = !holds || !overwrite;
  one("overwrite").onclick = overwrite;
  if (words) one("refused").scrollIntoView({ block: "nearest" });
}

/**
 * Do what the server may refuse, and say why.
 * @param {() => Promise<void>} act
 * @param {(holds: "shot" | "result") => void} [overwrite] does the same, and replaces that file
 */
export async function attempt(act, overwrite) {
  try {
    await act();
    refused("");
  } catch (error) {
    const holds = (overwrite && error instanceof Refusal && error.holds) || "";
    refused(error instanceof Error ? error.message : String(error), holds, holds && overwrite ? () => overwrite(holds) : null);
  }
}
