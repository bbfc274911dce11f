// One series, large.
const dialog = document.getElementById("detail");
let opener = null;
let calls = 0;

async function openDetail(place) {
  if (place < 0 || place >= order.length) return;
  const at = order[place], call = ++calls;
  moveTo(place);
  document.getElementById("detail-heading").textContent = `${data.path[at]}, sensor ${data.sensor[at]}`;
  const ends = { before: place === 0, after: place === order.length - 1 };
  for (const [name, end] of Object.entries(ends)) document.getElementById(name).setAttribute("aria-disabled", String(end));
  const body = document.getElementById("detail-body");
  body.replaceChildren(element("p", {}, sentence(at)));
  for (const problem of data.problems[at]) body.append(element("p", { className: "key" }, problem));
  if (!dialog.open) { opener = document.activeElement; dialog.showModal(); }
  const shown = await picture(at);
  if (call !== calls) return; // another was opened meanwhile, or the same again
  if (shown) {
    const key = element("p", { className: "key" });
    key.append(
      element("b", { className: "range" }, "▬ range"), "  ", element("b", { className: "event" }, "▼ detection"), "  ",
      element("b", { className: "truth" }, "┆ front tyre meets a step"), "  ", element("b", { className: "limit" }, "– – threshold"),
    );
    body.append(key);
    const width = Math.max(320, body.clientWidth);
    const draw = (label, how) => {
      const canvas = element("canvas", { role: "img" });
      canvas.setAttribute("aria-label", label);
      body.append(canvas);
      how(canvas);
    };
    draw("Range over time", (canvas) => drawRange(canvas, shown, at, width));
    draw("Range rate over time", (canvas) => drawRate(canvas, shown, at, width));
    draw("Statistic over time", (canvas) => drawStatistic(canvas, shown, at, width));
    draw("Amplitude over range and time", (canvas) => drawMap(canvas, shown, at, width));
  }
  body.append(stepTable(at), eventTable(at));
}

function sentence(at) {
  const held = data.score[at];
  const parts = [`${whole(data.sweeps[at])} sweeps in ${fixed(data.duration_s[at], 2)} s, ${whole(data.invalid_sweeps[at])} of them invalid; ${whole(data.detections[at])} detections`];
  if (held) parts.push(`${held[0]} of ${held[0] + held[1]} steps seen, ${whole(held[2])} false alarms`);
  else parts.push("its truth is not known");
  return `${parts.join("; ")}.`;
}

function stepTable(at) {
  const impacts = data.impacts_s[at] || [];
  return impacts.length ? element("p", {}, `A front tyre meets a step at ${impacts.map((time) => fixed(time, 3)).join(", ")} s.`) : "";
}

function eventTable(at) {
  const [times, ranges, statistics] = data.events[at];
  if (!times.length) return element("p", {}, "Nothing was detected.");
  const head = element("tr", {}, ...["time (s)", "slant range (m)", data.statistic.join(", ")].map((name) => element("th", { scope: "col" }, name)));
  const rows = times.map((time, place) =>
    element("tr", {}, ...[fixed(time, 3), fixed(ranges[place], 4), fixed(statistics[place], 3)].map((text) => element("td", {}, text))));
  const table = element("table", {}, element("caption", {}, "Detections"), element("thead", {}, head), element("tbody", {}, ...rows));
  const more = data.detections[at] - times.length;
  return element("div", {}, table, more > 0 ? element("p", {}, `… and ${whole(more)} more.`) : "");
}

document.getElementById("close").addEventListener("click", () => dialog.close());
document.getElementById("before").addEventListener("click", () => openDetail(active - 1));
document.getElementById("after").addEventListener("click", () => openDetail(active + 1));
dialog.addEventListener("close", () => (opener || document.getElementById("table")).focus());
dialog.addEventListener("click", (event) => {
  const box = dialog.getBoundingClientRect();
  const inside = event.clientX >= box.left && event.clientX <= box.right && event.clientY >= box.top && event.clientY <= box.bottom;
  if (event.target === dialog && !inside) dialog.close();
});
dialog.addEventListener("keydown", (event) => {
  if (event.key === "ArrowLeft") openDetail(active - 1);
  else if (event.key === "ArrowRight") openDetail(active + 1);
});
