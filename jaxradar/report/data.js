// The data, and pictures out of their blobs as they are asked for.
const data = JSON.parse(document.getElementById("data").textContent);
const blobs = [...document.querySelectorAll("script.blob")];
const opened = new Map();
const NOTHING = 65535;

// The bytes of a blob, taken apart once.
function blobBytes(number) {
  if (!opened.has(number)) {
    const text = blobs[number].textContent;
    const packed = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    opened.set(number, new Response(stream).arrayBuffer());
    if (opened.size > 40) opened.delete(opened.keys().next().value);
  }
  return opened.get(number);
}

// A picture, its parts by name as `page_data` says; null if there is none.
async function picture(series) {
  const frame = data.picture[series];
  if (!frame) return null;
  const first = series - (series % data.blob_pictures);
  let offset = 0;
  for (let other = first; other < series; other++) offset += data.picture[other] ? data.picture[other][5] : 0;
  const bytes = await blobBytes(Math.floor(series / data.blob_pictures));
  const words = new Uint16Array(bytes.slice(offset, offset + frame[5]));
  const [count, columns, rows] = words;
  const part = (place) => words.subarray(3 + place * count, 3 + (place + 1) * count);
  const [start, stop, near, far, top, , fastest] = frame;
  return {
    start, stop, near, far, top, fastest, count, columns, rows,
    low: part(0), high: part(1), slow: part(2), fast: part(3), statistic: part(4), event: part(5),
    map: new Uint8Array(bytes, offset + 6 + 12 * count, columns * rows),
  };
}

const metres = (shown, word) => shown.near + (word / 65534) * (shown.far - shown.near);
const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const whole = (value) => (value === null || value === undefined ? "–" : value.toLocaleString("en-US"));
const score = (series, place) => (data.score[series] ? data.score[series][place] : null);

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}
