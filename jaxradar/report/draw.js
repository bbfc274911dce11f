// Pictures on canvases, in the colours of the theme.
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function ready(canvas, width, height) {
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.scale(scale, scale);
  context.clearRect(0, 0, width, height);
  return context;
}

// The least and greatest range that is known, a little wider; the whole axis if none is.
function rangeSpan(shown) {
  let least = NOTHING, most = -1;
  for (let at = 0; at < shown.count; at++) {
    if (shown.low[at] === NOTHING) continue;
    least = Math.min(least, shown.low[at]);
    most = Math.max(most, shown.high[at]);
  }
  if (most < 0) return [shown.near, shown.far];
  const [low, high] = [metres(shown, least), metres(shown, most)];
  const room = Math.max(0.08 * (high - low), 0.005);
  return [low - room, high + room];
}

// When something was detected: the times themselves, or the columns if not all times are in the page.
function detectionTimes(shown, series) {
  const times = data.events[series][0];
  if (times.length === data.detections[series]) return times;
  const step = (shown.stop - shown.start) / shown.count;
  return Array.from(shown.event.keys()).filter((at) => shown.event[at]).map((at) => shown.start + (at + 0.5) * step);
}

// Range over time as a band of columns, and events as ticks: small, without axes.
function drawThumbnail(canvas, shown, series) {
  const [width, height] = [150, 32];
  canvas.style.width = `${width}px`;
  const context = ready(canvas, width, height);
  const [low, high] = rangeSpan(shown);
  const y = (word) => height - 2 - ((metres(shown, word) - low) / (high - low)) * (height - 4);
  context.fillStyle = color("range");
  for (let at = 0; at < shown.count; at++) {
    if (shown.low[at] === NOTHING) continue;
    const [top, bottom] = [y(shown.high[at]), y(shown.low[at])];
    context.fillRect((at / shown.count) * width, top, Math.max(1, width / shown.count), Math.max(1.2, bottom - top));
  }
  const x = (time) => ((time - shown.start) / Math.max(shown.stop - shown.start, 1e-9)) * width;
  context.fillStyle = color("truth");
  for (const time of data.impacts_s[series] || []) context.fillRect(x(time) - 0.7, 0, 1.4, height);
  context.fillStyle = color("event");
  for (const time of detectionTimes(shown, series)) context.fillRect(x(time) - 0.7, height - 6, 1.4, 6);
}

// Ticks at round numbers, about `count` of them.
function ticks(low, high, count) {
  const raw = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= raw) || raw;
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(at);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return found.map((value) => [value, value.toFixed(digits)]);
}

const LEFT = 62, RIGHT = 14, TOP = 24, BOTTOM = 36;

// Axes with units; gives x and y from values to places.
function axes(context, width, height, title, times, timeLabel, values, valueLabel) {
  const [right, bottom] = [width - RIGHT, height - BOTTOM];
  const x = (time) => LEFT + ((time - times[0]) / Math.max(times[1] - times[0], 1e-9)) * (right - LEFT);
  const y = (value) => bottom - ((value - values[0]) / Math.max(values[1] - values[0], 1e-12)) * (bottom - TOP);
  context.font = "12px system-ui, sans-serif";
  context.strokeStyle = color("line");
  context.fillStyle = color("ink");
  context.textAlign = "center";
  for (const [value, text] of ticks(times[0], times[1], 8)) {
    context.beginPath(); context.moveTo(x(value), TOP); context.lineTo(x(value), bottom); context.stroke();
    context.fillText(text, x(value), bottom + 15);
  }
  context.textAlign = "right";
  for (const [value, text] of ticks(values[0], values[1], 6)) {
    context.beginPath(); context.moveTo(LEFT, y(value)); context.lineTo(right, y(value)); context.stroke();
    context.fillText(text, LEFT - 6, y(value) + 4);
  }
  context.textAlign = "center";
  context.fillText(timeLabel, (LEFT + right) / 2, height - 4);
  context.save();
  context.translate(13, (TOP + bottom) / 2); context.rotate(-Math.PI / 2);
  context.fillText(valueLabel, 0, 0);
  context.restore();
  context.textAlign = "left";
  context.font = "600 13px system-ui, sans-serif";
  context.fillText(title, LEFT, 15);
  return [x, y];
}

function drawMarks(context, shown, series, x, height) {
  context.lineWidth = 1.6;
  context.strokeStyle = color("truth");
  context.setLineDash([6, 4]);
  for (const time of data.impacts_s[series] || []) {
    context.beginPath(); context.moveTo(x(time), TOP); context.lineTo(x(time), height - BOTTOM); context.stroke();
  }
  context.setLineDash([]);
  context.fillStyle = color("event");
  for (const time of detectionTimes(shown, series)) {
    context.beginPath();
    context.moveTo(x(time) - 5, TOP - 5); context.lineTo(x(time) + 5, TOP - 5); context.lineTo(x(time), TOP + 4);
    context.fill();
  }
}

