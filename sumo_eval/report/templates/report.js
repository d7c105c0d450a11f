// Draws the maps and charts of the report from the data in the page. Everything a person typed is shown through
// textContent, or through plain() where Plotly would read markup.
"use strict";

(async () => {
  const byId = (id) => document.getElementById(id);
  window.addEventListener("error", (event) => fail(event.message));
  window.addEventListener("unhandledrejection", (event) => fail(event.reason));
  const data = JSON.parse(await sumoEval.inflated(byId("report-data").textContent));
  const library = document.createElement("script"); // inline scripts run as they are added
  library.textContent = await sumoEval.inflated(byId("plotly-code").textContent);
  document.head.append(library);
  const C = sumoPage.colour;
  const outcomeStyles = () => ({
    "no contact": { symbol: "circle", color: C("--c"), size: 8, line: { width: 1, color: C("--paper") } },
    collision: { symbol: "x-thin", color: C("--hit"), size: 8, line: { width: 3.2, color: C("--hit") } },
    "off road": { symbol: "triangle-up", color: C("--off"), size: 10, line: { width: 1, color: C("--paper") } },
    "not evaluated": { symbol: "square", color: C("--paper"), size: 9, line: { width: 2, color: C("--ink") } },
  });
  const BINS = 20; // of D_i in 0..1
  const FIELD_CELLS = { x: 150, y: 36 };
  const FONT = { family: getComputedStyle(document.body).fontFamily, size: 12 };
  const CONFIG = { displaylogo: false, responsive: true, displayModeBar: false, doubleClick: "reset" };
  const canHover = matchMedia("(hover: hover)").matches;
  const selected = { scenario: 0, index: 0 };

  // --- words and numbers ---------------------------------------------------------------------------------------------

  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const short = (value) => String(+value.toPrecision(6));
  const label = (parameter) => [parameter.name.replaceAll("_", " "), parameter.unit].filter(Boolean).join(", ");
  const pointWords = (scenario, values) =>
    scenario.parameters.map((parameter, k) => `${parameter.name} ${short(values[k])}`).join(", ");

  /** Digits and heading of U; a loss in 0..1, which has no unit, has three decimals. */
  const digitsOfU = data.severityUnit ? 1 : 3, headOfU = data.severityUnit ? `U,${data.severityUnit}` : "U";
  const severity = (value) => `${fixed(value, digitsOfU)}${data.severityUnit}`;

  function caseHover(scenario, item) {
    const lines = scenario.parameters.map((p, k) => `${plain(p.name)} = ${short(item.values[k])} ${plain(p.unit)}`);
    lines.push(`<b>${item.outcome}</b>, ${item.zone} zone`);
    if (item.outcome === "collision") lines.push(`U = ${severity(item.severity)}, ideal ${severity(item.ideal_severity)}`);
    if (item.index !== null) lines.push(`D<sub>i</sub> = ${fixed(item.index, 3)}`);
    return lines.join("<br>");
  }

  // --- layouts -------------------------------------------------------------------------------------------------------

  function layout(x, y, more = {}) {
    const axis = { gridcolor: C("--hair"), zeroline: false, linecolor: C("--axis"), ticks: "outside", ticklen: 4, tickcolor: C("--axis") };
    const font = { ...FONT, color: C("--ink") };
    return {
      font, margin: { l: 52, r: 12, t: 8, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false,
      hovermode: "closest", dragmode: canHover ? "zoom" : false, autosize: true,
      hoverlabel: { bgcolor: C("--paper"), bordercolor: C("--axis"), font, align: "left" },
      ...more,
      xaxis: { ...axis, ...x }, yaxis: { ...axis, ...y },
    };
  }

  const title = (text) => ({ title: { text, standoff: 8 } });

  const padded = (scenario, k) => {
    const { low, high } = scenario.parameters[k];
    return [low - 0.045 * (high - low), high + 0.045 * (high - low)];
  };

  /** Range of an axis on which every value stands in the middle of a tile of its own. */
  function tiled(scenario, k) {
    const values = sumoMaps.levelsOf(scenario, k);
    if (values.length < 2) return padded(scenario, k);
    return [values[0] - (values[1] - values[0]) / 2, values.at(-1) + (values.at(-1) - values.at(-2)) / 2];
  }

  function mapAxes(scenario, view, rangeOf) {
    const { x, y } = view;
    const along = scenario.parameters[x];
    const xaxis = { ...title(plain(label(along))), range: rangeOf(scenario, x), fixedrange: true, showgrid: false };
    if (y === null) return [xaxis, { range: [-1, 1], visible: false, fixedrange: true }];
    const across = scenario.parameters[y];
    return [xaxis, { ...title(plain(label(across))), range: rangeOf(scenario, y), fixedrange: true, showgrid: false }];
  }

  const place = (view, values) => [values[view.x], view.y === null ? 0 : values[view.y]];

  // --- drawing when it is seen, and anew in another light ------------------------------------------------------------

  const drawn = [], unseen = new Set();

  /** Run a drawing once its section is unfolded, and again whenever the colours change. */
  function whenSeen(element, draw) {
    const fold = element.closest("details.fold");
    const first = () => {
      if (!unseen.delete(first)) return;
      drawn.push(draw);
      draw();
    };
    unseen.add(first);
    if (!fold || fold.open) first();
    else fold.addEventListener("toggle", first, { once: true });
  }

  sumoPage.onTheme(() => drawn.forEach((draw) => draw()));

  /** The numbers behind a chart, a row a mark. */
  function rowsOf(plot, scenario) {
    const rows = [["series", "case", "x", "y", "value"]];
    const key = (index) => (typeof index === "number" && scenario ? scenario.cases[index]?.key ?? "" : "");
    for (const trace of plot.data ?? []) {
      if (trace.hoverinfo === "skip" && trace.type !== "heatmap" && !trace.name) continue;
      const name = trace.name ?? "";
      if (trace.type === "heatmap") trace.z.forEach((line, r) => Array.from(line).forEach((z, c) => { if (z !== null) rows.push([name, key(trace.customdata?.[r]?.[c]), trace.x[c], trace.y[r], z]); }));
      else if (trace.x) Array.from(trace.x).forEach((x, i) => rows.push([name, key(trace.customdata?.[i]), x, trace.y?.[i], Array.isArray(trace.marker?.color) ? trace.marker.color[i] : ""]));
    }
    return rows;
  }

  /** The buttons that save a chart of Plotly, in a bar of their own or in the caption above it. */
  function withSaver(plot, name, bar, scenario = null) {
    const svg = async () => {
      const address = await Plotly.toImage(plot, { format: "svg", width: plot.clientWidth || 700, height: plot.clientHeight || 400 });
      return decodeURIComponent(address.slice(address.indexOf(",") + 1));
    };
    bar.append(sumoPage.saver(name, svg, () => rowsOf(plot, scenario)));
  }

  function chart(plot, name, scenario = null) {
    if (plot.dataset.saved) return;
    plot.dataset.saved = "yes";
    withSaver(plot, name, plot.closest("figure").querySelector("figcaption"), scenario);
  }

  // --- maps ----------------------------------------------------------------------------------------------------------

  const moveRings = [];

  /** A card of maps. what: { rangeOf, passes, traces(scenario, view, ads, shows, zones, scenarioIndex), ringed }. */
  function mapCard(card, scenarioIndex, what) {
    const scenario = data.scenarios[scenarioIndex];
    const holder = card.querySelector(".panels"), about = holder.getAttribute("aria-label");
    const view = sumoMaps.opening(scenario);
    const names = [...card.querySelectorAll("input[data-ads]")].map((input) => input.value);
    const first = () => card.querySelector("input[data-ads]:checked").value;
    let second = "";
    const [axisBar, sliceBar, note] = ["div", "div", "p"].map((tag) => document.createElement(tag));
    axisBar.className = "map-bar";
    sliceBar.className = "map-bar";
    note.className = "small slice-note";
    note.setAttribute("aria-live", "polite");
    const outer = document.createElement("div");
    outer.className = "beside";
    outer.setAttribute("role", "group");
    outer.setAttribute("aria-label", about);
    holder.replaceWith(axisBar, sliceBar, note, outer);
    let panels = [], plots = [];
    const passes = (item) => what.passes?.(item) ?? true;

    function build() {
      sumoMaps.axes(scenario, view, axisBar, build);
      if (names.length > 1) {
        const beside = sumoMaps.select([["", "nothing"], ...names.filter((name) => name !== first()).map((name) => [name, name])], second, (value) => { second = value; build(); what.changed?.(); });
        beside.dataset.beside = "";
        axisBar.append(sumoMaps.labelled("beside it", beside));
      }
      sumoMaps.sliders(scenario, view, sliceBar, () => draw());
      panels = sumoMaps.panelsOf(scenario, view);
      // Plotly may still be at work on its margins, and finds nothing to work on in a plot that is gone.
      for (const { plot, drawn } of plots) Promise.resolve(drawn).finally(() => Plotly.purge(plot));
      plots = [];
      const columns = second && second !== first() ? 2 : 1;
      outer.classList.toggle("two-ads", columns === 2);
      outer.replaceChildren(...Array.from({ length: columns }, (_, column) => {
        const side = document.createElement("div"), grid = document.createElement("div");
        if (columns === 2) {
          const heading = document.createElement("h4");
          heading.textContent = column ? second : first();
          side.append(heading);
        }
        grid.className = "panels";
        grid.classList.toggle("single", panels.length === 1);
        grid.classList.toggle("strip", view.y === null);
        grid.append(...panels.map((value, panel) => panelOf(value, panel, column)));
        side.append(grid);
        return side;
      }));
      draw();
    }

    function panelOf(value, panel, column) {
      const made = document.createElement("div"), bar = document.createElement("div"), heading = document.createElement("h5"), plot = document.createElement("div");
      made.className = "panel";
      bar.className = "plot-bar";
      plot.className = "plot";
      const parameter = view.panel === null ? null : scenario.parameters[view.panel];
      heading.textContent = parameter ? `${sumoMaps.words(parameter.name)} = ${short(value)} ${parameter.unit}` : "";
      bar.append(heading);
      made.append(bar, plot);
      plots.push({ plot, panel, column });
      withSaver(plot, `${scenario.name} ${what.name} ${heading.textContent}`.trim(), bar, scenario);
      return made;
    }

    function draw() {
      if (plots.some(({ plot }) => !plot.isConnected)) return;
      const shownZones = new Map();
      const sides = [first(), second];
      for (const one of plots) {
        const { plot, panel, column } = one;
        if (what.zones && !shownZones.has(panel)) shownZones.set(panel, sumoMaps.zones(scenario, view, panels, panel));
        const shows = (item) => passes(item) && sumoMaps.shows(scenario, view, panels, panel, item);
        const fresh = !plot.data;
        one.drawn = Plotly.react(plot, what.traces(scenario, view, sides[column], shows, shownZones.get(panel), scenarioIndex), layout(...mapAxes(scenario, view, what.rangeOf), { dragmode: false }), CONFIG);
        if (fresh) plot.on("plotly_click", (event) => onPick(scenarioIndex, event));
      }
      const own = scenario.cases.filter((item) => item.ads === first());
      const inside = own.filter((item) => passes(item) && panels.some((_, panel) => sumoMaps.shows(scenario, view, panels, panel, item))).length;
      const bare = what.zones && sumoMaps.sliced(scenario, view).some((k) => view.at[k].all) ? " A map over all values of a parameter shows no zones." : "";
      note.textContent = inside === own.length && !bare ? "" : `${inside} of ${own.length} cases of ${first()} are shown: those in the slice that pass the filter.${bare}`;
      note.hidden = !note.textContent;
    }

    card.addEventListener("change", (event) => {
      if (event.target.matches("input[data-ads]")) build();
      else draw();
    });
    moveRings.push(() => { if (plots.length && plots[0].plot.data) draw(); });
    let built = false;
    whenSeen(card, () => { built ? draw() : build(); built = true; });
    return { redraw: () => { if (built) draw(); } };
  }

  function backgroundTraces(scenario, view, zones) {
    if (!zones) return [];
    const [safe, hazardous, impossible] = ["--safe", "--hazardous", "--impossible"].map(C);
    if (view.y === null) {
      // One parameter has no area: zones are intervals, drawn as a band of cells.
      return [{
        type: "heatmap", x: zones.x, y: [0], z: [zones.exact[0].map((level) => (level > 0 ? 1 : 0))], zmin: 0, zmax: 1, showscale: false, hoverinfo: "skip",
        colorscale: [[0, hazardous], [0.5, hazardous], [0.5, safe], [1, safe]],
      }];
    }
    const shared = { type: "contour", x: zones.x, y: zones.y, hoverinfo: "skip", showscale: false, autocontour: false };
    const filled = { contours: { start: 0, end: 0, size: 1, coloring: "fill", showlines: false } };
    const [xLow, xHigh, yLow, yHigh] = [zones.x[0], zones.x.at(-1), zones.y[0], zones.y.at(-1)];
    const traces = [
      { ...shared, ...filled, zmin: -1, zmax: 1, z: zones.exact, colorscale: [[0, hazardous], [0.5, hazardous], [0.5, safe], [1, safe]] },
      { ...shared, z: zones.gp, contours: { start: 0, end: 0, size: 1, coloring: "none" }, line: { color: C("--ink"), width: 1.8 } },
    ];
    if (zones.impossible.length) {
      const corners = { x: [], y: [] };
      for (const polygon of zones.impossible) {
        corners.x.push(...polygon.map((corner) => corner[0]), null);
        corners.y.push(...polygon.map((corner) => corner[1]), null);
      }
      traces.push({
        ...corners, type: "scatter", mode: "lines", fill: "toself", hoverinfo: "skip", line: { width: 0 },
        fillcolor: impossible, fillpattern: { shape: "/", size: 7, solidity: 0.16, fgcolor: C("--hatch"), bgcolor: impossible },
      });
    }
    const frame = { x: [xLow, xHigh, xHigh, xLow, xLow], y: [yLow, yLow, yHigh, yHigh, yLow] };
    return [...traces, { ...frame, type: "scatter", mode: "lines", hoverinfo: "skip", line: { color: C("--axis"), width: 1 } }];
  }

  function markers(scenario, view, ads, shows) {
    return Object.entries(outcomeStyles()).map(([outcome, style]) => {
      const chosen = scenario.cases.map((item, index) => [item, index])
        .filter(([item]) => (ads === null || item.ads === ads) && item.outcome === outcome && shows(item));
      return {
        type: "scatter", mode: "markers", name: outcome, marker: { ...style, opacity: 1 }, cliponaxis: false,
        x: chosen.map(([item]) => place(view, item.values)[0]), y: chosen.map(([item]) => place(view, item.values)[1]),
        customdata: chosen.map(([, index]) => index),
        text: chosen.map(([item]) => caseHover(scenario, item)), hovertemplate: "%{text}<extra></extra>",
      };
    });
  }

  /** The most dangerous points that lie in the slice. */
  function stars(scenario, view, shows) {
    const worst = scenario.mostDangerous.filter(shows);
    return {
      type: "scatter", mode: "markers", cliponaxis: false, hovertemplate: "%{text}<extra></extra>", name: "most dangerous point",
      x: worst.map((star) => place(view, star.values)[0]), y: worst.map((star) => place(view, star.values)[1]),
      text: worst.map((star) => `most dangerous point<br>${plain(pointWords(scenario, star.values))}`),
      marker: { symbol: "star", size: 15, color: "#f0e442", line: { color: "#1b1f24", width: 1.2 } },
    };
  }

  /** A ring around the case that is shown, where it lies in the slice. */
  function ring(scenario, view, shows, scenarioIndex) {
    const item = scenarioIndex === selected.scenario ? scenario.cases[selected.index] : null;
    const at = item && shows(item) ? [place(view, item.values)] : [];
    return {
      type: "scatter", mode: "markers", hoverinfo: "skip", cliponaxis: false, x: at.map((one) => one[0]), y: at.map((one) => one[1]),
      marker: { symbol: "circle-open", size: 18, color: C("--ink"), line: { width: 2 } },
    };
  }

  function zoneMaps() {
    for (const card of document.querySelectorAll("[data-map]")) {
      const scenarioIndex = Number(card.dataset.map), scenario = data.scenarios[scenarioIndex];
      const filter = { zone: "", outcome: "", words: "", ranges: {} };
      const passes = (item) => (!filter.zone || item.zone === filter.zone) && (!filter.outcome || item.outcome === filter.outcome || item.kind === filter.outcome && item.outcome === "collision")
        && (!filter.words || item.key.toLowerCase().includes(filter.words))
        && Object.entries(filter.ranges).every(([k, [low, high]]) => item.values[k] >= low - 1e-9 && item.values[k] <= high + 1e-9);
      sceneDrawing(card, scenarioIndex);
      const list = caseList(card, scenario, scenarioIndex, passes);
      const maps = mapCard(card, scenarioIndex, {
        name: "zones", rangeOf: padded, passes, zones: true, changed: () => list.show(),
        // The star lies under the markers, so that the case at the most dangerous point stays visible and clickable.
        traces: (of, view, ads, shows, zones) => [
          ...backgroundTraces(of, view, zones), stars(of, view, (star) => shows({ ...star, key: "", outcome: filter.outcome, zone: filter.zone })),
          ...markers(of, view, ads, shows), ring(of, view, shows, scenarioIndex),
        ],
      });
      filterBar(card, scenario, filter, () => { maps.redraw(); list.show(); });
      card.addEventListener("change", () => list.show());
      groupList(card, scenario, scenarioIndex, filter, () => { maps.redraw(); list.show(); });
    }
  }

  function onPick(scenarioIndex, event) {
    const hit = event.points.find((point) => typeof point.customdata === "number");
    if (hit) showCase(scenarioIndex, hit.customdata, true);
  }

  // --- filters, groups and the list of cases --------------------------------------------------------------------------

  function filterBar(card, scenario, filter, changed) {
    const bar = card.querySelector("[data-filter]");
    const valuesOf = (name) => [...new Set(scenario.cases.map((item) => item[name]))].sort();
    const kinds = [...new Set(scenario.cases.filter((item) => item.outcome === "collision").map((item) => item.kind))];
    const choices = (values) => [["", "any"], ...values.map((value) => [value, value])];
    const [zone, outcome] = [["zone", valuesOf("zone")], ["outcome", [...valuesOf("outcome"), ...kinds]]].map(([name, values]) => {
      const made = sumoMaps.select(choices(values), "", (value) => { filter[name] = value; changed(); });
      made.dataset.by = name;
      return made;
    });
    const search = document.createElement("input");
    search.type = "search";
    search.size = 14;
    search.addEventListener("input", () => { filter.words = search.value.trim().toLowerCase(); changed(); });
    search.addEventListener("change", (event) => event.stopPropagation());
    const limits = scenario.parameters.map((parameter, k) => {
      const [low, high] = ["least", "most"].map((which) => {
        const input = document.createElement("input");
        input.type = "number";
        input.step = "any";
        input.dataset.range = `${parameter.name} ${which}`;
        input.setAttribute("aria-label", `${which} ${label(parameter)}`);
        input.placeholder = short(which === "least" ? parameter.low : parameter.high);
        input.addEventListener("change", (event) => { event.stopPropagation(); narrow(); });
        return input;
      });
      const narrow = () => {
        const value = (input, fallback) => (input.value === "" || !Number.isFinite(input.valueAsNumber) ? fallback : input.valueAsNumber);
        if (low.value === "" && high.value === "") delete filter.ranges[k];
        else filter.ranges[k] = [value(low, -Infinity), value(high, Infinity)];
        changed();
      };
      const holder = document.createElement("span");
      holder.className = "ranges";
      const box = document.createElement("label");
      box.append(`${label(parameter)}: `, low, " to ", high);
      holder.append(box);
      return { holder, low, high, narrow };
    });
    const clear = sumoPage.button("Clear", () => {
      Object.assign(filter, { zone: "", outcome: "", words: "", ranges: {} });
      search.value = zone.value = outcome.value = "";
      limits.forEach(({ low, high }) => { low.value = high.value = ""; });
      changed();
    });
    bar.append(sumoMaps.labelled("zone", zone), sumoMaps.labelled("outcome", outcome), sumoMaps.labelled("id has", search), ...limits.map(({ holder }) => holder), clear);
    filter.show = (ranges, kind) => {
      Object.assign(filter, { zone: "", words: "" });
      search.value = zone.value = "";
      limits.forEach(({ low, high }, k) => {
        const range = ranges[scenario.parameters[k].name];
        [low.value, high.value] = range ? range : ["", ""];
        if (range) filter.ranges[k] = range; else delete filter.ranges[k];
      });
      filter.outcome = [...outcome.options].some((option) => option.value === kind) ? kind : "";
      outcome.value = filter.outcome;
      changed();
    };
  }

  const MOST_GROUP_CASES = 6;

  function groupList(card, scenario, scenarioIndex, filter) {
    const box = card.querySelector("[data-groups]");
    box.hidden = scenario.groups.length === 0;
    box.querySelector("ul").replaceChildren(...scenario.groups.map((group) => {
      const row = document.createElement("li"), strong = document.createElement("b");
      strong.textContent = `${group.ads}, ${group.kind}: `;
      const filters = sumoPage.button("show", () => {
        const radio = [...card.querySelectorAll("input[data-ads]")].find((input) => input.value === group.ads);
        if (radio && !radio.checked) radio.click();
        filter.show(group.ranges, group.kind.replace(/ collision$| \(.*/, ""));
      }, `Show only this group: ${group.ads}, ${group.kind}`);
      filters.className = "copy";
      const links = group.cases.slice(0, MOST_GROUP_CASES).map((key) => {
        const link = document.createElement("a");
        link.href = `#case:${encodeURIComponent(key)}`;
        link.textContent = key.replace(`${scenario.name}-`, "").replace(`-${group.ads}`, "");
        return link;
      });
      row.append(strong, `${group.words}. `, ...links.flatMap((link) => [link, " "]), group.size > links.length ? `and ${group.size - links.length} more` : "", filters);
      return row;
    }));
    if (!scenario.moreGroups) return;
    const rest = document.createElement("li");
    rest.textContent = `${scenario.moreGroups} smaller ${scenario.moreGroups === 1 ? "group is" : "groups are"} not listed.`;
    box.querySelector("ul").append(rest);
  }

  const FIRST_ROWS = 15;

  function caseList(card, scenario, scenarioIndex, passes) {
    const box = card.querySelector("[data-cases]"), table = box.querySelector("table"), counter = box.querySelector("[data-count]");
    let most = FIRST_ROWS;
    const cell = (tag, text, className = "") => {
      const made = document.createElement(tag);
      made.textContent = text;
      made.className = className;
      return made;
    };
    const more = sumoPage.button("Show all", () => { most = Infinity; show(); });
    const columns = (item) => [...item.values.map((value) => [short(value), "n"]), [item.zone, ""], [item.outcome === "collision" ? `${item.kind} collision` : item.outcome, ""],
      [fixed(item.severity, digitsOfU), "n"], [fixed(item.human_likeness, 3), "n"], [fixed(item.index, 3), "n"]];
    const heads = () => [...scenario.parameters.map((parameter) => [label(parameter), "n"]), ["zone", ""], ["outcome", ""], [headOfU, "n"], ["in H", "n"], ["D_i", "n"]];
    function show() {
      if (!box.open) return;
      const chosen = [card.querySelector("input[data-ads]:checked").value, card.querySelector("[data-beside]")?.value];
      const own = scenario.cases.map((item, index) => ({ item, index })).filter(({ item }) => chosen.includes(item.ads));
      const passing = own.filter(({ item }) => passes(item));
      const head = document.createElement("thead"), body = document.createElement("tbody"), line = document.createElement("tr");
      line.append(cell("th", "id"), ...heads().map(([text, className]) => cell("th", text, className)));
      head.append(line);
      body.append(...passing.slice(0, most).map(({ item, index }) => {
        const row = document.createElement("tr"), id = document.createElement("th"), link = document.createElement("a");
        id.scope = "row";
        link.className = "case-id";
        link.href = `#case:${encodeURIComponent(item.key)}`;
        link.textContent = item.key;
        id.append(link, sumoPage.copier(item.key));
        row.append(id, ...columns(item).map(([text, className]) => cell("td", text, className)));
        return row;
      }));
      table.replaceChildren(head, body);
      counter.textContent = `${passing.length} of ${own.length} cases of ${chosen.filter(Boolean).join(" and ")} pass the filter. `;
      if (passing.length > most) counter.append(more);
    }
    box.addEventListener("toggle", show);
    return { show };
  }

  // --- human-likeness ------------------------------------------------------------------------------------------------

  function likenessMaps() {
    for (const card of document.querySelectorAll("[data-likeness]")) {
      const scenarioIndex = Number(card.dataset.likeness), scenario = data.scenarios[scenarioIndex];
      const quantity = () => card.querySelector(`input[name="quantity-${scenarioIndex}"]:checked`).value;
      mapCard(card, scenarioIndex, {
        name: "human-likeness", rangeOf: tiled,
        traces: (of, view, ads, shows) => likenessTiles(of, view, ads, shows, quantity()),
      });
      const plot = card.querySelector(".distribution");
      whenSeen(plot, () => distribution(plot, scenario));
    }
  }

  /** The cases of one ADS that lie in the slice: [{ item, index, at }]. */
  const casesOf = (scenario, view, ads, shows) => scenario.cases.map((item, index) => ({ item, index, at: place(view, item.values) }))
    .filter(({ item }) => item.ads === ads && shows(item));

  const MOST_TILES = 2_000;
  const CIVIDIS = ["#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838"].map((colour, k) => [k / 5, colour]);
  const bytes = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));

  /** Black or white, whichever is read better on the colour of a scale at a share of it: above 4.5 to 1 on any colour. */
  function inkOn(scale, share) {
    const after = Math.max(1, scale.findIndex(([at]) => at >= share)), [[low, below], [high, above]] = [scale[after - 1], scale[after]];
    const part = high > low ? (Math.min(Math.max(share, 0), 1) - low) / (high - low) : 1;
    const [from, to] = [below, above].map(bytes);
    const light = from.map((value, k) => (value + part * (to[k] - value)) / 255).map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4))
      .reduce((sum, value, k) => sum + value * [0.2126, 0.7152, 0.0722][k], 0);
    return light > 0.179 ? "#000" : "#fff"; // where (light + 0.05)^2 = 0.05 * 1.05, both are read as well
  }

  /** A cell for each value of the axes where the cases form a grid, else a square for each case. entries: of `casesOf`.
   *  look: case -> { z, word, text }. */
  function tiles(scenario, view, entries, look, colours) {
    const { zmin, zmax, ...scale } = { showscale: false, ...colours };
    const xs = sumoMaps.levelsOf(scenario, view.x), ys = view.y === null ? [0] : sumoMaps.levelsOf(scenario, view.y);
    const several = new Set(entries.map(({ at }) => at.join())).size < entries.length; // cases on one another: a slice through all values
    if (xs.length < 2 || ys.length < 2 || xs.length * ys.length > Math.min(MOST_TILES, 16 * scenario.cases.length / scenario.ads.length) || several) {
      return {
        type: "scatter", mode: entries.length <= 60 && !several ? "markers+text" : "markers", x: entries.map(({ at }) => at[0]), y: entries.map(({ at }) => at[1]), cliponaxis: false,
        customdata: entries.map(({ index }) => index), text: entries.map(({ item }) => look(item).word), textposition: "top center", textfont: { size: 10 },
        hovertext: entries.map(({ item }) => look(item).text), hovertemplate: "%{hovertext}<extra></extra>",
        marker: { symbol: "square", size: 14, color: entries.map(({ item }) => look(item).z), cmin: zmin, cmax: zmax, ...scale },
      };
    }
    const blank = (value) => ys.map(() => xs.map(() => value));
    const [z, words, hover, index] = [blank(null), blank(""), blank(""), blank(null)];
    for (const entry of entries) {
      const [row, column] = [ys.indexOf(entry.at[1]), xs.indexOf(entry.at[0])];
      const shownAs = look(entry.item);
      z[row][column] = shownAs.z;
      words[row][column] = `<span style="color:${inkOn(scale.colorscale, (shownAs.z - zmin) / (zmax - zmin))}">${shownAs.word}</span>`;
      hover[row][column] = shownAs.text;
      index[row][column] = entry.index;
    }
    return {
      type: "heatmap", x: xs, y: ys, z, text: words, texttemplate: "%{text}", textfont: { size: 10.5 }, hovertext: hover, zmin, zmax,
      customdata: index, hovertemplate: "%{hovertext}<extra></extra>", hoverongaps: false, xgap: 1, ygap: 1, ...scale,
    };
  }

  function likenessTiles(scenario, view, ads, shows, quantity) {
    const entries = casesOf(scenario, view, ads, (item) => shows(item) && item[quantity] !== null);
    const look = (item) => ({
      z: item[quantity], word: fixed(item[quantity], 2),
      text: `${caseHover(scenario, item)}<br>length ${fixed(item.length_factor, 2)}, operations ${fixed(item.operation_factor, 2)}, similarity ${fixed(item.similarity, 2)}`,
    });
    return [tiles(scenario, view, entries, look, { colorscale: CIVIDIS, zmin: 0, zmax: 1 })];
  }

  // --- preventability ------------------------------------------------------------------------------------------------

  const VERDICTS = Object.keys(data.verdicts);
  const VERDICT_SCALE = VERDICTS.flatMap((verdict, k) =>
    [[k / VERDICTS.length, data.verdicts[verdict].colour], [(k + 1) / VERDICTS.length, data.verdicts[verdict].colour]]);

  function preventedMaps() {
    for (const card of document.querySelectorAll("[data-prevented]")) {
      mapCard(card, Number(card.dataset.prevented), { name: "preventability", rangeOf: tiled, traces: preventedTraces });
    }
  }

  function preventedTraces(scenario, view, ads, shows, _, scenarioIndex) {
    const look = (item) => {
      const { words, letter } = data.verdicts[item.verdict];
      return { z: VERDICTS.indexOf(item.verdict) + 0.5, word: letter, text: `${caseHover(scenario, item)}<br>${words}` };
    };
    return [
      tiles(scenario, view, casesOf(scenario, view, ads, shows), look, { colorscale: VERDICT_SCALE, zmin: 0, zmax: VERDICTS.length }),
      ring(scenario, view, shows, scenarioIndex),
    ];
  }

  function distribution(plot, scenario) {
    histogram(plot, scenario, { value: (item) => item.index, high: 1, bins: BINS, digits: 2, axis: "D<sub>i</sub>", count: "safe cases", mean: (ads) => scenario.meanIndex[ads] });
  }

  /** Bars of one value by ADS from 0 to `high`; what lies beyond is in the last bin. mean: a dashed line and a word. */
  function histogram(plot, scenario, { value, high, bins, digits, axis, count, mean = null }) {
    const styles = [[C("--c"), "/"], [C("--actor"), "\\"], [C("--d"), "x"], [C("--off"), "-"], [C("--muted"), "|"], ["#c2185b", "+"]];
    const compared = scenario.ads.map((ads) => [ads, scenario.cases.filter((item) => item.ads === ads && value(item) !== null)])
      .filter(([, items]) => items.length > 0);
    const shapes = [];
    const traces = compared.map(([ads, items], position) => {
      const [colour, shape] = styles[position % styles.length];
      const middle = mean === null ? null : mean(ads);
      if (middle !== null) shapes.push({ type: "line", x0: middle, x1: middle, y0: 0, y1: 1, yref: "paper", line: { color: colour, width: 2, dash: "dash" } });
      const counts = new Array(bins).fill(0);
      for (const item of items) counts[Math.min(bins - 1, Math.floor(value(item) / high * bins))] += 1;
      const edge = (bin) => (bin * high / bins).toFixed(digits);
      const over = items.some((item) => value(item) > high);
      return {
        type: "bar", name: middle === null ? plain(ads) : `${plain(ads)}, mean ${middle.toFixed(3)}`, x: counts.map((_, bin) => (bin + 0.5) * high / bins), y: counts,
        customdata: counts.map((_, bin) => (over && bin === bins - 1 ? `above ${edge(bin)}` : `${edge(bin)} to ${edge(bin + 1)}`)),
        marker: { color: colour, line: { width: 1, color: C("--paper") }, pattern: { shape, fgcolor: C("--paper"), fillmode: "overlay", size: 6, solidity: 0.12 } },
        hovertemplate: `${axis} %{customdata}: %{y} cases<extra></extra>`,
      };
    });
    Plotly.react(plot, traces, layout(
      { ...title(axis), range: [-0.005 * high, 1.005 * high], fixedrange: true }, { ...title(count), rangemode: "tozero", fixedrange: true },
      { barmode: "group", bargap: 0.12, shapes, showlegend: true, dragmode: false, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 52, r: 12, t: 34, b: 44 } },
    ), CONFIG);
    chart(plot, `${scenario.name} ${count} by ${axis.replace(/<[^>]+>/g, "")}`, scenario);
  }

  // --- terms of C ----------------------------------------------------------------------------------------------------

  function termMaps() {
    for (const card of document.querySelectorAll("[data-terms]")) {
      const scenarioIndex = Number(card.dataset.terms), scenario = data.scenarios[scenarioIndex];
      const term = () => card.querySelector(`input[name="term-${scenarioIndex}"]:checked`).value;
      mapCard(card, scenarioIndex, {
        name: "terms", rangeOf: tiled,
        traces: (of, view, ads, shows) => {
          const known = of.cases.filter((item) => item[term()] !== null).map((item) => item[term()]);
          const most = term() === "avoided" ? 1 : Math.max(1e-9, ...known);
          card.querySelector("[data-most]").textContent = short(+most.toPrecision(3));
          const found = casesOf(of, view, ads, (item) => shows(item) && item[term()] !== null);
          const look = (item) => ({ z: item[term()], word: fixed(item[term()], term() === "severity" ? digitsOfU : 2), text: caseHover(of, item) });
          return [tiles(of, view, found, look, { colorscale: CIVIDIS, zmin: 0, zmax: most })];
        },
      });
      const hardest = Math.max(...scenario.cases.map((item) => item.severity ?? 0));
      const [severity, ttc] = ["severity", "ttc"].map((name) => card.querySelector(`[data-of=${name}]`));
      whenSeen(severity, () => histogram(severity, scenario, {
        value: (item) => item.severity, high: data.severityUnit ? Math.max(5, Math.ceil(hardest / 5) * 5) : 1, bins: 15, digits: data.severityUnit ? 1 : 2, axis: headOfU, count: "collisions",
      }));
      whenSeen(ttc, () => histogram(ttc, scenario, { value: (item) => item.ttc, high: 10, bins: 20, digits: 1, axis: "TTC, s", count: "cases" }));
    }
  }

  // --- one case ------------------------------------------------------------------------------------------------------

  const decoded = new Map();

  function trajectoriesOf(scenarioIndex) {
    if (!decoded.has(scenarioIndex)) {
      decoded.set(scenarioIndex, sumoEval.decodeTrajectories(data.scenarios[scenarioIndex].trajectories, data.channels));
    }
    return decoded.get(scenarioIndex);
  }

  function fill(select, entries, chosen) {
    select.replaceChildren(...entries.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
  }

  function showPickers() {
    const scenario = data.scenarios[selected.scenario];
    const item = scenario.cases[selected.index];
    fill(byId("pick-scenario"), data.scenarios.map((known, index) => [index, known.name]), selected.scenario);
    fill(byId("pick-ads"), scenario.ads.map((ads, index) => [index, ads]), scenario.ads.indexOf(item.ads));
    fill(byId("pick-case"), scenario.cases.map((other, index) => [other, index]).filter(([other]) => other.ads === item.ads)
      .map(([other, index]) => [index, `${pointWords(scenario, other.values)}: ${other.outcome}${other.index === null ? "" : `, D_i ${fixed(other.index, 2)}`}`]), selected.index);
  }

  function wirePickers() {
    byId("pick-scenario").addEventListener("change", (event) => showCase(Number(event.target.value), 0));
    byId("pick-ads").addEventListener("change", (event) => {
      const scenario = data.scenarios[selected.scenario];
      const { point } = scenario.cases[selected.index];
      const ads = scenario.ads[event.target.value];
      const same = scenario.cases.findIndex((item) => item.ads === ads && item.point === point);
      showCase(selected.scenario, same >= 0 ? same : scenario.cases.findIndex((item) => item.ads === ads));
    });
    byId("pick-case").addEventListener("change", (event) => showCase(selected.scenario, Number(event.target.value)));
    const move = (by) => {
      const options = [...byId("pick-case").options].map((option) => Number(option.value));
      const next = options[options.indexOf(selected.index) + by];
      if (next !== undefined) showCase(selected.scenario, next);
    };
    byId("pick-previous").addEventListener("click", () => move(-1));
    byId("pick-next").addEventListener("click", () => move(1));
    document.querySelectorAll("input[name=speed-over]").forEach((input) => input.addEventListener("change", () => drawSpeed(shown)));
  }

  /** Ug or U0 in words. */
  function reference(value) {
    return value === null ? "not known" : value === 0 ? "0, avoids" : severity(value);
  }

  function facts(scenario, item) {
    const rows = scenario.parameters.map((p, k) => [p.name, `${short(item.values[k])} ${p.unit}`]);
    rows.push(["zone", item.zone], ["status", item.status], ["verdict", data.verdicts[item.verdict].words]);
    if (item.time !== null) rows.push(["simulated time", `${fixed(item.time, 1)} s`]);
    rows.push(["exposure", short(item.exposure)]);
    if (item.latency !== null) rows.push(["slowest controller step", `${(1000 * item.latency).toPrecision(2)} ms`]);
    if (item.outcome === "collision") {
      rows.push(
        ["impact speed", `${fixed(item.impact_speed, 1)} m/s`], ["overlap", `${fixed(100 * item.overlap, 0)} %`], ["side hit", item.side],
        ["kind of collision", item.ideal_severity === null ? "ideal vehicle not known" : item.kind],
        ["severity U", severity(item.severity)], ["loss L", fixed(item.loss, 1)],
        ["ideal vehicle's Ug", reference(item.ideal_severity)], ["doing nothing, U0", reference(item.no_reaction_severity)],
        ["weight r", fixed(item.weight, 3)], ["A lost", fixed(item.aLost, 4)], ["C lost", fixed(item.lost, 4)],
      );
    }
    if (item.human_likeness !== null) {
      rows.push(["human-likeness in H", fixed(item.human_likeness, 3)]);
      if (item.outcome !== "collision") {
        rows.push(
          ["length factor in H", fixed(item.likeness_length_factor, 3)],
          ["operations factor in H", fixed(item.operation_tolerance, 3)], ["similarity in H", fixed(item.mixture_similarity, 3)],
        );
      }
    }
    if (item.plausibility !== null) rows.push(["plausibility", fixed(item.plausibility, 3)]);
    if (item.index !== null) {
      rows.push(
        ["D_i", fixed(item.index, 3)], ["length factor in D_i", fixed(item.length_factor, 3)],
        ["operations factor in D_i", fixed(item.operation_factor, 3)], ["similarity in D_i", fixed(item.similarity, 3)],
      );
    }
    for (const [name, value, unit] of item.measures) rows.push([name, `${fixed(value, 2)} ${unit}`]);
    if (item.zone === "safe") rows.push(["drivers compared with", String(item.drivers)]);
    rows.push(["ended", item.end, true]);
    if (item.cause) rows.push(["cause of the contact", item.cause, true]);
    if (item.error_place) rows.push(["where in the ADS's code", item.error_place, true]);
    if (item.clips) rows.push(["limits that acted (how often)", item.clips, true]);
    if (item.index_note) rows.push(["note on D_i", item.index_note, true]);
    return rows;
  }

  function showFacts(rows) {
    byId("case-facts").replaceChildren(...rows.map(([name, value, long]) => {
      const row = document.createElement("div");
      row.className = long ? "long" : "";
      const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
      dt.textContent = name;
      dd.textContent = long ? value : String(value).replace(/(?<=\d) (?=[^\s\d]{1,5}$)/, "\u00a0"); // no unit on a line of its own
      row.append(dt, dd);
      return row;
    }));
  }

  const replayCommand = (key) => `sumo-eval replay ${data.folder} ${/^[\w.~+-]+$/.test(key) ? key : `'${key.replaceAll("'", "'\\''")}'`} --open`;

  let shown = null;
  let turn = 0;

  async function showCase(scenarioIndex, index, scroll = false) {
    const mine = ++turn;
    selected.scenario = scenarioIndex;
    selected.index = index;
    const scenario = data.scenarios[scenarioIndex];
    const item = scenario.cases[index];
    const driverIndexes = scenario.drivers[item.point] ?? [];
    showPickers();
    moveRings.forEach((move) => move());
    byId("case-key").replaceChildren(item.key, sumoPage.copier(item.key));
    const command = replayCommand(item.key);
    byId("case-command").replaceChildren(command, sumoPage.copier(command));
    byId("case-name").textContent = `${item.ads}: ${pointWords(scenario, item.values)}`;
    showFacts(facts(scenario, item));
    const trouble = [item.missing, item.error].filter((text, k, all) => text && all.indexOf(text) === k).join(" ");
    byId("case-error").hidden = !trouble;
    byId("case-error").textContent = trouble || "";
    const fold = byId("case").closest("details.fold");
    if (scroll) sumoPage.unfold(byId("case"));
    if (scroll) (fold ?? byId("case")).scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
    const drawable = "ego" in item.vehicles;
    byId("case-charts").hidden = !drawable;
    const lacking = !item.embedded ? "trajectories" : item.drivers > driverIndexes.length ? "drivers' trajectories" : "";
    byId("case-elsewhere").hidden = !lacking;
    byId("case-elsewhere").textContent = `The ${lacking} of this case are not in this file. They are in the run's folder, and the command above shows them.`;
    shown = null;
    player.stop();
    if (!drawable || (fold && !fold.open)) return; // charts are drawn when the section is unfolded
    const all = await trajectoriesOf(scenarioIndex);
    if (mine !== turn) return;
    shown = { scenario, item, ads: all[item.vehicles.ego], actors: actorsOf(item, all), drivers: driverIndexes.map((k) => all[k]) };
    sumoReplay.named(scenario.bodies, shown);
    byId("legend-ads").textContent = item.ads;
    byId("legend-actors").textContent = kindsOf(shown.actors);
    byId("legend-drivers").hidden = shown.drivers.length === 0;
    byId("legend-drivers").lastElementChild.textContent = `${shown.drivers.length} human drivers`;
    drawCharts(shown);
    startReplay(shown, all);
  }

  /** `2 cars, 1 child`: who else is there. */
  function kindsOf(actors) {
    const count = new Map();
    for (const [, { kind }] of actors) count.set(kind, (count.get(kind) ?? 0) + 1);
    return [...count].map(([kind, n]) => `${n} ${n === 1 ? kind : kind === "child" ? "children" : `${kind}s`}`).join(", ") || "nobody else";
  }

  /** How a case of a space begins, beside its map: the one that is chosen, or the first whose trajectories are here. */
  function sceneDrawing(card, scenarioIndex) {
    const figure = card.querySelector("[data-scene]"), scenario = data.scenarios[scenarioIndex];
    const drawable = (item) => "ego" in item.vehicles;
    async function draw() {
      const chosen = selected.scenario === scenarioIndex ? scenario.cases[selected.index] : null;
      const item = chosen && drawable(chosen) ? chosen : scenario.cases.find(drawable);
      figure.hidden = !item;
      if (!item) return;
      const all = await trajectoriesOf(scenarioIndex), view = { ego: all[item.vehicles.ego], actors: actorsOf(item, all), contact: null };
      sumoReplay.still(figure.querySelector("canvas"), { road: scenario.road, bodies: scenario.bodies, ghosts: [] }, view, C("--c"), 0);
      figure.querySelector("figcaption").textContent = `How ${item.key} begins: the ego and ${kindsOf(view.actors)}, from above, to scale`;
    }
    whenSeen(card, draw);
    moveRings.push(() => { if (drawn.includes(draw)) draw(); });
    for (const name of ["resize", "beforeprint", "afterprint"]) window.addEventListener(name, () => { if (drawn.includes(draw)) draw(); });
  }

  function drawCharts(view) {
    if (!view) return;
    drawPaths(view);
    drawSpeed(view);
    drawFields(view);
    for (const [id, name] of [["plot-paths", "paths"], ["plot-speed", "speed"], ["plot-field-ads", "field"], ["plot-field-drivers", "drivers' field"]]) chart(byId(id), `${name} of a case`);
  }

  /** Begin and end along the road of what there is to see of a case, m. */
  function extent({ scenario, ads, drivers, actors }) {
    const furthest = Math.max(...[ads, ...drivers, ...actors.map(([, actor]) => actor)].map((t) => t.x.at(-1)));
    return [ads.x[0] - 8, Math.max(ads.x[0] + 60, Math.min(scenario.road.end, furthest + 20))];
  }

  function roadShapes({ road }, [begin, end]) {
    const line = (y, style) => ({ type: "line", x0: begin, x1: end, y0: y, y1: y, layer: "below", line: style });
    const shapes = [{ type: "rect", x0: begin, x1: end, y0: road.right, y1: road.left, layer: "below", fillcolor: C("--road"), line: { width: 0 } }];
    for (const edge of [road.right, road.left]) shapes.push(line(edge, { color: C("--muted"), width: 2 }));
    for (let lane = 1; lane < road.lanes; lane++) {
      shapes.push(line(road.right + lane * road.laneWidth, { color: C("--axis"), width: 1.5, dash: "dash" }));
    }
    for (const [x, wide, reach] of road.crossings) {
      shapes.unshift({ type: "rect", x0: x - wide / 2, x1: x + wide / 2, y0: -reach, y1: reach, layer: "below", fillcolor: C("--road"), line: { width: 0 } });
    }
    for (const [x0, x1, y] of road.solid) {
      shapes.push({ ...line(y, { color: C("--muted"), width: 1.5 }), x0: Math.max(x0, begin), x1: Math.min(x1, end) });
    }
    for (const gone of road.gone) {
      const [corner, , [x0, y0], [x1, y1]] = gone, inView = (x) => Math.min(Math.max(x, begin), end);
      const border = gone.slice(1).map(([x, y]) => [inView(x), x1 === x0 ? y : y0 + (y1 - y0) * Math.min(Math.max((inView(x) - x0) / (x1 - x0), 0), 1)]);
      if (border[0][0] === border[2][0]) continue;
      const edge = border.map(([x, y]) => `${x},${y}`).join("L");
      shapes.push({ type: "path", path: `M${inView(corner[0])},${corner[1]}L${edge}L${border[2][0]},${corner[1]}Z`, layer: "below", fillcolor: C("--paper"), line: { color: C("--paper"), width: 2 } });
      shapes.push({ type: "path", path: `M${edge}`, layer: "below", line: { color: C("--muted"), width: 2 } });
    }
    return shapes;
  }

  const LEAST_PIXELS = 8; // of a body in a chart: a child is 0.2 m long on a road of 200 m

  /** Bodies where their cases ended, drawn as what they are: traces of filled parts and of lines on them. pixel: [m, m] along
   *  both axes of the chart, which may be stretched. */
  function bodyTraces(trajectories, colour, pixel) {
    const filled = { x: [], y: [] }, marks = { x: [], y: [] };
    for (const t of trajectories) {
      const [c, s] = [Math.cos(t.heading.at(-1)), Math.sin(t.heading.at(-1))];
      const parts = sumoReplay.bodyParts(t).map(({ ring, role }) => ({ role, ring: [...ring, ring[0]].map(([a, b]) => [a * c - b * s, a * s + b * c]) }));
      const wider = [0, 1].map((axis) => {
        const all = parts.flatMap(({ ring }) => ring.map((point) => point[axis]));
        return Math.max(1, LEAST_PIXELS * pixel[axis] / (Math.max(...all) - Math.min(...all)));
      });
      for (const { ring, role } of parts) {
        const into = role === "body" ? [filled] : role === "head" ? [filled, marks] : [marks];
        for (const { x, y } of into) {
          x.push(...ring.map(([a]) => t.x.at(-1) + wider[0] * a), null);
          y.push(...ring.map(([, b]) => t.y.at(-1) + wider[1] * b), null);
        }
      }
    }
    return [
      { ...filled, type: "scatter", mode: "lines", fill: "toself", fillcolor: colour, line: { color: colour, width: 1 }, hoverinfo: "skip" },
      { ...marks, type: "scatter", mode: "lines", line: { color: "#fff", width: 1 }, hoverinfo: "skip" },
    ];
  }

  function manyLines(trajectories, xChannel, yChannel, style, name) {
    const x = [], y = [];
    for (const trajectory of trajectories) {
      x.push(...trajectory[xChannel], null);
      y.push(...trajectory[yChannel], null);
    }
    return { type: "scatter", mode: "lines", name, x, y, line: style, hoverinfo: "skip" };
  }

  function lines(view, xChannel, yChannel, hover) {
    const one = (name, trajectory, style) => ({
      type: "scatter", mode: "lines", name, x: Array.from(trajectory[xChannel]), y: Array.from(trajectory[yChannel]), line: style,
      hovertemplate: `<b>${plain(name)}</b><br>${hover}<extra></extra>`,
    });
    return [
      manyLines(view.drivers, xChannel, yChannel, { color: C("--driver"), width: 1 }, "drivers"),
      one(view.item.ads, view.ads, { color: C("--c"), width: 3 }),
      ...view.actors.map(([name, trajectory]) => one(name === trajectory.kind ? name : `${name}, ${trajectory.kind}`, trajectory, { color: C("--actor"), width: 2, dash: "dash" })),
    ];
  }

  /** The road on the map between two places along it: its surface and its lines. */
  function roadTraces({ road }, [begin, end], onMap) {
    const along = (points) => {
      const places = sumoReplay.within(points, begin, end).map(([x, y]) => onMap(x, y));
      return { x: places.map(([x]) => x), y: places.map(([, y]) => y), type: "scatter", mode: "lines", hoverinfo: "skip" };
    };
    const across = (y) => along([[begin, y], [end, y]]), [left, right] = [across(road.left), across(road.right)];
    const surface = { ...left, x: [...left.x, ...right.x.toReversed()], y: [...left.y, ...right.y.toReversed()], fill: "toself", fillcolor: C("--road"), line: { width: 0 } };
    const mouths = sumoReplay.crossingRings(road).filter(([[x0], [x1]]) => x1 > begin && x0 < end).map((ring) => {
      const places = [...ring, ring[0]].map(([x, y]) => onMap(x, Math.min(Math.max(y, road.right - 8), road.left + 8)));
      return { ...surface, x: places.map(([x]) => x), y: places.map(([, y]) => y) };
    });
    const traces = [...mouths, surface, ...[left, right].map((edge) => ({ ...edge, line: { color: "#57606a", width: 2 } }))];
    for (let lane = 1; lane < road.lanes; lane++) traces.push({ ...across(road.right + lane * road.laneWidth), line: { color: C("--axis"), width: 1, dash: "dash" } });
    for (const [x0, x1, y] of road.solid) traces.push({ ...along([[x0, y], [x1, y]]), line: { color: "#57606a", width: 1.5 } });
    for (const gone of road.gone) {
      const inner = along(gone.slice(1)), outer = along([[gone[1][0], gone[0][1]], [gone[3][0], gone[0][1]]]);
      if (!inner.x.length) continue;
      traces.push({ ...inner, x: [...inner.x, ...outer.x.toReversed()], y: [...inner.y, ...outer.y.toReversed()], fill: "toself", fillcolor: C("--paper"), line: { color: C("--paper"), width: 2 } });
      traces.push({ ...inner, line: { color: "#57606a", width: 2 } });
    }
    return traces;
  }

  const TALLEST = 560; // px, of a chart on the map
  const BROAD = 44; // px, of a road in it: the map is to scale along the road, across it as many times wider as that takes

  /** A chart on the map between two places of a road that bends: how many times wider the road is drawn, places and
   *  trajectories so, m a pixel, and both axes in one scale; the chart is as tall as the bend needs it. */
  function mapChart(plot, road, [begin, end]) {
    const middle = (road.left + road.right) / 2, wide = Math.max(200, plot.clientWidth - 66);
    const sharpest = Math.max(...road.line.map(([, , , , curvature]) => Math.abs(curvature)), 1e-9);
    const chart_ = { times: 1 };
    chart_.onMap = (x, y, heading) => sumoReplay.onMap(road, x, middle + chart_.times * (y - middle), heading);
    chart_.mapped = (t) => {
      const places = Array.from(t.x, (x, k) => chart_.onMap(x, t.y[k], t.heading[k]));
      return { ...t, x: places.map(([x]) => x), y: places.map(([, y]) => y), heading: places.map(([, , heading]) => heading) };
    };
    const ranges = () => {
      const places = [road.left, road.right].flatMap((y) => sumoReplay.within([[begin, y], [end, y]], begin, end)).map(([x, y]) => chart_.onMap(x, y));
      return [0, 1].map((axis) => [Math.min(...places.map((at) => at[axis])) - 4, Math.max(...places.map((at) => at[axis])) + 4]);
    };
    const scaled = ([xs, ys]) => Math.max((xs[1] - xs[0]) / wide, (ys[1] - ys[0]) / (TALLEST - 54));
    chart_.times = Math.max(1, Math.min(BROAD * scaled(ranges()) / (road.left - road.right), 0.8 / sharpest / (road.left - road.right)));
    const [xs, ys] = ranges();
    chart_.pixel = scaled([xs, ys]);
    plot.style.height = `${Math.round(Math.min(TALLEST, Math.max(230, (ys[1] - ys[0]) / chart_.pixel + 54)))}px`;
    chart_.axes = [{ ...title("x on the map, m"), range: xs, showgrid: false }, { ...title("y, m"), range: ys, showgrid: false, scaleanchor: "x" }];
    return chart_;
  }

  const timesWider = (times) => (times > 1.05 ? `, the road drawn ${times.toFixed(1)} times as wide` : "");

  function drawPaths(view) {
    const { scenario, ads, item, actors } = view, { road } = scenario;
    const span = extent(view), plot = byId("plot-paths");
    let traces, look, pixel, mark = ads, bodies = actors.map(([, t]) => t), words = "y is stretched";
    if (sumoReplay.bends(road)) {
      const chart_ = mapChart(plot, road, span);
      mark = chart_.mapped(ads);
      bodies = actors.map(([, t]) => chart_.mapped(t));
      traces = [
        ...roadTraces(scenario, span, chart_.onMap),
        ...lines({ ...view, ads: mark, drivers: view.drivers.map(chart_.mapped), actors: actors.map(([name], k) => [name, bodies[k]]) }, "x", "y", "x %{x:.0f} m, y %{y:.0f} m on the map"),
      ];
      look = layout(...chart_.axes);
      pixel = [chart_.pixel, chart_.pixel];
      words = `on the map${timesWider(chart_.times)}`;
    } else {
      plot.style.height = "";
      const [low, high] = sumoReplay.roomOf(road, view).map((y, k) => y + (k ? 0.6 : -0.6));
      traces = lines(view, "x", "y", "x %{x:.1f} m, y %{y:.2f} m");
      look = layout(
        { ...title("x along the road, m"), range: span, showgrid: false }, { ...title("y, m"), range: [low, high], showgrid: false },
        { shapes: roadShapes(scenario, span) },
      );
      pixel = [(span[1] - span[0]) / Math.max(200, plot.clientWidth - 64), (high - low) / 198];
    }
    byId("paths-scale").textContent = words;
    traces.push(...bodyTraces(bodies, C("--actor"), pixel), ...bodyTraces([mark], C("--c"), pixel));
    if (item.outcome === "collision") {
      traces.push({
        type: "scatter", mode: "markers", name: "contact", x: [mark.x.at(-1)], y: [mark.y.at(-1)], hovertemplate: "contact<extra></extra>",
        marker: { symbol: "x-thin", size: 13, line: { color: C("--hit"), width: 3.5 } },
      });
    }
    Plotly.react(plot, traces, look, CONFIG);
  }

  function drawSpeed(view) {
    if (!view) return;
    const over = document.querySelector("input[name=speed-over]:checked").value;
    const xaxis = over === "x"
      ? { ...title("x along the road, m"), range: extent(view) } : { ...title("time, s"), rangemode: "tozero" };
    const hover = `${over === "x" ? "x %{x:.1f} m" : "t %{x:.1f} s"}, %{y:.1f} m/s`;
    Plotly.react("plot-speed", lines(view, over, "speed", hover),
      layout(xaxis, { ...title("speed, m/s"), rangemode: "tozero" }), CONFIG);
  }

  // --- trajectory fields ---------------------------------------------------------------------------------------------

  function grid(view) {
    const { road } = view.scenario;
    const [, end] = extent(view);
    const centres = (low, high, n) => Array.from({ length: n }, (_, k) => low + (high - low) * (k + 0.5) / n);
    const xs = centres(view.ads.x[0], end, FIELD_CELLS.x);
    const ys = centres(road.right, road.left, FIELD_CELLS.y);
    return { xs, ys, points: { x: ys.flatMap(() => xs), y: ys.flatMap((y) => xs.map(() => y)) } };
  }

  const nextFrame = () => new Promise((resolve) => setTimeout(resolve, 0));

  const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"].map((colour, k) => [k / 9, colour]);

  function viridis(share) {
    const place = Math.min(Math.max(share, 0), 1) * 9, low = Math.min(8, Math.floor(place)), part = place - low;
    const mixed = [1, 3, 5].map((digit) => [low, low + 1].map((k) => parseInt(VIRIDIS[k][1].slice(digit, digit + 2), 16))).map(([a, b]) => Math.round(a + (b - a) * part));
    return `rgb(${mixed.join(",")})`;
  }

  /** A field over the road as a picture on the map: cells along and across the road, laid along the bend. */
  function fieldPicture({ onMap, axes: [east, north] }, xs, ys, field, zmin, zmax) {
    const [[x0, x1], [y0, y1]] = [east.range, north.range], canvas = document.createElement("canvas");
    const scale = Math.min(1600 / (x1 - x0), 1600 / (y1 - y0));
    Object.assign(canvas, { width: Math.ceil((x1 - x0) * scale), height: Math.ceil((y1 - y0) * scale) });
    const context = canvas.getContext("2d"), [dx, dy] = [(xs[1] - xs[0]) / 2, (ys[1] - ys[0]) / 2];
    field.forEach((strength, i) => {
      const x = xs[i % xs.length], y = ys[Math.floor(i / xs.length)];
      context.beginPath();
      [[-dx, -dy], [dx, -dy], [dx, dy], [-dx, dy]].forEach(([a, b], k) => {
        const [px, py] = onMap(x + a, y + b);
        context[k ? "lineTo" : "moveTo"]((px - x0) * scale, (y1 - py) * scale);
      });
      context.closePath();
      context.fillStyle = context.strokeStyle = viridis((strength - zmin) / (zmax - zmin || 1)); // the edge closes the seams
      context.fill();
      context.stroke();
    });
    return { source: canvas.toDataURL(), xref: "x", yref: "y", x: x0, y: y1, sizex: x1 - x0, sizey: y1 - y0, sizing: "stretch", layer: "below" };
  }

  async function drawFields(view) {
    const { xs, ys, points } = grid(view);
    const own = sumoEval.trajectoryField(points, view.ads, data.field);
    const mean = new Float64Array(own.length);
    for (const driver of view.drivers) {
      await nextFrame(); // ten drivers take a while on a phone; the page must stay alive
      if (shown !== view) return;
      const field = sumoEval.trajectoryField(points, driver, data.field);
      for (let i = 0; i < mean.length; i++) mean[i] += field[i] / view.drivers.length;
    }
    const both = view.drivers.length ? [own, mean] : [own];
    const zmin = Math.min(...both.map((field) => field.reduce((a, b) => Math.min(a, b))));
    const zmax = Math.max(...both.map((field) => field.reduce((a, b) => Math.max(a, b))));
    byId("figure-field-drivers").hidden = view.drivers.length === 0;
    const { road } = view.scenario, bent = sumoReplay.bends(road);
    const bar = { title: { text: "S" }, thickness: 12, outlinewidth: 0, len: 1 };
    both.forEach((field, k) => {
      const plot = byId(["plot-field-ads", "plot-field-drivers"][k]);
      const chart_ = bent ? mapChart(plot, road, [xs[0], xs.at(-1)]) : null, drives = k === 0 ? [view.ads] : view.drivers;
      const path = manyLines(bent ? drives.map(chart_.mapped) : drives, "x", "y", k === 0 ? { color: "#fff", width: 1.8 } : { color: "rgba(255,255,255,0.7)", width: 1 });
      if (bent) {
        const numbers = { // seen by the pointer and by who saves them
          type: "scatter", mode: "markers", name: "S", hovertemplate: "x %{x:.0f} m, y %{y:.0f} m on the map<br>S = %{marker.color:.2f}<extra></extra>", x: [], y: [],
          marker: { color: [], size: 4, opacity: 0, cmin: zmin, cmax: zmax, colorscale: VIRIDIS, showscale: true, colorbar: bar },
        };
        for (let i = 0; i < field.length; i += 1) {
          const [column, row] = [i % xs.length, Math.floor(i / xs.length)];
          if (column % 3 !== 1 || row % 4 !== 1) continue;
          const [x, y] = chart_.onMap(xs[column], ys[row]);
          numbers.x.push(x);
          numbers.y.push(y);
          numbers.marker.color.push(field[i]);
        }
        Plotly.react(plot, [path, numbers], layout(...chart_.axes, { margin: { l: 52, r: 8, t: 8, b: 44 }, images: [fieldPicture(chart_, xs, ys, field, zmin, zmax)] }), CONFIG);
        return;
      }
      plot.style.height = "";
      const z = ys.map((_, row) => Array.from(field.subarray(row * xs.length, (row + 1) * xs.length)));
      const heat = {
        type: "heatmap", x: xs, y: ys, z, zmin, zmax, colorscale: VIRIDIS, zsmooth: "best", hovertemplate: "x %{x:.0f} m, y %{y:.2f} m<br>S = %{z:.2f}<extra></extra>", colorbar: bar,
      };
      Plotly.react(plot, [heat, path], layout(
        { ...title("x along the road, m"), range: [xs[0], xs.at(-1)], showgrid: false },
        { ...title("y, m"), range: [road.right, road.left], showgrid: false }, { margin: { l: 52, r: 8, t: 8, b: 44 }, images: [] },
      ), CONFIG);
    });
    document.documentElement.dataset.fields = "drawn";
  }

  // --- replay --------------------------------------------------------------------------------------------------------

  const player = sumoReplay.player(byId("replay"));

  const contactOf = (item) => (item.contact === null ? null : { ...item.contact, speed: item.impact_speed });

  /** What may run beside the case: the other ADSs at the same point, and each driver. */
  function companions(view, all) {
    const { scenario, item } = view;
    const others = scenario.cases.filter((other) => other.point === item.point && other !== item && "ego" in other.vehicles);
    return [
      ...others.map((other) => ({ name: other.ads, ego: all[other.vehicles.ego], actors: actorsOf(other, all), contact: contactOf(other) })),
      ...view.drivers.map((driver, k) => ({ name: `driver ${k + 1}, in the traffic of this drive`, ego: driver, actors: view.actors, contact: null })),
    ];
  }

  const actorsOf = (item, all) => Object.entries(item.vehicles).filter(([name]) => name !== "ego").map(([name, k]) => [name, all[k]]);

  function startReplay(view, all) {
    const found = companions(view, all), select = byId("replay-beside");
    fill(select, [[-1, "nothing"], ...found.map(({ name }, k) => [k, name])], -1);
    const own = { name: view.item.ads, ego: view.ads, actors: view.actors, contact: contactOf(view.item) };
    const draw = () => player.show({
      road: view.scenario.road, bodies: view.scenario.bodies, ghosts: view.drivers, views: [own, ...found.slice(Number(select.value), Number(select.value) + 1)].slice(0, Number(select.value) < 0 ? 1 : 2),
    });
    select.onchange = draw;
    draw();
  }

  // --- the page ------------------------------------------------------------------------------------------------------

  const LEAD_IN = 4; // s before the moment of contact that a click plays

  /** Beside the first words: the worst case at its moment of contact, which a click plays, and the map around it. */
  async function opening({ s, index }) {
    const box = document.querySelector("[data-opening]"), scenario = data.scenarios[s], item = scenario.cases[index];
    const [stillFigure, mapFigure] = box.querySelectorAll("figure"), plot = box.querySelector(".plot"), view = sumoMaps.opening(scenario);
    view.panel = null;
    const held = sumoMaps.sliced(scenario, view);
    for (const k of held) view.at[k] = { value: item.values[k], half: 0, all: false };
    const shows = (one) => sumoMaps.shows(scenario, view, [null], 0, one);
    plot.classList.toggle("strip", view.y === null);
    const where = held.map((k) => `${sumoMaps.words(scenario.parameters[k].name)} = ${Number(item.values[k].toPrecision(4))} ${scenario.parameters[k].unit}`).join(", ");
    mapFigure.querySelector("figcaption").textContent = `${item.ads} in ${scenario.name}${where ? `, at ${where}` : ""}`;
    const faint = (one) => (one.outcome === "collision" || one.outcome === "off road") && !(one.ads === item.ads && shows(one));
    const others = () => markers(scenario, view, null, faint).map((trace) => ({ ...trace, marker: { ...trace.marker, opacity: 0.5 } }));
    mapFigure.querySelector(".small").hidden = !scenario.cases.some(faint);
    const drawMap = () => Plotly.react(plot, [
      ...backgroundTraces(scenario, view, sumoMaps.zones(scenario, view, [null], 0)), ...others(), ...markers(scenario, view, item.ads, shows), ring(scenario, view, shows, s),
    ], layout(...mapAxes(scenario, view, padded), { dragmode: false }), CONFIG);
    drawMap();
    chart(plot, `${scenario.name} map of ${item.ads}`, scenario);
    plot.on("plotly_click", (event) => onPick(s, event));
    drawn.push(drawMap);
    moveRings.push(drawMap);
    if (!("ego" in item.vehicles)) return;

    stillFigure.hidden = false; // room for it, so that nothing moves when it is drawn
    const all = await trajectoriesOf(s), canvas = box.querySelector("canvas"), contact = contactOf(item);
    const drive = { ego: all[item.vehicles.ego], actors: actorsOf(item, all), contact }, end = contact?.time ?? drive.ego.time.at(-1) - drive.ego.time[0];
    const ended = contact ? `contact at ${(3.6 * contact.speed).toFixed(0)} km/h after ${fixed(contact.time, 1)} s` : `${item.outcome}, ${item.end}`;
    stillFigure.querySelector("span").textContent = `${item.outcome === "no contact" ? "Least human-like" : "Worst"} case of ${item.ads}: ${ended}`;
    let time = end;
    const frame = () => sumoReplay.moment(canvas, { road: scenario.road, bodies: scenario.bodies, ghosts: [] }, drive, C("--c"), time);
    const play = () => {
      const begin = performance.now(), from = Math.max(0, end - LEAD_IN);
      const step = (now) => {
        time = Math.min(end, from + (now - begin) / 1000);
        frame();
        if (time < end) requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    };
    frame();
    stillFigure.addEventListener("click", play);
    drawn.push(frame);
    for (const name of ["resize", "beforeprint", "afterprint"]) window.addEventListener(name, frame);
  }

  function entryOf(key) {
    for (const [s, scenario] of data.scenarios.entries()) {
      const index = scenario.cases.findIndex((item) => item.key === key);
      if (index >= 0) return { s, index };
    }
    return null;
  }

  /** The case that the address names; where the page does not have it, a note says so. */
  function caseFromAddress() {
    const key = sumoPage.anchor().startsWith("case:") ? sumoPage.anchor().slice("case:".length) : null;
    const found = entryOf(key), note = byId("case-absent");
    note.hidden = key === null || found !== null;
    note.textContent = `The case ${key} is not on this page. If the run has it, this shows it: ${replayCommand(key ?? "")}`;
    if (note.hidden) return found;
    sumoPage.unfold(note);
    note.scrollIntoView();
    return null;
  }

  function onPrint(begins) {
    document.documentElement.classList.toggle("printing", begins);
    if (begins) document.querySelectorAll("details:not([data-cases])").forEach((details) => { details.open = true; });
    // A drive is unpacked when its section is first opened. The button Print waits for that, Ctrl+P does not.
    document.documentElement.classList.toggle("undrawn", begins && !shown && !byId("case-charts").hidden);
    [...unseen].forEach((draw) => draw());
    drawn.forEach((draw) => draw());
    for (const plot of document.querySelectorAll(".js-plotly-plot")) {
      if (plot.clientWidth === 0) continue;
      Plotly.relayout(plot, begins ? { width: plot.clientWidth, height: plot.clientHeight } : { width: null, height: null, autosize: true });
    }
  }

  function fail(reason) {
    byId("failure").hidden = false;
    byId("failure").textContent = `A chart of this report could not be drawn (${reason}). The tables and sentences are complete without it.`;
  }

  sumoPage.beforePrint(() => showCase(selected.scenario, selected.index));
  window.addEventListener("beforeprint", () => onPrint(true));
  window.addEventListener("afterprint", () => onPrint(false));
  window.addEventListener("hashchange", () => {
    const asked = caseFromAddress();
    if (asked) showCase(asked.s, asked.index, true);
  });
  zoneMaps();
  likenessMaps();
  termMaps();
  preventedMaps();
  wirePickers();
  const asked = caseFromAddress();
  const worst = entryOf(document.querySelector("[data-opening]")?.dataset.opening);
  const first = asked ?? worst ?? (data.scenarios[0]?.cases.length ? { s: 0, index: 0 } : null);
  const caseFold = byId("case").closest("details.fold");
  caseFold?.addEventListener("toggle", () => { if (caseFold.open && !shown) showCase(selected.scenario, selected.index); });
  drawn.push(() => drawCharts(shown));
  if (first) showCase(first.s, first.index, asked !== null);
  else byId("case-charts").hidden = true;
  if (worst) await opening(worst);
  document.documentElement.dataset.report = "ready";
})();
