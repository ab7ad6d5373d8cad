// One time cursor over all: what the page holds, what a click finds, how time goes on.

const $ = name => document.getElementById(name), LIGHT = .299792458;  // m/ns
const MOST_ROWS = 7, MOST_SHOWN = 14, WEAKEST_DB = -45, STEPS = [0.05, 0.1, 0.25, 0.5, 1, 2];
const state = { time: 0, playing: false, tinted: false, whole: false, camera: null, panels: [], grain: 1, fps: 0, written: 0 };

async function unpacked() {  // numbers of the page: each { at, kind, count, deltas } in the header stands for an array
  const meta = JSON.parse($("meta").textContent), text = atob($("data").textContent.trim()), packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const all = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  const kinds = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };
  const read = value => {
    if (Array.isArray(value)) return value.map(read);
    if (value === null || typeof value != "object") return value;
    if (!("at" in value)) return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, read(each)]));
    const found = new kinds[value.kind](all, value.at, value.count);
    for (let i = value.deltas || Infinity; i < found.length; i++) found[i] += found[i - value.deltas];  // of the frame before, modulo 2^16
    return found;
  };
  return read(meta);
}

function interpolated(values, position) {
  const k = Math.max(0, Math.min(values.length - 1, Math.floor(position))), n = Math.min(values.length - 1, k + 1);
  return values[k] + (values[n] - values[k]) * Math.max(0, Math.min(1, position - k));
}

function cubic(values, position) {  // through the values (Catmull, Rom); what feet do between two frames is no line
  const k = Math.max(0, Math.min(values.length - 2, Math.floor(position))), f = Math.max(0, Math.min(1, position - k)), at = i => values[Math.max(0, Math.min(values.length - 1, i))];
  const [a, b, c, d] = [at(k - 1), at(k), at(k + 1), at(k + 2)];
  return values.length < 4 ? interpolated(values, position) : b + f / 2 * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)));
}

const spoken = speed => `${Math.abs(speed).toFixed(1)} m/s ${speed >= 0 ? "towards the radar" : "away from it"}`;
const listed = words => words.length < 2 ? words.join("") : words.slice(0, -1).join(", ") + " and " + words.at(-1);
const safe = text => text.replace(/[&<>]/g, c => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);
const decibels = level => `${fixed(level, 1)} dB`;


function course(path, recording) {  // of a path by reflections, in words
  const place = path.meets.indexOf("target"), over = names => "over " + listed(names.map(name => `<b>${safe(called(name, recording))}</b>`)), out = path.meets.slice(1, place), back = path.meets.slice(place + 1, -1).reverse();
  if (out.join() == back.join()) return `${over(out)} out and back`;
  return !out.length || !back.length ? `${over(out.concat(back))} on one way, straight on the other` : `out ${over(out)}, back ${over(back)}`;
}

class Panel {
  constructor(recording, colours) {
    this.recording = recording; this.parts = new Set(); this.paths = new Set(); this.lit = new Set(); this.cell = null;
    this.split = recording.split && recording.split.names ? new Split(recording.split) : null;
    this.ghosts = this.split && recording.paths.some(path => this.split.names.includes(path.name));  // split by path
    this.box = $("panels").appendChild(document.createElement("section")); this.box.className = "panel";
    this.box.appendChild(document.createElement("h2")).textContent = recording.title;
    const place = name => { const made = this.box.appendChild(document.createElement("div")); made.className = name; return made; };
    const room = place("room");
    if (recording.why_no_room) { this.box.classList.add("bare"); const why = room.appendChild(document.createElement("div")); why.className = "why"; why.textContent = recording.why_no_room; }
    else {
      this.room = new Room(room, recording); this.steer(room);
      this.said = room.appendChild(document.createElement("div")); this.said.className = "said";
      const box = room.appendChild(document.createElement("div")); box.className = "list"; box.onpointerdown = event => event.stopPropagation(); box.hidden = !recording.paths.length;
      this.focus = recording.focus;
      if (recording.targets.length > 1) {
        const choice = box.appendChild(document.createElement("select"));
        recording.targets.forEach((each, i) => choice.add(new Option(`paths to ${each.name}`, i, false, i == this.focus)));
        choice.onchange = () => { this.focus = Number(choice.value); this.paths.clear(); draw(); };
      }
      this.list = box.appendChild(document.createElement("table"));
      this.list.onclick = event => { const row = event.target.closest("[data-path]"); if (row) this.choose(Number(row.dataset.path)); };
    }
    this.charts = Object.entries(recording.maps).map(([kind, map]) => {
      const box = place("map " + kind), chart = new Chart(box, kind, map, colours);
      if (kind == "range_doppler" && (this.near = this.nearby(chart.whole))) {
        this.zoom = box.appendChild(document.createElement("button"));
        this.zoom.title = "w"; this.zoom.onclick = event => { event.stopPropagation(); whole(); };
      }
      if (kind == "spectrogram") chart.split = this.split;
      box.onclick = event => { const at = chart.at(event); if (at) clicked(kind, at.x, at.y); };
      box.onmousemove = event => { const at = chart.at(event); box.title = at ? this.tip(chart, at) : ""; };
      return chart;
    });
    if (recording.split) {
      this.box.classList.add("parted");
      const box = place("legend");
      if (this.split) this.legend = new Legend(box, this); else box.textContent = recording.split.why;
    }
  }

