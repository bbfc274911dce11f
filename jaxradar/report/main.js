// What is there when the page opens, and what the keys do.
function setTheme(dark) {
  document.documentElement.classList.toggle("dark", dark);
  const button = document.getElementById("theme");
  button.setAttribute("aria-pressed", String(dark));
  drawn = "";
  showRows();
  if (dialog.open) openDetail(active);
}

function showSettings() {
  const place = document.getElementById("settings");
  const versions = Object.entries(data.versions).map(([name, version]) => `${name} ${version}`).join(", ");
  const window_ = data.window;
  const { sensor, start_s, stop_s, bins } = data.selection;
  const parts = [
    sensor === null ? "all sensors" : `sensor ${sensor}`,
    start_s === null && stop_s === null ? "the whole of each log" : `from ${start_s ?? "the first sweep"} to ${stop_s ?? "the last"} (s)`,
    bins === null ? "all range bins" : `${bins} range bins`,
  ];
  place.append(
    element("p", {}, `A detection hits a step if it comes at most ${window_.seconds} s before the impact, or in the last ${window_.metres} m. Looked at: ${parts.join(", ")}. ${versions}.`),
    element("pre", {}, data.detector),
  );
  if (data.failures.length) {
    const failures = document.getElementById("failures");
    failures.hidden = false;
    failures.querySelector("summary").textContent = `${whole(data.failures.length)} logs could not be read`;
    failures.querySelector("ul").append(...data.failures.map(([, error]) => element("li", {}, error)));
  }
}

document.getElementById("about").textContent = `${data.folder}, ${data.made}`;
showSum();
showHead();
showSettings();
refresh();
setTheme(matchMedia("(prefers-color-scheme: dark)").matches);
document.getElementById("theme").addEventListener("click", () => setTheme(!document.documentElement.classList.contains("dark")));
document.getElementById("words").addEventListener("input", refresh);
document.getElementById("kind").addEventListener("change", refresh);
document.getElementById("scroll").addEventListener("scroll", () => requestAnimationFrame(showRows));
window.addEventListener("resize", () => { drawn = ""; showRows(); if (dialog.open) openDetail(active); });
document.getElementById("table").addEventListener("keydown", (event) => {
  if (event.target !== event.currentTarget) return;
  const page = Math.max(1, Math.floor(document.getElementById("scroll").clientHeight / ROW) - 2);
  const moves = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -order.length, End: order.length };
  if (event.key in moves) moveTo(active + moves[event.key]);
  else if (event.key === "Enter") openDetail(active);
  else return;
  event.preventDefault();
});
document.documentElement.dataset.ready = "yes";
