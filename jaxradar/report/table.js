// The table: thousands of rows, of which those in sight are in the page.
const ROW = 39;
const COLUMNS = [
  ["log", (at) => data.path[at], 30],
  ["sensor", (at) => data.sensor[at], 7],
  ["", null, 16],
  ["sweeps", (at) => data.sweeps[at], 8],
  ["seconds", (at) => data.duration_s[at], 8],
  ["Hz", (at) => data.sweep_rate_hz[at], 7],
  ["invalid", (at) => data.invalid_sweeps[at], 8],
  ["found", (at) => data.detections[at], 8],
  ["hit", (at) => score(at, 0), 6],
  ["missed", (at) => score(at, 1), 8],
  ["false", (at) => score(at, 2), 8],
  ["lead ms", (at) => (data.score[at] && data.score[at][3].length ? 1000 * data.score[at][3][0] : null), 9],
];
const KINDS = {
  "all": () => true,
  "with a missed step": (at) => score(at, 1) > 0,
  "with a false alarm": (at) => score(at, 2) > 0,
  "without a detection": (at) => data.detections[at] === 0,
  "with something to say of the log": (at) => data.problems[at].length > 0,
  "whose truth is not known": (at) => !data.score[at],
};
let order = data.path.map((_, at) => at);
let sorted = { column: -1, down: false };
let active = 0;

function showHead() {
  const head = document.getElementById("head");
  COLUMNS.forEach(([name, value, width], column) => {
    const cell = element("th", { scope: "col", style: `width:${width}%` });
    if (value) {
      const button = element("button", { type: "button" }, name);
      button.addEventListener("click", () => sortBy(column));
      cell.append(button);
    } else cell.append(element("span", { style: "padding:6px 8px;display:inline-block" }, "range over time"));
    head.append(cell);
  });
  const kind = document.getElementById("kind");
  for (const name of Object.keys(KINDS)) kind.append(element("option", { value: name }, name));
}

function sortBy(column) {
  sorted = { column, down: sorted.column === column ? !sorted.down : column >= 7 };
  document.querySelectorAll("#head th").forEach((cell, at) => {
    if (at === column) cell.setAttribute("aria-sort", sorted.down ? "descending" : "ascending");
    else cell.removeAttribute("aria-sort");
  });
  refresh();
}

// Which series are shown, and in which order.
function refresh() {
  const words = document.getElementById("words").value.toLowerCase().split(/\s+/).filter(Boolean);
  const kind = KINDS[document.getElementById("kind").value];
  order = [];
  for (let at = 0; at < data.path.length; at++) {
    const name = data.path[at].toLowerCase();
    if (kind(at) && words.every((word) => name.includes(word))) order.push(at);
  }
  if (sorted.column >= 0) {
    const value = COLUMNS[sorted.column][1], sign = sorted.down ? -1 : 1;
    const compare = new Intl.Collator("en", { numeric: true }).compare;
    const keys = new Map(order.map((at) => [at, value(at)]));
    order.sort((a, b) => {
      const [one, other] = [keys.get(a), keys.get(b)];
      if (one === null || other === null) return (one === null) - (other === null) || a - b;
      return sign * (typeof one === "string" ? compare(one, other) : one - other) || a - b;
    });
  }
  active = 0;
  document.getElementById("scroll").scrollTop = 0;
  document.getElementById("count").textContent = `${whole(order.length)} of ${whole(data.path.length)}`;
  document.getElementById("table").setAttribute("aria-rowcount", order.length + 1);
  drawn = "";
  showRows();
}

let drawn = "";

function showRows() {
  const scroll = document.getElementById("scroll"), rows = document.getElementById("rows");
  const first = Math.max(0, Math.floor(scroll.scrollTop / ROW) - 8);
  const last = Math.min(order.length, first + Math.ceil(scroll.clientHeight / ROW) + 16);
  const wanted = `${first} ${last} ${active}`;
  if (wanted === drawn) return;
  drawn = wanted;
  const gap = (height) => element("tr", { ariaHidden: "true" }, element("td", { colSpan: COLUMNS.length, style: `height:${height}px;padding:0;border:0` }));
  if (!order.length) {
    rows.replaceChildren(element("tr", {}, element("td", { colSpan: COLUMNS.length, className: "none" }, "No series is like that.")));
    return;
  }
  rows.replaceChildren(gap(first * ROW), ...order.slice(first, last).map((at, place) => row(at, first + place)), gap((order.length - last) * ROW));
}

function row(at, place) {
  const made = element("tr", { className: place === active ? "row active" : "row", id: `row-${place}` });
  made.setAttribute("aria-rowindex", place + 2);
  made.setAttribute("aria-selected", String(place === active));
  COLUMNS.forEach(([name, value]) => {
    const cell = name === "log" ? element("th", { scope: "row" }) : element("td");
    if (!value) cell.append(...(data.picture[at] ? [thumbnail(at)] : []));
    else {
      const held = value(at);
      cell.textContent = typeof held === "string" ? held : name === "seconds" || name === "Hz" ? fixed(held, 1) : name === "lead ms" ? fixed(held, 0) : whole(held);
      if (typeof held === "string") cell.title = held;
      if ((name === "missed" || name === "false") && held > 0) cell.className = "wrong";
    }
    made.append(cell);
  });
  made.addEventListener("click", () => { active = place; openDetail(place); });
  return made;
}

function thumbnail(at) {
  const canvas = element("canvas", { role: "img" });
  canvas.setAttribute("aria-label", `Range over time, ${data.detections[at]} detections`);
  picture(at).then((shown) => { if (shown) drawThumbnail(canvas, shown, at); });
  return canvas;
}

function moveTo(place) {
  if (!order.length) return;
  active = Math.min(order.length - 1, Math.max(0, place));
  const scroll = document.getElementById("scroll"), head = 34;
  const top = active * ROW;
  if (top < scroll.scrollTop) scroll.scrollTop = top;
  else if (top + ROW + head > scroll.scrollTop + scroll.clientHeight) scroll.scrollTop = top + ROW + head - scroll.clientHeight;
  showRows();
  document.getElementById("table").setAttribute("aria-activedescendant", `row-${active}`);
}
