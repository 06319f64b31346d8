"use strict";
// Splats in 3D: WebGL 2 with true ellipses where there is one, else soft squares on a 2D canvas.
// Browsers keep about 16 WebGL contexts and drop the oldest, and printers get WebGL as black. So one
// context, on a canvas that nobody sees, serves every 3D view of the page: each view is a plain
// canvas that gets a copy of what was drawn for it.
const V = {
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  unit: (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); },
  along: (a, b, t) => [a[0] + b[0] * t, a[1] + b[1] * t, a[2] + b[2] * t],
};

// Undo splat_view.pack: positions, six entries of each covariance, colour and opacity.
function unpackSplats(model) {
  const raw = Uint8Array.from(atob(model.data), (letter) => letter.charCodeAt(0));
  const n = model.count, words = new Uint16Array(raw.buffer, 0, 3 * n);
  const scale = raw.subarray(6 * n, 9 * n), turn = new Int8Array(raw.buffer, 9 * n, 3 * n);
  const colour = raw.subarray(12 * n, 15 * n), alpha = raw.subarray(15 * n, 16 * n);
  const [low, high] = model.box, [least, top] = model.scales;
  const means = new Float32Array(3 * n), cov = new Float32Array(6 * n), size = new Float32Array(n);
  for (let i = 0; i < n; i++) {
    const s = [0, 0, 0];
    for (let k = 0; k < 3; k++) {
      means[3 * i + k] = low[k] + (high[k] - low[k]) * words[3 * i + k] / 65535;
      s[k] = Math.exp(least + (top - least) * scale[3 * i + k] / 255);
    }
    const [x, y, z] = [0, 1, 2].map((k) => turn[3 * i + k] / 127);
    const w = Math.sqrt(Math.max(0, 1 - x * x - y * y - z * z));
    const r = [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ];
    let at = 6 * i;
    for (let a = 0; a < 3; a++) {
      for (let b = a; b < 3; b++) {
        let sum = 0;
        for (let k = 0; k < 3; k++) sum += r[3 * a + k] * r[3 * b + k] * s[k] * s[k];
        cov[at++] = sum;
      }
    }
    size[i] = Math.cbrt(s[0] * s[1] * s[2]);
  }
  return { n, means, cov, size, colour, alpha };
}