  steer(room) {
    room.onpointerdown = event => room.setPointerCapture(event.pointerId);
    room.onpointermove = event => {
      if (!event.buttons) return;
      const c = state.camera;
      if (event.buttons > 1 || event.shiftKey) {
        const pace = c.distance * .0016, [s, k] = [Math.sin(c.yaw), Math.cos(c.yaw)];
        c.centre = [c.centre[0] + pace * s * event.movementX, c.centre[1] - pace * k * event.movementX, c.centre[2] + pace * event.movementY];
      } else { c.yaw -= event.movementX * .008; c.pitch = Math.max(-1.55, Math.min(1.55, c.pitch + event.movementY * .008)); }
      draw();
    };
    room.oncontextmenu = event => event.preventDefault();
    room.addEventListener("wheel", event => { event.preventDefault(); state.camera.distance = Math.max(.5, Math.min(500, state.camera.distance * Math.exp(event.deltaY * .001))); draw(); }, { passive: false });
  }

  tip(chart, { x, y }) {
    const level = chart.level(x, y, chart.kind == "range_doppler" ? this.moment(chart) : 0), unit = { time: "s", speed: "m/s", range: "m" };
    return `${fixed(x, 2)} ${unit[chart.map.x.of]}, ${fixed(y, 2)} ${unit[chart.map.y.of]}, ${level === null ? "below the colours" : decibels(level) + " re 1 W"}${this.split && chart.kind == "spectrogram" ? this.split.shares(y, x).parts.slice(0, 3).map(part => `\n${shortened(part.name)} ${decibels(part.relative)}`).join("") : ""}`;
  }

  nearby(all) {  // the part of a range-Doppler map that targets and their stronger paths reach; null where that is most of it
    const { parts, paths, radar } = this.recording, [least, greatest] = [values => values.reduce((a, b) => b < a ? b : a, Infinity), values => values.reduce((a, b) => b > a ? b : a, -Infinity)];
    if (!parts.length) return null;
    const strongest = greatest(paths.map(path => greatest(path.level))), seen = paths.filter(path => greatest(path.level) > strongest - 30);
    const within = (low, high, [first, last]) => { const free = .1 * (high - low); return [Math.max(first, low - free), Math.min(last, high + free)]; };
    const fast = greatest(parts.map(part => Math.max(greatest(part.fast), -least(part.slow))));
    const found = {
      x: within(least(parts.map(part => least(part.near))), greatest([...parts.map(part => greatest(part.far)), ...seen.map(path => greatest(path.range))]), all.x),
      y: fast > radar.max_speed ? all.y : within(Math.min(0, least(parts.map(part => least(part.slow)))), Math.max(0, greatest(parts.map(part => greatest(part.fast)))), all.y),
    };
    const part = axis => (found[axis][1] - found[axis][0]) / (all[axis][1] - all[axis][0]);
    return part("x") * part("y") < .85 ? found : null;
  }

  moment(chart) {  // number of the range-Doppler map that is nearest in time
    const times = chart.map.times;
    let best = 0;
    for (let k = 1; k < times.length; k++) if (Math.abs(times[k] - state.time) < Math.abs(times[best] - state.time)) best = k;
    return best;
  }

  folded(speed) { const most = this.recording.radar.max_speed; return speed - 2 * most * Math.floor((speed + most) / (2 * most)); }

  partsAt(time) {
    const at = time * this.recording.frames_hz;
    return this.recording.parts.map((part, number) => ({ ...part, number, speed: cubic(part.speed, at), range: cubic(part.range, at), slow: cubic(part.slow, at), fast: cubic(part.fast, at), near: cubic(part.near, at), far: cubic(part.far, at), visible: part.visible ? interpolated(part.visible, at) : null }));
  }

