// The rig in 3D on a plain canvas: lines and polygons, sorted by depth. It needs no WebGL and no
// library, so the page stays small, opens anywhere, and prints.
"use strict";
(() => {
  const canvas = document.getElementById("rig3d");
  if (!canvas) return;
  const scene = JSON.parse(document.getElementById("rig3d-data").textContent);
  const colours = ["#2464b4", "#c77c11", "#2e8b57", "#8e44ad", "#b03a2e", "#148f97", "#6b7a12", "#a0458c", "#4d5a66"];
  const axisColours = ["#c0392b", "#27ae60", "#2464b4"];
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (k, a) => [k * a[0], k * a[1], k * a[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => times(1 / Math.hypot(...a), a);

  document.getElementById("magnification").textContent = scene.magnification;

  // Level axes: e is ahead, n to the left, u up.
  const u = unit(scene.up);
  const e = unit(cross(Math.abs(u[1]) < 0.9 ? [0, 1, 0] : [0, 0, 1], u));
  const n = cross(u, e);

  const place = (s) => s.T.map((row) => row[3]);
  const places = scene.sensors.map(place);
  const extentOf = (points) => {
    const low = [0, 1, 2].map((i) => Math.min(...points.map((p) => p[i])));
    const high = [0, 1, 2].map((i) => Math.max(...points.map((p) => p[i])));
    return { middle: times(0.5, add(low, high)), size: Math.max(0.1, Math.hypot(...sub(high, low))) };
  };
  const rig = extentOf(places);
  const reach = extentOf(places.concat(...scene.boards.map((b) => b.outline), ...scene.sensors.flatMap((s) => s.views)));
  const start = { yaw: 0.7, pitch: 0.5, size: 0.9 * reach.size, centre: reach.middle };
  let view = { ...start };
  const shown = (name) => document.getElementById("show-" + name).checked;

  function items() {
    const list = [];
    const line = (points, colour, width, alpha = 1) => list.push({ points, colour, width, alpha });
    if (shown("boards")) for (const b of scene.boards) list.push({ points: b.outline, colour: "#66707a", fill: "#9aa7b4", width: 0.8, alpha: 0.6, closed: true });
    scene.sensors.forEach((s, k) => {
      const colour = colours[k % colours.length], origin = places[k];
      const length = 0.12 * rig.size;
      for (let i = 0; i < 3; i++) line([origin, add(origin, times(length, s.T.map((row) => row[i])))], axisColours[i], 2);
      if (shown("views")) for (const curve of s.views) {
        line(curve, colour, 1.2, 0.9);
        const step = Math.max(1, Math.floor(curve.length / 8));
        for (let i = 0; i < curve.length; i += step) line([origin, curve[i]], colour, 0.5, 0.35);
      }
      if (shown("ellipsoids") && s.ellipsoid) for (let i = 0; i < 3; i++) {
        const a = s.ellipsoid.map((row) => row[i]), b = s.ellipsoid.map((row) => row[(i + 1) % 3]);
        const ring = [];
        for (let t = 0; t <= 36; t++) {
          const w = (t / 18) * Math.PI;
          ring.push(add(origin, times(scene.magnification, add(times(Math.cos(w), a), times(Math.sin(w), b)))));
        }
        line(ring, colour, 1, 0.9);
      }
    });
    return list;
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio; canvas.height = height * ratio;
    const g = canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.clearRect(0, 0, width, height);
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    const level = (p) => { const d = sub(p, view.centre); return [dot(d, e), dot(d, n), dot(d, u)]; };
    const scale = Math.min(width, height) / view.size;
    // Right, up and towards the eye.
    const project = (p) => {
      const [x, y, z] = level(p);
      const ahead = cy * x + sy * y, right = -sy * x + cy * y;
      return [width / 2 + scale * right, height / 2 - scale * (cp * z - sp * ahead), cp * ahead + sp * z];
    };
    const drawn = items().map((item) => {
      const flat = item.points.map(project);
      return { ...item, flat, depth: flat.reduce((sum, p) => sum + p[2], 0) / flat.length };
    });
    drawn.sort((a, b) => a.depth - b.depth);
    for (const item of drawn) {
      g.beginPath();
      item.flat.forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
      if (item.closed) g.closePath();
      if (item.fill) { g.globalAlpha = 0.12; g.fillStyle = item.fill; g.fill(); }
      g.globalAlpha = item.alpha; g.strokeStyle = item.colour; g.lineWidth = item.width; g.stroke();
    }
    g.globalAlpha = 1;
    if (shown("names")) {
      g.font = "12px system-ui, sans-serif"; g.lineWidth = 3; g.strokeStyle = "#fff";
      const taken = [];
      scene.sensors.forEach((s, k) => {
        const p = project(places[k]);
        let y = p[1] - 6;
        // Names that would cover each other move down.
        while (taken.some((t) => Math.abs(t[0] - p[0]) < 60 && Math.abs(t[1] - y) < 13)) y += 13;
        taken.push([p[0], y]);
        g.strokeText(s.name, p[0] + 7, y); g.fillStyle = colours[k % colours.length]; g.fillText(s.name, p[0] + 7, y);
      });
    }
    canvas.dataset.yaw = view.yaw.toFixed(4); canvas.dataset.pitch = view.pitch.toFixed(4); canvas.dataset.size = view.size.toFixed(4);
  }

  // Beyond the poles, up would be down.
  function tilt(angle) { view.pitch = Math.max(-1.55, Math.min(1.55, view.pitch + angle)); }

  const held = new Map();
  let spread = 0;
  canvas.addEventListener("pointerdown", (event) => { held.set(event.pointerId, event); canvas.setPointerCapture(event.pointerId); spread = 0; });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => { held.delete(event.pointerId); spread = 0; });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return;
    held.set(event.pointerId, event);
    if (held.size === 2) {
      const [a, b] = [...held.values()], now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (spread) view.size *= spread / now;
      spread = now;
    } else {
      view.yaw -= 0.008 * (event.clientX - last.clientX);
      tilt(0.008 * (event.clientY - last.clientY));
    }
    draw();
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); view.size *= Math.exp(0.001 * event.deltaY); draw(); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (!turn) return;
    event.preventDefault(); view.yaw += turn[0]; tilt(turn[1]); draw();
  });
  document.getElementById("fit-rig").addEventListener("click", () => { view = { ...view, size: rig.size * 2.2, centre: rig.middle }; draw(); });
  document.getElementById("fit-all").addEventListener("click", () => { view = { ...start }; draw(); });
  for (const name of ["boards", "views", "ellipsoids", "names"]) document.getElementById("show-" + name).addEventListener("change", draw);
  window.addEventListener("resize", draw);
  window.addEventListener("beforeprint", draw);
  draw();
})();
