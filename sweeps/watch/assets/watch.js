"use strict";
// Asks for the state every second or two and draws it. Texts become text nodes, nothing else.
const SVG = "http://www.w3.org/2000/svg";
const at = id => document.getElementById(id);
let seen = "", last = 0, failed = 0;

function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function mark(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

// Swept keys of strategies are most of a label; the whole of it is the cell's title.
const short = label => label.replaceAll(/([[ ])strategy\./g, "$1");
// As in `verdict_word`: a tied entry may be far behind.
const verdictWord = verdict => verdict === "tied" ? "not better" : verdict || "open";
const number = (value, digits) => value === null ? "" : value.toFixed(digits);
const count = value => value.toLocaleString("en");

function drawHead(state) {
  document.title = `${state.name}: warpgrasp watch`;
  at("name").replaceChildren(state.name, node("span",
    {class: state.running ? "pill running" : "pill"},
    state.running ? `${state.kind}, running` : state.kind));
  at("headline").textContent = state.headline;
  at("bar").hidden = state.done < 0;
  at("bar").firstElementChild.style.width = `${100 * Math.max(0, state.done)}%`;
  at("bar").setAttribute("aria-valuenow", Math.round(100 * Math.max(0, state.done)));
  at("facts").replaceChildren(...state.facts.map(([what, value]) =>
    node("div", {}, node("dt", {}, what), node("dd", {}, value))));
  at("notes").hidden = !state.notes.length;
  at("notes").replaceChildren(...state.notes.map(text => node("li", {}, text)));
}

const HEADINGS = ["", "strategy", "", "", "behind", "", "episodes", "touches"];

function drawBoard(state) {
  at("head").replaceChildren(...HEADINGS.map((name, n) => node("th",
    {scope: "col", class: n === 3 ? "plot" : n === 1 || n === 5 ? "text" : ""},
    n === 2 ? state.metric : name)));
  const scale = scaleOf(state.rows);
  at("about").textContent = state.about + (state.rows.some(row => isCut(row, scale))
    ? " An arrow: it goes on beyond the scale." : "");
  if (state.rows.length) at("head").cells[3].append(axisOf(scale));
  at("rows").replaceChildren(...state.rows.map((row, n) => node("tr", {class: row.verdict || "open"},
    node("td", {}, `${n + 1}`), node("th", {scope: "row", title: row.label}, short(row.label)),
    node("td", {}, number(row.mean, 3)), node("td", {class: "plot"}, forest(row, scale)),
    node("td", {}, n ? number(row.behind, 3) : ""),
    node("td", {class: "text"}, node("span", {class: "tag"}, verdictWord(row.verdict))),
    node("td", {}, count(row.episodes)), node("td", {}, number(row.touches, 1)))));
  at("more").textContent = state.more ? `and ${count(state.more)} more` : "";
}

// Holds the interval of the first entry, and of the others what is not too far from it.
function scaleOf(rows) {
  const known = rows.filter(row => row.mean !== null), first = known[0];
  if (!first) return {low: 0, high: 1};
  const far = value => Math.abs(value - first.mean);
  const sorted = known.map(row => row.mean).sort((a, b) => far(a) - far(b));
  const most = far(sorted[Math.ceil(0.9 * sorted.length) - 1]);
  const means = sorted.filter(value => far(value) <= 1.5 * most);
  const own = [first.low, first.high].filter(value => value !== null);
  const reach = 3 * Math.max(most + 0.1 * Math.abs(first.mean), ...own.map(far));
  const ends = known.filter(row => row.verdict !== "worse").flatMap(row => [row.low, row.high])
    .filter(value => value !== null && far(value) <= reach);
  const all = [...means, ...own, ...ends];
  let low = Math.min(...all), high = Math.max(...all);
  if (!(high > low)) [low, high] = [low - 0.5, high + 0.5];
  const room = 0.05 * (high - low);
  return {low: low - room, high: high + room};
}

const WIDE = 272, TALL = 22;  // in the shape that the style sheet gives both, so one scale holds

function place(value, scale) {
  const share = (value - scale.low) / (scale.high - scale.low);
  return 4 + (WIDE - 8) * Math.min(1, Math.max(0, share));
}

function axisOf(scale) {
  const svg = mark("svg", {viewBox: `0 0 ${WIDE} 14`, width: WIDE, height: 14, "aria-hidden": "true"});
  for (const tick of ticks(scale.low, scale.high, 4))
    svg.append(mark("text", {x: place(tick, scale), y: 11, "text-anchor": "middle",
      "font-size": 10, fill: "currentColor"}, label(tick)));
  return svg;
}

function forest(row, scale) {
  const svg = mark("svg", {viewBox: `0 0 ${WIDE} ${TALL}`, role: "img"});
  const kind = `c-${row.verdict || "open"}`;
  for (const tick of ticks(scale.low, scale.high, 4))
    svg.append(mark("line", {class: "zero", x1: place(tick, scale), x2: place(tick, scale), y1: 0,
      y2: TALL}));
  if (row.mean === null) return svg;
  const known = row.low !== null && row.high !== null, middle = TALL / 2;
  svg.append(mark("title", {}, known ? `${number(row.low, 3)} to ${number(row.high, 3)}`
    : "no interval yet"));
  if (known) {
    svg.append(mark("line", {class: kind, x1: place(row.low, scale), x2: place(row.high, scale),
      y1: middle, y2: middle, "stroke-width": 3, opacity: 0.55}));
    for (const end of new Set([row.low, row.high])) svg.append(endOf(end, scale, kind));
  }
  svg.append(side(row.mean, scale) ? endOf(row.mean, scale, kind)
    : mark("circle", {class: kind, cx: place(row.mean, scale), cy: middle, r: 4}));
  return svg;
}

// -1 or 1 where a value lies to the left or right of the scale.
const side = (value, scale) => value < scale.low ? -1 : value > scale.high ? 1 : 0;
const isCut = (row, scale) => row.mean !== null &&
  [row.mean, row.low ?? row.mean, row.high ?? row.mean].some(value => side(value, scale));

// The end of a bar: a tick, or an arrow where it goes on beyond the scale.
function endOf(value, scale, kind) {
  const x = place(value, scale), y = TALL / 2, beyond = side(value, scale);
  if (!beyond) return mark("line", {class: kind, x1: x, x2: x, y1: y - 4, y2: y + 4, "stroke-width": 2});
  const tip = x + 4 * beyond, base = x - 4 * beyond;
  return mark("polygon", {class: kind, points: `${tip},${y} ${base},${y - 5} ${base},${y + 5}`});
}

function ticks(low, high, wanted) {
  const raw = (high - low) / wanted, size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(times => times * size).find(value => value >= raw);
  const found = [];
  for (let n = Math.ceil(low / step); n * step <= high + 1e-9 * step; n++) found.push(n * step);
  return found;
}

const label = value => `${Number(value.toPrecision(6))}`;

// A frame with axes; gives functions from values to places.
function chart(svg, x, y, names) {
  const box = {left: 48, right: 16, top: 12, bottom: 38, wide: 520, tall: 300};
  svg.setAttribute("viewBox", `0 0 ${box.wide} ${box.tall}`);
  svg.replaceChildren();
  const toX = value => box.left + (box.wide - box.left - box.right) * x.share(value);
  const toY = value => box.tall - box.bottom - (box.tall - box.top - box.bottom) * y.share(value);
  for (const tick of y.ticks) {
    svg.append(mark("line", {class: "grid", x1: box.left, x2: box.wide - box.right, y1: toY(tick),
      y2: toY(tick)}));
    svg.append(mark("text", {x: box.left - 6, y: toY(tick) + 4, "text-anchor": "end"}, label(tick)));
  }
  for (const tick of x.ticks)
    svg.append(mark("text", {x: toX(tick), y: box.tall - box.bottom + 16, "text-anchor": "middle"},
      label(tick)));
  svg.append(mark("line", {class: "axis", x1: box.left, x2: box.wide - box.right,
    y1: box.tall - box.bottom, y2: box.tall - box.bottom}));
  svg.append(mark("text", {x: (box.left + box.wide - box.right) / 2, y: box.tall - 4,
    "text-anchor": "middle"}, names[0]));
  svg.append(mark("text", {x: -(box.top + box.tall - box.bottom) / 2, y: 12, "text-anchor": "middle",
    transform: "rotate(-90)"}, names[1]));
  svg.setAttribute("aria-label", `${names[1]} against ${names[0]}`);
  return [toX, toY];
}

const linear = (low, high, wanted) => ({ticks: ticks(low, high, wanted),
  share: value => (value - low) / (high - low || 1)});
const logarithmic = (low, high, found) => ({ticks: found,
  share: value => Math.log(value / low) / Math.log(high / low || Math.E)});

function drawSurvivors(state) {
  at("survivors").hidden = !state.rungs.length;
  if (!state.rungs.length) return;
  const most = state.rungs[0][1], farthest = state.rungs[state.rungs.length - 1][0];
  const first = state.rungs[0][0];
  const powers = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 1e4, 1e5];
  const counts = [];
  for (const [replicates] of state.rungs)
    if (!counts.length || replicates > 1.5 * counts[counts.length - 1]) counts.push(replicates);
  const svg = at("survivors").querySelector("svg");
  const [x, y] = chart(svg, logarithmic(first / 1.2, Math.max(farthest, 2 * first), counts),
    logarithmic(0.8, 1.3 * most, powers.filter(value => value <= 1.3 * most)),
    ["episodes on each object", "entries"]);
  let path = "";
  state.rungs.forEach(([replicates, taking], n) => {
    const from = n ? state.rungs[n - 1][0] : first / 1.2;
    path += `${n ? "L" : "M"}${x(from)} ${y(Math.max(taking, 0.8))}L${x(replicates)} ${y(Math.max(taking, 0.8))}`;
  });
  svg.append(mark("path", {class: "line c-open", d: path}));
  for (const [replicates, taking] of state.rungs) {
    const dot = mark("circle", {class: "c-open", cx: x(replicates), cy: y(Math.max(taking, 0.8)), r: 3});
    dot.append(mark("title", {}, `${taking} entries, ${replicates} episodes`));
    svg.append(dot);
  }
}

const NAMED = 6;

function drawError(state) {
  const dots = state.rows.filter(row => row.touches !== null && row.mean !== null);
  at("error").hidden = !dots.length;
  if (!dots.length) return;
  const all = [...dots.map(row => [row.touches, row.mean]), ...(state.metric === "chamfer_mm"
    ? state.curves.flatMap(([, points]) => points) : [])];
  const xs = all.map(point => point[0]), ys = all.map(point => point[1]);
  const wide = range => (range[1] > range[0] ? range : [range[0] - 0.5, range[1] + 0.5]);
  const room = ([low, high]) => [low - 0.06 * (high - low), high + 0.06 * (high - low)];
  const [left, right] = room(wide([Math.min(...xs), Math.max(...xs)]));
  const [low, high] = room(wide([Math.min(...ys), Math.max(...ys)]));
  const svg = at("error").querySelector("svg");
  const [x, y] = chart(svg, linear(Math.max(0, left), right, 6), linear(Math.max(0, low), high, 5),
    ["touches", state.metric]);
  const curved = state.metric === "chamfer_mm" ? state.curves : [];
  const named = dots.slice(0, NAMED), colour = row => `l-${named.indexOf(row)}`;
  for (const [name, points] of [...curved].reverse()) {
    const row = named.find(other => other.label === name);
    if (!row || !points.length) continue;
    const steps = points.map(([a, b], n) => `${n ? "H" : "M"}${x(a)}${n ? "V" : " "}${y(b)}`);
    const line = mark("path", {class: `line ${colour(row)}`, d: steps.join("")});
    line.append(mark("title", {}, name));
    svg.append(line);
  }
  for (const row of [...dots].reverse()) {
    const dot = mark("circle", {class: colour(row), cx: x(row.touches), cy: y(row.mean),
      r: row === dots[0] ? 6 : 4});
    dot.append(mark("title", {}, `${row.label}: ${number(row.mean, 3)} after ${number(row.touches, 1)}`));
    svg.append(dot);
  }
  at("legend").replaceChildren(...named.map(row => node("li", {class: colour(row), title: row.label},
    short(row.label))), ...(dots.length > NAMED ? [node("li", {class: "l--1"}, "others")] : []));
  at("error").querySelector("figcaption").textContent = "A dot an entry, at its mean number of " +
    "touches; the large one is the first." + (curved.length ? " Lines: mean error after each fit, " +
    "of the first entries, over their first 64 episodes of each object." : "");
}

function drawFailures(state) {
  at("nofailure").hidden = state.failures.length > 0 || state.failed_units.length > 0;
  at("nofailure").textContent = state.rows.length ? "No episode failed so far." : "Not known yet.";
  at("reasons").replaceChildren(...state.failures.map(([reason, episodes]) => node("tr", {},
    node("td", {class: "text"}, reason), node("td", {}, `${count(episodes)} episode${episodes === 1 ? "" : "s"}`))));
  at("units").replaceChildren(...[...state.faults, ...state.failed_units].map(text => node("li", {}, text)));
}

async function ask() {
  try {
    const answer = await fetch(`/state.json?seen=${encodeURIComponent(seen)}`);
    if (answer.status === 200) {
      const state = await answer.json();
      seen = state.version;
      drawHead(state); drawBoard(state); drawSurvivors(state); drawError(state);
      drawFailures(state);
    } else if (answer.status !== 204) throw new Error(await answer.text());
    last = Date.now();
    failed = 0;
    at("fresh").textContent = "";
    at("fresh").className = "";
  } catch (error) {
    failed += 1;
    at("fresh").className = "stale";
    at("fresh").textContent = `not up to date: ${error.message}`;
  }
  setTimeout(ask, document.hidden ? 5000 : Math.min(1000 * (1 + failed), 10000));
}

ask();
