// Episodes of many policies: a metric in order, or over what was drawn for the episode.
"use strict";
(() => {
  const { element, mark, shown } = drm;

  class Episodes {
    constructor(place, content) {
      Object.assign(this, { content, hidden: new Set(), chart: null });
      const choice = (name, entries) => {
        const made = element("select", { ariaLabel: name, dataset: { act: name } }, ...entries.map(({ label, unit }, value) => element("option", { value, textContent: unit ? `${label} (${unit})` : label })));
        made.addEventListener("change", () => this.rebuild());
        return made;
      };
      this.metric = choice("metric", content.metrics);
      this.over = choice("over", content.columns);
      this.who = element("div", { className: "who", role: "group", ariaLabel: "who is shown" }, ...content.policies.map(({ label, colour, dash }, k) => {
        const chip = element("button", { type: "button", className: "chip", ariaPressed: "true", dataset: { policy: label } }, mark(colour, dash), label);
        chip.addEventListener("click", () => {
          const hidden = chip.ariaPressed === "true";
          chip.ariaPressed = String(!hidden);
          this.hidden[hidden ? "add" : "delete"](k);
          this.chart.setSeries(k + 1, { show: !hidden });
        });
        return chip;
      }));
      this.plot = element("div", { className: "plot" });
      this.told = element("p", { className: "note tip" });
      place.append(element("div", { className: "tools" }, element("label", {}, "metric", this.metric), element("label", { hidden: content.columns.length < 2 }, "over", this.over)), this.who, this.plot, this.told);
      for (const child of [...place.children].slice(1)) child.style.marginTop = "10px";
      this.rebuild();
      drm.onTheme(() => this.rebuild());
      new ResizeObserver(() => {
        const width = this.plot.clientWidth;
        if (width && width !== this.chart.width) this.chart.setSize({ width, height: this.height(width) });
      }).observe(place);
    }

    height(width) {
      return Math.round(Math.max(260, Math.min(420, 0.5 * width)));
    }

    rebuild() {
      this.chart?.destroy();
      const metric = this.content.metrics[this.metric.value];
      const column = this.content.columns[this.over.value];
      const sorted = column.values === null;
      const rows = metric.values; // by policy, of every episode; null where there is none
      const count = Math.max(...rows.map((row) => row.length));
      let order = Array.from({ length: count }, (_, k) => k);
      let xs;
      let ys;
      if (sorted) {
        xs = order.map((k) => (100 * (k + 1)) / count);
        this.who_at = rows.map((row) => order.filter((k) => k < row.length).sort((a, b) => (row[a] ?? Infinity) - (row[b] ?? Infinity)));
        ys = rows.map((row, p) => {
          const own = this.who_at[p];
          // of fewer episodes: their own shares
          return order.map((k) => row[own[Math.min(own.length - 1, Math.floor(((k + 0.5) * own.length) / count))]]);
        });
      } else {
        order = order.filter((k) => column.values[k] !== null).sort((a, b) => column.values[a] - column.values[b]);
        xs = order.map((k) => column.values[k]);
        ys = rows.map((row) => order.map((k) => row[k] ?? null));
      }
      const values = ys.flat().filter((value) => value !== null);
      const log = metric.unit !== "%" && values.length > 0 && values.every((value) => value > 0) && Math.max(...values) > 8 * Math.min(...values);
      const clean = (value) => (value === null || (log && !(value > 0)) ? null : value);
      const axes = drm.axes(metric.unit, 58);
      const label = (text, unit) => (unit ? `${text} (${unit})` : text);
      const plain = (tick) => (tick === null ? "" : String(+tick.toPrecision(4)).replace("-", "−"));
      this.chart = new uPlot({
        width: Math.max(220, this.plot.clientWidth),
        height: this.height(this.plot.clientWidth || 800),
        scales: { x: { time: false }, y: log ? { distr: 3, log: 10 } : {} },
        axes: [
          { ...axes[0], label: label(column.label, column.unit), labelSize: 20, labelFont: "12px system-ui, sans-serif", size: 30, values: (_, ticks) => ticks.map(plain) },
          { ...axes[1], label: label(metric.label, metric.unit), labelSize: 20, labelFont: "12px system-ui, sans-serif", values: (_, ticks) => ticks.map(plain) },
        ],
        legend: { show: false },
        cursor: { drag: { x: true, y: true, uni: 20 }, focus: { prox: 24 }, points: { size: 9 } },
        focus: { alpha: 0.35 },
        series: [{}, ...this.content.policies.map(({ label: name, colour, dash }, k) => ({
          label: name,
          show: !this.hidden.has(k),
          stroke: drm.line(colour),
          width: 1.8,
          dash,
          paths: sorted ? undefined : () => null,
          points: { show: !sorted, size: 6.5, width: 1.6, fill: dash.length ? drm.colour("card") : drm.line(colour) },
        }))],
        hooks: {
          setCursor: [(chart) => {
            const place = chart.cursor.idx;
            if (place === null || place === undefined) return this.#say("Drag to zoom, double click for everything.");
            const parts = this.content.policies.map(({ label: name }, k) => (this.hidden.has(k) ? null : `${name} ${shown(ys[k][place])}`)).filter(Boolean);
            const where = sorted ? `best ${shown(xs[place])} % of the episodes: at most` : `seed ${this.content.seeds[order[place]]}, ${column.label} ${shown(xs[place])} ${column.unit}:`;
            return this.#say(`${where} ${parts.join(", ")} ${metric.unit}`);
          }],
        },
      }, [xs, ...ys.map((row) => row.map(clean))], this.plot);
      this.#say("Drag to zoom, double click for everything.");
    }

    #say(text) {
      this.told.textContent = text;
    }
  }

  drm.episodes = drm.parts("episodes").map(([place, content]) => new Episodes(place, content));
  document.documentElement.dataset.state = "drawn";
})();
