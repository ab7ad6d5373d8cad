// Maps with their axes and colour bars: spectrogram, range over time, range-Doppler map of the moment.

const LABELS = { time: "Time [s]", speed: "Radial velocity [m/s], approaching > 0", range: "Range [m]" };
const HEADS = { spectrogram: "Spectrogram", range_time: "Range over time", range_doppler: "Range and speed at the cursor" };

function ticks(low, high, most) {
  const raw = (high - low) / Math.max(1, most), power = 10 ** Math.floor(Math.log10(raw)), pitch = [1, 2, 5, 10].map(x => x * power).find(x => x >= raw), found = [];
  for (let k = Math.ceil(low / pitch - 1e-9); k * pitch <= high + 1e-9 * pitch; k++) found.push(k * pitch);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(pitch) + 1e-9)) };
}

const fixed = (value, digits) => value.toFixed(digits).replace(/^-(?=0(\.0*)?$)/, "").replace("-", "\u2212");

class Chart {
  constructor(box, kind, map, colours) {  // map: values (frame, y, x) 0..255 from low_db to high_db, axes x and y by their first and last cells' middles
    Object.assign(this, { kind, map, colours });
    this.canvas = box.appendChild(document.createElement("canvas"));
    const { x, y } = map, half = axis => axis.count > 1 ? (axis.last - axis.first) / (axis.count - 1) / 2 : axis.half || .5;
    this.span = this.whole = { x: [x.first - half(x), x.last + half(x)], y: [y.first - half(y), y.last + half(y)] };
    this.image = document.createElement("canvas");
    this.image.width = x.count; this.image.height = y.count;
    this.plain = document.createElement("canvas");  // all that does not change from frame to frame
    if (kind != "range_doppler") { this.cursor = box.appendChild(document.createElement("div")); this.cursor.className = "cursor"; }
  }

  measure() {  // where the image lies within the canvas, as large as that is now
    fit(this.canvas);
    const ratio = this.canvas.width / Math.max(1, this.canvas.clientWidth), em = parseFloat(getComputedStyle(document.documentElement).fontSize) * ratio;
    this.place = { ratio, em, left: 4.1 * em, top: 1.5 * em, width: this.canvas.width - 10.4 * em, height: this.canvas.height - 4.2 * em };
  }

  px(x) { const { left, width } = this.place, [low, high] = this.span.x; return left + (x - low) / (high - low) * width; }

  py(y) { const { top, height } = this.place, [low, high] = this.span.y; return top + (high - y) / (high - low) * height; }

  at(event) {  // values of the axes under the pointer; null beside the image
    const box = this.canvas.getBoundingClientRect(), { ratio, left, top, width, height } = this.place;
    const u = ((event.clientX - box.left) * ratio - left) / width, v = 1 - ((event.clientY - box.top) * ratio - top) / height;
    if (u < 0 || u > 1 || v < 0 || v > 1) return null;
    return { x: this.span.x[0] + u * (this.span.x[1] - this.span.x[0]), y: this.span.y[0] + v * (this.span.y[1] - this.span.y[0]) };
  }

  cell(x, y) {
    const number = (axis, span, value) => Math.max(0, Math.min(axis.count - 1, Math.floor((value - span[0]) / (span[1] - span[0]) * axis.count)));
    return [number(this.map.x, this.whole.x, x), number(this.map.y, this.whole.y, y)];
  }

  level(x, y, frame = 0) {  // dB re 1 W, of the parts that are on; null where that is below all colours
    if (this.split && !this.split.whole_on) { const level = this.split.made().sum_db[this.split.row(y) * this.split.x.count + this.split.column(x)]; return level > this.map.low_db ? level : null; }
    const [i, j] = this.cell(x, y), { values, x: across, y: up, low_db: low, high_db: high } = this.map, value = values[(frame * up.count + j) * across.count + i];
    return value ? low + value / 255 * (high - low) : null;
  }

  paint(frame, span_db) {
    const { values, x, y, low_db: low, high_db: high } = this.map, pen = penOf(this.image), made = pen.createImageData(x.count, y.count), words = new Uint32Array(made.data.buffer);
    const floor = 255 * (1 - span_db / (high - low)), hue = Array.from({ length: 256 }, (_, k) => { const c = 3 * Math.max(0, Math.round((k - floor) / (255 - floor) * 255)); return (255 << 24 | this.colours[c + 2] << 16 | this.colours[c + 1] << 8 | this.colours[c]) >>> 0; });
    if (this.split && !(this.split.whole_on && !state.tinted)) { this.paintParts(words, hue, floor); pen.putImageData(made, 0, 0); return; }
    for (let j = 0; j < y.count; j++) for (let i = 0, from = (frame * y.count + j) * x.count, to = (y.count - 1 - j) * x.count; i < x.count; i++) words[to + i] = hue[values[from + i]];
    pen.putImageData(made, 0, 0);
  }

  paintParts(words, hue, floor) {  // levels are those of the map where all parts are on, else of their sum; the hue is that of the strongest one
    const { values, x, y, low_db: low, high_db: high } = this.map, { sum_db, strongest, whole_on, rgb, x: { count } } = this.split.made(), { tinted } = state;
    const near = Array.from({ length: x.count }, (_, i) => this.split.column(x.first + i * (x.last - x.first) / Math.max(1, x.count - 1)));
    for (let j = 0; j < y.count; j++) for (let i = 0, to = (y.count - 1 - j) * x.count; i < x.count; i++) {
      const cell = j * count + near[i], value = whole_on ? values[j * x.count + i] : Math.max(0, Math.min(255, Math.round(255 * (sum_db[cell] - low) / (high - low)))), own = rgb[strongest[cell]];
      if (!tinted) { words[to + i] = hue[value]; continue; }
      const light = value > floor && own ? FAINT + (1 - FAINT) * (value - floor) / (255 - floor) : 0, [r, g, b] = own || [0, 0, 0];
      words[to + i] = (255 << 24 | b * light << 16 | g * light << 8 | r * light) >>> 0;
    }
  }