  pathsAt(time, target = this.focus, weakest = WEAKEST_DB) {  // those to a target that exist then, strongest first, levels relative to the direct one
    const { paths, frames_hz: rate } = this.recording, k = Math.round(time * rate), found = [];
    paths.forEach((path, number) => {
      const frame = Math.max(0, Math.min(path.level.length - 1, k));
      if (path.target != target || !(path.level[frame] > -1e9)) return;
      const n = path.meets.length, points = path.meets.map((_, i) => Array.from(path.points.subarray(3 * (n * frame + i), 3 * (n * frame + i + 1))));
      found.push({ ...path, number, level: path.level[frame], range: path.range[frame], speed: path.speed[frame], points });
    });
    const direct = found.find(path => path.order == 0), strongest = Math.max(...found.map(path => path.level));
    const from = direct && direct.level > strongest - 30 ? direct.level : strongest;
    for (const path of found) path.level -= from;
    return found.sort((a, b) => b.level - a.level).filter(path => path.level > weakest || this.paths.has(path.number));
  }

  choose(number) {
    const only = this.paths.size == 1 && this.paths.has(number);
    this.paths = new Set(only ? [] : [number]); this.parts.clear(); this.lit.clear(); this.cell = null;
    const path = this.recording.paths[number];
    $("told").innerHTML = only ? "" : `Path <b>${safe(path.name)}</b>: ${path.order ? `${path.order} reflection${path.order > 1 ? "s" : ""} on the way out and back together` : "straight out and back"}. Its range over time is drawn in the range map, its place then as a ring in the range-Doppler map.`;
    draw();
  }

  peaks(time, speed) {  // ranges [m] of the echoes at that speed then, the strongest first, within 15 dB
    const chart = this.charts.find(each => each.kind == "range_doppler");
    if (!chart) return [];
    const frame = this.moment(chart), [, row] = chart.cell(0, speed), { x, y, values, low_db: low, high_db: high } = chart.map, found = [];
    const cell = i => values[(frame * y.count + row) * x.count + i] || 0;
    for (let i = 0; i < x.count; i++) if (cell(i) && cell(i) >= (cell(i - 1) || 0) && cell(i) > (cell(i + 1) || 0)) found.push({ range: x.first + i * (x.last - x.first) / Math.max(1, x.count - 1), level: low + cell(i) / 255 * (high - low) });
    found.sort((a, b) => b.level - a.level);
    return found.filter(each => each.level > found[0].level - 15 && each.level > low + 5).slice(0, 3);
  }

  vertices(target, time) {  // places (V, 3) of a target's vertices half a frame before and after that time, and the time between
    const { vertices, low, pitch, frames, every } = this.recording.targets[target], rate = this.recording.frames_hz / every, size = vertices.length / frames, end = (frames - 1) / rate;
    const sides = [-.5, .5].map(side => Math.max(0, Math.min(end, time + side / rate)));
    const places = sides.map(at => {
      const k = Math.min(frames - 1, Math.floor(at * rate)), n = Math.min(frames - 1, k + 1), f = at * rate - k;
      return Float32Array.from({ length: size }, (_, i) => low[i % 3] + pitch[i % 3] * (vertices[k * size + i] * (1 - f) + vertices[n * size + i] * f));
    });
    return { places, step: sides[1] - sides[0] };
  }

  over(path, { places, step }) {  // ranges [m] and speeds [m/s] of a target's vertices as seen over a path, by the images of the antennas
    const [out, back] = path.images, away = (at, i, [x, y, z]) => Math.sqrt((at[i] - x) ** 2 + (at[i + 1] - y) ** 2 + (at[i + 2] - z) ** 2);
    const far = places.map(at => Float32Array.from({ length: at.length / 3 }, (_, i) => (away(at, 3 * i, out) + away(at, 3 * i, back)) / 2 + path.added));
    return { range: far[0].map((r, i) => (r + far[1][i]) / 2), speed: far[0].map((r, i) => step ? (r - far[1][i]) / step : 0) };
  }

