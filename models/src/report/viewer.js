"use strict";
// Player of moving particles in plain WebGL. Lengths in metres, y up; a particle is a shaded disc, 1.24 spacings wide.
(() => {
  const byId = (id) => document.getElementById(id);
  const scene = JSON.parse(byId("scene").textContent);
  const canvas = byId("view");
  const gl = canvas.getContext("webgl", { antialias: true, stencil: true });
  if (!gl || scene.frames === 0 || scene.particles === 0) {
    byId("no-player").textContent = gl ? "No particles to show." :
      "The moving particles cannot be shown here: this browser gives the page no WebGL (is its graphics driver blocked?).";
    return;
  }

  const FIELD_OF_VIEW = 0.6; // vertical [rad]
  const HOLD = 0.8; // rest on the last frame before the motion starts again [s]
  const STEPS = 65534; // of the box along each axis; 65535 marks an absent particle

  // ---- small vectors --------------------------------------------------------------------------------------------
  const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((x) => x / (Math.hypot(...a) || 1));
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

  // ---- the scene ------------------------------------------------------------------------------------------------
  const bytes = (base64) => {
    const text = atob(base64);
    const list = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) list[i] = text.charCodeAt(i);
    return list;
  };
  const size = Math.max(...scene.extent, 2 * scene.spacing) || 1;
  const radius = scene.spacing > 0 ? 0.62 * scene.spacing : 0.01 * size;
  const centre = scene.low.map((x, i) => x + scene.extent[i] / 2);
  const hasGround = scene.ground !== null;
  const cameras = scene.cameras.filter((rows) => rows.flat().every((x) => x !== null));
  const eyeOf = (rows) => rows.map((row) => row[3]);
  const gridStep = (() => {
    const rough = size / 8, decade = 10 ** Math.floor(Math.log10(rough));
    return decade * [1, 2, 5, 10].find((m) => m * decade >= rough);
  })();

  const groundLines = () => {
    const vertices = [], reach = Math.ceil((1.5 * size) / gridStep), parts = 6 * reach;
    const [cx, cz] = [centre[0], centre[2]].map((x) => Math.round(x / gridStep) * gridStep);
    const put = (x, z) => {
      const r = Math.hypot(x - centre[0], z - centre[2]) / (reach * gridStep);
      vertices.push(x, scene.ground, z, 0.7 * clamp(1 - r, 0, 1));
    };
    for (let line = -reach; line <= reach; line++) {
      for (let part = 0; part < parts; part++) {
        for (const end of [part, part + 1]) {
          const along = (2 * end / parts - 1) * reach * gridStep;
          put(cx + line * gridStep, cz + along);
        }
        for (const end of [part, part + 1]) {
          const along = (2 * end / parts - 1) * reach * gridStep;
          put(cx + along, cz + line * gridStep);
        }
      }
    }
    return vertices;
  };

  const frustumLines = () => {
    const vertices = [];
    for (const rows of cameras) {
      const depth = 0.12 * size;
      const at = (x, y, z) => rows.map((r) => r[3] + depth * (r[0] * x + r[1] * y + r[2] * z));
      const [a, b, c, d] = [[-0.5, -0.375], [0.5, -0.375], [0.5, 0.375], [-0.5, 0.375]].map(([x, y]) => at(x, y, -1));
      const eye = at(0, 0, 0), [left, tip, right] = [at(-0.18, 0.43, -1), at(0, 0.62, -1), at(0.18, 0.43, -1)];
      const edges = [eye, a, eye, b, eye, c, eye, d, a, b, b, c, c, d, d, a, left, tip, tip, right, right, left];
      for (const point of edges) vertices.push(...point, 0.9);
    }
    return vertices;
  };

  // ---- what the graphics card holds -----------------------------------------------------------------------------
  const PARTICLE_VERTEX = `
    attribute vec3 now, next, tint;
    uniform mat4 clip;
    uniform vec3 low, extent;
    uniform float blend, pixels, floorHeight;
    uniform mediump float shadow;
    varying vec3 colour;
    void main() {
      colour = tint;
      vec3 p = low + extent * mix(now, next, blend);
      if (shadow > 0.5) p.y = floorHeight;
      gl_Position = clip * vec4(p, 1.0);
      gl_PointSize = max(pixels / gl_Position.w, 1.5);
      if (max(now.x, next.x) > 0.999992) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    }`;
  const PARTICLE_FRAGMENT = `
    precision mediump float;
    uniform mediump float shadow;
    varying vec3 colour;
    void main() {
      vec2 c = 2.0 * gl_PointCoord - 1.0;
      float r2 = dot(c, c);
      if (r2 > 1.0) discard;
      vec3 normal = vec3(c.x, -c.y, sqrt(1.0 - r2));
      float light = 0.62 + 0.46 * max(dot(normal, normalize(vec3(-0.45, 0.75, 0.6))), 0.0);
      vec3 shaded = colour * light * (1.0 - 0.25 * r2 * r2);
      gl_FragColor = shadow > 0.5 ? vec4(0.0, 0.0, 0.0, 0.28) : vec4(shaded, 1.0);
    }`;
  const LINE_VERTEX = `
    attribute vec4 vertex;
    uniform mat4 clip;
    varying float strength;
    void main() {
      strength = vertex.w;
      gl_Position = clip * vec4(vertex.xyz, 1.0);
    }`;
  const LINE_FRAGMENT = `
    precision mediump float;
    uniform vec3 ink;
    varying float strength;
    void main() { gl_FragColor = vec4(ink * strength, strength); }`;

  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made) || "no program");
    return { made, slot: (n) => gl.getAttribLocation(made, n), uniform: (n) => gl.getUniformLocation(made, n) };
  };
  const buffer = (data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  };
  const lineBuffer = (list) => ({ count: list.length / 4, data: buffer(new Float32Array(list)) });
  const upload = () => ({
    particles: program(PARTICLE_VERTEX, PARTICLE_FRAGMENT),
    lines: program(LINE_VERTEX, LINE_FRAGMENT),
    positions: buffer(bytes(scene.positions)),
    colours: buffer(bytes(scene.colours)),
    ground: lineBuffer(hasGround ? groundLines() : []),
    frustums: lineBuffer(frustumLines()),
  });
  let held = upload();

  // ---- the view -------------------------------------------------------------------------------------------------
  const view = { target: centre, yaw: 0.6, pitch: 0.35, distance: 1 };
  let dirty = true, shown = false;

  const corners = () => {
    const [low, high] = [[...scene.low], add(scene.low, scene.extent)];
    if (hasGround && scene.ground > low[1] - size) low[1] = Math.min(low[1], scene.ground);
    return [0, 1, 2, 3, 4, 5, 6, 7].map((n) => [0, 1, 2].map((i) => ((n >> i) & 1 ? high : low)[i]));
  };
  // The least distance from which all points are inside the picture, with a margin.
  const fit = (points) => {
    const { back, right, up } = axes();
    const slope = 0.86 * Math.tan(FIELD_OF_VIEW / 2), aspect = canvas.clientWidth / canvas.clientHeight || 1;
    const needed = points.map((point) => {
      const p = add(point, view.target, -1);
      return dot(p, back) + Math.max(Math.abs(dot(p, up)), Math.abs(dot(p, right)) / aspect) / slope;
    });
    view.distance = Math.max(...needed, size);
    dirty = true;
  };
  const home = () => {
    Object.assign(view, { target: centre, yaw: 0.6, pitch: 0.35 });
    if (cameras.length > 0) {
      const [x, y, z] = unit(add(eyeOf(cameras[0]), centre, -1));
      Object.assign(view, { yaw: Math.atan2(x, z), pitch: clamp(Math.asin(clamp(y, -1, 1)), 0.22, 1.2) });
    }
    fit(corners());
  };
  const showAll = () => {
    view.target = centre;
    fit([...corners(), ...cameras.map(eyeOf)]);
  };
  const axes = () => {
    const { yaw, pitch } = view;
    const back = [Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch), Math.cos(pitch) * Math.cos(yaw)];
    const right = unit(cross([0, 1, 0], back));
    return { back, right, up: cross(back, right) };
  };
  const clipMatrix = () => {
    const { back, right, up } = axes();
    const eye = add(view.target, back, view.distance);
    const f = 1 / Math.tan(FIELD_OF_VIEW / 2), aspect = canvas.width / canvas.height;
    const near = 0.02 * view.distance, far = 4 * (view.distance + 2 * size);
    const depth = (far + near) / (near - far), shift = (2 * far * near) / (near - far);
    const column = (i) => [(f / aspect) * right[i], f * up[i], depth * back[i], -back[i]];
    const [rx, uy, bz] = [right, up, back].map((axis) => -dot(axis, eye));
    return [...column(0), ...column(1), ...column(2), (f / aspect) * rx, f * uy, depth * bz + shift, -bz];
  };
  const orbit = (dx, dy) => {
    view.yaw -= dx;
    view.pitch = clamp(view.pitch + dy, -0.25, 1.55);
    dirty = true;
  };
  const zoom = (factor) => {
    view.distance = clamp(view.distance * factor, 0.05 * size, 200 * size);
    dirty = true;
  };
  const pan = (dx, dy) => {
    const { right, up } = axes();
    const metres = (2 * view.distance * Math.tan(FIELD_OF_VIEW / 2)) / canvas.clientHeight;
    view.target = add(add(view.target, right, -dx * metres), up, dy * metres);
    dirty = true;
  };

  // ---- drawing --------------------------------------------------------------------------------------------------
  const ink = (name) => {
    const hex = getComputedStyle(canvas).getPropertyValue(name).trim();
    return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255 || 0);
  };
  const drawLines = (lines, clip, name) => {
    if (lines.count === 0) return;
    const { made, slot, uniform } = held.lines;
    gl.useProgram(made);
    gl.uniformMatrix4fv(uniform("clip"), false, clip);
    gl.uniform3fv(uniform("ink"), ink(name));
    gl.bindBuffer(gl.ARRAY_BUFFER, lines.data);
    gl.enableVertexAttribArray(slot("vertex"));
    gl.vertexAttribPointer(slot("vertex"), 4, gl.FLOAT, false, 0, 0);
    gl.drawArrays(gl.LINES, 0, lines.count);
  };
  const drawParticles = (clip, shadow) => {
    const { made, slot, uniform } = held.particles;
    const frame = Math.min(Math.floor(clock.frame), scene.frames - 1), next = Math.min(frame + 1, scene.frames - 1);
    gl.useProgram(made);
    gl.uniformMatrix4fv(uniform("clip"), false, clip);
    gl.uniform3fv(uniform("low"), scene.low);
    gl.uniform3fv(uniform("extent"), scene.extent.map((x) => (x * 65535) / STEPS));
    gl.uniform1f(uniform("blend"), clock.frame - frame);
    const drawn = shadow ? 1.2 * radius : radius; // wide enough for the shadow of a grid to have no holes
    gl.uniform1f(uniform("pixels"), (drawn * canvas.height) / Math.tan(FIELD_OF_VIEW / 2));
    gl.uniform1f(uniform("floorHeight"), scene.ground || 0);
    gl.uniform1f(uniform("shadow"), shadow ? 1 : 0);
    const feed = (name, data, type, bytesEach, offset) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(slot(name));
      gl.vertexAttribPointer(slot(name), 3, type, true, bytesEach, offset);
    };
    feed("now", held.positions, gl.UNSIGNED_SHORT, 6, frame * scene.particles * 6);
    feed("next", held.positions, gl.UNSIGNED_SHORT, 6, next * scene.particles * 6);
    feed("tint", held.colours, gl.UNSIGNED_BYTE, 3, 0);
    gl.drawArrays(gl.POINTS, 0, scene.particles);
  };
  const draw = () => {
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * scale)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const clip = clipMatrix();
    gl.depthMask(false);
    if (hasGround && view.pitch > 0) {
      // The stencil lets every pixel be darkened only once, so that the shadow is even.
      gl.enable(gl.STENCIL_TEST);
      gl.stencilFunc(gl.EQUAL, 0, 255);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      drawParticles(clip, true);
      gl.disable(gl.STENCIL_TEST);
    }
    drawLines(held.ground, clip, "--grid");
    gl.depthMask(true);
    drawParticles(clip, false);
    if (byId("cameras").checked) drawLines(held.frustums, clip, "--accent");
  };

  // ---- time -----------------------------------------------------------------------------------------------------
  const last = scene.frames - 1;
  const dt = scene.dt > 0 ? scene.dt : 0.1;
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const clock = { frame: 0, playing: last > 0 && !calm, rest: 0, speed: 1 };
  const showClock = () => {
    const frame = Math.round(clock.frame), seconds = (clock.frame * dt).toFixed(dt < 0.0095 ? 4 : 3);
    const counted = `frame ${frame + 1} of ${scene.frames}`;
    byId("clock").textContent = scene.dt > 0 ? `${seconds} s · ${counted}` : counted;
    byId("time").value = clock.frame;
    byId("play").textContent = clock.playing ? "Pause" : "Play";
  };
  const advance = (elapsed) => {
    if (clock.frame < last) {
      clock.frame = Math.min(last, clock.frame + (elapsed * clock.speed) / dt);
      clock.rest = 0;
    } else if ((clock.rest += elapsed) > HOLD) {
      clock.frame = 0;
    }
    dirty = true;
  };
  const togglePlay = () => { clock.playing = !clock.playing && last > 0; dirty = true; };

  const speeds = [1, 1 / 2, 1 / 4, 1 / 10, 1 / 20];
  const names = ["1×", "½×", "¼×", "1/10×", "1/20×"];
  names.forEach((name, i) => byId("speed").add(new Option(name, speeds[i])));
  clock.speed = scene.dt > 0 ? speeds.find((s) => (last * dt) / s >= 2.5) || 1 / 20 : 1;
  byId("speed").value = clock.speed;
  byId("speed").onchange = (event) => { clock.speed = Number(event.target.value); };
  byId("time").max = last;
  byId("time").disabled = byId("play").disabled = last === 0;
  byId("time").oninput = (event) => {
    Object.assign(clock, { frame: Number(event.target.value), playing: false });
    dirty = true;
  };
  byId("play").onclick = togglePlay;

  // ---- hands ----------------------------------------------------------------------------------------------------
  const fingers = new Map();
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
  canvas.onpointermove = (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const after = [event.clientX, event.clientY], dx = after[0] - before[0], dy = after[1] - before[1];
    const other = [...fingers].find(([id]) => id !== event.pointerId);
    fingers.set(event.pointerId, after);
    if (other) {
      const gap = (p) => Math.max(1, Math.hypot(p[0] - other[1][0], p[1] - other[1][1]));
      zoom(gap(before) / gap(after));
      pan(dx / 2, dy / 2);
    } else if (event.shiftKey || (event.buttons & 6) !== 0) {
      pan(dx, dy);
    } else {
      orbit(0.007 * dx, 0.007 * dy);
    }
  };
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.ondblclick = home;
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY * (event.deltaMode === 1 ? 0.04 : 0.0012), -0.5, 0.5)));
  }, { passive: false });
  canvas.onkeydown = (event) => {
    const keys = {
      ArrowLeft: () => orbit(0.1, 0), ArrowRight: () => orbit(-0.1, 0), ArrowUp: () => orbit(0, 0.1),
      ArrowDown: () => orbit(0, -0.1), "+": () => zoom(0.9), "-": () => zoom(1 / 0.9), " ": togglePlay,
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  };
  byId("home").onclick = home;
  byId("cameras").onchange = (event) => (event.target.checked ? showAll() : home());
  byId("cameras-label").hidden = cameras.length === 0;
  canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); held = null; });
  canvas.addEventListener("webglcontextrestored", () => { held = upload(); dirty = true; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
  new ResizeObserver(() => { dirty = true; }).observe(canvas);

  // ---- begin ----------------------------------------------------------------------------------------------------
  const absent = scene.absent > 0 ? ` ${scene.absent} positions are not finite and left out.` : "";
  byId("legend").textContent =
    `${scene.particles} particles${hasGround ? `, ground grid every ${Number(gridStep.toPrecision(1))} m` : ""}. ` +
    `Drag to turn, wheel or pinch to zoom, shift-drag or two fingers to move, double-click to reset.${absent}`;
  byId("player").hidden = false;
  byId("no-player").hidden = true;
  showClock();
  let before = null;
  const tick = (now) => {
    const elapsed = before === null ? 0 : Math.min(0.1, (now - before) / 1000);
    before = now;
    if (!shown && canvas.clientWidth > 0) { shown = true; home(); }
    if (clock.playing) advance(elapsed);
    if (dirty && held) { dirty = false; draw(); showClock(); }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
})();