const VERTEX = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D;
uniform sampler2D table; uniform mat3 turn; uniform vec3 eye; uniform vec2 focal, half_size;
in vec2 corner; in uint place; out vec2 at; out vec4 tone;
vec4 fetch(uint k) { uint i = place * 4u + k; return texelFetch(table, ivec2(int(i % 2048u), int(i / 2048u)), 0); }
void main() {
  vec4 a = fetch(0u), b = fetch(1u), c = fetch(2u), d = fetch(3u);
  vec3 p = turn * (a.xyz - eye);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0); at = vec2(0.0); tone = vec4(0.0);
  if (p.z < 0.02) return;
  mat3 cov = mat3(b.x, b.y, b.z, b.y, b.w, c.x, b.z, c.x, c.y);
  vec2 edge = 1.3 * half_size / focal;
  vec2 t = clamp(p.xy / p.z, -edge, edge) * p.z;
  mat3 j = mat3(focal.x / p.z, 0.0, 0.0, 0.0, focal.y / p.z, 0.0, -focal.x * t.x / (p.z * p.z), -focal.y * t.y / (p.z * p.z), 0.0);
  mat3 m = j * turn; mat3 q = m * cov * transpose(m);
  float xx = q[0][0] + 0.3, yy = q[1][1] + 0.3, xy = q[0][1];
  float mid = 0.5 * (xx + yy), gap = sqrt(max(0.25 * (xx - yy) * (xx - yy) + xy * xy, 1e-9));
  float one = mid + gap, two = max(mid - gap, 0.05);
  vec2 axis = abs(xy) < 1e-6 ? (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0)) : normalize(vec2(xy, one - xx));
  vec2 reach = 3.0 * corner * min(sqrt(vec2(one, two)), vec2(1024.0));
  vec2 pixel = focal * p.xy / p.z + reach.x * axis + reach.y * vec2(-axis.y, axis.x);
  at = 3.0 * corner; tone = vec4(c.z, c.w, d.x, a.w);
  gl_Position = vec4(pixel.x / half_size.x, -pixel.y / half_size.y, 0.0, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float; in vec2 at; in vec4 tone; out vec4 result;
void main() {
  float power = dot(at, at); if (power > 9.0) discard;
  float alpha = min(0.99, tone.a * exp(-0.5 * power)); if (alpha < 1.0 / 255.0) discard;
  result = vec4(tone.rgb * alpha, alpha);
}`;

function webglPainter() {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: false });
  if (!gl) return null;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.bindAttribLocation(program, 0, "corner");
  gl.bindAttribLocation(program, 1, "place");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const where = { turn: uniform("turn"), eye: uniform("eye"), focal: uniform("focal"), half: uniform("half_size") };
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
  const order = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, order);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_INT, 0, 0);
  gl.vertexAttribDivisor(1, 1);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(1, 1, 1, 1);
  let loaded = null;
  function load(s) {
    const height = Math.ceil(4 * s.n / 2048), table = new Float32Array(4 * 2048 * height);
    for (let i = 0; i < s.n; i++) {
      table.set([s.means[3 * i], s.means[3 * i + 1], s.means[3 * i + 2], s.alpha[i] / 255], 16 * i);
      table.set(s.cov.subarray(6 * i, 6 * i + 6), 16 * i + 4);
      table.set([s.colour[3 * i] / 255, s.colour[3 * i + 1] / 255, s.colour[3 * i + 2] / 255], 16 * i + 10);
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 2048, height, 0, gl.RGBA, gl.FLOAT, table);
    loaded = s;
  }
  return {
    kind: "webgl2",
    lost: () => gl.isContextLost(),
    paint(view, splats, camera, places) {
      if (loaded !== splats) load(splats);
      if (canvas.width !== view.width || canvas.height !== view.height) Object.assign(canvas, { width: view.width, height: view.height });
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clear(gl.COLOR_BUFFER_BIT);
      const [r, d, f] = [camera.right, camera.down, camera.forward];
      gl.uniformMatrix3fv(where.turn, false, [r[0], d[0], f[0], r[1], d[1], f[1], r[2], d[2], f[2]]);
      gl.uniform3fv(where.eye, camera.eye);
      gl.uniform2f(where.focal, camera.focal, camera.focal);
      gl.uniform2f(where.half, canvas.width / 2, canvas.height / 2);
      gl.bindBuffer(gl.ARRAY_BUFFER, order);
      gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, places.length);
      if (gl.isContextLost()) return; // the view keeps its last picture until it is drawn again
      view.getContext("2d").drawImage(canvas, 0, 0); // within the same task: afterwards it is gone
    },
  };
}

function canvasPainter() {
  return {
    kind: "canvas",
    lost: () => false,
    paint(view, s, camera, places) {
      const { width, height } = view, context = view.getContext("2d");
      context.fillStyle = "#fff";
      context.fillRect(0, 0, width, height);
      for (const i of places) {
        const p = V.sub([s.means[3 * i], s.means[3 * i + 1], s.means[3 * i + 2]], camera.eye);
        const z = V.dot(p, camera.forward);
        if (z < 0.02) continue;
        const scale = camera.focal / z, side = Math.min(width, Math.max(1, 3 * s.size[i] * scale));
        context.globalAlpha = s.alpha[i] / 255;
        context.fillStyle = `rgb(${s.colour[3 * i]} ${s.colour[3 * i + 1]} ${s.colour[3 * i + 2]})`;
        context.fillRect(width / 2 + V.dot(p, camera.right) * scale - side / 2, height / 2 + V.dot(p, camera.down) * scale - side / 2, side, side);
      }
      context.globalAlpha = 1;
    },
  };
}

let pagePainter = null;
function sharedPainter() {
  if (pagePainter && !pagePainter.lost()) return pagePainter;
  try { pagePainter = webglPainter(); } catch (reason) { pagePainter = null; console.warn(`WebGL 2 refused: ${reason.message}`); }
  pagePainter = pagePainter || canvasPainter();
  return pagePainter;
}

// Far to near by counting sort over 4096 depth bins: a whole sort takes a millisecond or two.
function farToNear(s, camera) {
  const depth = new Float32Array(s.n);
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < s.n; i++) {
    const f = camera.forward, e = camera.eye;
    const z = (s.means[3 * i] - e[0]) * f[0] + (s.means[3 * i + 1] - e[1]) * f[1] + (s.means[3 * i + 2] - e[2]) * f[2];
    depth[i] = z;
    if (z < low) low = z;
    if (z > high) high = z;
  }
  const bins = 4096, starts = new Uint32Array(bins + 1), keys = new Uint16Array(s.n);
  const scale = (bins - 1) / Math.max(high - low, 1e-9);
  for (let i = 0; i < s.n; i++) starts[(keys[i] = bins - 1 - ((depth[i] - low) * scale | 0)) + 1]++;
  for (let k = 0; k < bins; k++) starts[k + 1] += starts[k];
  const places = new Uint32Array(s.n);
  for (let i = 0; i < s.n; i++) places[starts[keys[i]]++] = i;
  return places;
}
