"use strict";
// One 3D view: which model it shows, from where, and what mouse, fingers and keys do to that.
function makeOrbit(root, capture) {
  const canvas = root.querySelector("canvas"), models = root.querySelector(".models");
  const unpacked = new Map();
  let model = null, pose = null, waiting = false;

  function reset() {
    const offset = V.sub(model.eye, model.target), up = V.unit(model.up);
    const radius = Math.hypot(...offset) || 1;
    const lift = Math.asin(Math.max(-1, Math.min(1, V.dot(offset, up) / radius)));
    const east = V.unit(V.along(offset, up, -V.dot(offset, up)));
    pose = { azimuth: 0, lift, radius, first: radius, east, up, north: V.cross(up, east) };
  }
  function camera() {
    const { azimuth, lift, radius, east, north, up } = pose;
    const level = V.along(east.map((x) => x * Math.cos(azimuth)), north, Math.sin(azimuth));
    const out = V.along(level.map((x) => x * Math.cos(lift)), up, Math.sin(lift));
    const forward = out.map((x) => -x), right = V.unit(V.cross(forward, up));
    return {
      eye: V.along(model.target, out, radius), forward, right, down: V.cross(forward, right),
      focal: canvas.height / 2 / Math.tan(model.fov / 2),
    };
  }
  function draw() {
    waiting = false;
    const sharp = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * sharp)), height = Math.max(1, Math.round(canvas.clientHeight * sharp));
    if (canvas.clientWidth && (canvas.width !== width || canvas.height !== height)) Object.assign(canvas, { width, height });
    const splats = unpacked.get(model.id), now = camera(), painter = sharedPainter();
    painter.paint(canvas, splats, now, farToNear(splats, now));
    canvas.dataset.painter = painter.kind;
    canvas.dataset.frames = String(Number(canvas.dataset.frames || 0) + 1);
  }
  function soon() {
    if (!waiting && model) { waiting = true; requestAnimationFrame(draw); }
  }
  function choose(id) {
    const kept = pose;
    model = capture.models.find((one) => one.id === id);
    if (!unpacked.has(id)) unpacked.set(id, unpackSplats(model));
    reset();
    if (kept) Object.assign(pose, { azimuth: kept.azimuth, lift: kept.lift, radius: pose.first * kept.radius / kept.first });
    for (const button of models.children) {
      const mine = button.dataset.id === id;
      button.setAttribute("aria-checked", String(mine));
      button.tabIndex = mine ? 0 : -1;
    }
    const shown = model.count < model.total ? `${model.count.toLocaleString("en")} of ${model.total.toLocaleString("en")} splats.` : `${model.count.toLocaleString("en")} splats.`;
    root.querySelector(".count").textContent = shown;
    soon();
  }
  for (const one of capture.models) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: one.name });
    button.dataset.id = one.id;
    button.setAttribute("role", "radio");
    button.addEventListener("click", () => choose(one.id));
    models.append(button);
  }
  models.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    const all = [...models.children], next = all[(all.indexOf(event.target) + step + all.length) % all.length];
    next.focus();
    next.click();
    event.preventDefault();
  });

  const turn = (dx, dy) => {
    pose.azimuth -= dx;
    pose.lift = Math.max(-1.5, Math.min(1.5, pose.lift + dy));
    soon();
  };
  const zoom = (factor) => {
    pose.radius = Math.max(pose.first / 20, Math.min(pose.first * 6, pose.radius * factor));
    soon();
  };
  const fingers = new Map();
  const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before || !pose) return;
    const apart = fingers.size === 2 ? spread() : 0;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) zoom(apart / Math.max(1, spread()));
    else turn((event.clientX - before[0]) * 0.008, (event.clientY - before[1]) * 0.008);
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.001));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { reset(); soon(); });
  canvas.addEventListener("keydown", (event) => {
    const act = {
      ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
      "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1.1), Home: () => { reset(); soon(); },
    }[event.key];
    if (act) { act(); event.preventDefault(); }
  });
  const start = () => { if (!model) choose((capture.models.find((one) => one.id === capture.start[1]) || capture.models[0]).id); };
  // nothing is decoded before it is near the window; printing needs all of it
  new IntersectionObserver((entries, watcher) => {
    if (entries.some((entry) => entry.isIntersecting)) { watcher.disconnect(); start(); }
  }, { rootMargin: "400px" }).observe(canvas);
  window.addEventListener("beforeprint", () => { if (!model) { start(); draw(); } });
  window.addEventListener("resize", soon);
}
