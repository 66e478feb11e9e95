"use strict";
const at = (id) => document.getElementById(id);
const boxes = [...document.querySelectorAll("#answer [name=choice]")];
const none = document.querySelector("#answer [name=none]");
const answers = [];
let order = [], participant = "", shown = 0, since = 0;

// FNV-1a makes a number of the participant's code, mulberry32 random numbers of that.
function randomOf(code) {
  let state = 2166136261;
  for (const byte of new TextEncoder().encode(code)) state = Math.imul(state ^ byte, 16777619);
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

function shuffled(count, random) {
  const numbers = [...Array(count).keys()];
  for (let last = count - 1; last > 0; last--) {
    const other = Math.floor(random() * (last + 1));
    [numbers[last], numbers[other]] = [numbers[other], numbers[last]];
  }
  return numbers;
}

function show() {
  for (const box of [...boxes, none]) box.checked = false;
  at("missing").textContent = "";
  at("picture").src = trials[order[shown]].src;
  at("picture").alt = `Image ${shown + 1}; it is to be judged by eye`;
  at("progress").textContent = `Image ${shown + 1} of ${trials.length}`;
  at("progress").focus();
  since = performance.now();
}

function keep() {
  const { src, ...trial } = trials[order[shown]];
  const chosen = boxes.filter((box) => box.checked).map((box) => box.value);
  const seconds = Math.round(performance.now() - since) / 1000;
  answers.push({ participant, order: shown + 1, ...trial, chosen, seconds });
}

function table() {
  const names = Object.keys(answers[0]);
  const cell = (value) => `"${String(Array.isArray(value) ? value.join(";") : value).replaceAll('"', '""')}"`;
  const lines = answers.map((answer) => names.map((name) => cell(answer[name])).join(","));
  return [names.join(","), ...lines].join("\n") + "\n";
}

function offer(id, kind, text, ending) {
  at(id).href = `data:${kind};charset=utf-8,${encodeURIComponent(text)}`;
  at(id).download = `answers-${participant}.${ending}`;
}

function end() {
  at("trial").hidden = true;
  at("end").hidden = false;
  offer("json", "application/json", JSON.stringify({ participant, answers }, null, 1) + "\n", "json");
  offer("csv", "text/csv", table(), "csv");
  at("thanks").focus();
}

at("begin").addEventListener("submit", (event) => {
  event.preventDefault();
  participant = at("participant").value;
  order = shuffled(trials.length, randomOf(participant));
  at("intro").hidden = true;
  at("trial").hidden = false;
  show();
});

at("answer").addEventListener("change", (event) => {
  if (event.target === none && none.checked) for (const box of boxes) box.checked = false;
  else if (event.target !== none && event.target.checked) none.checked = false;
});

at("answer").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!none.checked && !boxes.some((box) => box.checked)) {
    at("missing").textContent = "Choose at least one answer, or No.";
    return;
  }
  keep();
  shown += 1;
  if (shown < trials.length) show();
  else end();
});

document.addEventListener("keydown", (event) => {
  if (at("trial").hidden || event.ctrlKey || event.altKey || event.metaKey) return;
  if (/^\d$/.test(event.key)) (event.key === "0" ? none : boxes[event.key - 1])?.click();
  else if (event.key === "Enter" && event.target.tagName !== "BUTTON") {
    event.preventDefault();
    at("answer").requestSubmit();
  }
});

addEventListener("beforeunload", (event) => {
  if (answers.length) event.preventDefault();
});