  explain(speed, range) {  // lights what moves at that speed, or has that delay and speed over the likeliest path, and says so; either may be null
    const { radar, maps, targets } = this.recording, time = state.time, all = this.partsAt(time), several = targets.length > 1;
    const cell = speed === null ? 0 : Math.max(...["spectrogram", "range_doppler"].filter(kind => maps[kind]).map(kind => (maps[kind].y.last - maps[kind].y.first) / Math.max(1, maps[kind].y.count - 1)));
    const slack = Math.max(.12, 1.5 * cell), room = Math.max(.05, 1.5 * radar.range_bin), clipped = value => Math.max(0, value);
    const off = part => speed === null ? 0 : clipped(Math.abs(this.folded((part.slow + part.fast) / 2 - speed)) - (part.fast - part.slow) / 2);
    const apart = part => speed === null ? 0 : Math.abs(this.folded(part.speed - speed));
    const speeds = part => `${fixed(part.slow, 1)} to ${fixed(part.fast, 1)} m/s`;
    const name = part => `<b>${safe(part.name)}</b> (${speeds(part)}${part.name == (targets[part.target] || {}).name ? "" : `, ${fixed(part.speed, 1)} at its middle`}${part.fast > radar.max_speed || part.slow < -radar.max_speed ? ", folded" : ""}; ${part.range.toFixed(2)} m${part.visible === null ? "" : `, ${(100 * part.visible).toFixed(0)} % in view`})`;
    const moving = all.filter(part => off(part) <= slack).sort((a, b) => apart(a) - apart(b)), echoes = range === null ? this.peaks(time, speed) : [{ range }], told = [];
    const seen = targets.flatMap((_, target) => { const own = this.vertices(target, time); return this.pathsAt(time, target, -Infinity).map(path => ({ path, ...this.over(path, own) })); });
    const reached = new Set();
    this.paths = new Set();
    echoes.forEach((echo, order) => {
      const fits = [];
      let nearest = null;
      for (const { path, range: ranges, speed: velocities } of seen) {
        const { owner, first, parts } = targets[path.target], counts = new Float32Array(parts);
        for (let i = 0; i < ranges.length; i++) {
          const far = Math.abs(ranges[i] - echo.range) / room, fast = speed === null ? 0 : Math.abs(this.folded(velocities[i] - speed)) / slack;
          if (far < 1 && fast < 1) counts[owner[i]] += (1 - far) * (1 - fast);
          if (!nearest || far + fast < nearest.away) nearest = { away: far + fast, path, range: ranges[i], speed: velocities[i], part: all[first + owner[i]] };
        }
        const sum = counts.reduce((a, b) => a + b, 0);
        if (sum) fits.push({ path, score: path.level + 10 * Math.log10(sum / ranges.length), owner, ranges, velocities, parts: [...counts.keys()].filter(k => counts[k]).sort((a, b) => counts[b] - counts[a]).map(k => all[first + k]) });
      }
      fits.sort((a, b) => b.score - a.score);
      const named = path => `<b>${safe(path.name)}</b>${several ? ` to ${safe(targets[path.target].name)}` : ""}`, by = ({ path, owner, ranges, velocities, parts: [part] }) => {
        let [sum, count, slow, fast] = [0, 0, Infinity, -Infinity];
        owner.forEach((k, i) => { if (k == part.number - targets[path.target].first) { sum += ranges[i]; count += 1; slow = Math.min(slow, velocities[i]); fast = Math.max(fast, velocities[i]); } });
        return `${named(path)} (${safe(part.name)}: ${(sum / count).toFixed(2)} m, ${fixed(slow, 1)} to ${fixed(fast, 1)} m/s over it)`;
      };
      const where = range === null ? `${echo.range.toFixed(2)} m (${(2 * echo.range / LIGHT).toFixed(1)} ns): ` : "";
      if (fits.length) {
        this.paths.add(fits[0].path.number);
        if (range !== null) fits[0].parts.forEach(part => reached.add(part.number));
        told.push(`${where}path ${fits.slice(0, order ? 1 : 2).map(by).join(" or ")}`);
      } else told.push(where + (nearest ? `no path in use fits; nearest is ${named(nearest.path)} (${safe(nearest.part.name)}: ${nearest.range.toFixed(2)} m, ${fixed(nearest.speed, 1)} m/s)` : "no path is known"));
    });
    this.parts = range === null ? new Set(moving.map(part => part.number)) : reached;
    if (range !== null) return `Delay ${(2 * range / LIGHT).toFixed(1)} ns: ${told.join()}.`;
    const nearest = all.slice().sort((a, b) => off(a) - off(b))[0], fastest = nearest && all.every(part => Math.abs(part.fast) <= Math.abs(speed) && Math.abs(part.slow) <= Math.abs(speed));
    const who = !all.length ? "" : moving.length ? `At that speed moves: ${moving.slice(0, 2).map(name).join(", ")}${moving.length > 2 ? ` and parts of ${moving.length - 2} more` : ""}. `
      : `${fastest ? "Fastest then" : "Nearest in speed"}: ${name(nearest)}, ${off(nearest).toFixed(1)} m/s off on the direct path. `;
    return who + (!echoes.length ? "No echo at that speed rises out of the map's floor then." : seen.length ? `The strongest echoes at that speed come from ${told.join("; from ")}.` : `The strongest echoes at that speed come from ${echoes.map(echo => `${echo.range.toFixed(2)} m`).join(", ")}.`);
  }

