// Where an object goes on the ground, in fractions of the frame, that keeps its real height.

/** @typedef {[number, number]} Point */
/** @typedef {{at: Point, size: number, yaw: number}} Place */

/** Of an object that neither shot nor picture places. @type {Place} */
export const FIRST_PLACE = { at: [0.5, 0.8], size: 0.35, yaw: 0 };
const NEAREST = 0.02; // below the horizon: beyond it the object would be out of sight

/** @param {Point | null} horizon rows at the left and the right border @param {number} column */
export function horizonAt(horizon, column) {
  if (!horizon) return -10;
  return horizon[0] + (horizon[1] - horizon[0]) * column;
}

/** Rows of a horizon at the left and the right border. @param {number} middle its row @param {number} roll how steeply it falls to the right in degrees @param {number} aspect width by height @returns {Point} */
export function horizonOf(middle, roll, aspect) {
  const half = 0.5 * aspect * Math.tan((roll * Math.PI) / 180);
  return [middle - half, middle + half];
}

/** How steeply a horizon falls to the right, in degrees. @param {Point} horizon @param {number} aspect width by height */
export function rollOf(horizon, aspect) {
  return (Math.atan((horizon[1] - horizon[0]) / aspect) * 180) / Math.PI;
}

/**
 * The object at another point of the ground: its size changes with its distance from the horizon.
 * @param {Place} place
 * @param {Point} to
 * @param {Point | null} horizon
 * @returns {Place}
 */
export function movedTo(place, to, horizon) {
  const column = Math.min(2, Math.max(-1, to[0]));
  const top = horizonAt(horizon, column) + NEAREST;
  const row = Math.min(2, Math.max(top, to[1]));
  const before = place.at[1] - horizonAt(horizon, place.at[0]);
  const after = row - horizonAt(horizon, column);
  const ratio = before > 0 ? after / before : 1;
  return { ...place, at: [column, row], size: clampSize(place.size * ratio) };
}

/**
 * The object farther away (factor below 1) or nearer, straight from the viewer.
 * @param {Place} place
 * @param {number} factor
 * @param {Point | null} horizon
 * @returns {Place}
 */
export function atDistance(place, factor, horizon) {
  const far = horizonAt(horizon, place.at[0]);
  const row = far + (place.at[1] - far) * factor;
  return movedTo(place, [0.5 + (place.at[0] - 0.5) * factor, row], horizon);
}

/** @param {number} size */
export function clampSize(size) {
  return Math.min(20, Math.max(0.01, size));
}

/** @param {number} value @param {number} digits */
export function rounded(value, digits) {
  return Number(value.toFixed(digits));
}
