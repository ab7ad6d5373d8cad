// The room in three dimensions: bodies and furniture as triangles, paths and edges as lines of a width, names over them. WebGL 2 alone.

const LEFT = [1, .55, .26], RIGHT = [.34, .71, .91], TRUNK = [.79, .8, .82], OTHER = [.66, .6, .85], FOUND = [.72, 1, .2];
const ORDERS = [[1, 1, 1], [.94, .89, .26], [.12, .78, .59], [.84, .56, .75]];
const NEAR = .05, TANGENT = .42, SHADOW = 512, MOST_PARTS = 64;

const SOLID = [`#version 300 es
in vec3 a, b; in float part; uniform float f; uniform vec3 low, pitch; uniform mat4 view, light;
out vec3 at; out vec4 shade; flat out int owner;
void main() { at = low + pitch * mix(a, b, f); gl_Position = view * vec4(at, 1); shade = light * vec4(at, 1); owner = int(part + .5); }`,
`#version 300 es
precision highp float; precision highp sampler2DShadow;
in vec3 at; in vec4 shade; flat in int owner;
uniform vec3 eye, radar; uniform vec4 colours[${MOST_PARTS}]; uniform sampler2DShadow depth; uniform float alpha, known, bias;
out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(at), dFdy(at)));  // towards the viewer
  vec4 own = colours[owner];
  float visible = dot(normal, normalize(radar - at)) > 0. ? 1. : 0.;
  if (own.a > 0. && known > .5 && visible > 0.) visible = textureProj(depth, vec4(shade.xy * .5 + shade.w * .5, shade.z * .5 + shade.w * (.5 - bias), shade.w));
  float lamp = .62 + .38 * abs(dot(normal, normalize(eye - at)));
  float light = own.a > 1. ? 1. : alpha < 1. || own.a < 0. ? .8 : mix(.3, 1., visible);
  colour = vec4(own.rgb * light * lamp, alpha);
}`];
const DARK = [SOLID[0], `#version 300 es
precision mediump float; out vec4 colour; void main() { colour = vec4(1); }`];
const LINE = [`#version 300 es
in vec2 corner; in vec3 p, q; in vec4 hue; in float width; uniform mat4 view; uniform vec2 size; out vec4 h;
void main() {
  vec4 P = view * vec4(p, 1), Q = view * vec4(q, 1);
  if (P.w < ${NEAR} && Q.w < ${NEAR}) { gl_Position = vec4(2, 2, 2, 1); return; }
  if (P.w < ${NEAR}) P = mix(P, Q, (${NEAR} - P.w) / (Q.w - P.w));
  if (Q.w < ${NEAR}) Q = mix(Q, P, (${NEAR} - Q.w) / (P.w - Q.w));
  vec2 d = (Q.xy / Q.w - P.xy / P.w) * size; d /= max(length(d), 1e-6);
  vec4 c = corner.x < .5 ? P : Q;
  c.xy += vec2(-d.y, d.x) * corner.y * width / size * c.w; gl_Position = c; h = hue;
}`, `#version 300 es
precision mediump float; in vec4 h; out vec4 colour; void main() { colour = h; }`];

const SOFTWARE = (() => {  // where no graphics card draws, smooth edges cost as much as all else
  const gl = document.createElement("canvas").getContext("webgl2"), told = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !told || /swiftshader|llvmpipe|software/i.test(gl.getParameter(told.UNMASKED_RENDERER_WEBGL));
})();

const penOf = (canvas, alpha = false) => canvas.getContext("2d", { alpha, willReadFrequently: SOFTWARE });

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]], dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => { const l = Math.hypot(...a) || 1; return a.map(x => x / l); };
const blend = (a, b, f) => a.map((x, i) => x + f * (b[i] - x));

function product(a, b) {  // matrices by columns: a b
  const c = new Float32Array(16);
  for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) c[4 * i + j] += a[4 * k + j] * b[4 * i + k];
  return c;
}

