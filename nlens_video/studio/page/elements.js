// Elements of the page: found, drawn over the picture, put on it, and dragged.

const SVG = "http://www.w3.org/2000/svg";

/** @typedef {(event: PointerEvent) => void} Moved */

/** @template {Element} [T=HTMLElement] @param {string} id @returns {T} */
export const one = (id) => /** @type {T} */ (/** @type {unknown} */ (document.getElementById(id)));

/** @param {string} id */
export const field = (id) => /** @type {HTMLInputElement} */ (one(id));

for (const kind of ["input", "change", "focusout"]) { // before what a field's own listeners do
  document.addEventListener(kind, ({ target }) => {
    if (!(target instanceof HTMLInputElement) || !["number", "text"].includes(target.type)) return;
    target.toggleAttribute("data-typing", kind === "input");
  }, { capture: true });
}

/** Whether a field holds text that is typed and not taken yet. @param {EventTarget | null} input */
export function isTyping(input) {
  return input instanceof HTMLInputElement && input.hasAttribute("data-typing");
}

/** @param {string} id @param {string | number} value */
export function setUnlessTyping(id, value) {
  const input = field(id);
  if (!isTyping(input)) input.value = String(value);
}

/** A shape in fractions of the frame. @param {string} kind @param {{[name: string]: string | number}} attributes */
export function shape(kind, attributes) {
  const drawn = document.createElementNS(SVG, kind);
  Object.entries(attributes).forEach(([name, value]) => drawn.setAttribute(name, String(value)));
  return drawn;
}

/** @param {number[]} ends x0, y0, x1, y1 @param {string} name its class */
export function lineOf([x1 = 0, y1 = 0, x2 = 0, y2 = 0], name) {
  return shape("line", { x1, y1, x2, y2, class: name });
}

/** Points as a shape has them. @param {number[][]} points */
export function listed(points) {
  return points.map((point) => point.join()).join(" ");
}

/** Put a handle on the picture, never beyond its border. @param {HTMLElement} handle @param {number} x @param {number} y */
export function put(handle, x, y) {
  handle.style.left = `${100 * Math.min(0.98, Math.max(0.02, x))}%`;
  handle.style.top = `${100 * Math.min(0.97, Math.max(0.03, y))}%`;
}

/**
 * Follow a slider until it is let go, also where it is back where it began: of that browsers tell no `change`.
 * @param {string} id
 * @param {(value: number, done: boolean) => void} moved
 */
export function onSlide(id, moved) {
  const slider = field(id);
  let held = false;
  const end = () => {
    if (held) moved(slider.valueAsNumber, true);
    held = false;
  };
  slider.addEventListener("input", () => {
    held = true;
    moved(slider.valueAsNumber, false);
  });
  for (const kind of ["change", "keyup", "blur"]) slider.addEventListener(kind, end);
  for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, end);
}

let dragging = false; // by one pointer at a time: other fingers are left aside meanwhile

/**
 * Follow the pointer from where it is pressed on an element until it is lifted. A click without a motion changes nothing.
 * @param {Element} element
 * @param {(down: PointerEvent) => Moved | null} begin gives what each motion does, null where nothing is dragged
 * @param {() => void} end of a motion
 * @param {boolean} [pressed] whether the press is a motion already
 */
export function onDrag(element, begin, end, pressed = false) {
  element.addEventListener("pointerdown", (event) => {
    const down = /** @type {PointerEvent} */ (event);
    const follow = down.button || dragging ? null : begin(down);
    if (!follow) return;
    let moved = pressed;
    if (pressed) follow(down);
    const over = new AbortController();
    /** @param {string} kind @param {Moved} act */
    const on = (kind, act) => element.addEventListener(kind, (event) => {
      const now = /** @type {PointerEvent} */ (event);
      if (now.pointerId === down.pointerId) act(now);
    }, { signal: over.signal });
    element.setPointerCapture(down.pointerId);
    dragging = true;
    on("pointermove", (now) => {
      moved ||= now.clientX !== down.clientX || now.clientY !== down.clientY; // a pen also tells how hard it is pressed
      if (moved) follow(now);
    });
    on("lostpointercapture", () => {
      dragging = false;
      over.abort();
      if (moved) end();
    });
  });
}
