"use strict";
// The viewer of a page's clouds (cloud.js draws them), linked to its charts and tables. Scenes come as JSON
// (report/scenes.py).
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
  // Points in another order, by steps of the golden section: the first so many are spread over the whole cloud.
  const spread = (count) => {
    const common = (a, b) => (b ? common(b, a % b) : a);
    let step = Math.max(1, Math.round(0.618034 * count));
    while (common(count, step) > 1) step++;
    return Uint32Array.from({ length: count }, (_, k) => (k * step) % count);
  };
  const unpacked = new Map();
  const sceneAt = (number) => {
    if (!unpacked.has(number)) {
      const scene = data.scenes[number];
      const sides = scene.sides.map((side) => ({ ...side }));
      let order = null;
      const ordered = (values) => values.map((_, k) => values[order[k]]);
      for (const side of sides) {
        if (side.xyz) {
          const cells = decoded(side.xyz, Uint16Array);
          side.count = cells.length / 3;
          order = spread(side.count);
          side.points = new Float32Array(cells.length);
          for (let k = 0; k < cells.length; k++)
            side.points[k] = side.low[k % 3] + cells[3 * order[Math.floor(k / 3)] + (k % 3)] * side.step[k % 3];
          side.groups = Object.fromEntries(Object.entries(side.picks).map(([n, x]) => [n, ordered(decoded(x, Uint16Array))]));
        } else Object.assign(side, { points: sides[0].points, groups: sides[0].groups, count: sides[0].count });
        side.levels = Object.fromEntries(Object.entries(side.values).map(([n, x]) => [n, ordered(decoded(x, Uint8Array))]));
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

  const state = { scene: 0, channel: data.channels[0].name, wipe: 0.5, pick: null, figures: "" };
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
  const cloud = cloudOn(stage);
  byId("lost").hidden = !!cloud;
  const tonesOf = (side, lit) => {
    const levels = side.levels[state.channel], { ramp } = channelOf[state.channel];
    const table = Array.from({ length: 256 }, (_, level) => (level ? colour(ramp, (level - 1) / 254) : NONE));
    const tones = new Uint8Array(4 * side.count);
    for (let k = 0; k < side.count; k++) {
      tones.set(table[levels ? levels[k] : 0], 4 * k);
      tones[4 * k + 3] = lit[k];
    }
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
  // Rays that are lit, of the sides of the scene that is shown.
  let lit = [], shown = -1;
  const upload = () => {
    const scene = sceneAt(state.scene);
    lit = scene.sides.map(litOf);
    if (!cloud) return;
    if (shown !== state.scene) cloud.show(scene.sides, linesOf(scene));
    shown = state.scene;
    cloud.paint(scene.sides.map((side, k) => tonesOf(side, lit[k])));
  };
  const countLit = () => lit[0].reduce((sum, one) => sum + (one ? 1 : 0), 0);

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
  const view = () => ({ matrix: seenFrom, wipe: state.wipe, lit: !!state.pick });

  // The map of the channel: images that stand in the page already.
  const drawMap = () => {
    const found = ["before", "after"].map((side) => document.querySelector(`[data-map="${state.channel} ${side}"]`));
    const only = document.querySelector(`[data-map="${state.channel} residual"]`);
    byId("flat").hidden = !(found[0] || only);
    if (byId("flat").hidden) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    Object.assign(flat, { width: Math.round(flat.clientWidth * ratio), height: Math.round(flat.clientHeight * ratio) });
    const brush = flat.getContext("2d"), { width, height } = flat;
    brush.imageSmoothingEnabled = false;
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
    const { rows, columns, groups } = data.grid, cells = new Set(), side = sceneAt(state.scene).sides[0];
    for (let k = 0; k < side.count; k++)
      if (lit[0][k]) cells.add(side.groups.row[k] * groups + Math.floor((side.groups.column[k] * groups) / columns));
    brush.fillStyle = "rgba(20, 22, 26, 0.78)";
    const x = (k) => Math.round((k * width) / groups), y = (k) => Math.round((k * height) / rows);
    for (let row = 0; row < rows; row++)
      for (let group = 0; group < groups; group++)
        if (!cells.has(row * groups + group)) brush.fillRect(x(group), y(row), x(group + 1) - x(group), y(row + 1) - y(row));
  };

  // At most once a frame; a map is drawn again where it changes alone.
  let asked = 0;
  const MOVED = 1, WIPED = 2, CHANGED = 3;
  const draw = (what = CHANGED) => {
    if (!asked) requestAnimationFrame(() => {
      const most = asked;
      asked = 0;
      if (cloud) most === CHANGED ? cloud.draw(view()) : cloud.move(view());
      if (most > MOVED) { drawMap(); place(); }
    });
    asked = Math.max(asked, what);
  };
  const place = () => {
    const two = sceneAt(state.scene).sides.length > 1;
    byId("divide").hidden = !two;
    byId("divide").style.left = `${100 * state.wipe}%`;
    wipe.hidden = !two;
    sceneAt(state.scene).sides.forEach((side, k) => { byId(k ? "right" : "left").textContent = side.name; });
    // A side that the slider leaves no room has no name either.
    byId("left").hidden = two && state.wipe === 0;
    byId("right").hidden = !two || state.wipe === 1;
  };
  const scale = () => {
    const { ramp, low, high, unit } = channelOf[state.channel], brush = byId("scale").getContext("2d");
    for (let k = 0; k < 160; k++) {
      brush.fillStyle = `rgb(${colour(ramp, k / 159).map(Math.round).join(",")})`;
      brush.fillRect(k, 0, 1, 12);
    }
    byId("low").textContent = low; byId("high").textContent = `${high} ${unit}`;
  };
  const there = byId("there");
  let seesCloud = true, changed = false;
  new IntersectionObserver(([one]) => {
    seesCloud = one.isIntersecting;
    changed &&= !seesCloud;
    there.hidden = !changed;
  }).observe(byId("explorer"));
  const change = () => { upload(); scale(); draw(); say(); };

  // What is lit, in words and on the charts.
  const say = () => {
    const clouds = sceneAt(state.scene).sides.filter((side) => side.xyz);
    const counts = clouds.map((side) => (clouds.length > 1 ? `${side.name} ${side.count}` : side.count)).join(", ");
    const what = state.pick ? `${state.pick.words}: ${countLit()} of ${clouds[0].count} rays are lit` : `${counts} points`;
    const thinned = data.every > 1 ? ` To keep this page small, one point in ${data.every} is drawn.` : "";
    told.textContent = `${what} in ${sceneAt(state.scene).name}.${thinned}`;
    // Who clicks elsewhere on the page is told there, and led to the cloud.
    there.textContent = `${told.textContent} Show.`;
    there.hidden = seesCloud || !changed;
    for (const target of document.querySelectorAll(".target")) {
      const { chart } = target.dataset, index = +target.dataset.index;
      const on = chart === "scene" ? index === state.scene : chart === state.pick?.chart && index === state.pick.index;
      target.setAttribute("aria-pressed", String(on));
    }
    for (const one of document.querySelectorAll(".shows[role]"))
      one.setAttribute("aria-pressed", String(Object.entries(wanted(one)).every(([name, value]) => state[name] === value)));
    for (const figure of document.querySelectorAll("figure")) figure.classList.toggle("shown", !!figure.id && state.figures.split(" ").includes(figure.id));
  };
  // What a word of the page shows: a scene, a channel, figures.
  const wanted = ({ dataset }) => ({
    ...(dataset.scene && { scene: +dataset.scene }),
    ...(dataset.channel && { channel: dataset.channel }),
    ...(dataset.figures && { figures: dataset.figures }),
  });
  const show = (what) => {
    Object.assign(state, { figures: "" }, what);
    changed = true;
    byId("scene").value = state.scene; byId("channel").value = state.channel;
    change();
  };
  const pick = (what) => {
    const same = what && state.pick && JSON.stringify(what) === JSON.stringify(state.pick);
    state.pick = same ? null : what;
    changed = true;
    change();
  };

  for (const svg of document.querySelectorAll("svg")) {
    const targets = [...svg.querySelectorAll(".target")];
    targets.forEach((target, k) => {
      target.setAttribute("role", "button");
      target.setAttribute("tabindex", k ? "-1" : "0");
      const chosen = () => {
        const { chart } = target.dataset, index = +target.dataset.index;
        if (chart === "scene") { show({ scene: index }); return; }
        const channel = (target.closest("figure")?.id || "").split("_")[1];
        if (channel && channelOf[channel]) { state.channel = channel; byId("channel").value = channel; }
        pick({ chart, index, words: target.getAttribute("aria-label") });
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
  for (const one of document.querySelectorAll(".shows")) {
    if (one.dataset.channel && !channelOf[one.dataset.channel]) continue;
    one.setAttribute("role", "button"); one.setAttribute("tabindex", "0");
    const chosen = () => show(wanted(one));
    one.addEventListener("click", chosen);
    one.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); chosen(); }
    });
  }
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && (state.pick || state.figures)) { state.pick = null; show({}); }
  });

  data.scenes.forEach((scene, k) => byId("scene").add(new Option(scene.name, k)));
  data.channels.forEach((one) => byId("channel").add(new Option(one.words, one.name)));
  byId("scene").addEventListener("change", (event) => show({ scene: +event.target.value }));
  byId("channel").addEventListener("change", (event) => show({ channel: event.target.value }));
  wipe.addEventListener("input", () => { state.wipe = wipe.value / 100; draw(WIPED); });
  byId("reset").addEventListener("click", () => { Object.assign(camera, JSON.parse(start)); draw(MOVED); });
  byId("clear").addEventListener("click", () => { state.pick = null; show({}); });
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
    draw(MOVED);
  });
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY / 700)); draw(MOVED); }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (way) (event.shiftKey ? move : turn)(...way);
    else if (event.key === "+" || event.key === "=") zoom(0.9);
    else if (event.key === "-") zoom(1.1);
    else if (event.key === "0" || event.key === "Home") Object.assign(camera, JSON.parse(start));
    else return;
    event.preventDefault();
    draw(MOVED);
  });
  window.addEventListener("resize", () => draw());

  window.jaxsimViewer = {
    state,
    lit: countLit,
    rests: () => !asked && cloud.rests(),
    // Frames a second of a turn with every point, each finished before the next.
    speed: (frames) => {
      let ms = 0;
      for (let k = 0; k < frames; k++) { camera.turn += 0.02; ms += cloud.timed(view()); }
      return (1000 * frames) / ms;
    },
    // Frames a second of a turn as somebody sees it who drags, and the share of the points that it draws at its end.
    turning: (seconds) => new Promise((done) => {
      const begun = performance.now();
      let frames = 0;
      const step = () => {
        const now = performance.now();
        if (now - begun > 1000 * seconds) { done([(1000 * frames) / (now - begun), cloud.share()]); return; }
        frames++; camera.turn += 0.02;
        cloud.move(view());
        requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    }),
  };
  change();
})();