function lookAt(eye, centre, tangent, aspect, near, far) {  // perspective whose upper edge is at that tangent
  const z = unit(sub(eye, centre)), x = unit(cross(Math.abs(z[2]) > .999 ? [1, 0, 0] : [0, 0, 1], z)), y = cross(z, x);
  const world = [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
  const lens = [1 / tangent / aspect, 0, 0, 0, 0, 1 / tangent, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
  return product(lens, world);
}

class Room {
  constructor(box, recording) {
    this.recording = recording;
    const stage = box.appendChild(document.createElement("div"));
    stage.className = "stage";
    this.canvas = stage.appendChild(document.createElement("canvas"));
    this.over = stage.appendChild(document.createElement("canvas"));
    this.over.className = "over";
    const gl = this.gl = this.canvas.getContext("webgl2", { antialias: !SOFTWARE, alpha: false });
    if (!gl) throw new Error("this browser has no WebGL 2; take a newer one, or switch its hardware acceleration on");
    [this.solid, this.dark, this.line] = [SOLID, DARK, LINE].map(text => this.program(...text));
    this.targets = recording.targets.map(each => this.mesh(each));
    const furniture = recording.surfaces.filter(each => !each.shell);
    this.furniture = this.still(furniture.map(each => each.triangles));
    this.shell = recording.surfaces.filter(each => each.shell).map(each => ({ ...this.still([each.triangles]), inward: each.inward, offset: each.offset, floor: each.floor }));
    this.fixed = this.lines([...this.edges(), ...this.beam()]);
    this.moving = this.lines([]);
    this.shadow = this.shadowMap();
  }

  program(vertex, fragment) {
    const gl = this.gl, made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    ["a", "b", "part"].forEach((name, place) => gl.bindAttribLocation(made, place, name));
    gl.linkProgram(made);
    const uniforms = {};
    for (let i = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) {
      const name = gl.getActiveUniform(made, i).name.replace("[0]", "");
      uniforms[name] = gl.getUniformLocation(made, name);
    }
    return { made, uniforms };
  }

  buffer(values, kind = this.gl.ARRAY_BUFFER) {
    const gl = this.gl, made = gl.createBuffer();
    gl.bindVertexArray(null); gl.bindBuffer(kind, made); gl.bufferData(kind, values, gl.STATIC_DRAW);
    return made;
  }

  mesh(target) {  // frames one after another in one buffer, of which two neighbours are blended
    const { gl } = this;
    return {
      ...target, count: target.faces.length, array: gl.createVertexArray(), buffer: this.buffer(target.vertices),
      owners: this.buffer(Float32Array.from(target.owner)), tints: target.tint && this.buffer(Float32Array.from(target.tint, k => Math.min(k, MOST_PARTS - 1))), index: this.buffer(Uint32Array.from(target.faces), gl.ELEMENT_ARRAY_BUFFER),
    };
  }

  still(parts) {
    const { gl } = this, all = new Float32Array(parts.reduce((n, each) => n + each.length, 0));
    parts.reduce((n, each) => (all.set(each, n), n + each.length), 0);
    const array = gl.createVertexArray(), made = this.buffer(all);
    gl.bindVertexArray(array); gl.bindBuffer(gl.ARRAY_BUFFER, made);
    for (const place of [0, 1]) { gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0); }
    gl.vertexAttrib1f(2, 0);
    return { array, count: all.length / 3 };
  }

  lines(list) {  // each line: start, end, colour with opacity, width in pixels
    const { gl } = this, array = gl.createVertexArray(), corners = this.buffer(new Float32Array([0, -1, 0, 1, 1, -1, 1, 1])), made = this.buffer(this.packed(list));
    gl.bindVertexArray(array);
    const put = (name, buffer, size, stride, offset, divisor) => {
      const place = gl.getAttribLocation(this.line.made, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset); gl.vertexAttribDivisor(place, divisor);
    };
    put("corner", corners, 2, 0, 0, 0);
    [["p", 3, 0], ["q", 3, 12], ["hue", 4, 24], ["width", 1, 40]].forEach(([name, size, offset]) => put(name, made, size, 44, offset, 1));
    return { array, made, count: list.length };
  }

  packed(list) {
    const values = new Float32Array(11 * list.length);
    list.forEach(([p, q, hue, width], i) => values.set([...p, ...q, ...hue, width], 11 * i));
    return values;
  }

  edges() {
    const found = [], { low, high } = this.recording.bounds;
    for (const { edges, shell } of this.recording.surfaces)
      for (let i = 0; i < edges.length; i += 6) found.push([edges.slice(i, i + 3), edges.slice(i + 3, i + 6), shell ? [.55, .6, .68, .55] : [.5, .53, .58, .8], 1]);
    const floor = this.recording.floor_m + .002, [x0, y0] = low.map(Math.ceil), [x1, y1] = high.map(Math.floor);
    const few = Math.max(1, Math.ceil(Math.max(x1 - x0, y1 - y0) / 20));  // a line each metre, of large places each few metres
    for (let x = x0; x <= x1; x += few) found.push([[x, low[1], floor], [x, high[1], floor], [.35, .38, .44, .5], 1]);
    for (let y = y0; y <= y1; y += few) found.push([[low[0], y, floor], [high[0], y, floor], [.35, .38, .44, .5], 1]);
    for (const axis of [0, 1]) found.push([this.origin(), this.origin(axis, 1), [.9, .9, .9, .9], 2]);
    return found;
  }

  origin(axis = 0, reach = 0) {  // of the axes x and y on the floor, in a corner of it
    const { low } = this.recording.bounds;
    return [0, 1].map(k => low[k] + .15 + (k == axis ? reach : 0)).concat(this.recording.floor_m + .004);
  }

  beam() {  // the radar's housing, its boresight, and the rim of its half-power beam
    const { position: p, axes: [forward, left, up], beam_deg: beam } = this.recording.radar, red = [1, .35, .35, 1], found = [];
    const at = (x, y, z) => p.map((c, i) => c + x * forward[i] + y * left[i] + z * up[i]);
    const rim = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([y, z]) => at(0, .06 * y, .06 * z));
    rim.forEach((c, i) => found.push([c, rim[(i + 1) % 4], red, 3]));
    found.push([p, at(beam ? .35 : .5, 0, 0), red, 3]);
    if (!beam) return found;
    const reach = 1, [wide, high] = beam.map(each => Math.tan(Math.min(each, 150) / 360 * Math.PI));
    const round = Array.from({ length: 33 }, (_, i) => { const a = i / 16 * Math.PI, y = wide * Math.cos(a), z = high * Math.sin(a), l = reach / Math.hypot(1, y, z); return at(l, l * y, l * z); });
    for (let i = 0; i < 32; i++) { found.push([round[i], round[i + 1], [1, .35, .35, .5], 1.5]); if (i % 4 == 0) found.push([p, round[i], [1, .35, .35, .35], 1]); }
    return found;
  }

  shadowMap() {
    const { gl } = this, texture = gl.createTexture(), frame = gl.createFramebuffer();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.DEPTH_COMPONENT24, SHADOW, SHADOW, 0, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null);
    for (const [name, value] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"], ["COMPARE_MODE", "COMPARE_REF_TO_TEXTURE"], ["COMPARE_FUNC", "LEQUAL"]])
      gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + name], gl[value]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return { texture, frame };
  }

  centres(time) {  // middle and radius of each target then
    return this.targets.map(({ middles, radii, frames, every }) => {
      const at = time * this.recording.frames_hz / every, k = Math.min(frames - 1, Math.floor(at)), n = Math.min(frames - 1, k + 1), f = Math.min(1, at - k);
      return { middle: blend(Array.from(middles.subarray(3 * k, 3 * k + 3)), Array.from(middles.subarray(3 * n, 3 * n + 3)), f), radius: Math.max(radii[k], radii[n]) };
    });
  }

  lamp(time) {  // the radar's view of all targets; null where they stand all around it
    const { position } = this.recording.radar, all = this.centres(time);
    if (!all.length) return null;
    const middle = all.reduce((sum, each) => sum.map((x, i) => x + each.middle[i] / all.length), [0, 0, 0]);
    const ahead = unit(sub(middle, position));
    let wide = 0, near = Infinity, far = 0;
    for (const each of all) {
      const away = sub(each.middle, position), distance = Math.hypot(...away);
      wide = Math.max(wide, Math.acos(Math.min(1, dot(unit(away), ahead))) + Math.asin(Math.min(1, each.radius / distance)));
      near = Math.min(near, distance - each.radius); far = Math.max(far, distance + each.radius);
    }
    if (wide > 1.3 || near < .05) return null;
    const first = Math.max(.05, .3 * near * Math.cos(wide)), last = 1.05 * far, distance = (near + far) / 2;
    const bias = .015 * first * last / (distance * distance * (last - first));  // 15 mm
    return { matrix: lookAt(position, middle, Math.tan(wide) * 1.02, 1, first, last), bias };
  }

  view(camera) {
    const { yaw, pitch, distance, centre } = camera, c = Math.cos(pitch);
    const eye = [centre[0] + distance * c * Math.cos(yaw), centre[1] + distance * c * Math.sin(yaw), centre[2] + distance * Math.sin(pitch)];
    return { eye, matrix: lookAt(eye, centre, TANGENT, this.canvas.width / this.canvas.height, NEAR, 4 * distance + 60) };
  }

  drawSolids(program, time, camera, lamp, state) {
    const { gl } = this, { uniforms: u } = program, rec = this.recording;
    gl.useProgram(program.made);
    gl.uniformMatrix4fv(u.view, false, camera.matrix);
    const whole = (low, pitch) => { gl.uniform3fv(u.low, low); gl.uniform3fv(u.pitch, pitch); };
    if (program === this.solid) {
      gl.uniformMatrix4fv(u.light, false, lamp ? lamp.matrix : new Float32Array(16));
      gl.uniform3fv(u.eye, camera.eye); gl.uniform3fv(u.radar, rec.radar.position);
      gl.uniform1f(u.known, lamp ? 1 : 0); gl.uniform1f(u.bias, lamp ? lamp.bias : 0); gl.uniform1f(u.alpha, 1);
    }
    for (const target of this.targets) {
      const at = Math.max(0, Math.min(target.frames - 1, time * rec.frames_hz / target.every)), k = Math.min(target.frames - 1, Math.floor(at)), n = Math.min(target.frames - 1, k + 1), size = 6 * target.vertices.length / 3 / target.frames;
      gl.bindVertexArray(target.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, target.buffer);
      for (const [place, frame] of [[0, k], [1, n]]) { gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, 3, gl.UNSIGNED_SHORT, false, 0, frame * size); }
      gl.bindBuffer(gl.ARRAY_BUFFER, program === this.solid && this.tinted(target, state) ? target.tints : target.owners); gl.enableVertexAttribArray(2); gl.vertexAttribPointer(2, 1, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, target.index);
      gl.uniform1f(u.f, at - k); whole(target.low, target.pitch);
      if (program === this.solid) gl.uniform4fv(u.colours, this.colours(target, state));
      gl.drawElements(gl.TRIANGLES, target.count, gl.UNSIGNED_INT, 0);
    }
    whole([0, 0, 0], [1, 1, 1]); gl.uniform1f(u.f, 0);
    if (this.furniture.count) {
      if (program === this.solid) gl.uniform4fv(u.colours, [.4, .43, .48, -1]);
      gl.bindVertexArray(this.furniture.array); gl.drawArrays(gl.TRIANGLES, 0, this.furniture.count);
    }
    if (program !== this.solid) return;
    gl.enable(gl.BLEND); gl.depthMask(false);
    for (const wall of this.shell) {  // from outside one looks through
      if (dot(wall.inward, camera.eye) < wall.offset) continue;
      gl.uniform1f(u.alpha, wall.floor ? .9 : .22); gl.uniform4fv(u.colours, wall.floor ? [.16, .18, .21, -1] : [.4, .46, .55, -1]);
      gl.bindVertexArray(wall.array); gl.drawArrays(gl.TRIANGLES, 0, wall.count);
    }
    gl.depthMask(true);
  }

  tinted(target, { split }) { return split && state.tinted && target.tints; }

  colours(target, panel) {
    const found = new Float32Array(4 * MOST_PARTS), some = panel.parts.size > 0, { split, lit } = panel;
    if (this.tinted(target, panel)) {
      found.set([...OTHER.map(c => .5 * c), 1], 4 * (MOST_PARTS - 1));
      split.rgb.forEach((own, k) => found.set(!split.on.has(k) ? [.2, .21, .23, 1] : lit.has(k) ? [...own.map(c => c / 255), 2] : [...own.map(c => (lit.size ? .5 : 1) * c / 255), 1], 4 * k));
      return found;
    }
    this.recording.parts.slice(target.first, target.first + target.parts).forEach(({ side }, i) => {
      const moves = panel.parts.has(target.first + i), own = side == "left" ? LEFT : side == "right" ? RIGHT : side == "middle" ? TRUNK : OTHER;
      found.set(moves ? [...FOUND, 2] : [...own.map(c => some ? .55 * c : c), 1], 4 * i);
    });
    return found;
  }

  drawLines(lines, matrix) {
    const { gl } = this, u = this.line.uniforms;
    gl.useProgram(this.line.made); gl.uniformMatrix4fv(u.view, false, matrix); gl.uniform2f(u.size, this.canvas.width, this.canvas.height);
    gl.bindVertexArray(lines.array); gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, lines.count);
  }

  draw(time, camera, grain, state, shown, names) {  // `shown`: the paths of the moment, strongest first
    const { gl, canvas } = this;
    fit(canvas, grain); fit(this.over);
    this.em = parseFloat(getComputedStyle(document.documentElement).fontSize);
    const lamp = this.lamp(time), seen = this.view(camera);
    gl.enable(gl.DEPTH_TEST); gl.disable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    if (lamp) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.frame); gl.viewport(0, 0, SHADOW, SHADOW); gl.clear(gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(2, 4);
      this.drawSolids(this.dark, time, lamp, null, state);
      gl.disable(gl.POLYGON_OFFSET_FILL); gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }
    gl.viewport(0, 0, canvas.width, canvas.height); gl.clearColor(.078, .09, .11, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindTexture(gl.TEXTURE_2D, this.shadow.texture);
    this.drawSolids(this.solid, time, seen, lamp, state);
    gl.enable(gl.BLEND);
    this.drawLines(this.fixed, seen.matrix);
    gl.disable(gl.DEPTH_TEST);
    const list = shown.slice().reverse().flatMap(path => this.linesOf(path, state));
    gl.bindVertexArray(null); gl.bindBuffer(gl.ARRAY_BUFFER, this.moving.made); gl.bufferData(gl.ARRAY_BUFFER, this.packed(list), gl.DYNAMIC_DRAW);
    this.moving.count = list.length;
    if (list.length) this.drawLines(this.moving, seen.matrix);
    if (names) this.drawNames(time, seen.matrix, state, shown);
  }

  linesOf(path, state) {  // `state` is the panel's
    const chosen = state.paths.has(path.number), some = state.paths.size > 0, scale = this.canvas.width / Math.max(1, this.canvas.clientWidth);
    const width = scale * Math.max(1, 4.5 + path.level / 8) * (chosen ? 1.6 : 1), hue = [...hueOf(path, state), some && !chosen ? .15 : .9];
    return path.points.slice(1).map((point, i) => [path.points[i], point, hue, width]);
  }

  drawNames(time, matrix, state, shown) {
    const { over } = this, pen = penOf(over, true), ratio = over.width / Math.max(1, over.clientWidth), size = this.em * ratio;
    pen.clearRect(0, 0, over.width, over.height);
    pen.font = `${size}px system-ui, "DejaVu Sans", sans-serif`; pen.textAlign = "center"; pen.lineJoin = "round"; pen.lineWidth = 3 * ratio;
    const taken = [], write = (text, point, colour, dotted) => {
      const c = [0, 1, 3].map(row => matrix[row] * point[0] + matrix[4 + row] * point[1] + matrix[8 + row] * point[2] + matrix[12 + row]);
      if (c[2] < NEAR) return false;
      const x = (c[0] / c[2] + 1) / 2 * over.width, y = (1 - c[1] / c[2]) / 2 * over.height, half = pen.measureText(text).width / 2;
      if (dotted) { pen.fillStyle = colour; pen.beginPath(); pen.arc(x, y, 3.5 * ratio, 0, 7); pen.fill(); }
      // Above the point, below it or beside it, wherever no other name stands; else its dot alone.
      const free = [[0, -.5], [0, 1.3], [half / size + .6, .35], [-half / size - .6, .35]].map(([u, v]) => [x + u * size, y + v * size])
        .find(([u, v]) => u - half > 0 && u + half < over.width && v > size && v < over.height - .3 * size && taken.every(([a, b, w]) => Math.abs(a - u) > half + w + .3 * size || Math.abs(b - v) > 1.25 * size));
      if (!text || !free) return false;
      taken.push([...free, half]);
      pen.strokeStyle = "#000c"; pen.strokeText(text, ...free); pen.fillStyle = colour; pen.fillText(text, ...free);
      return true;
    };
    ["x", "y"].forEach((name, axis) => write(name, this.origin(axis, 1.12), "#e6e8ea"));
    write("radar", this.recording.radar.position, "#ff8080");
    this.centres(time).forEach(({ middle, radius }, i) => this.targets.length > 1 && write(this.targets[i].name, [middle[0], middle[1], middle[2] + radius], "#e6e8ea"));
    const known = new Set();
    for (const path of shown) {
      if (state.paths.size && !state.paths.has(path.number)) continue;
      path.points.forEach((point, i) => {
        const name = path.meets[i], key = name + point.map(x => x.toFixed(2));
        if (name == "radar" || name == "target" || known.has(key)) return;
        known.add(key);
        if (write(known.has(name) ? "" : called(name, this.recording), point, `rgb(${hueOf(path, state).map(x => 255 * x)})`, true)) known.add(name);
      });
    }
  }
}