  made(speed) {  // lights the parts that make the cell of the spectrogram at that speed now, within 10 dB of the strongest, and lists them
    const found = this.split.shares(speed, state.time), { recording } = this;
    this.lit = new Set(found.parts.filter(each => each.level > found.parts[0].level - LIT_DB).map(each => each.part));
    if (this.ghosts) this.paths = new Set([...recording.paths.keys()].filter(k => this.lit.has(this.split.partOf(recording.paths[k]))));
    else {
      const lit = new Set();
      for (const { owner, tint, first } of recording.targets) owner.forEach((k, i) => { if (this.lit.has(tint[i])) lit.add(first + k); });
      if (recording.targets.some(({ tint }) => tint.some(k => k < this.split.names.length))) this.parts = lit;
    }
    return sharesTold(found, this.split);
  }

  story(paths) {
    const { recording } = this, { standing, parts, frames_hz: rate, walls } = recording, time = state.time, said = [];
    if (standing) {
      const feet = ["left", "right"].map(side => ({ side, down: standing[side][Math.min(standing[side].length - 1, Math.round(time * rate))] > 0, part: parts.find(each => each.foot == side) }));
      const swing = ({ side, part }) => `the <b style="color:${side == "left" ? "#ff8c42" : "#56b4e9"}">${side} foot</b> swings (${spoken(cubic(part.speed, time * rate))})`;
      const text = feet.every(each => each.down) ? "both feet stand" : feet.every(each => !each.down) ? feet.map(swing).join(", ") : feet.map(each => each.down ? `the ${each.side} foot stands` : swing(each)).sort((a, b) => b.includes("swings") - a.includes("swings")).join(", ");
      const whose = recording.targets.length > 1 ? `${safe(recording.targets[feet[0].part.target].name)}: ` : "";
      said.push(whose + (whose ? text : text[0].toUpperCase() + text.slice(1)) + ".");
    }
    if (recording.paths.length && !paths.length) said.push("No path leads there now.");
    const ghosts = paths.filter(path => path.order > 0), direct = paths.find(path => path.order == 0);
    if (ghosts.length) {
      const tell = path => `${course(path, recording)}${direct ? ` (${decibels(path.level)} against direct, ${(path.range - direct.range).toFixed(2)} m farther)` : ""}`;
      const wall = ghosts.find(path => path.meets.some(name => walls.includes(name)));
      said.push(`Strongest ghost: ${tell(ghosts[0])}.` + (wall && wall !== ghosts[0] ? ` Strongest by a wall: ${tell(wall)}.` : ""));
    }
    return said.join("<br>");
  }

  rows(paths) {
    const head = `<caption>Level: of 1 m² at the ${this.recording.standing ? "pelvis" : "middle"}, both orders (there and back) together, in all cells, against direct</caption><tr><th>path: out, back<th>level<th>range<th>speed</tr>`;
    return head + paths.slice(0, MOST_ROWS).map(path => `<tr data-path="${path.number}" class="${this.paths.has(path.number) ? "lit" : ""}"><td><i class="order${Math.min(3, path.order)}" style="background:rgb(${hueOf(path, this).map(x => 255 * x)});height:${Math.max(1, 4.5 + path.level / 8).toFixed(1)}px"></i>${safe(path.name)}<td>${decibels(path.level)}<td>${path.range.toFixed(2)} m<td>${fixed(path.speed, 2)} m/s</tr>`).join("") + "<tr><td>\u00a0</tr>".repeat(Math.max(0, Math.min(MOST_ROWS, this.recording.paths.filter(path => path.target == this.focus).length) - paths.length));
  }

