// What every page has: dark and light, tables that sort, the index, the filter. Charts are told of a change of colours.
"use strict";
window.drm = (() => {
  const root = document.documentElement;
  const listeners = [];
  const dark = JSON.parse(document.querySelector("#on-dark").textContent);
  const drm = {
    colour: (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim(),
    /** A policy's colour as it is drawn now: where it is dark, some are paler. */
    line: (colour) => (root.dataset.theme === "dark" ? dark[colour] ?? colour : colour),
    onTheme: (listener) => listeners.push(listener),
    element: (name, properties = {}, ...children) => {
      const { dataset, ...rest } = properties;
      const made = Object.assign(document.createElement(name), rest);
      Object.assign(made.dataset, dataset ?? {});
      made.append(...children);
      return made;
    },
    /** A piece of a policy's line. */
    mark: (colour, dash = []) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      made.setAttribute("viewBox", "0 0 22 8");
      made.setAttribute("class", "mark");
      made.setAttribute("aria-hidden", "true");
      const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
      for (const [name, value] of Object.entries({ x1: 1, y1: 4, x2: 21, y2: 4, stroke: colour, "stroke-dasharray": dash.join(" ") })) {
        if (value !== "") line.setAttribute(name, value);
      }
      made.append(line);
      return made;
    },
    numbers: (text) => {
      const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
      return new Float32Array(bytes.buffer);
    },
    /** A number in about four digits, with a proper minus sign. */
    shown: (value) => {
      if (value === null || value === undefined || !Number.isFinite(value)) return "–";
      const size = Math.abs(value);
      const digits = size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : size >= 0.01 || size === 0 ? 3 : 5;
      return value.toFixed(digits).replace("-", "−");
    },
    /** What is drawn here, with its data. */
    parts: (script) => [...document.querySelectorAll(`.drawn[data-script="${script}"]`)]
      .map((place) => [place, JSON.parse(place.querySelector("script").textContent)]),
    axes: (unit, width) => {
      const font = "11px system-ui, sans-serif";
      const ink = drm.colour("soft");
      const grid = { stroke: drm.colour("grid"), width: 1 };
      const ticks = { stroke: drm.colour("line"), width: 1, size: 4 };
      return [
        { stroke: ink, grid, ticks, font, size: 26, gap: 3 },
        { stroke: ink, grid, ticks, font, size: width ?? 52, gap: 4 },
      ];
    },
  };

  document.querySelector("#theme").addEventListener("click", () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    try { localStorage.setItem("drm-theme", root.dataset.theme); } catch { /* a page without memory */ }
    for (const listener of listeners) listener();
  });

  // tables
  const orderOf = (cell) => {
    const text = cell.dataset.order ?? cell.textContent.trim().replace("−", "-").replaceAll(",", "");
    const number = parseFloat(text);
    return Number.isNaN(number) ? [1, text] : [0, number];
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      head.tabIndex = 0;
      const sort = () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const rows = [...table.tBodies[0].rows].map((row) => [orderOf(row.cells[column]), row]);
        rows.sort(([[ka, a]], [[kb, b]]) => ka - kb || (up ? 1 : -1) * (ka ? String(a).localeCompare(String(b)) : a - b));
        table.tBodies[0].append(...rows.map(([, row]) => row));
      };
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
    });
  }

  // the index: where one is; folded on a narrow screen
  const index = document.querySelector("#index details");
  if (matchMedia("(max-width: 900px)").matches) index.open = false;
  const entries = new Map([...document.querySelectorAll("#index li")].map((entry) => [entry.dataset.for, entry]));
  const sections = [...document.querySelectorAll("main > section")];
  const seen = new Set();
  const watcher = new IntersectionObserver((changes) => {
    for (const { target, isIntersecting } of changes) seen[isIntersecting ? "add" : "delete"](target);
    const first = sections.find((section) => seen.has(section));
    for (const [name, entry] of entries) entry.classList.toggle("here", name === first?.id);
  }, { rootMargin: "-5% 0px -60% 0px" });
  for (const section of sections) watcher.observe(section);

  // the filter
  const choices = [...document.querySelectorAll("[data-choice]")];
  const search = document.querySelector("#search");
  if (search) {
    const found = document.querySelector("#found");
    const words = new Map(sections.map((section) => [section, section.querySelector("h2").textContent.toLowerCase()]));
    const rows = [...document.querySelectorAll("tr[data-tag]")];
    const texts = new Map(rows.map((row) => [row, row.textContent.toLowerCase()]));
    const filter = () => {
      const chosen = new Set(choices.filter((choice) => choice.getAttribute("aria-pressed") === "true").map((choice) => choice.dataset.choice));
      const everything = chosen.size === choices.length;
      const asked = search.value.trim().toLowerCase();
      let count = 0;
      for (const row of rows) {
        const inTitle = words.get(row.closest("section")).includes(asked);
        row.hidden = !(chosen.has(row.dataset.tag) && (inTitle || texts.get(row).includes(asked)));
        if (!row.hidden) count += 1;
      }
      for (const section of sections) {
        const own = [...section.querySelectorAll("tr[data-tag]")];
        const tags = (section.dataset.tags ?? "").split(" ");
        const fits = words.get(section).includes(asked) && (everything || tags.some((tag) => chosen.has(tag)));
        section.hidden = own.length ? own.every((row) => row.hidden) && !(asked && everything && fits) : !fits;
        const entry = entries.get(section.id);
        if (entry) entry.hidden = section.hidden;
      }
      for (const list of document.querySelectorAll("#index ul")) {
        const empty = [...list.children].every((entry) => entry.hidden);
        list.hidden = empty;
        if (list.previousElementSibling?.tagName === "H2") list.previousElementSibling.hidden = empty;
      }
      for (const heading of document.querySelectorAll("h2.group")) {
        let next = heading.nextElementSibling;
        while (next?.tagName === "SECTION" && next.hidden) next = next.nextElementSibling;
        heading.hidden = next?.tagName !== "SECTION";
      }
      found.textContent = `${count} of ${rows.length} rows`;
    };
    // a click shows what has this verdict alone, another click everything again
    const pressed = (choice) => choice.getAttribute("aria-pressed") === "true";
    for (const choice of choices) {
      choice.addEventListener("click", () => {
        const alone = pressed(choice) && choices.filter(pressed).length === 1;
        for (const other of choices) other.setAttribute("aria-pressed", String(alone || other === choice));
        filter();
      });
    }
    search.addEventListener("input", filter);
    filter();
  }
  return drm;
})();