function hueOf(path, { split, ghosts }) {  // of a path by its reflections, or by the part of the recording that came over it
  if (!ghosts || !state.tinted) return ORDERS[Math.min(3, path.order)];
  const part = split.partOf(path);
  return part < 0 ? [.3, .3, .3] : split.rgb[part].map(c => c / 255 * (split.on.has(part) ? 1 : .4));
}

function called(name, { surfaces, radar }) {  // a wall by where it is as seen from the radar, or by its axis; all else by its name
  const wall = surfaces.find(each => each.name == name && each.shell && Math.abs(each.inward[2]) < .5);
  if (!wall || !/^wall[-+][xy]$/.test(name)) return name;
  const [ahead, left] = radar.axes.map(axis => dot(axis, wall.inward));
  const where = ahead > .8 ? "behind the radar" : ahead < -.8 ? "opposite the radar" : left < -.8 ? "on the radar's left" : left > .8 ? "on the radar's right" : `at the ${name[4] == "-" ? "low" : "high"} end of ${name[5]}`;
  return `wall ${where} (${name})`;
}

function fit(canvas, grain = 1) {  // as many pixels as are shown, or fewer
  const ratio = Math.min(2, window.devicePixelRatio || 1) / grain, width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width != width || canvas.height != height) { canvas.width = width; canvas.height = height; }
}
