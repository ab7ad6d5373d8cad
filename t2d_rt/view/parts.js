// The parts that a recording was split into: how any of them add up, which is strongest in a cell, and the legend that switches them.

const MOST_TOLD = 6, LIT_DB = 10, MOST_GHOSTS = 7, FAINT = .3;

class Split {
  constructor(data) {  // levels (part, row, column) in 16 bits; products of two parts cell by cell
    Object.assign(this, data);
    this.on = new Set(this.names.keys()); this.cells = this.x.count * this.y.count;
    this.amplitude = Float64Array.from({ length: 65536 }, (_, k) => k ? 10 ** (k / 65535 * (this.high_db - this.low_db) / 20) : 0);
    this.rgb = this.names.map((_, k) => Array.from(this.colours.subarray(3 * k, 3 * k + 3)));
    this.steady = this.names.map(name => /^(static scene|several bounces|no target|\d+ others)/.test(name));
  }

  get whole_on() { return this.on.size == this.names.length; }

  partOf(path) {  // the part that came over a path: one of its own, or the rest; -1 for none
    const own = this.names.indexOf(path.name);
    return own < 0 && this.others ? this.names.length - 1 : own;
  }

  time(column) { return this.x.first + column * (this.x.last - this.x.first) / Math.max(1, this.x.count - 1); }

  column(time) { return Math.max(0, Math.min(this.x.count - 1, Math.round((time - this.x.first) / ((this.x.last - this.x.first) / Math.max(1, this.x.count - 1) || 1)))); }

  row(speed) { return Math.max(0, Math.min(this.y.count - 1, Math.round((speed - this.y.first) / ((this.y.last - this.y.first) / Math.max(1, this.y.count - 1) || 1)))); }

  level(value) { return this.low_db + value / 65535 * (this.high_db - this.low_db); }

  made() {  // of the parts that are on: dB of their sum in each cell, -Infinity for none, and the strongest of them
    const key = [...this.on].sort().join();
    if (this.known === key) return this;
    const { cells, levels, amplitude, on } = this, power = new Float64Array(cells), strongest = new Uint8Array(cells).fill(255), best = new Uint16Array(cells);
    for (const part of on) for (let i = 0, at = part * cells; i < cells; i++, at++) {
      power[i] += amplitude[levels[at]] ** 2;
      if (levels[at] > best[i]) { best[i] = levels[at]; strongest[i] = part; }
    }
    const { counts, one, other, common } = this, chosen = this.names.map((_, k) => on.has(k));
    for (let i = 0, k = 0; i < cells; i++) for (const end = k + counts[i]; k < end; k++)
      if (chosen[one[k]] && chosen[other[k]]) power[i] += 2 * (common[k] - 32768) / 32767 * amplitude[levels[one[k] * cells + i]] * amplitude[levels[other[k] * cells + i]];
    this.sum_db = Float32Array.from(power, p => p > 1 ? this.low_db + 10 * Math.log10(p) : -Infinity);
    if (this.whole_on) this.sum_db = Float32Array.from(this.whole, value => value ? this.level(value) : -Infinity);
    Object.assign(this, { known: key, strongest });
    return this;
  }

  shares(speed, time) {  // of all parts in the nearest cell that is kept: level and its ratio to the whole's, strongest first
    const row = this.row(speed), column = this.column(time), cell = row * this.x.count + column, whole = this.level(this.whole[cell]), step = (this.y.last - this.y.first) / Math.max(1, this.y.count - 1);
    const found = speed < this.y.first - step || speed > this.y.last + step ? [] : this.names.map((name, part) => ({ name, part, value: this.levels[part * this.cells + cell] })).filter(each => each.value).sort((a, b) => b.value - a.value);
    return { time: this.time(column), speed: this.y.first + row * step, whole, parts: found.map(each => ({ ...each, level: this.level(each.value), relative: this.level(each.value) - whole })) };
  }

  ghosts(time, low_db) {  // peaks of the paths in the range-Doppler map, those that are on, strongest first
    const column = this.column(time), found = [];
    this.names.forEach((name, part) => {
      const at = part * this.x.count + column, level = this.peaks_db[at];
      if (this.on.has(part) && !this.steady[part] && level > low_db) found.push({ name, part, level, range: this.ranges[at], speed: this.speeds[at] });
    });
    return found.sort((a, b) => b.level - a.level);
  }
}

class Legend {  // chips that switch parts on and off, and the picture between levels and parts
  constructor(box, panel) {
    const { split } = panel, add = (text, title, act) => { const made = box.appendChild(document.createElement("button")); made.textContent = text; made.title = title; made.onclick = act; return made; };
    box.className = "legend"; this.panel = panel;
    this.mode = add("", "c: colours of the map, the body and the paths", () => tint(!state.tinted));
    add("all", "all parts: the recording as it is", () => choose(split.names));
    add("none", "no part", () => choose([]));
    this.told = box.appendChild(document.createElement("span"));
    this.chips = split.names.map((name, part) => {
      const chip = add("", "click: on or off; shift and click: alone", event => {
        const now = new Set([...split.on].map(k => split.names[k]));
        if (event.shiftKey) now.size == 1 && now.has(name) ? split.names.forEach(each => now.add(each)) : (now.clear(), now.add(name));
        else now.has(name) ? now.delete(name) : now.add(name);
        choose([...now]);
      });
      chip.innerHTML = `<i style="background:rgb(${split.rgb[part]})"></i>${safe(shortened(name))}`;
      return chip;
    });
  }

  draw() {
    const { split, lit } = this.panel;
    this.mode.textContent = state.tinted ? "colours: strongest part" : "colours: level";
    this.chips.forEach((chip, part) => { chip.className = `chip${split.on.has(part) ? "" : " off"}${lit.has(part) ? " lit" : ""}`; chip.setAttribute("aria-pressed", split.on.has(part)); });
    this.told.textContent = split.whole_on ? "of the recording" : `of the sum of ${split.on.size} of ${split.names.length} parts`;
  }
}

const shortened = name => name.replace(/_/g, " ");

function choose(names) {  // the parts of these names are on, in all recordings
  for (const { split } of state.panels) if (split) split.on = new Set([...split.names.keys()].filter(k => names.includes(split.names[k])));
  draw();
}

function tint(on) {
  state.tinted = on && state.panels.some(({ split }) => split);
  draw();
}

function sharesTold({ time, speed, whole, parts }, split) {
  if (!parts.length) return "No part reaches that cell. ";
  const each = ({ name, part, relative }) => `<b style="color:rgb(${split.rgb[part]})">${safe(shortened(name))}</b> ${relative > 0 ? "+" : ""}${decibels(relative)}`;
  return `Made by ${parts.slice(0, MOST_TOLD).map(each).join(", ")}${parts.length > MOST_TOLD ? " and weaker ones" : ""} (against the whole, ${decibels(whole)} re 1 W at ${time.toFixed(2)} s, ${fixed(speed, 2)} m/s). `;
}