  marks(chart, time, paths) {
    const { recording, cell } = this, truth = $("truth").checked, feet = recording.parts.filter(part => part.foot), { frames_hz: rate } = recording;
    const colour = order => `rgb(${ORDERS[Math.min(3, order)].map(x => 255 * x)})`, side = part => part.foot == "left" ? "#ff8c42" : "#56b4e9";
    return (pen, { kind }, em) => {
      const curve = (values, hz, shade, fold) => {
        pen.strokeStyle = shade; pen.beginPath();
        let before = null;
        for (let k = 0; k < values.length; k += fold ? .25 : 1) {
          const value = fold ? this.folded(cubic(values, k)) : values[k], jump = before === null || !(Math.abs(value - before) < (fold ? recording.radar.max_speed : 1e9));
          if (value === value) jump ? pen.moveTo(chart.px(k / hz), chart.py(value)) : pen.lineTo(chart.px(k / hz), chart.py(value));
          before = value === value ? value : null;
        }
        pen.stroke();
      };
      const band = (part, shade) => {  // from the slowest to the fastest point of a part; where it folds, its edges alone
        pen.fillStyle = shade; pen.globalAlpha = .3; pen.beginPath();
        for (let k = 0, before = null; k < part.slow.length; k += .25) {
          const now = [chart.px(k / rate), this.folded(cubic(part.slow, k)), this.folded(cubic(part.fast, k))], [x, low, high] = now;
          if (before && low <= high && before[1] <= before[2]) { pen.moveTo(before[0], chart.py(before[1])); pen.lineTo(x, chart.py(low)); pen.lineTo(x, chart.py(high)); pen.lineTo(before[0], chart.py(before[2])); }
          before = now;
        }
        if (!this.split || !state.tinted) pen.fill();  // which would hide the colours of parts
        pen.globalAlpha = .85; pen.lineWidth = .08 * em;
        curve(part.slow, rate, shade, true); curve(part.fast, rate, shade, true); pen.globalAlpha = 1;
      };
      const ring = (x, y, shade, thick = 1.5) => { pen.lineWidth = thick; pen.strokeStyle = shade; pen.beginPath(); pen.arc(x, y, .5 * em, 0, 7); pen.stroke(); };
      pen.font = `${.95 * em}px system-ui, "DejaVu Sans", sans-serif`;
      if (kind == "spectrogram" && truth) for (const part of feet) band(part, side(part));
      if (kind == "range_time") {
        pen.lineWidth = .16 * em; pen.setLineDash([.4 * em, .5 * em]);
        for (const number of this.paths) curve(recording.paths[number].range, rate, colour(recording.paths[number].order), false);
        pen.setLineDash([]);
      }
      if (kind == "range_doppler") {
        const shown = this.paths.size ? paths.filter(path => this.paths.has(path.number)) : paths.slice(0, 4), { left, top, width, height } = chart.place;
        const peaks = this.ghosts ? this.split.ghosts(time, chart.map.high_db - Number($("span").value) - 10) : [], inside = ({ range, speed }) => range > chart.span.x[0] && range < chart.span.x[1] && speed > chart.span.y[0] && speed < chart.span.y[1];
        const own = part => `rgb(${state.tinted ? this.split.rgb[part] : [255, 255, 255]})`, named = peaks.filter(each => inside(each) && (!this.lit.size || this.lit.has(each.part))).slice(0, MOST_GHOSTS);
        const marked = this.ghosts ? named.map(({ name, part, level, range, speed }) => ({ x: chart.px(range), y: chart.py(speed), shade: own(part), text: `${name}  ${fixed(level - peaks[0].level, 0)} dB` })) : shown.map(path => ({ x: chart.px(path.range), y: chart.py(this.folded(path.speed)), shade: colour(path.order), text: path.name }));
        if (truth && !this.ghosts) for (const part of this.partsAt(time).filter(each => each.foot)) marked.push({ x: chart.px(part.range), y: chart.py(this.folded(part.speed)), shade: side(part), text: `${part.name}, middle` });
        const steep = ({ x, y }) => Math.atan2(y - top, left + width - x);
        marked.sort((a, b) => steep(a) - steep(b));  // so that few of the lines to the names cross
        const below = shown.length && this.folded(shown[0].speed) < 0;  // names stand in the corner where no echoes are
        marked.forEach(({ x, y, shade, text }, i) => {
          const at = below ? top + height - (marked.length - i - .3) * 1.2 * em : top + (i + .7) * 1.2 * em, to = left + width - .4 * em, from = to - pen.measureText(text).width - .3 * em;
          ring(x, y, shade);
          const l = Math.hypot(from - x, at - y) || 1;
          pen.lineWidth = 1; pen.globalAlpha = .55; pen.beginPath(); pen.moveTo(x + (from - x) / l * .5 * em, y + (at - y) / l * .5 * em); pen.lineTo(from, at); pen.stroke(); pen.globalAlpha = 1;
          pen.textAlign = "right"; pen.textBaseline = "middle"; pen.lineWidth = 3; pen.strokeStyle = "#000c"; pen.strokeText(text, to, at); pen.fillStyle = shade; pen.fillText(text, to, at);
        });
      }
      if (cell && kind in cell) ring(chart.px(cell[kind][0]), chart.py(cell[kind][1]), "#b8ff33", 3);
    };
  }