  frame(pen, span_db) {  // axes, ticks, units, colour bar
    const { em, left, top, width, height } = this.place, { high_db: high } = this.map, right = left + width, bottom = top + height;
    const line = (...points) => { pen.beginPath(); points.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y)); pen.stroke(); };
    pen.fillStyle = "#14171c"; pen.fillRect(0, 0, this.plain.width, this.plain.height);
    pen.font = `${em}px system-ui, "DejaVu Sans", sans-serif`; pen.fillStyle = "#fff"; pen.textAlign = "left"; pen.textBaseline = "alphabetic";
    pen.fillText(HEADS[this.kind], left, top - .4 * em);
    pen.fillStyle = pen.strokeStyle = "#b6bbc2"; pen.lineWidth = 1; pen.strokeRect(left - .5, top - .5, width + 1, height + 1);
    const across = ticks(...this.span.x, width / em / 5), up = ticks(...this.span.y, height / em / 2.2);
    pen.textAlign = "center"; pen.textBaseline = "top";
    for (const x of across.found) { line([this.px(x), bottom], [this.px(x), bottom + .3 * em]); pen.fillText(fixed(x, across.digits), this.px(x), bottom + .4 * em); }
    pen.fillText(LABELS[this.map.x.of], left + width / 2, bottom + 1.45 * em);
    pen.textAlign = "right"; pen.textBaseline = "middle";
    for (const y of up.found) { line([left - .3 * em, this.py(y)], [left, this.py(y)]); pen.fillText(fixed(y, up.digits), left - .45 * em, this.py(y)); }
    pen.save(); pen.translate(.2 * em, top + height / 2); pen.rotate(-Math.PI / 2); pen.textAlign = "center"; pen.textBaseline = "top";
    const label = LABELS[this.map.y.of], short = pen.measureText(label).width > height + 2 * em ? label.replace(/,.*/, "") : label;
    pen.fillText(short, 0, 0); pen.restore();
    const grey = this.split && state.tinted;
    for (let k = 0; k < height; k++) { const c = 3 * Math.round((1 - k / height) * 255); pen.fillStyle = grey ? `rgb(${Array(3).fill(255 * (1 - k / height * (1 - FAINT)))})` : `rgb(${this.colours[c]},${this.colours[c + 1]},${this.colours[c + 2]})`; pen.fillRect(right + .5 * em, top + k, .7 * em, 1.5); }
    const levels = ticks(high - span_db, high, height / em / 2); pen.fillStyle = pen.strokeStyle = "#b6bbc2"; pen.textAlign = "left"; pen.textBaseline = "middle";
    for (const level of levels.found) { const y = top + (high - level) / span_db * height; line([right + 1.2 * em, y], [right + 1.4 * em, y]); pen.fillText(fixed(level, levels.digits), right + 1.5 * em, y); }
    pen.save(); pen.translate(this.plain.width - .2 * em, top + height / 2); pen.rotate(-Math.PI / 2); pen.textAlign = "center"; pen.textBaseline = "bottom"; pen.fillText("dB re 1 W", 0, 0); pen.restore();
  }

  point(time) {  // moves the cursor, which is no part of the picture: that stays as it is
    if (!this.cursor || !this.place) return;
    const { ratio, top, height } = this.place;
    this.cursor.style.cssText = `transform: translate(${this.px(time) / ratio}px, ${top / ratio}px); height: ${height / ratio}px`;
  }

  draw(frame, span_db, known, marks) {  // marks(pen, chart) draws over the image, if `known`, what they depend on, has changed
    const { canvas, plain, image } = this;
    this.measure();
    const { em, left, top, width, height } = this.place, now = [canvas.width, canvas.height, span_db, em, this.span.x, this.span.y, this.split ? [state.tinted, ...this.split.on] : ""].join(), pen = penOf(canvas);
    if (width < 1 || height < 1 || this.shown === frame + now + known) return;
    this.shown = frame + now + known;
    const wanted = [frame, span_db, this.split ? [state.tinted, ...this.split.on] : ""].join("/"), moved = this.painted !== wanted;
    if (moved) { this.paint(frame, span_db); this.painted = wanted; }
    if (this.framed !== now || moved && this.kind != "range_doppler") {
      plain.width = canvas.width; plain.height = canvas.height; this.framed = now;
      const back = penOf(plain);
      this.frame(back, span_db);
      if (this.kind != "range_doppler") { back.imageSmoothingEnabled = image.width > width; back.drawImage(image, left, top, width, height); }
    }
    pen.drawImage(plain, 0, 0);
    pen.save(); pen.beginPath(); pen.rect(left, top, width, height); pen.clip(); pen.lineJoin = "round";
    if (this.kind == "range_doppler") {
      const { x, y } = this.whole, [from, upper] = [this.px(x[0]), this.py(y[1])];
      pen.imageSmoothingEnabled = false; pen.drawImage(image, from, upper, this.px(x[1]) - from, this.py(y[0]) - upper);
    }
    marks(pen, this, em); pen.restore();
  }
}
