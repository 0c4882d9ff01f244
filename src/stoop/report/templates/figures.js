// Puts the Bokeh figures of a time history into their places when it comes into sight; reads values at the cursor, marks
// windows, saves tables. Needs BokehJS; without it the page shows its stills.
(() => {
  "use strict";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colors = new Map("COLORS".split("|").map((pair) => pair.split(">")));
  const recolored = new RegExp([...colors.keys()].join("|"), "g");
  const all = (element, selector) => [...element.querySelectorAll(selector)];
  const seconds = (value) => value.toFixed(3).replace(/\.?0+$/, "");
  const digits = (value) => (Number.isFinite(value) ? Number(value.toPrecision(4)).toString().replace("-", "−") : "–");
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const mapped = (object, make) => Object.fromEntries(Object.entries(object).map(([key, value]) => [key, make(value)]));

  class History {
    constructor(element) {
      this.element = element;
      this.text = element.querySelector('script[type="application/json"]').textContent;
      this.marked = null;
    }

    show() {
      const content = JSON.parse(dark.matches ? this.text.replace(recolored, (c) => colors.get(c)) : this.text);
      const [start, end] = this.whole = content.span;
      this.content = content;
      this.tables = content.tables.map(({ t, ...columns }) => new Bokeh.ColumnDataSource({
        data: { t: unpacked(t, Float64Array), ...mapped(columns, (text) => unpacked(text, Float32Array)) },
      }));
      this.time = new Bokeh.Range1d({ start, end });
      this.cursor = new Bokeh.Span({ dimension: "height", line_color: style("--tick"), line_width: 1 });
      this.box = new Bokeh.BoxAnnotation({ fill_color: style("--fitted-edge"), fill_alpha: 0.25, line_color: null, visible: false });
      this.panels = all(this.element, ".strips");
      this.figures = this.panels.map(() => []);
      this.hidden ??= new Set();
      this.element.classList.add("live");
      this.page = new Bokeh.Document();
      this.places = []; // of the roots, in their order: Bokeh looks there when one is added
      Bokeh.embed.add_document_standalone(this.page, this.element, this.places);
      this.connect();
      this.watcher?.disconnect();
      this.watcher = new IntersectionObserver((entries) => {
        for (const { isIntersecting, target } of entries)
          if (isIntersecting) { this.watcher.unobserve(target); this.fill(this.panels.indexOf(target)); }
      }, { rootMargin: "300px" });
      this.panels.forEach((panel, i) => {
        const height = content.panels[i].reduce((sum, strip) => sum + strip.height + 6, 20);
        panel.replaceChildren();
        panel.style.minHeight = `${height}px`;
        this.watcher.observe(panel);
      });
    }

    // Put the figures of a panel into their places.
    fill(i) {
      const strips = this.content.panels[i];
      this.figures[i] = strips.map((strip, k) => this.figure(strip, k === strips.length - 1, this.tables, this.content.shades, this.panels[i].clientWidth));
      for (const figure of this.figures[i]) {
        const place = document.createElement("div");
        this.panels[i].append(place);
        this.places.push(place);
        this.hide(figure);
        this.drag(figure);
        figure.on_event("doubletap", () => this.reset());
        figure.on_event("selectiongeometry", (event) => event.final && this.mark(event.geometry.x0, event.geometry.x1));
        this.page.add_root(figure);
      }
    }

    figure(strip, last, tables, shades, width) {
      const tools = [
        new Bokeh.BoxZoomTool({ dimensions: "auto", name: "zoom" }), new Bokeh.PanTool({ name: "pan" }),
        new Bokeh.BoxSelectTool({ dimensions: "width", renderers: [], name: "window" }),
        new Bokeh.WheelZoomTool({ dimensions: "width", modifiers: { ctrl: true } }),
        new Bokeh.CrosshairTool({ dimensions: "height", overlay: this.cursor }),
      ];
      const figure = Bokeh.Plotting.figure({
        height: strip.height + (last ? 26 : 6), sizing_mode: "stretch_width", tools,
        x_range: this.time, y_range: new Bokeh.Range1d({ start: strip.range[0], end: strip.range[1] }),
        toolbar_location: null, min_border_left: 62, min_border_right: 8, min_border_top: 4, min_border_bottom: 2,
        background_fill_color: null, border_fill_color: null, outline_line_color: null,
      });
      figure.toolbar.active_scroll = tools[3];
      const [x] = figure.xaxes ?? [figure.xaxis], [y] = figure.yaxes ?? [figure.yaxis];
      for (const axis of [x, y])
        Object.assign(axis, {
          axis_line_color: null, major_tick_line_color: null, minor_tick_line_color: null,
          major_label_text_color: style("--tick"), major_label_text_font_size: "11px",
        });
      x.visible = last;
      x.ticker.desired_num_ticks = Math.min(6, Math.max(3, Math.floor((width - 70) / 50)));
      y.ticker.desired_num_ticks = Math.max(2, Math.round(strip.height / 24));
      for (const grid of figure.center.filter((one) => one.type === "Grid")) grid.grid_line_color = style("--grid");
      for (const { start, stop, color, edge } of shades)
        figure.add_layout(new Bokeh.BoxAnnotation({ left: start, right: stop, fill_color: color, fill_alpha: 1, line_color: edge, level: "underlay" }));
      figure.add_layout(this.box);
      for (const one of strip.series) draw(figure, one, tables[one.table]);
      return figure;
    }

    connect() {
      const { element } = this;
      for (const button of all(element, "[data-series]")) button.onclick = () => this.toggle(button);
      for (const button of all(element, "[data-tool]")) button.onclick = () => this.use(button.dataset.tool);
      for (const button of all(element, "[data-action]")) button.onclick = () => this[button.dataset.action](button);
      if (!element.dataset.window) element.querySelector('[data-tool="window"]')?.remove();
      this.cursor.properties.location.change.connect(() => this.read());
      // A finger scrolls the page until a tool is chosen.
      const first = matchMedia("(pointer: coarse)").matches ? "" : "zoom";
      this.use(this.tool ?? first);
    }

    toggle(button) {
      const { series } = button.dataset;
      const shown = this.hidden.delete(series) || !this.hidden.add(series);
      button.setAttribute("aria-pressed", String(shown));
      this.figures.flat().forEach((figure) => this.hide(figure));
    }

    hide(figure) {
      for (const renderer of figure.renderers) renderer.visible = !this.hidden.has(renderer.name);
    }

    use(name) {
      this.tool = name;
      for (const button of all(this.element, "[data-tool]")) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
      this.figures.flat().forEach((figure) => this.drag(figure));
    }

    drag(figure) {
      figure.toolbar.active_drag = figure.toolbar.tools.find((tool) => tool.name === this.tool) ?? null;
    }

    reset() {
      this.time.setv({ start: this.whole[0], end: this.whole[1] });
      for (const figure of this.figures.flat()) figure.reset.emit();
      this.mark(NaN, NaN);
    }

    mark(start, stop) {
      const output = this.element.querySelector(".marked");
      this.marked = start < stop ? [start, stop] : null;
      this.box.visible = !!this.marked;
      output.hidden = !this.marked;
      if (!this.marked) return;
      this.box.setv({ left: start, right: stop });
      output.querySelector("code").textContent = `${this.element.dataset.window}${seconds(start)}:${seconds(stop)}`;
    }

    async copy(button) {
      const text = this.element.querySelector(".marked code").textContent;
      try {
        await navigator.clipboard.writeText(text);
      } catch {
        getSelection().selectAllChildren(this.element.querySelector(".marked code"));
        document.execCommand("copy");
      }
      button.textContent = "copied";
      setTimeout(() => { button.textContent = "copy"; }, 1500);
    }

    // Value of every visible curve at the cursor, the last sample before it.
    read() {
      const at = this.cursor.location;
      const outputs = all(this.element, ".values");
      for (const track of tracks.values()) track.draw(at);
      this.figures.forEach((panel, i) => {
        const found = [];
        for (const renderer of panel.flatMap((figure) => figure.renderers)) {
          const { glyph, data_source: source } = renderer;
          if (!renderer.visible || !glyph || glyph.type === "VArea") continue;
          const k = before(source, at);
          if (k >= 0) found.push(`${renderer.name} ${digits(source.get_array(glyph.y.field)[k])}`);
        }
        outputs[i].textContent = Number.isFinite(at) && found.length ? `${seconds(at)} s: ${found.join(" · ")}` : "";
      });
    }

    // The table of all curves, of the marked window if there is one; time axes that differ are joined.
    csv() {
      const [low, high] = this.marked ?? [-Infinity, Infinity];
      const rows = new Map();
      const head = ["time [s]"];
      for (const source of this.tables) {
        const columns = source.columns().filter((name) => name !== "t");
        const time = source.get_array("t");
        const values = columns.map((name) => source.get_array(name));
        for (let k = 0; k < time.length; k++) {
          if (!(time[k] >= low && time[k] <= high)) continue;
          if (!rows.has(time[k])) rows.set(time[k], []);
          values.forEach((value, j) => { rows.get(time[k])[head.length - 1 + j] = value[k]; });
        }
        head.push(...columns.map((name) => name.trim()));
      }
      const cell = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(7))) : "");
      const quoted = head.map((name) => `"${name.replaceAll('"', '""')}"`);
      const lines = [...rows.keys()].sort((a, b) => a - b)
        .map((t) => [t, ...Array.from({ length: head.length - 1 }, (_, j) => cell(rows.get(t)[j]))].join(","));
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([[quoted.join(","), ...lines, ""].join("\n")], { type: "text/csv" }));
      link.download = `${document.title.replace(/[^\w-]+/g, "-")}.csv`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    }
  }

  function draw(figure, one, source) {
    const { name, color, width, column } = one;
    if (one.band)
      figure.varea({ x: { field: "t" }, y1: { field: one.low }, y2: { field: one.high }, source, fill_color: one.band, name: one.band_name, level: "underlay" });
    if (one.marker)
      figure.scatter({ x: { field: "t" }, y: { field: column }, source, size: 6, marker: one.marker, line_color: color, fill_color: one.filled ? color : null, name });
    else
      figure.line({ x: { field: "t" }, y: { field: column }, source, line_color: color, line_width: width, line_dash: one.dash, name });
  }

  function unpacked(text, Kind) {
    return new Kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  }

  // Index of the last sample at or before a time; NaN, which breaks curves, is passed over.
  function before(source, at) {
    source._stoop ??= (() => {
      const time = source.get_array("t");
      const index = [...time.keys()].filter((k) => Number.isFinite(time[k]));
      return { index, time: index.map((k) => time[k]) };
    })();
    const { index, time } = source._stoop;
    let low = 0;
    let high = time.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] <= at) low = middle + 1;
      else high = middle;
    }
    return low ? index[low - 1] : -1;
  }

  // Path and attitude in space, seen from far away; east to the right, north away, up.
  class Track {
    constructor(element) {
      this.element = element;
      this.canvas = element.querySelector("canvas");
      const { columns, data, aircraft, size } = JSON.parse(element.querySelector("script").textContent);
      const numbers = unpacked(data, Float64Array);
      this.rows = Array.from({ length: numbers.length / columns }, (_, i) => numbers.subarray(i * columns, (i + 1) * columns));
      this.aircraft = aircraft;
      this.azimuth = 0.61;
      this.elevation = 0.44;
      const ends = [1, 2, 3].map((k) => this.rows.reduce(([a, b], row) => [Math.min(a, row[k]), Math.max(b, row[k])], [Infinity, -Infinity]));
      this.middle = ends.map(([a, b]) => (a + b) / 2);
      this.ground = ends[2][0];
      this.extent = Math.max(...ends.map(([a, b]) => b - a), 1);
      this.size = size * this.extent;
      element.classList.add("live");
      this.canvas.onpointerdown = (event) => this.canvas.setPointerCapture(event.pointerId);
      this.canvas.onpointermove = (event) => {
        if (!this.canvas.hasPointerCapture(event.pointerId)) return;
        this.azimuth += event.movementX / 150;
        this.elevation = Math.min(Math.PI / 2, Math.max(0, this.elevation + event.movementY / 150));
        this.draw();
      };
      new ResizeObserver(() => this.draw()).observe(this.canvas);
    }

    place([north, east, up]) {
      const [n, e, h] = [north - this.middle[0], east - this.middle[1], up - this.middle[2]];
      const right = e * Math.cos(this.azimuth) - n * Math.sin(this.azimuth);
      const away = e * Math.sin(this.azimuth) + n * Math.cos(this.azimuth);
      return [this.across + this.scale * right, this.down - this.scale * (h * Math.cos(this.elevation) + away * Math.sin(this.elevation))];
    }

    line(points, color, width) {
      const { context } = this;
      context.beginPath();
      for (const point of points) context.lineTo(...this.place(point));
      context.strokeStyle = color;
      context.lineWidth = width;
      context.stroke();
    }

    // The aircraft (points along body axes) of a row, so many times its size.
    glyph(row, times) {
      const [w, x, y, z] = row.subarray(4);
      const s = times * this.size;
      return this.aircraft.map(([a, b, c]) => [
        row[1] + s * ((1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c),
        row[2] + s * (2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c),
        row[3] - s * (2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c),
      ]);
    }

    draw(time = this.time) {
      this.time = time;
      const { canvas } = this;
      const ratio = devicePixelRatio;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      canvas.width = width * ratio;
      canvas.height = height * ratio;
      this.context = canvas.getContext("2d");
      this.context.scale(ratio, ratio);
      this.across = width / 2;
      this.down = height / 2;
      this.scale = 0.8 * Math.min(width, height) / this.extent;
      const path = this.rows.map((row) => row.subarray(1, 4));
      const step = 10 ** Math.floor(Math.log10(this.extent / 2));
      for (let k = -10; k <= 10; k++) {
        const reach = 10 * step;
        if (Math.abs(k * step) > this.extent * 0.75) continue;
        const limit = Math.min(reach, this.extent * 0.75);
        const [n, e] = [Math.round(this.middle[0] / step) * step, Math.round(this.middle[1] / step) * step];
        this.line([[n + k * step, e - limit, this.ground], [n + k * step, e + limit, this.ground]], style("--grid"), 1);
        this.line([[n - limit, e + k * step, this.ground], [n + limit, e + k * step, this.ground]], style("--grid"), 1);
      }
      this.line(path.map(([n, e]) => [n, e, this.ground]), style("--measured"), 1);
      this.line(path, style("--fit"), 1.5);
      const every = Math.max(1, Math.floor(this.rows.length / 40));
      for (let i = 0; i < this.rows.length; i += every) if (Number.isFinite(this.rows[i][4])) this.line(this.glyph(this.rows[i], 1), style("--ink"), 1);
      const now = this.rows.findLast((row) => row[0] <= time);
      if (now && Number.isFinite(time)) {
        this.line([[now[1], now[2], this.ground], now.subarray(1, 4)], style("--lag"), 1);
        this.line(Number.isFinite(now[4]) ? this.glyph(now, 2.5) : [], style("--lag"), 2.5);
      }
      this.context.fillStyle = style("--tick");
      this.context.font = "11px system-ui, sans-serif";
      this.context.fillText(`grid ${step} m`, 6, height - 6);
    }
  }

  // Print shows what is folded.
  let folded = [];
  addEventListener("beforeprint", () => { folded = all(document, "details:not([open])"); for (const one of folded) one.open = true; });
  addEventListener("afterprint", () => { for (const one of folded) one.open = false; });

  if (typeof Bokeh === "undefined") return;
  Bokeh.set_log_level("error");
  const histories = new Map(all(document, ".history").map((element) => [element, new History(element)]));
  const tracks = new Map(all(document, ".track").map((element) => [element, new Track(element)]));
  const watcher = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries)
      if (isIntersecting) { watcher.unobserve(target); histories.get(target).show(); }
  }, { rootMargin: "300px" });
  for (const element of histories.keys()) watcher.observe(element);
  dark.addEventListener("change", () => { for (const one of histories.values()) if (one.figures) one.show(); for (const one of tracks.values()) one.draw(); });
})();
