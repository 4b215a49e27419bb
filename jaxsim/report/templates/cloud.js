"use strict";
// Draws clouds by WebGL, without a library. While a view moves it draws as many points as the machine does in time, spread
// over the whole cloud, and all of them as soon as it rests.
const cloudOn = (stage) => {
  // A colour's fourth part says whether the point is lit.
  const VERTEX = `attribute vec3 place; attribute vec4 tone;
    uniform mat4 seen; uniform float size; uniform float picked; varying vec3 paint;
    void main() {
      gl_Position = seen * vec4(place, 1.0);
      gl_PointSize = clamp(size / max(gl_Position.w, 0.1), 1.5, 9.0) * mix(1.0, 1.5, tone.a * picked);
      paint = tone.rgb * mix(1.0, 0.22 + 0.78 * tone.a, picked);
    }`;
  const FRAGMENT = `precision mediump float; varying vec3 paint; void main() { gl_FragColor = vec4(paint, 1.0); }`;
  const IN_TIME_MS = 22, FEWEST = 20_000, RESTS_AFTER_MS = 200;

  // Without smoothed edges: in software they take two thirds of the time, and points are square as it is.
  const gl = stage.getContext("webgl", { antialias: false });
  if (!gl) return null;
  const made = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader);
    return shader;
  };
  const program = gl.createProgram();
  gl.attachShader(program, made(gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, made(gl.FRAGMENT_SHADER, FRAGMENT));
  gl.bindAttribLocation(program, 0, "place"); gl.bindAttribLocation(program, 1, "tone");
  gl.linkProgram(program); gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST); gl.enableVertexAttribArray(0); gl.enableVertexAttribArray(1);
  gl.clearColor(0.043, 0.047, 0.055, 1);
  const [seen, size, picked] = ["seen", "size", "picked"].map((name) => gl.getUniformLocation(program, name));
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  const software = /swiftshader|llvmpipe|softpipe|software/i.test(told ? gl.getParameter(told.UNMASKED_RENDERER_WEBGL) : "");

  const filled = (content) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, content, gl.STATIC_DRAW);
    return buffer;
  };
  // Places are those of a scene, and stay on the card while it is shown; colours change.
  let sides = [], lines = null;
  const released = (...buffers) => buffers.forEach((one) => one && gl.deleteBuffer(one));
  const show = (clouds, drawn) => {
    released(...new Set(sides.map((one) => one.place)), ...sides.map((one) => one.tone), lines?.place, lines?.tone);
    const placed = new Map();
    sides = clouds.map(({ points, count }) => {
      if (!placed.has(points)) placed.set(points, filled(points));
      return { place: placed.get(points), tone: null, count };
    });
    lines = { place: filled(drawn.places), tone: filled(drawn.tones), count: drawn.places.length / 3 };
  };
  const paint = (tones) => sides.forEach((side, k) => { released(side.tone); side.tone = filled(tones[k]); });

  // The canvas's own pixels: as fine as the screen's, but fewer where each of them costs time.
  const resized = (moving) => {
    const ratio = software ? (moving ? 0.5 : 1) : Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(stage.clientWidth * ratio), height = Math.round(stage.clientHeight * ratio);
    if (stage.width !== width || stage.height !== height) Object.assign(stage, { width, height });
    return ratio;
  };
  // `matrix` is a function of the canvas's width over its height; `wipe` the share of it that the first side has.
  const draw = ({ matrix, wipe, lit }, { share = 1, moving = false } = {}) => {
    const ratio = resized(moving), { width, height } = stage;
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(seen, false, matrix(width / Math.max(height, 1)));
    // Fewer points, larger ones: surfaces stay closed.
    gl.uniform1f(size, (60 * ratio) / Math.sqrt(Math.max(share, 0.25)));
    const put = (one, mode, count) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, one.place); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ARRAY_BUFFER, one.tone); gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 0, 0);
      gl.drawArrays(mode, 0, count);
    };
    gl.uniform1f(picked, 0);
    put(lines, gl.LINES, lines.count);
    gl.uniform1f(picked, lit ? 1 : 0);
    gl.enable(gl.SCISSOR_TEST);
    const cut = sides.length > 1 ? Math.round(width * wipe) : width;
    sides.forEach((side, k) => {
      const wide = k ? width - cut : cut;
      if (wide <= 0) return;
      gl.scissor(k ? cut : 0, 0, wide, height);
      put(side, gl.POINTS, Math.ceil(side.count * share));
    });
  };
  const pixel = new Uint8Array(4);
  // Draws, and waits until it is drawn: milliseconds.
  const timed = (view, how) => {
    const begun = performance.now();
    draw(view, how);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - begun;
  };

  let share = 1, rest = 0;
  const most = () => Math.max(...sides.map((side) => side.count), 1);
  const settle = () => { clearTimeout(rest); rest = 0; };
  // What is drawn whole is newer than what a rest would draw: nothing may come after it.
  const whole = (view) => { settle(); draw(view); };
  const move = (view) => {
    const took = timed(view, { share, moving: true }), fewest = Math.min(1, FEWEST / most());
    share = Math.min(1, Math.max(fewest, share * Math.min(Math.max(IN_TIME_MS / took, 0.5), 1.25)));
    settle();
    rest = setTimeout(() => whole(view), RESTS_AFTER_MS);
  };
  return { show, paint, draw: whole, move, timed, share: () => share, rests: () => !rest };
};
