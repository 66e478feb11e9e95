// What the tables of objects hold.

import { rounded } from "./ground.js";

/** @typedef {import("./ground.js").Place} Place */
/** @typedef {import("./shot.js").Table} Table */

const OF_THE_SHOT = ["layers", "footprint", "footprint-node"]; // keys of the first object, whichever that is

/** A table without keys that are undefined. @param {Table} table @returns {Table} */
export function cleaned(table) {
  return Object.fromEntries(Object.entries(table).filter(([, value]) => value !== undefined));
}

/** What the first object holds for the shot goes to the one that is first now. @param {Table[]} before @param {Table[]} after @returns {Table[]} */
export function inherited(before, after) {
  const [first] = before;
  const [next] = after;
  if (!first || first === next) return after;
  const shared = Object.fromEntries(OF_THE_SHOT.filter((key) => first[key] !== undefined).map((key) => [key, first[key]]));
  return after.map((table, at) => {
    const own = Object.entries(table).filter(([key]) => !OF_THE_SHOT.includes(key) && key !== "camera");
    return { ...Object.fromEntries(own), ...(at ? {} : shared) };
  });
}

/** A place as the shot writes it. @param {Place} place @returns {Table} */
export function written({ at: [x, y], size, yaw }) {
  return { at: [rounded(x, 4), rounded(y, 4)], size: rounded(size, 4), yaw: rounded(yaw, 2) };
}

/** A height, such as `0.4m` or `40cm`, times a factor, in its unit. @param {string | number} height @param {number} factor */
export function taller(height, factor) {
  const [, digits, unit = ""] = /^(.*?)([cm]*)$/.exec(String(height)) ?? [];
  const tall = Number((Number(digits) * factor).toPrecision(5));
  return unit ? `${tall}${unit}` : tall;
}
