// Surfaces to be turned about: WebGL 2, nothing else. `scenes` comes from scene.rs.
(() => {
"use strict";
const root = document.getElementById("viewer");
if (!root) return;
root.classList.add("with");
// The page is there before its first picture in three dimensions: without a graphics card a context takes half a second.
let started = false;
requestAnimationFrame(() => setTimeout(start));
addEventListener("beforeprint", start);
function start() {
if (started) return;
started = true;
const part = name => root.querySelector(`[data-part="${name}"]`);
const canvas = part("canvas"), stage = part("stage");
const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
if (!gl) { root.classList.remove("with"); return; }

// Numbers of the page ---------------------------------------------------------------------------
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
const scenes = JSON.parse(document.getElementById("scenes").textContent);
const TOP = 65534, NONE = 65535, NO_VALUE = -1e30;
function unpack(scene) {
  if (scene.points) return scene;
  const words = new Uint16Array(bytes(scene.positions)), n = 3 * scene.vertices;
  scene.points = scene.labels.map((_, s) => {
    const points = new Float32Array(n);
    for (let i = 0; i < n; i++) points[i] = scene.low[i % 3] + scene.size * words[s * n + i] / TOP;
    return points;
  });
  scene.index = new Uint32Array(bytes(scene.triangles));
  scene.normals = [];
  const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
  for (const points of scene.points) for (let i = 0; i < n; i++) {
    low[i % 3] = Math.min(low[i % 3], points[i]);
    high[i % 3] = Math.max(high[i % 3], points[i]);
  }
  scene.center = low.map((l, i) => (l + high[i]) / 2);
  scene.radius = Math.hypot(...low.map((l, i) => high[i] - l)) / 2;
  return scene;
}
// What is not looked at is not computed.
function valuesOf(scene, q) {
  const { vertices, labels } = scene;
  q.all ??= Float32Array.from(new Uint16Array(bytes(q.values)), c => c === NONE ? NO_VALUE : q.least + q.span * c / TOP);
  q.states ??= labels.map((_, s) => q.all.subarray(s * vertices, (s + 1) * vertices));
  return q.states[now.step];
}
function normalsOf(scene) {
  return scene.normals[now.step] ??= normals(scene.points[now.step], scene.index);
}
function edgesOf(scene) {
  if (scene.edges) return scene.edges;
  const edges = new Map(), { index } = scene;
  for (let t = 0; t < index.length; t += 3) for (let k = 0; k < 3; k++) {
    const a = index[t + k], b = index[t + (k + 1) % 3];
    edges.set(Math.min(a, b) * 67108864 + Math.max(a, b), [a, b]);
  }
  return scene.edges = new Uint32Array([...edges.values()].flat());
}
function normals(p, index) {
  const sum = new Float32Array(p.length);
  for (let t = 0; t < index.length; t += 3) {
    const [a, b, c] = [3 * index[t], 3 * index[t + 1], 3 * index[t + 2]];
    const u = [0, 1, 2].map(i => p[b + i] - p[a + i]), v = [0, 1, 2].map(i => p[c + i] - p[a + i]);
    const n = cross(u, v);
    for (const at of [a, b, c]) for (let i = 0; i < 3; i++) sum[at + i] += n[i];
  }
  return sum;
}
const cross = (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];

// Programs --------------------------------------------------------------------------------------
const VERTEX = `#version 300 es
uniform mat3 turn; uniform vec3 center; uniform vec2 scale; uniform float depth, lift;
in vec3 point, normal; in float value; out vec3 facing; out float shown, known;
void main() {
  vec3 p = turn * (point - center);
  facing = turn * normal;
  known = value > -1e29 ? 1.0 : 0.0;
  shown = known > 0.5 ? value : 0.0;
  gl_Position = vec4(p.xy * scale, -p.z * depth - lift, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 stops[9]; uniform vec2 range; uniform vec4 plain; uniform vec3 none;
in vec3 facing; in float shown, known; out vec4 color;
void main() {
  if (plain.a > 0.0) { color = vec4(plain.rgb * plain.a, plain.a); return; }
  float at = clamp((shown - range.x) / (range.y - range.x), 0.0, 1.0) * 8.0;
  int below = int(min(at, 7.0));
  vec3 paint = known > 0.99 ? mix(stops[below], stops[below + 1], at - float(below)) : none;
  float light = abs(normalize(facing).z);
  color = vec4(paint * (0.45 + 0.55 * light), 1.0);
}`;
function compile(kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  return shader;
}
const program = gl.createProgram();
gl.attachShader(program, compile(gl.VERTEX_SHADER, VERTEX));
gl.attachShader(program, compile(gl.FRAGMENT_SHADER, FRAGMENT));
["point", "normal", "value"].forEach((name, at) => gl.bindAttribLocation(program, at, name));
gl.linkProgram(program);
gl.useProgram(program);
const uniform = name => gl.getUniformLocation(program, name);
const at = Object.fromEntries(["turn", "center", "scale", "depth", "lift", "stops", "range", "plain", "none"]
  .map(name => [name, uniform(name)]));
const buffers = [0, 1, 2].map(() => gl.createBuffer()), corners = gl.createBuffer();
gl.enable(gl.DEPTH_TEST);
gl.enable(gl.BLEND);
gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
function feed(slot, values, size) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers[slot]);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  gl.enableVertexAttribArray(slot);
  gl.vertexAttribPointer(slot, size, gl.FLOAT, false, 0, 0);
}
function draw(mode, index) {
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, corners);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.DYNAMIC_DRAW);
  gl.drawElements(mode, index.length, gl.UNSIGNED_INT, 0);
}