  tell(paths) { this.said.innerHTML = this.story(paths); this.list.innerHTML = this.rows(paths); }

  draw(all) {  // the room; and names, texts and maps, if `all` is to be brought up to date
    const paths = this.pathsAt(state.time), span = Number($("span").value);
    if (this.room && all) this.tell(paths);  // before the room, whose height it leaves
    if (this.room) this.room.draw(state.time, state.camera, state.grain, this, paths.filter((path, i) => i < MOST_SHOWN || this.paths.has(path.number)), all);
    if (!all) return;
    const known = JSON.stringify([$("truth").checked, [...this.paths], this.cell, this.focus, this.split && [state.tinted, [...this.lit], [...this.split.on]]]);
    if (this.legend) this.legend.draw();
    for (const chart of this.charts) {
      const moving = chart.kind == "range_doppler";
      if (moving && this.zoom) { chart.span = state.whole ? chart.whole : this.near; this.zoom.textContent = state.whole ? "where targets are" : "whole map"; }
      const moment = moving ? this.moment(chart) : 0;
      chart.draw(moment, span + (moving ? 10 : 0), known + (moving ? state.time : ""), this.marks(chart, state.time, moving ? paths : []));  // its echoes are spread over more cells
      chart.point(state.time);
    }
  }
}

function clicked(kind, x, y) {  // a cell of a map, of all recordings alike
  const time = kind == "range_doppler" ? state.time : x, speed = kind == "range_time" ? null : y, range = kind == "spectrogram" ? null : kind == "range_time" ? y : x;
  play(false); seek(time);
  const where = [`${state.time.toFixed(2)} s`, speed === null ? null : `${fixed(speed, 2)} m/s`, range === null ? null : `${range.toFixed(2)} m`].filter(Boolean).join(", ");
  $("told").innerHTML = `Clicked: ${where}. ` + state.panels.map(panel => {
    panel.cell = { spectrogram: speed === null ? [NaN, NaN] : [state.time, speed], range_time: range === null ? [NaN, NaN] : [state.time, range], range_doppler: speed === null || range === null ? [NaN, NaN] : [range, speed] };
    panel.lit.clear();
    const moves = panel.explain(speed, range), text = (panel.split && range === null ? panel.made(speed) : "") + moves;
    return state.panels.length > 1 ? `<i>${safe(panel.recording.title)}:</i> ${text}` : text;
  }).join("<br>");
  draw();
}

function whole() { state.whole = !state.whole; draw(); }

function forget() { for (const panel of state.panels) { panel.parts.clear(); panel.paths.clear(); panel.lit.clear(); panel.cell = null; } $("told").innerHTML = hint(); draw(); }

function look(from) {
  const { recording } = state.panels.find(each => each.room) || {};
  if (!recording) return;
  const { low, high, middle } = recording.bounds, { position: p, axes: [forward] } = recording.radar, heading = Math.atan2(forward[1], forward[0]);
  const canvas = state.panels.find(each => each.room).room.canvas, wide = Math.max(.2, canvas.clientWidth / Math.max(1, canvas.clientHeight));
  const fitted = (yaw, pitch) => {  // as near as all corners allow
    const z = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)], x = [-Math.sin(yaw), Math.cos(yaw), 0], y = cross(z, x);
    let distance = 1;
    for (let k = 0; k < 8; k++) {
      const corner = sub([k & 1, k & 2, k & 4].map((one, i) => one ? high[i] : low[i]), middle);
      distance = Math.max(distance, dot(corner, z) + Math.max(Math.abs(dot(corner, x)) / wide / .95, Math.abs(dot(corner, y)) / .86) / TANGENT);
    }
    return { yaw, pitch, distance, centre: middle };
  };
  const bodies = state.panels.find(each => each.room).room.centres(state.time)[0] || { middle, radius: 1 };
  state.camera = {
    room: wide > 1.6 ? fitted(heading + 1.9, .3) : fitted(heading + 2.3, .5),
    radar: { yaw: heading + Math.PI, pitch: -Math.asin(forward[2]), distance: 1.5, centre: p.map((c, i) => c + 1.1 * forward[i]) },
    above: fitted(heading + Math.PI, 1.55),
    near: { yaw: heading + .9, pitch: .25, distance: 4.2 * bodies.radius, centre: bodies.middle },
  }[from];
  $("look").value = from;
}

function seek(time) { state.time = Math.max(0, Math.min(state.duration, time)); draw(); }

