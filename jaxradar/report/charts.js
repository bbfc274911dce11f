// Charts of all series together, as SVG.
const SVG = "http://www.w3.org/2000/svg";

function svg(name, attributes, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function chart(caption, description, width, height) {
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": description });
  return [element("figure", {}, element("figcaption", {}, caption), drawing), drawing];
}

// Share of steps seen over false alarms an hour, with 95 % intervals; zero stands at the left edge.
function operatingCurve() {
  const points = (data.curve.length ? data.curve : data.own).filter((one) => one.rate && one.false_per_hour);
  if (!points.length) return null;
  const [width, height, left, right, top, bottom] = [490, 270, 52, 34, 10, 44];
  const best = points.find((one) => one.chosen) || points[0];
  const [figure, drawing] = chart(
    `Steps seen against false alarms, over the threshold`,
    `At its own threshold ${(100 * best.rate[0]).toFixed(1)} percent of the steps are seen, ` +
      `with ${best.false_per_hour[0].toPrecision(3)} false alarms an hour`,
    width, height,
  );
  const shown = points.flatMap((one) => [one.false_per_hour[0], one.false_per_hour[2]]).filter((value) => value > 0);
  const least = Math.floor(Math.log10(Math.min(...shown))) - 1, most = Math.ceil(Math.log10(Math.max(...shown)));
  const x = (rate) => {
    const power = rate > 0 ? Math.max(Math.log10(rate), least) : least;
    return left + ((power - least) / (most - least)) * (width - left - right);
  };
  const y = (share) => height - bottom - share * (height - top - bottom);
  for (const share of [0, 0.25, 0.5, 0.75, 1]) {
    drawing.append(
      svg("line", { class: "grid", x1: left, x2: width - right, y1: y(share), y2: y(share) }),
      svg("text", { x: left - 6, y: y(share) + 4, "text-anchor": "end" }, `${100 * share}`),
    );
  }
  const stride = Math.ceil((most - least) / 7);
  for (let power = least; power <= most; power += stride) {
    const label = power === least ? "0" : power >= 0 && power < 6 ? (10 ** power).toLocaleString("en-US") : `1e${power}`;
    drawing.append(
      svg("line", { class: "grid", x1: x(10 ** power), x2: x(10 ** power), y1: y(0), y2: y(1) }),
      svg("text", { x: x(10 ** power), y: height - bottom + 16, "text-anchor": "middle" }, label),
    );
  }
  drawing.append(
    svg("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, "false alarms an hour"),
    svg("text", { transform: `translate(14 ${(height - bottom + top) / 2}) rotate(-90)`, "text-anchor": "middle" }, "steps seen (%)"),
    svg("polyline", { class: "curve", points: points.map((one) => `${x(one.false_per_hour[0])},${y(one.rate[0])}`).join(" ") }),
  );
  for (const one of points) {
    const [across, up] = [x(one.false_per_hour[0]), y(one.rate[0])];
    drawing.append(
      svg("line", { class: "bar", x1: across, x2: across, y1: y(one.rate[1]), y2: y(one.rate[2]) }),
      svg("line", { class: "bar", x1: x(one.false_per_hour[1]), x2: x(one.false_per_hour[2]), y1: up, y2: up }),
    );
  }
  for (const one of points) {
    const dot = svg("circle", { class: one.chosen ? "dot chosen" : "dot", cx: x(one.false_per_hour[0]), cy: y(one.rate[0]), r: one.chosen ? 6 : 4 });
    dot.append(svg("title", {}, `threshold ${one.threshold}: ${(100 * one.rate[0]).toFixed(1)} % seen, ${one.false_per_hour[0].toPrecision(3)} false alarms an hour, over ${one.hours.toPrecision(3)} h`));
    drawing.append(dot);
  }
  figure.append(element("p", { className: "key" }, `Large point: the threshold as set. Bars: 95 %. Over ${whole(best.series)} series.`));
  return figure;
}

// How long before the impact: a histogram.
function leads() {
  const held = data.score.flatMap((one) => (one ? one[3] : [])).map((lead) => 1000 * lead);
  if (held.length < 3) return null;
  const [width, height, left, right, top, bottom] = [430, 270, 52, 14, 10, 44];
  const longest = held.reduce((a, b) => Math.max(a, b), 0), count = 24;
  const step = Math.max(longest, 1) / count;
  const bins = new Array(count).fill(0);
  for (const lead of held) bins[Math.min(count - 1, Math.max(0, Math.floor(lead / step)))]++;
  const most = Math.max(...bins);
  const median = 1000 * data.summary.median_lead_s;
  const [figure, drawing] = chart(
    "How long before the impact", `Median lead ${median.toFixed(0)} milliseconds of ${held.length} hits`, width, height,
  );
  const x = (lead) => left + (lead / (count * step)) * (width - left - right);
  const y = (share) => height - bottom - (share / most) * (height - top - bottom);
  for (const [value, text] of ticks(0, most, 4)) {
    drawing.append(
      svg("line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) }),
      svg("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, text),
    );
  }
  bins.forEach((size, at) => {
    drawing.append(svg("rect", { class: "fill", x: x(at * step) + 0.5, width: Math.max(1, x(step) - x(0) - 1), y: y(size), height: y(0) - y(size) }));
  });
  for (const [value, text] of ticks(0, longest, 6)) {
    drawing.append(svg("text", { x: x(value), y: height - bottom + 16, "text-anchor": "middle" }, text));
  }
  drawing.append(
    svg("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, "lead (ms)"),
    svg("text", { transform: `translate(14 ${(height - bottom + top) / 2}) rotate(-90)`, "text-anchor": "middle" }, "hits"),
  );
  return figure;
}

function showSum() {
  const sum = data.summary, own = data.own[0], list = document.getElementById("sum");
  const card = (name, value, small = "") =>
    list.append(element("div", {}, element("dt", {}, name), element("dd", {}, value, element("small", {}, small))));
  card("Logs", whole(sum.logs), data.failures.length ? `${data.failures.length} could not be read` : "all read");
  card("Sweeps", whole(sum.sweeps), `${(sum.duration_s / 3600).toPrecision(3)} h`);
  if (own && own.rate) {
    const percent = (share) => (100 * share).toFixed(1);
    card("Steps seen", `${percent(own.rate[0])} %`, `${whole(sum.hits)} of ${whole(sum.hits + sum.misses)}; 95 %: ${own.rate.slice(1).map(percent).join(" to ")} %`);
  }
  if (own && own.false_per_hour) {
    const round = (rate) => (rate >= 100 ? whole(Math.round(rate)) : rate.toPrecision(2));
    card("False alarms an hour", round(own.false_per_hour[0]), `${whole(sum.false_alarms)} in ${(sum.known_s / 3600).toPrecision(3)} h; 95 %: ${own.false_per_hour.slice(1).map(round).join(" to ")}`);
  }
  if (sum.median_lead_s !== null) card("Median lead", `${(1000 * sum.median_lead_s).toFixed(0)} ms`, "from detection to impact");
  const charts = document.getElementById("charts");
  for (const figure of [operatingCurve(), leads()]) if (figure) charts.append(figure);
}