// What is looked at -----------------------------------------------------------------------------
const now = { scene: null, step: 0, quantity: 0, azimuth: 90, elevation: 0, zoom: 1, shift: [0, 0], size: [1, 1] };
const dark = () => getComputedStyle(document.documentElement).getPropertyValue("--dark").trim() === "1";
function axes() {
  const [a, e] = [now.azimuth, now.elevation].map(degrees => degrees * Math.PI / 180);
  const eye = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  const right = [-Math.sin(a), Math.cos(a), 0];
  return [right, cross(eye, right), eye];
}
// Pixels of the page for one mm.
const pixels = () => now.zoom * Math.min(0.8 * stage.clientWidth / now.size[0], 0.84 * stage.clientHeight / now.size[1]);
// Width and height (mm) of all states in this view.
function extent() {
  const [right, up] = axes(), { points, center } = now.scene, most = [1, 1];
  for (const p of points) for (let i = 0; i < p.length; i += 3) {
    const d = [p[i] - center[0], p[i + 1] - center[1], p[i + 2] - center[2]];
    most[0] = Math.max(most[0], 2 * Math.abs(dot(right, d)));
    most[1] = Math.max(most[1], 2 * Math.abs(dot(up, d)));
  }
  return most;
}
let waiting = false;
function redraw() {
  if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; paint(); }); }
}
function paint() {
  const { scene, step } = now, q = scene.quantities[now.quantity];
  const [width, height] = [stage.clientWidth, stage.clientHeight], dense = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
    canvas.width = Math.round(width * dense);
    canvas.height = Math.round(height * dense);
  }
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const [right, up, eye] = axes(), scale = pixels();
  gl.uniformMatrix3fv(at.turn, true, [...right, ...up, ...eye]);
  gl.uniform3fv(at.center, scene.center.map((c, i) => c - now.shift[0] * right[i] - now.shift[1] * up[i]));
  gl.uniform2f(at.scale, 2 * scale / width, 2 * scale / height);
  gl.uniform1f(at.depth, 0.4 / scene.radius);
  gl.uniform3fv(at.stops, q.stops.flat().map(c => c / 255));
  gl.uniform2fv(at.range, q.range);
  gl.uniform3fv(at.none, dark() ? [0.42, 0.42, 0.41] : [0.79, 0.78, 0.76]);
  gl.uniform4f(at.plain, 0, 0, 0, 0);
  gl.uniform1f(at.lift, 0);
  feed(0, scene.points[step], 3);
  feed(1, normalsOf(scene), 3);
  feed(2, valuesOf(scene, q), 1);
  draw(gl.TRIANGLES, scene.index);
  const ink = dark() ? [1, 1, 1] : [0, 0, 0];
  gl.uniform1f(at.lift, 0.002);
  if (part("edges").checked) {
    gl.uniform4f(at.plain, ...ink, 0.22);
    draw(gl.LINES, edgesOf(scene));
  }
  if (part("ghost").checked && step !== 0) {
    gl.uniform4f(at.plain, ...(dark() ? [1, 0.62, 0.3] : [0.72, 0.28, 0]), 0.45);
    gl.uniform1f(at.lift, 0);
    feed(0, scene.points[0], 3);
    draw(gl.LINES, edgesOf(scene));
  }
  for (const [which, plate] of scene.plates[step].entries()) {
    feed(0, new Float32Array(plate.flat()), 3);
    gl.disableVertexAttribArray(1);
    gl.disableVertexAttribArray(2);
    gl.uniform1f(at.lift, 0);
    gl.uniform4f(at.plain, ...(dark() ? [0.35, 0.72, 1] : [0, 0.37, 0.62]), 0.95);
    draw(gl.LINE_LOOP, Uint32Array.from(plate.keys()));
    // A window is no plate.
    if (which > 1) continue;
    gl.depthMask(false);
    gl.uniform4f(at.plain, ...(dark() ? [0.35, 0.72, 1] : [0, 0.37, 0.62]), 0.1);
    draw(gl.TRIANGLES, Uint32Array.from(plate.slice(2).flatMap((_, n) => [0, n + 1, n + 2])));
    gl.depthMask(true);
  }
  marks(right, up, eye, scale);
}
// Bar of 50 mm, and the letters of the axes.
function marks(right, up, eye, scale) {
  const bar = [100, 50, 20, 10, 5].find(mm => mm * scale < 0.3 * stage.clientWidth) || 2;
  part("bar").style.width = `${bar * scale}px`;
  part("bar").textContent = `${bar} mm`;
  const spokes = [0, 1, 2].map(i => ({ i, x: 44 + 26 * right[i], y: 40 - 26 * up[i], z: eye[i] })).sort((a, b) => a.z - b.z);
  part("axes").innerHTML = spokes.map(({ i, x, y, z }) => `<g opacity="${z < -0.2 ? 0.45 : 1}">` +
    `<line x1="44" y1="40" x2="${x}" y2="${y}"/><text x="${x + 6 * right[i]}" y="${y - 9 * up[i] + 4}" ` +
    `text-anchor="${right[i] > 0.3 ? "start" : right[i] < -0.3 ? "end" : "middle"}">` +
    `${Math.hypot(right[i], up[i]) > 0.25 ? now.scene.axes[i] : ""}</text></g>`).join("");
}