function draw() {
  if (state.panels.some(({ legend }) => legend)) {  // sides and orders have no colours of their own where parts have
    $("sides").hidden = state.tinted && state.panels.every(({ split, ghosts }) => split && !ghosts) || !state.panels.some(({ recording }) => recording.standing);
    $("orders").hidden = state.tinted && state.panels.every(({ ghosts }) => ghosts) || $("lit").hidden || state.panels.every(({ recording }) => recording.paths.length < 2);
  }
  const now = performance.now(), all = !state.playing || !SOFTWARE || now - state.written > 120;  // without a graphics card each thing that moves costs
  if (all) { $("clock").value = `${state.time.toFixed(2)} of ${state.duration.toFixed(2)} s`; $("time").value = state.time; state.written = now; }
  for (const panel of state.panels) panel.draw(all);
}

function play(on) {
  if (on == state.playing) return;
  state.playing = on; $("play").textContent = on ? "Pause" : "Play";
  if (!on) { state.grain = 1; draw(); return; }
  let before = performance.now(), since = before, count = 0;
  const next = now => {
    if (!state.playing) return;
    const time = state.time + (now - before) / 1000 * Number($("speed").value);
    before = now; count += 1;
    seek(time > state.duration ? 0 : time);
    if (count == 10) {  // a slow machine moves coarser pictures, and shows fine ones where it stands
      state.fps = 1000 * count / (now - since); since = now; count = 0;
      if (state.fps < 18) state.grain = Math.min(3, state.grain + .5); else if (state.fps > 45) state.grain = Math.max(1, state.grain - .5);
    }
    requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
}

const HINT = "Click a cell of a map: the parts of the body that move at that speed then light up, and the paths whose delay and speed fit are named here.";

const hint = () => HINT + (state.panels.some(({ split }) => split) ? " What the parts that the recording was split into return in that cell is listed, those that make it light up." : "");

function keys(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName == "SELECT") return;
  const pace = (event.shiftKey ? 10 : 1) / state.frames_hz, speeds = $("speed"), action = {
    " ": () => play(!state.playing), ArrowLeft: () => { play(false); seek(state.time - pace); }, ArrowRight: () => { play(false); seek(state.time + pace); },
    ArrowUp: () => speeds.selectedIndex = Math.min(speeds.length - 1, speeds.selectedIndex + 1), ArrowDown: () => speeds.selectedIndex = Math.max(0, speeds.selectedIndex - 1),
    Home: () => seek(0), End: () => seek(state.duration), Escape: forget, w: whole, c: () => tint(!state.tinted),
  }[event.key];
  if (action) { action(); event.preventDefault(); }
}

async function start() {
  const meta = await unpacked(), asked = new URLSearchParams(location.hash.slice(1));
  $("panels").className = meta.recordings.length > 1 ? "two" : "one";
  $("title").textContent = meta.title; $("caption").textContent = [...new Set(meta.recordings.map(each => each.caption))].join(" | "); $("frame").hidden = meta.recordings.every(each => each.why_no_room); $("title").title = meta.recordings.map(each => each.radar.told).join("\n");
  Object.assign(state, { duration: meta.duration_s, frames_hz: meta.frames_hz });
  state.panels = meta.recordings.map(each => new Panel(each, meta.colours));
  $("sides").hidden = !meta.recordings.some(each => each.standing); $("truth").parentNode.hidden = $("sides").hidden;
  $("lit").hidden = $("look").parentNode.hidden = meta.recordings.every(each => each.why_no_room); $("orders").hidden = $("lit").hidden || meta.recordings.every(each => each.paths.length < 2);
  $("time").max = state.duration;
  state.time = Math.max(0, Math.min(state.duration, Number(asked.get("t") ?? .4 * state.duration) || 0));
  for (const panel of state.panels) if (panel.room) panel.tell(panel.pathsAt(state.time));  // what remains is the room's
  look(asked.get("look") || "room"); if (!state.camera) look("room");
  $("told").textContent = hint();
  state.tinted = state.panels.some(({ split }) => split);
  $("play").onclick = () => play(!state.playing);
  $("time").oninput = event => { play(false); seek(Number(event.target.value)); };
  $("span").onchange = $("truth").onchange = draw;
  $("look").onchange = event => { look(event.target.value); draw(); };
  addEventListener("keydown", keys); addEventListener("resize", draw);
  if (asked.has("speed")) clicked("spectrogram", state.time, Number(asked.get("speed"))); else draw();
  if (asked.has("play")) play(true);
  document.body.dataset.ready = performance.now().toFixed(0);
}

start().catch(error => { $("told").textContent = `This page cannot be shown: ${error.message}.`; throw error; });
