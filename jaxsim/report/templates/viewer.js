"use strict";
// The viewer of a page's clouds: WebGL without a library. Scenes come as JSON (report/scenes.py).
(() => {
  const data = JSON.parse(document.getElementById("scenes").textContent);
  const byId = (id) => document.getElementById(id);
  const stage = byId("cloud"), flat = byId("map"), wipe = byId("wipe"), told = byId("told");
  const channelOf = Object.fromEntries(data.channels.map((one) => [one.name, one]));
  document.documentElement.classList.add("turns");

  // Numbers: base64 of little-endian integers.
  const decoded = (text, type) => {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
    return new type(bytes.buffer);
  };
  const unpacked = new Map();
  const sceneAt = (number) => {
    if (!unpacked.has(number)) {
      const scene = data.scenes[number];
      const sides = scene.sides.map((side) => ({ ...side }));
      for (const side of sides) {
        const own = side.xyz ? side : sides[0];
        if (side.xyz) {
          const cells = decoded(side.xyz, Uint16Array);
          side.points = Float32Array.from(cells, (cell, k) => side.low[k % 3] + cell * side.step[k % 3]);
          side.groups = Object.fromEntries(Object.entries(side.picks).map(([n, t]) => [n, decoded(t, Uint16Array)]));
        } else Object.assign(side, { points: own.points, groups: own.groups });
        side.levels = Object.fromEntries(Object.entries(side.values).map(([n, t]) => [n, decoded(t, Uint8Array)]));
        side.count = side.points.length / 3;
      }
      unpacked.set(number, { ...scene, sides });
    }
    return unpacked.get(number);
  };

  // Colours.
  const RAMPS = {
    diverging: [[33, 140, 255], [90, 160, 215], [104, 108, 114], [226, 122, 90], [255, 64, 48]],
    turbo: [[64, 78, 190], [54, 150, 246], [40, 214, 186], [130, 246, 96], [222, 220, 56], [250, 130, 38], [186, 34, 8]],
  };
  const NONE = [52, 55, 60];
  const colour = (ramp, share) => {
    const stops = RAMPS[ramp], at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    return stops[k].map((low, c) => low + (stops[k + 1][c] - low) * (at - k));
  };

  const state = { scene: 0, channel: data.channels[0].name, wipe: 0.5, pick: null };
  const camera = { turn: Math.PI, lift: 0.5, away: 26, at: [5, 0, -1] };
  const start = JSON.stringify(camera);

  // What is picked: a chart's group, or a cell of the map.
  const isLit = (side, k) => {
    const pick = state.pick;
    if (!pick) return true;
    if (pick.chart !== "cell") return side.groups[pick.chart]?.[k] === pick.index;
    const width = data.grid.columns / data.grid.groups;
    return side.groups.row?.[k] === pick.row && Math.floor(side.groups.column[k] / width) === pick.group;
  };
  const litOf = (side) => {
    const lit = new Uint8Array(side.count);
    for (let k = 0; k < side.count; k++) lit[k] = isLit(side, k) ? 255 : 0;
    return lit;
  };

  // The cloud.
  const VERTEX = `attribute vec3 place; attribute vec4 tone; attribute float lit;
    uniform mat4 seen; uniform float size; uniform float picked; varying vec4 paint;
    void main() {
      gl_Position = seen * vec4(place, 1.0);
      gl_PointSize = clamp(size / max(gl_Position.w, 0.1), 1.5, 9.0) * mix(1.0, 1.5, lit * picked);
      paint = vec4(tone.rgb * mix(1.0, 0.22 + 0.78 * lit, picked), 1.0);
    }`;
  const FRAGMENT = `precision mediump float; varying vec4 paint; void main() { gl_FragColor = paint; }`;
  const gl = stage.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  let program = null, buffers = [];
  if (gl) {
    const made = (kind, text) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader);
      return shader;
    };
    program = gl.createProgram();
    gl.attachShader(program, made(gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(program, made(gl.FRAGMENT_SHADER, FRAGMENT));
    ["place", "tone", "lit"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    gl.enable(gl.DEPTH_TEST);
  } else byId("lost").hidden = false;

  const filled = (content) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, content, gl.STATIC_DRAW);
    return buffer;
  };
  const tonesOf = (side) => {
    const levels = side.levels[state.channel], { ramp } = channelOf[state.channel];
    const table = Array.from({ length: 256 }, (_, level) => (level ? colour(ramp, (level - 1) / 254) : NONE));
    const tones = new Uint8Array(4 * side.count);
    for (let k = 0; k < side.count; k++) tones.set(table[levels ? levels[k] : 0], 4 * k);
    return tones;
  };
  // Rings at round distances on the ground, and the edges of boxes.
  const linesOf = (scene) => {
    const places = [], tones = [];
    const add = (a, b, tone) => { places.push(...a, ...b); tones.push(...tone, 255, ...tone, 255); };
    for (const radius of [10, 20, 40, 80])
      for (let k = 0; k < 96; k++) {
        const at = (step) => [radius * Math.cos(step * Math.PI / 48), radius * Math.sin(step * Math.PI / 48), scene.ground];
        add(at(k), at(k + 1), [58, 62, 68]);
      }
    for (const box of scene.boxes)
      for (const [a, b] of [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7], [0, 5], [1, 4]])
        add(box.corners[a], box.corners[b], box.tone);
    return { places: new Float32Array(places), tones: new Uint8Array(tones) };
  };
  const upload = () => {
    if (!gl) return;
    for (const one of buffers) for (const name of ["place", "tone", "lit"]) gl.deleteBuffer(one[name]);
    const scene = sceneAt(state.scene), lines = linesOf(scene);
    buffers = scene.sides.map((side) => ({
      place: filled(side.points), tone: filled(tonesOf(side)), lit: filled(litOf(side)), count: side.count, mode: gl.POINTS,
    }));
    const count = lines.places.length / 3;
    buffers.push({
      place: filled(lines.places), tone: filled(lines.tones), lit: filled(new Uint8Array(count).fill(255)), count, mode: gl.LINES,
    });
  };

  // A pinhole that looks at `at`: columns of the matrix from places to what is seen.
  const seenFrom = (aspect) => {
    const { turn, lift, away, at } = camera;
    const back = [Math.cos(lift) * Math.cos(turn), Math.cos(lift) * Math.sin(turn), Math.sin(lift)];
    const right = [-Math.sin(turn), Math.cos(turn), 0];
    const up = [-Math.sin(lift) * Math.cos(turn), -Math.sin(lift) * Math.sin(turn), Math.cos(lift)];
    const eye = at.map((v, k) => v + away * back[k]);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const focal = 1.5, near = 0.2, far = 600, deep = (far + near) / (near - far), shift = (2 * far * near) / (near - far);
    const rows = [right, up, back].map((axis) => [...axis, -dot(axis, eye)]);
    const x = rows[0].map((v) => (v * focal) / aspect), y = rows[1].map((v) => v * focal);
    const z = rows[2].map((v, k) => v * deep + (k === 3 ? shift : 0)), w = rows[2].map((v) => -v);
    return new Float32Array([0, 1, 2, 3].flatMap((k) => [x[k], y[k], z[k], w[k]]));
  };
  const resize = (canvas) => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    return ratio;
  };
  const drawCloud = () => {
    if (!gl) return;
    const ratio = resize(stage), { width, height } = stage;
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0.043, 0.047, 0.055, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "seen"), false, seenFrom(width / Math.max(height, 1)));
    gl.uniform1f(gl.getUniformLocation(program, "size"), 60 * ratio);
    const picked = gl.getUniformLocation(program, "picked");
    const draw = (one) => {
      [["place", 3, gl.FLOAT, false], ["tone", 4, gl.UNSIGNED_BYTE, true], ["lit", 1, gl.UNSIGNED_BYTE, true]].forEach(
        ([name, size, type, scaled], k) => {
          gl.bindBuffer(gl.ARRAY_BUFFER, one[name]);
          gl.enableVertexAttribArray(k);
          gl.vertexAttribPointer(k, size, type, scaled, 0, 0);
        });
      gl.uniform1f(picked, one.mode === gl.POINTS && state.pick ? 1 : 0);
      gl.drawArrays(one.mode, 0, one.count);
    };
    draw(buffers[buffers.length - 1]);
    const sides = buffers.length - 1, cut = Math.round(width * state.wipe);
    gl.enable(gl.SCISSOR_TEST);
    for (let k = 0; k < sides; k++) {
      if (sides === 1) gl.scissor(0, 0, width, height);
      else gl.scissor(k ? cut : 0, 0, k ? width - cut : cut, height);
      draw(buffers[k]);
    }
  };

  // The map of the channel: images that stand in the page already.
  const drawMap = () => {
    const found = ["before", "after"].map((side) => document.querySelector(`[data-map="${state.channel} ${side}"]`));
    const only = document.querySelector(`[data-map="${state.channel} residual"]`);
    byId("flat").hidden = !(found[0] || only);
    if (byId("flat").hidden) return;
    resize(flat);
    const brush = flat.getContext("2d"), { width, height } = flat;
    brush.imageSmoothingEnabled = false;
    brush.clearRect(0, 0, width, height);
    const pictures = (only ? [only, only] : found).map((one) => pictureOf(one.getAttribute("href")));
    pictures.forEach((picture, k) => {
      if (!picture.complete) return;
      const from = k ? state.wipe : 0, to = k ? 1 : state.wipe;
      if (to > from)
        brush.drawImage(picture, picture.width * from, 0, picture.width * (to - from), picture.height,
          width * from, 0, width * (to - from), height);
    });
    if (state.pick) shade(brush, width, height);
    brush.fillStyle = "#000"; brush.fillRect(width * state.wipe - 1, 0, 2, height);
  };
  const pictures = new Map();
  const pictureOf = (address) => {
    if (!pictures.has(address)) {
      const picture = new Image();
      picture.onload = () => drawMap();
      picture.src = address;
      pictures.set(address, picture);
    }
    return pictures.get(address);
  };
  // Cells without a lit ray are covered.
  const shade = (brush, width, height) => {
    const { rows, columns, groups } = data.grid, lit = new Set(), side = sceneAt(state.scene).sides[0];
    for (let k = 0; k < side.count; k++)
      if (isLit(side, k)) lit.add(side.groups.row[k] * groups + Math.floor((side.groups.column[k] * groups) / columns));
    brush.fillStyle = "rgba(20, 22, 26, 0.78)";
    const x = (k) => Math.round((k * width) / groups), y = (k) => Math.round((k * height) / rows);
    for (let row = 0; row < rows; row++)
      for (let group = 0; group < groups; group++)
        if (!lit.has(row * groups + group)) brush.fillRect(x(group), y(row), x(group + 1) - x(group), y(row + 1) - y(row));
  };

  let asked = false;
  const draw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; drawCloud(); drawMap(); place(); });
  };
  const place = () => {
    const two = sceneAt(state.scene).sides.length > 1;
    byId("divide").hidden = !two;
    byId("divide").style.left = `${100 * state.wipe}%`;
    wipe.hidden = !two;
    sceneAt(state.scene).sides.forEach((side, k) => { byId(k ? "right" : "left").textContent = side.name; });
    byId("right").hidden = !two;
  };
  const scale = () => {
    const { ramp, low, high, unit } = channelOf[state.channel], brush = byId("scale").getContext("2d");
    for (let k = 0; k < 160; k++) {
      brush.fillStyle = `rgb(${colour(ramp, k / 159).map(Math.round).join(",")})`;
      brush.fillRect(k, 0, 1, 12);
    }
    byId("low").textContent = low; byId("high").textContent = `${high} ${unit}`;
  };
  const change = () => { upload(); scale(); draw(); say(); };

  // What is lit, in words and on the charts.
  const say = () => {
    const side = sceneAt(state.scene).sides[0];
    let count = 0;
    for (let k = 0; k < side.count; k++) if (isLit(side, k)) count++;
    const what = state.pick ? `${state.pick.words}: ${count} of ${side.count} rays are lit` : `${side.count} rays`;
    told.textContent = `${what} in ${sceneAt(state.scene).name}.`;
    for (const target of document.querySelectorAll(".target"))
      target.setAttribute("aria-pressed", String(!!state.pick && target.dataset.chart === state.pick.chart && +target.dataset.index === state.pick.index));
  };
  const pick = (what) => {
    const same = what && state.pick && JSON.stringify(what) === JSON.stringify(state.pick);
    state.pick = same ? null : what;
    change();
  };

  for (const svg of document.querySelectorAll("svg")) {
    const targets = [...svg.querySelectorAll(".target")];
    targets.forEach((target, k) => {
      target.setAttribute("role", "button");
      target.setAttribute("tabindex", k ? "-1" : "0");
      const chosen = () => {
        const channel = (target.closest("figure")?.id || "").split("_")[1];
        if (channel && channelOf[channel]) { state.channel = channel; byId("channel").value = channel; }
        pick({ chart: target.dataset.chart, index: +target.dataset.index, words: target.getAttribute("aria-label") });
      };
      target.addEventListener("click", chosen);
      target.addEventListener("keydown", (event) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); chosen(); }
        if (step && targets[k + step]) {
          event.preventDefault();
          target.setAttribute("tabindex", "-1"); targets[k + step].setAttribute("tabindex", "0"); targets[k + step].focus();
        }
      });
    });
  }
  document.addEventListener("keydown", (event) => { if (event.key === "Escape" && state.pick) pick(null); });

  data.scenes.forEach((scene, k) => byId("scene").add(new Option(scene.name, k)));
  data.channels.forEach((one) => byId("channel").add(new Option(one.words, one.name)));
  byId("scene").addEventListener("change", (event) => { state.scene = +event.target.value; change(); });
  byId("channel").addEventListener("change", (event) => { state.channel = event.target.value; change(); });
  wipe.addEventListener("input", () => { state.wipe = wipe.value / 100; draw(); });
  byId("reset").addEventListener("click", () => { Object.assign(camera, JSON.parse(start)); draw(); });
  byId("clear").addEventListener("click", () => pick(null));
  flat.addEventListener("click", (event) => {
    const box = flat.getBoundingClientRect(), { rows, groups } = data.grid;
    const row = Math.floor(((event.clientY - box.top) / box.height) * rows);
    const group = Math.floor(((event.clientX - box.left) / box.width) * groups);
    pick({ chart: "cell", row, group, index: -1, words: `row ${row}, part ${group + 1} of ${groups} of the columns` });
  });

  // Turning, moving, zooming: mouse, touch, keys.
  const turn = (x, y) => {
    camera.turn -= x;
    camera.lift = Math.min(Math.max(camera.lift + y, -0.2), 1.57);
  };
  const move = (x, y) => {
    const right = [-Math.sin(camera.turn), Math.cos(camera.turn)], ahead = [-Math.cos(camera.turn), -Math.sin(camera.turn)];
    camera.at[0] += camera.away * (-x * right[0] + y * ahead[0]);
    camera.at[1] += camera.away * (-x * right[1] + y * ahead[1]);
  };
  const zoom = (factor) => { camera.away = Math.min(Math.max(camera.away * factor, 2), 250); };
  const fingers = new Map();
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, (event) => fingers.delete(event.pointerId));
  stage.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const now = [event.clientX, event.clientY], x = (now[0] - last[0]) / 300, y = (now[1] - last[1]) / 300;
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const gap = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
      zoom(gap(last) / Math.max(gap(now), 1));
      move(x / 2, y / 2);
    } else if (event.shiftKey || event.buttons === 2) move(x, y);
    else turn(2 * x, 2 * y);
    fingers.set(event.pointerId, now);
    draw();
  });
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY / 700)); draw(); }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (way) (event.shiftKey ? move : turn)(...way);
    else if (event.key === "+" || event.key === "=") zoom(0.9);
    else if (event.key === "-") zoom(1.1);
    else if (event.key === "0" || event.key === "Home") Object.assign(camera, JSON.parse(start));
    else return;
    event.preventDefault();
    draw();
  });
  window.addEventListener("resize", draw);

  window.jaxsimViewer = {
    state,
    lit: () => { let n = 0; const side = sceneAt(state.scene).sides[0]; for (let k = 0; k < side.count; k++) n += isLit(side, k); return n; },
    // Frames a second of a turn, each finished before the next.
    speed: (frames) => {
      const begun = performance.now(), pixel = new Uint8Array(4);
      for (let k = 0; k < frames; k++) {
        camera.turn += 0.02; drawCloud();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      }
      return (1000 * frames) / (performance.now() - begun);
    },
  };
  change();
})();