// Controls --------------------------------------------------------------------------------------
const number = v => Math.abs(v) >= 100 ? v.toFixed(0) : v === 0 ? "0" : String(Number(v.toPrecision(3)));
function option(list, texts) {
  list.replaceChildren(...texts.map((text, n) => new Option(text, n)));
}
function choose(n) {
  now.scene = unpack(scenes[n]);
  now.step = now.scene.labels.length - 1;
  now.quantity = 0;
  option(part("quantity"), now.scene.quantities.map(q => `${q.name} (${q.unit})`));
  const slider = part("step");
  slider.max = now.step;
  part("steps").hidden = now.step === 0;
  part("along").textContent = now.scene.along;
  part("caption").textContent = now.scene.caption;
  part("views").replaceChildren(...now.scene.views.map(view => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = view.name;
    button.addEventListener("click", () => look(view));
    return button;
  }));
  look(now.scene.views[0]);
  tell();
}
function look(view) {
  Object.assign(now, { azimuth: view.azimuth, elevation: view.elevation, zoom: 1, shift: [0, 0] });
  now.size = extent();
  redraw();
}
function tell() {
  const { scene, step } = now, q = scene.quantities[now.quantity], [low, high] = q.range;
  const text = `${scene.labels.length > 1 ? `${step + 1} of ${scene.labels.length}: ` : ""}${scene.labels[step]}`;
  part("step").value = step;
  part("step").setAttribute("aria-valuetext", text);
  part("label").textContent = text;
  part("ramp").style.background = `linear-gradient(to right, ${q.stops.map(c => `rgb(${c})`).join(",")})`;
  part("ticks").replaceChildren(...[0, 1, 2, 3, 4].map(n => {
    const tick = document.createElement("span");
    tick.textContent = number(low + (high - low) * n / 4).replace("-", "−");
    return tick;
  }));
  part("unit").textContent = `${q.name} (${q.unit}); grey: ${q.none}`;
  canvas.setAttribute("aria-label", `${scene.title}, ${q.name}, ${text}`);
  redraw();
}
function step(n) {
  now.step = Math.max(0, Math.min(now.scene.labels.length - 1, n));
  tell();
}
option(part("scene"), scenes.map(scene => scene.title));
part("scene").addEventListener("change", event => choose(Number(event.target.value)));
part("quantity").addEventListener("change", event => { now.quantity = Number(event.target.value); tell(); });
part("step").addEventListener("input", event => step(Number(event.target.value)));
part("edges").addEventListener("change", redraw);
part("ghost").addEventListener("change", redraw);
let timer = 0;
part("play").addEventListener("click", event => {
  if (timer) { clearInterval(timer); timer = 0; } else {
    if (now.step === now.scene.labels.length - 1) step(0);
    timer = setInterval(() => {
      step(now.step + 1);
      if (now.step === now.scene.labels.length - 1) { clearInterval(timer); timer = 0; event.target.textContent = "Play"; }
    }, 350);
  }
  event.target.textContent = timer ? "Stop" : "Play";
});