function drawRange(canvas, shown, series, width) {
  const height = 230, context = ready(canvas, width, height);
  const span = rangeSpan(shown);
  const [x, y] = axes(
    context, width, height, "Range of the followed echo", [shown.start, shown.stop], "time (s)", span, "slant range (m)",
  );
  context.fillStyle = color("range");
  const step = (shown.stop - shown.start) / shown.count;
  for (let at = 0; at < shown.count; at++) {
    if (shown.low[at] === NOTHING) continue;
    const [top, bottom] = [y(metres(shown, shown.high[at])), y(metres(shown, shown.low[at]))];
    const left = x(shown.start + at * step);
    context.fillRect(left, top - 0.7, Math.max(1.2, x(shown.start + (at + 1) * step) - left), bottom - top + 1.4);
  }
  drawMarks(context, shown, series, x, height);
}

function drawStatistic(canvas, shown, series, width) {
  const height = 200, context = ready(canvas, width, height);
  const threshold = data.threshold;
  const top = Math.max(shown.top, 1.25 * threshold, 1e-9);
  const [x, y] = axes(
    context, width, height, `What is held against the threshold: ${data.statistic[0]}, greatest of each column`,
    [shown.start, shown.stop], "time (s)", [0, 1.05 * top], data.statistic[1],
  );
  context.strokeStyle = color("range");
  context.lineWidth = 1.4;
  context.beginPath();
  const step = (shown.stop - shown.start) / shown.count;
  for (let at = 0; at < shown.count; at++) {
    const [left, level] = [x(shown.start + (at + 0.5) * step), y((shown.statistic[at] / 65535) * shown.top)];
    if (at) context.lineTo(left, level); else context.moveTo(left, level);
  }
  context.stroke();
  context.strokeStyle = color("limit");
  context.setLineDash([8, 4]);
  context.beginPath();
  context.moveTo(LEFT, y(threshold)); context.lineTo(width - RIGHT, y(threshold)); context.stroke();
  context.setLineDash([]);
  drawMarks(context, shown, series, x, height);
}

function drawRate(canvas, shown, series, width) {
  const height = 180, context = ready(canvas, width, height);
  const top = Math.max(shown.fastest, 1e-3);
  const [x, y] = axes(
    context, width, height, "Its rate of change", [shown.start, shown.stop], "time (s)",
    [-1.05 * top, 1.05 * top], "range rate (m/s)",
  );
  context.fillStyle = color("range");
  const step = (shown.stop - shown.start) / shown.count;
  const rate = (word) => ((word - 32767) / 32767) * shown.fastest;
  for (let at = 0; at < shown.count; at++) {
    if (shown.slow[at] === NOTHING) continue;
    const [high, low] = [y(rate(shown.fast[at])), y(rate(shown.slow[at]))];
    const left = x(shown.start + at * step);
    context.fillRect(left, high - 0.6, Math.max(1.2, x(shown.start + (at + 1) * step) - left), low - high + 1.2);
  }
  drawMarks(context, shown, series, x, height);
}

function drawMap(canvas, shown, series, width) {
  const height = 250, context = ready(canvas, width, height);
  const [x, y] = axes(
    context, width, height, "Amplitude (square root), single sweeps", [shown.start, shown.stop], "time (s)",
    [shown.near, shown.far], "slant range (m)",
  );
  const image = new ImageData(Math.max(shown.columns, 1), Math.max(shown.rows, 1));
  for (let row = 0; row < shown.rows; row++) {
    for (let column = 0; column < shown.columns; column++) {
      // Cividis, nearly: dark blue to yellow, the same to every eye.
      const share = shown.map[row * shown.columns + column] / 255;
      const place = 4 * ((shown.rows - 1 - row) * shown.columns + column);
      image.data[place] = 255 * Math.min(1, Math.max(0, 1.08 * share - 0.04));
      image.data[place + 1] = 32 + 200 * share;
      image.data[place + 2] = 255 * (0.3 + 0.2 * Math.sin(3.1 * share) - 0.1 * share);
      image.data[place + 3] = 255;
    }
  }
  const small = element("canvas", { width: image.width, height: image.height });
  small.getContext("2d").putImageData(image, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(small, x(shown.start), y(shown.far), x(shown.stop) - x(shown.start), y(shown.near) - y(shown.far));
  drawMarks(context, shown, series, x, height);
}