// Mouse, fingers, keys --------------------------------------------------------------------------
const held = new Map();
const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
function turn(dx, dy) {
  now.azimuth -= dx;
  now.elevation = Math.max(-90, Math.min(90, now.elevation + dy));
  redraw();
}
function zoom(factor) { now.zoom = Math.max(0.3, Math.min(20, now.zoom * factor)); redraw(); }
function slide(dx, dy) { now.shift[0] += dx / pixels(); now.shift[1] -= dy / pixels(); redraw(); }
canvas.addEventListener("pointerdown", event => {
  held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  canvas.setPointerCapture(event.pointerId);
});
canvas.addEventListener("pointermove", event => {
  const last = held.get(event.pointerId);
  if (!last) { point(event); return; }
  const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
  const before = held.size === 2 ? spread() : 0;
  held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  if (held.size === 2) zoom(spread() / Math.max(before, 1));
  else if (event.shiftKey || event.buttons & 6) slide(dx, dy);
  else turn(0.4 * dx, 0.4 * dy);
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => held.delete(event.pointerId));
canvas.addEventListener("contextmenu", event => event.preventDefault());
// The page scrolls until the picture was clicked.
canvas.addEventListener("wheel", event => {
  if (document.activeElement !== canvas && !event.ctrlKey) return;
  event.preventDefault();
  zoom(Math.exp(-0.0012 * event.deltaY));
}, { passive: false });
canvas.addEventListener("dblclick", () => look(now.scene.views[0]));
const KEYS = {
  ArrowLeft: () => turn(-6, 0), ArrowRight: () => turn(6, 0), ArrowUp: () => turn(0, -6), ArrowDown: () => turn(0, 6),
  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15), "0": () => look(now.scene.views[0]),
  ",": () => step(now.step - 1), ".": () => step(now.step + 1),
};
canvas.addEventListener("keydown", event => {
  if (!KEYS[event.key] || event.ctrlKey || event.metaKey) return;
  event.preventDefault();
  KEYS[event.key]();
});

// Value under the pointer: the nearest triangle that it meets.
function point(event) {
  const box = canvas.getBoundingClientRect(), scale = pixels(), [right, up, eye] = axes();
  const u = (event.clientX - box.left - box.width / 2) / scale, v = (box.height / 2 - (event.clientY - box.top)) / scale;
  const { scene } = now, p = scene.points[now.step], q = scene.quantities[now.quantity], values = valuesOf(scene, q);
  const origin = [0, 1, 2].map(i => scene.center[i] + (u - now.shift[0]) * right[i] + (v - now.shift[1]) * up[i]);
  const flat = (n, axis) => axis[0] * (p[3 * n] - origin[0]) + axis[1] * (p[3 * n + 1] - origin[1]) + axis[2] * (p[3 * n + 2] - origin[2]);
  let best = -Infinity, found = null;
  for (let t = 0; t < scene.index.length; t += 3) {
    const [a, b, c] = [scene.index[t], scene.index[t + 1], scene.index[t + 2]];
    const [ax, ay, bx, by, cx, cy] = [flat(a, right), flat(a, up), flat(b, right), flat(b, up), flat(c, right), flat(c, up)];
    const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    const [wa, wb] = [(bx * cy - by * cx) / area, (cx * ay - cy * ax) / area], wc = 1 - wa - wb;
    if (!(wa >= 0 && wb >= 0 && wc >= 0)) continue;
    const depth = wa * flat(a, eye) + wb * flat(b, eye) + wc * flat(c, eye);
    if (depth > best) {
      best = depth;
      const known = Math.min(values[a], values[b], values[c]) > NO_VALUE;
      found = { value: known ? wa * values[a] + wb * values[b] + wc * values[c] : NaN, at: [0, 1, 2].map(i => wa * p[3 * a + i] + wb * p[3 * b + i] + wc * p[3 * c + i]) };
    }
  }
  const tip = part("tip");
  tip.hidden = !found;
  if (!found) return;
  const value = Number.isNaN(found.value) ? q.none : `${number(found.value).replace("-", "−")} ${q.unit}`;
  tip.textContent = `${value} at (${found.at.map(x => x.toFixed(0).replace("-", "−")).join(", ")}) mm`;
  tip.style.left = `${Math.min(event.clientX - box.left + 14, box.width - 190)}px`;
  tip.style.top = `${event.clientY - box.top + 16}px`;
}
canvas.addEventListener("pointerleave", () => { part("tip").hidden = true; });
new ResizeObserver(redraw).observe(stage);
// At once, since a page that is printed waits for no frame.
document.addEventListener("themechange", paint);
// What is printed is a copy, as what is drawn last may not be on the screen yet.
for (const [word, on] of [["beforeprint", true], ["afterprint", false]]) addEventListener(word, () => {
  root.classList.toggle("paper", on);
  paint();
  const copy = part("print");
  [copy.width, copy.height] = on ? [canvas.width, canvas.height] : [1, 1];
  if (on) copy.getContext("2d").drawImage(canvas, 0, 0);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
choose(0);
paint();
}
})();
