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
  const COLOURS = { ads: "#0072b2", driver: "#8593a3", actor: "#b26a00", ink: "#1b1f24", muted: "#57606a", line: "#d5dbe1" };
  const ZONE_COLOURS = { safe: "#e6f1f8", hazardous: "#fbd9b5" };
  const OUTCOMES = {
    "no contact": { symbol: "circle", color: "#0072b2", size: 8, line: { width: 1, color: "#fff" } },
    collision: { symbol: "x-thin", color: "#b23c00", size: 8, line: { width: 3.2, color: "#b23c00" } },
    "off road": { symbol: "triangle-up", color: "#8a3d74", size: 10, line: { width: 1, color: "#fff" } },
    "not evaluated": { symbol: "square", color: "#fff", size: 9, line: { width: 2, color: "#1b1f24" } },
  };
  const BINS = 20; // of D_i in 0..1
  const FIELD_CELLS = { x: 150, y: 36 };
  const FONT = { family: getComputedStyle(document.body).fontFamily, size: 12, color: COLOURS.ink };
  const CONFIG = { displaylogo: false, responsive: true, displayModeBar: false, doubleClick: "reset" };
  const canHover = matchMedia("(hover: hover)").matches;
  const selected = { scenario: 0, index: 0 };

  // --- words and numbers ---------------------------------------------------------------------------------------------

  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const short = (value) => String(+value.toPrecision(6));
  const label = (parameter) => `${parameter.name.replaceAll("_", " ")}, ${parameter.unit}`;
  const pointWords = (scenario, values) =>
    scenario.parameters.map((parameter, k) => `${parameter.name} ${short(values[k])}`).join(", ");

  function caseHover(scenario, item) {
    const lines = scenario.parameters.map((p, k) => `${plain(p.name)} = ${short(item.values[k])} ${plain(p.unit)}`);
    lines.push(`<b>${item.outcome}</b>, ${item.zone} zone`);
    if (item.outcome === "collision") lines.push(`U = ${fixed(item.severity, 1)} m/s, ideal ${fixed(item.idealSeverity, 1)} m/s`);
    if (item.index !== null) lines.push(`D<sub>i</sub> = ${fixed(item.index, 3)}`);
    return lines.join("<br>");
  }

  // --- layouts -------------------------------------------------------------------------------------------------------

  function layout(x, y, more = {}) {
    const axis = { gridcolor: "#e6eaee", zeroline: false, linecolor: "#9aa4ae", ticks: "outside", ticklen: 4, tickcolor: "#9aa4ae" };
    return {
      font: FONT, margin: { l: 52, r: 12, t: 8, b: 44 }, paper_bgcolor: "#fff", plot_bgcolor: "#fff", showlegend: false,
      hovermode: "closest", dragmode: canHover ? "zoom" : false, autosize: true,
      hoverlabel: { bgcolor: "#fff", bordercolor: "#9aa4ae", font: { ...FONT, size: 12 }, align: "left" },
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
    const values = [...new Set(scenario.cases.map((item) => item.values[k]))].sort((a, b) => a - b);
    if (values.length < 2) return padded(scenario, k);
    return [values[0] - (values[1] - values[0]) / 2, values.at(-1) + (values.at(-1) - values.at(-2)) / 2];
  }

  function mapAxes(scenario, rangeOf) {
    const { x, y } = scenario.view;
    const along = scenario.parameters[x];
    const xaxis = { ...title(plain(label(along))), range: rangeOf(scenario, x), fixedrange: true, showgrid: false };
    if (y === null) return [xaxis, { range: [-1, 1], visible: false, fixedrange: true }];
    const across = scenario.parameters[y];
    return [xaxis, { ...title(plain(label(across))), range: rangeOf(scenario, y), fixedrange: true, showgrid: false }];
  }

  const place = (scenario, values) =>
    [values[scenario.view.x], scenario.view.y === null ? 0 : values[scenario.view.y]];

  // --- zone maps -----------------------------------------------------------------------------------------------------

  function panelsOf(card, scenario) {
    const holder = card.querySelector(".panels");
    holder.classList.toggle("single", scenario.view.panels.length === 1);
    holder.classList.toggle("strip", scenario.view.y === null);
    const parameter = scenario.view.panel === null ? null : scenario.parameters[scenario.view.panel];
    return scenario.view.panels.map((value) => {
      const panel = document.createElement("div");
      panel.className = "panel";
      if (parameter) {
        const heading = document.createElement("h5");
        heading.textContent = `${parameter.name.replaceAll("_", " ")} = ${short(value)} ${parameter.unit}`;
        panel.append(heading);
      }
      const plot = document.createElement("div");
      plot.className = "plot";
      panel.append(plot);
      holder.append(panel);
      return plot;
    });
  }

  function background(scenario, panel) {
    const map = scenario.maps[panel];
    const rows = (levels) => Array.from({ length: map.y.length }, (_, r) =>
      Array.from(levels.subarray(r * map.x.length, (r + 1) * map.x.length), (level) => level / 32000));
    const shared = { type: "contour", x: map.x, y: map.y, hoverinfo: "skip", showscale: false, autocontour: false };
    const [xLow, xHigh, yLow, yHigh] = [map.x[0], map.x.at(-1), map.y[0], map.y.at(-1)];
    const corners = { x: [xLow, xHigh, xHigh, xLow, xLow], y: [yLow, yLow, yHigh, yHigh, yLow] };
    const impossible = { x: [], y: [] };
    for (const polygon of map.impossible) {
      impossible.x.push(...polygon.map((corner) => corner[0]), null);
      impossible.y.push(...polygon.map((corner) => corner[1]), null);
    }
    const scaled = { zmin: -1, zmax: 1, contours: { start: 0, end: 0, size: 1, coloring: "fill", showlines: false } };
    const { safe, hazardous } = ZONE_COLOURS;
    return [
      { ...shared, ...scaled, z: rows(sumoEval.decodeLevels(map.exact)), colorscale: [[0, hazardous], [0.5, hazardous], [0.5, safe], [1, safe]] },
      {
        ...shared, z: rows(sumoEval.decodeLevels(map.gp)), contours: { start: 0, end: 0, size: 1, coloring: "none" },
        line: { color: COLOURS.ink, width: 1.8 },
      },
      {
        ...impossible, type: "scatter", mode: "lines", fill: "toself", hoverinfo: "skip", line: { width: 0 },
        fillcolor: "#e4e6e9", fillpattern: { shape: "/", size: 7, solidity: 0.16, fgcolor: "#9aa1aa", bgcolor: "#e4e6e9" },
      },
      { ...corners, type: "scatter", mode: "lines", hoverinfo: "skip", line: { color: "#9aa4ae", width: 1 } },
    ];
  }

  function strip(scenario, panel) {
    // One parameter has no area: zones are intervals, drawn as a band of cells.
    const map = scenario.maps[panel];
    const z = [Array.from(sumoEval.decodeLevels(map.exact), (level) => (level > 0 ? 1 : 0))];
    const { safe, hazardous } = ZONE_COLOURS;
    return [{
      type: "heatmap", x: map.x, y: [0], z, zmin: 0, zmax: 1, showscale: false, hoverinfo: "skip",
      colorscale: [[0, hazardous], [0.5, hazardous], [0.5, safe], [1, safe]],
    }];
  }

  function markers(scenario, panel, ads) {
    return Object.entries(OUTCOMES).map(([outcome, style]) => {
      const found = scenario.cases.map((item, index) => [item, index])
        .filter(([item]) => item.ads === ads && item.outcome === outcome && item.panel === panel);
      return {
        type: "scatter", mode: "markers", name: outcome, marker: { ...style, opacity: 1 }, cliponaxis: false,
        x: found.map(([item]) => place(scenario, item.values)[0]), y: found.map(([item]) => place(scenario, item.values)[1]),
        customdata: found.map(([, index]) => index),
        text: found.map(([item]) => caseHover(scenario, item)), hovertemplate: "%{text}<extra></extra>",
      };
    });
  }

  function highlights(scenario, panel, scenarioIndex) {
    const worst = scenario.mostDangerous.filter((star) => star.panel === panel);
    const item = scenario.cases[selected.index];
    const ring = scenarioIndex === selected.scenario && item && item.panel === panel ? [place(scenario, item.values)] : [];
    return [
      {
        type: "scatter", mode: "markers", cliponaxis: false, hovertemplate: "%{text}<extra></extra>",
        x: worst.map((star) => place(scenario, star.values)[0]), y: worst.map((star) => place(scenario, star.values)[1]),
        text: worst.map((star) => `most dangerous point${star.inPlace ? "" : ", off this slice"}<br>${plain(pointWords(scenario, star.values))}`),
        marker: { symbol: worst.map((star) => (star.inPlace ? "star" : "star-open")), size: 15,
          color: worst.map((star) => (star.inPlace ? "#f0e442" : COLOURS.ink)), line: { color: COLOURS.ink, width: 1.2 } },
      },
      {
        type: "scatter", mode: "markers", hoverinfo: "skip", cliponaxis: false, x: ring.map((at) => at[0]), y: ring.map((at) => at[1]),
        marker: { symbol: "circle-open", size: 18, color: COLOURS.ink, line: { width: 2 } },
      },
    ];
  }

  const moveRings = [];

  function zoneMaps() {
    for (const card of document.querySelectorAll("[data-map]")) {
      const scenarioIndex = Number(card.dataset.map);
      const scenario = data.scenarios[scenarioIndex];
      const plots = panelsOf(card, scenario);
      const backgrounds = plots.map((_, panel) => (scenario.view.y === null ? strip : background)(scenario, panel));
      const chosen = () => card.querySelector("input:checked").value;
      const draw = () => plots.forEach((plot, panel) => {
        const [worst, ring] = highlights(scenario, panel, scenarioIndex);
        // The star lies under the markers, so that the case at the most dangerous point stays visible and clickable.
        const traces = [...backgrounds[panel], worst, ...markers(scenario, panel, chosen()), ring];
        Plotly.react(plot, traces, layout(...mapAxes(scenario, padded), { dragmode: false }), CONFIG);
      });
      draw();
      moveRings.push(() => plots.forEach((plot, panel) => {
        const ring = highlights(scenario, panel, scenarioIndex)[1];
        Plotly.restyle(plot, { x: [ring.x], y: [ring.y] }, [plot.data.length - 1]);
      }));
      card.addEventListener("change", draw);
      plots.forEach((plot) => plot.on("plotly_click", (event) => onPick(scenarioIndex, event)));
    }
  }

  function onPick(scenarioIndex, event) {
    const hit = event.points.find((point) => typeof point.customdata === "number");
    if (hit) showCase(scenarioIndex, hit.customdata, true);
  }

  // --- human-likeness ------------------------------------------------------------------------------------------------

  function likenessMaps() {
    for (const card of document.querySelectorAll("[data-likeness]")) {
      const scenarioIndex = Number(card.dataset.likeness);
      const scenario = data.scenarios[scenarioIndex];
      const plots = panelsOf(card, scenario);
      const [ads, quantity] = ["likeness", "quantity"].map((name) => () =>
        card.querySelector(`input[name="${name}-${scenarioIndex}"]:checked`).value);
      const draw = () => plots.forEach((plot, panel) => {
        Plotly.react(plot, likenessTiles(scenario, panel, ads(), quantity()), layout(...mapAxes(scenario, tiled), { dragmode: false }), CONFIG);
      });
      draw();
      card.addEventListener("change", draw);
      plots.forEach((plot) => plot.on("plotly_click", (event) => onPick(scenarioIndex, event)));
      distribution(card.querySelector(".distribution"), scenario);
    }
  }

  /** The cases of one ADS that a panel shows: [{ item, index, at }]. */
  const casesOf = (scenario, ads, shows) => scenario.cases.map((item, index) => ({ item, index, at: place(scenario, item.values) }))
    .filter(({ item }) => item.ads === ads && shows(item));

  /** A cell for each case where they form a grid, else a square for each. `look` gives { z, word, text } of a case. */
  function tiles(found, look, colours) {
    const { zmin, zmax, ...scale } = { showscale: false, ...colours };
    const xs = [...new Set(found.map(({ at }) => at[0]))].sort((a, b) => a - b);
    const ys = [...new Set(found.map(({ at }) => at[1]))].sort((a, b) => a - b);
    if (xs.length < 2 || ys.length < 2 || xs.length * ys.length > 4 * found.length) {
      return {
        type: "scatter", mode: "markers", x: found.map(({ at }) => at[0]), y: found.map(({ at }) => at[1]), cliponaxis: false,
        customdata: found.map(({ index }) => index), text: found.map(({ item }) => look(item).text), hovertemplate: "%{text}<extra></extra>",
        marker: { symbol: "square", size: 14, color: found.map(({ item }) => look(item).z), cmin: zmin, cmax: zmax, ...scale },
      };
    }
    const blank = (value) => ys.map(() => xs.map(() => value));
    const [z, words, hover, index] = [blank(null), blank(""), blank(""), blank(null)];
    for (const entry of found) {
      const [row, column] = [ys.indexOf(entry.at[1]), xs.indexOf(entry.at[0])];
      const shownAs = look(entry.item);
      z[row][column] = shownAs.z;
      words[row][column] = shownAs.word;
      hover[row][column] = shownAs.text;
      index[row][column] = entry.index;
    }
    return {
      type: "heatmap", x: xs, y: ys, z, text: words, texttemplate: "%{text}", textfont: { size: 10.5 }, hovertext: hover, zmin, zmax,
      customdata: index, hovertemplate: "%{hovertext}<extra></extra>", hoverongaps: false, xgap: 1, ygap: 1, ...scale,
    };
  }

  function likenessTiles(scenario, panel, ads, quantity) {
    const found = casesOf(scenario, ads, (item) => item.panel === panel && item[quantity] !== null);
    const look = (item) => ({
      z: item[quantity], word: fixed(item[quantity], 2),
      text: `${caseHover(scenario, item)}<br>length ${fixed(item.lengthFactor, 2)}, operations ${fixed(item.operationFactor, 2)}, similarity ${fixed(item.similarity, 2)}`,
    });
    return [tiles(found, look, { colorscale: "Cividis", zmin: 0, zmax: 1 })];
  }

  // --- preventability ------------------------------------------------------------------------------------------------

  const VERDICTS = Object.keys(data.verdicts);
  const VERDICT_SCALE = VERDICTS.flatMap((verdict, k) =>
    [[k / VERDICTS.length, data.verdicts[verdict].colour], [(k + 1) / VERDICTS.length, data.verdicts[verdict].colour]]);

  function preventedMaps() {
    for (const card of document.querySelectorAll("[data-prevented]")) {
      const scenarioIndex = Number(card.dataset.prevented);
      const scenario = data.scenarios[scenarioIndex];
      const plots = panelsOf(card, scenario);
      const slices = [...card.querySelectorAll("[data-slice]")].map((select) => {
        const k = scenario.parameters.findIndex((parameter) => parameter.name === select.dataset.slice);
        const values = [...new Set(scenario.cases.map((item) => item.values[k]))].sort((a, b) => a - b);
        fill(select, values.map((value) => [value, `${short(value)} ${scenario.parameters[k].unit}`]), scenario.view.slice[k]);
        return { k, select };
      });
      const draw = () => plots.forEach((plot, panel) => {
        const ads = card.querySelector("input:checked").value;
        Plotly.react(plot, preventedTraces(scenario, scenarioIndex, panel, ads, slices), layout(...mapAxes(scenario, tiled), { dragmode: false }), CONFIG);
      });
      draw();
      moveRings.push(draw);
      card.addEventListener("change", draw);
      plots.forEach((plot) => plot.on("plotly_click", (event) => onPick(scenarioIndex, event)));
    }
  }

  function preventedTraces(scenario, scenarioIndex, panel, ads, slices) {
    // The selects choose the slice here, so the panel counts only where there is none.
    const onSlice = (item) => (slices.length ? slices.every(({ k, select }) => item.values[k] === Number(select.value)) : item.panel === panel);
    const look = (item) => {
      const { words, letter, ink } = data.verdicts[item.verdict];
      return { z: VERDICTS.indexOf(item.verdict) + 0.5, word: `<span style="color:${ink}">${letter}</span>`, text: `${caseHover(scenario, item)}<br>${words}` };
    };
    const chosen = scenarioIndex === selected.scenario ? scenario.cases[selected.index] : null;
    const ring = chosen && onSlice(chosen) ? [place(scenario, chosen.values)] : [];
    return [
      tiles(casesOf(scenario, ads, onSlice), look, { colorscale: VERDICT_SCALE, zmin: 0, zmax: VERDICTS.length }),
      {
        type: "scatter", mode: "markers", hoverinfo: "skip", x: ring.map((at) => at[0]), y: ring.map((at) => at[1]), cliponaxis: false,
        marker: { symbol: "circle-open", size: 18, color: COLOURS.ink, line: { width: 2 } },
      },
    ];
  }

  function distribution(plot, scenario) {
    histogram(plot, scenario, { value: (item) => item.index, high: 1, bins: BINS, digits: 2, axis: "D<sub>i</sub>", count: "safe cases", mean: (ads) => scenario.meanIndex[ads] });
  }

  /** Bars of one value by ADS from 0 to `high`; what lies beyond is in the last bin. mean: a dashed line and a word. */
  function histogram(plot, scenario, { value, high, bins, digits, axis, count, mean = null }) {
    const styles = [["#0072b2", "/"], ["#b26a00", "\\"], ["#4d9e7a", "x"], ["#8a3d74", "-"], ["#57606a", "|"], ["#c2185b", "+"]];
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
        marker: { color: colour, line: { width: 1, color: "#fff" }, pattern: { shape, fgcolor: "#fff", fillmode: "overlay", size: 6, solidity: 0.12 } },
        hovertemplate: `${axis} %{customdata}: %{y} cases<extra></extra>`,
      };
    });
    Plotly.newPlot(plot, traces, layout(
      { ...title(axis), range: [-0.005 * high, 1.005 * high], fixedrange: true }, { ...title(count), rangemode: "tozero", fixedrange: true },
      { barmode: "group", bargap: 0.12, shapes, showlegend: true, dragmode: false, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 52, r: 12, t: 34, b: 44 } },
    ), CONFIG);
  }

  // --- terms of C ----------------------------------------------------------------------------------------------------

  function termMaps() {
    for (const card of document.querySelectorAll("[data-terms]")) {
      const scenarioIndex = Number(card.dataset.terms);
      const scenario = data.scenarios[scenarioIndex];
      const plots = panelsOf(card, scenario);
      const [ads, term] = ["terms", "term"].map((name) => () => card.querySelector(`input[name="${name}-${scenarioIndex}"]:checked`).value);
      const draw = () => {
        const known = scenario.cases.filter((item) => item[term()] !== null).map((item) => item[term()]);
        const most = term() === "avoided" ? 1 : Math.max(1e-9, ...known);
        card.querySelector("[data-most]").textContent = short(+most.toPrecision(3));
        plots.forEach((plot, panel) => {
          const found = casesOf(scenario, ads(), (item) => item.panel === panel && item[term()] !== null);
          const look = (item) => ({ z: item[term()], word: fixed(item[term()], term() === "severity" ? 1 : 2), text: caseHover(scenario, item) });
          Plotly.react(plot, [tiles(found, look, { colorscale: "Cividis", zmin: 0, zmax: most })], layout(...mapAxes(scenario, tiled), { dragmode: false }), CONFIG);
        });
      };
      draw();
      card.addEventListener("change", draw);
      plots.forEach((plot) => plot.on("plotly_click", (event) => onPick(scenarioIndex, event)));
      const hardest = Math.max(...scenario.cases.map((item) => item.severity ?? 0));
      histogram(card.querySelector("[data-of=severity]"), scenario, {
        value: (item) => item.severity, high: Math.max(5, Math.ceil(hardest / 5) * 5), bins: 15, digits: 1, axis: "U, m/s", count: "collisions",
      });
      histogram(card.querySelector("[data-of=ttc]"), scenario, { value: (item) => item.ttc, high: 10, bins: 20, digits: 1, axis: "TTC, s", count: "cases" });
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
  function reference(severity) {
    return severity === null ? "not known" : severity === 0 ? "0, avoids" : `${fixed(severity, 1)}${data.severityUnit}`;
  }

  function facts(scenario, item) {
    const rows = scenario.parameters.map((p, k) => [p.name, `${short(item.values[k])} ${p.unit}`]);
    rows.push(["zone", item.zone], ["status", item.status], ["verdict", data.verdicts[item.verdict].words]);
    if (item.time !== null) rows.push(["simulated time", `${fixed(item.time, 1)} s`]);
    rows.push(["exposure", short(item.exposure)]);
    if (item.latency !== null) rows.push(["slowest controller step", `${(1000 * item.latency).toPrecision(2)} ms`]);
    if (item.outcome === "collision") {
      rows.push(
        ["impact speed", `${fixed(item.impactSpeed, 1)} m/s`], ["overlap", `${fixed(100 * item.overlap, 0)} %`], ["side hit", item.side],
        ["kind of collision", item.idealSeverity === null ? "ideal vehicle not known" : item.kind],
        ["severity U", `${fixed(item.severity, 1)}${data.severityUnit}`], ["loss L", fixed(item.loss, 1)],
        ["ideal vehicle's Ug", reference(item.idealSeverity)], ["doing nothing, U0", reference(item.noReactionSeverity)],
        ["weight r", fixed(item.weight, 3)], ["A lost", fixed(item.aLost, 4)], ["C lost", fixed(item.lost, 4)],
      );
    }
    if (item.humanLikeness !== null) {
      rows.push(["human-likeness in H", fixed(item.humanLikeness, 3)]);
      if (item.outcome !== "collision") {
        rows.push(["operations factor in H", fixed(item.operationTolerance, 3)], ["similarity in H", fixed(item.mixtureSimilarity, 3)]);
      }
    }
    if (item.plausibility !== null) rows.push(["plausibility", fixed(item.plausibility, 3)]);
    if (item.index !== null) {
      rows.push(
        ["D_i", fixed(item.index, 3)], ["length factor", fixed(item.lengthFactor, 3)],
        ["operations factor in D_i", fixed(item.operationFactor, 3)], ["similarity in D_i", fixed(item.similarity, 3)],
      );
    }
    for (const [name, value, unit] of item.measures) rows.push([name, `${fixed(value, 2)} ${unit}`]);
    if (item.zone === "safe") rows.push(["drivers compared with", String(item.drivers)]);
    rows.push(["ended", item.end, true]);
    if (item.errorPlace) rows.push(["where in the ADS's code", item.errorPlace, true]);
    if (item.clips) rows.push(["limits that acted (how often)", item.clips, true]);
    if (item.indexNote) rows.push(["note on D_i", item.indexNote, true]);
    return rows;
  }

  function showFacts(rows) {
    byId("case-facts").replaceChildren(...rows.map(([name, value, long]) => {
      const row = document.createElement("div");
      row.className = long ? "long" : "";
      const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
      dt.textContent = name;
      dd.textContent = value;
      row.append(dt, dd);
      return row;
    }));
  }

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
    byId("case-name").textContent = `${item.ads}: ${pointWords(scenario, item.values)}`;
    showFacts(facts(scenario, item));
    const trouble = [item.missing, item.error].filter((text, k, all) => text && all.indexOf(text) === k).join(" ");
    byId("case-error").hidden = !trouble;
    byId("case-error").textContent = trouble || "";
    if (scroll) byId("case").scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
    const drawable = "ego" in item.vehicles;
    byId("case-charts").hidden = !drawable;
    const lacking = !item.embedded ? "trajectories" : item.drivers > driverIndexes.length ? "drivers' trajectories" : "";
    byId("case-elsewhere").hidden = !lacking;
    byId("case-elsewhere").textContent = `The ${lacking} of this case are not in this file; they are in the run's folder, and sumo-eval replay shows them.`;
    shown = null;
    player.stop();
    if (!drawable) return;
    const all = await trajectoriesOf(scenarioIndex);
    if (mine !== turn) return;
    shown = { scenario, item, ads: all[item.vehicles.ego], actors: actorsOf(item, all), drivers: driverIndexes.map((k) => all[k]) };
    byId("legend-ads").textContent = item.ads;
    byId("legend-drivers").hidden = shown.drivers.length === 0;
    byId("legend-drivers").lastElementChild.textContent = `${shown.drivers.length} human drivers`;
    drawPaths(shown);
    drawSpeed(shown);
    startReplay(shown, all);
    drawFields(shown);
  }

  /** Begin and end along the road of what there is to see of a case, m. */
  function extent({ scenario, ads, drivers, actors }) {
    const furthest = Math.max(...[ads, ...drivers, ...actors.map(([, actor]) => actor)].map((t) => t.x.at(-1)));
    return [ads.x[0] - 8, Math.max(ads.x[0] + 60, Math.min(scenario.road.end, furthest + 20))];
  }

  function roadShapes({ road }, [begin, end]) {
    const line = (y, style) => ({ type: "line", x0: begin, x1: end, y0: y, y1: y, layer: "below", line: style });
    const shapes = [{ type: "rect", x0: begin, x1: end, y0: road.right, y1: road.left, layer: "below", fillcolor: "#eef0f2", line: { width: 0 } }];
    for (const edge of [road.right, road.left]) shapes.push(line(edge, { color: "#57606a", width: 2 }));
    for (let lane = 1; lane < road.lanes; lane++) {
      shapes.push(line(road.right + lane * road.laneWidth, { color: "#9aa4ae", width: 1.5, dash: "dash" }));
    }
    for (const [x, wide, reach] of road.crossings) {
      shapes.unshift({ type: "rect", x0: x - wide / 2, x1: x + wide / 2, y0: -reach, y1: reach, layer: "below", fillcolor: "#eef0f2", line: { width: 0 } });
    }
    for (const [x0, x1, y] of road.solid) {
      shapes.push({ ...line(y, { color: "#57606a", width: 1.5 }), x0: Math.max(x0, begin), x1: Math.min(x1, end) });
    }
    for (const gone of road.gone) {
      const [corner, , [x0, y0], [x1, y1]] = gone, inView = (x) => Math.min(Math.max(x, begin), end);
      const border = gone.slice(1).map(([x]) => [inView(x), y0 + (y1 - y0) * Math.min(Math.max((inView(x) - x0) / (x1 - x0), 0), 1)]);
      if (border[0][0] === border[2][0]) continue;
      const edge = border.map(([x, y]) => `${x},${y}`).join("L");
      shapes.push({ type: "path", path: `M${inView(corner[0])},${corner[1]}L${edge}Z`, layer: "below", fillcolor: "#fff", line: { color: "#fff", width: 2 } });
      shapes.push({ type: "path", path: `M${edge}`, layer: "below", line: { color: "#57606a", width: 2 } });
    }
    return shapes;
  }

  /** Corners of a body, x and y of a closed polygon. */
  function body(trajectory, x, y, heading) {
    const [c, s, l, w] = [Math.cos(heading), Math.sin(heading), trajectory.length / 2, trajectory.width / 2];
    const corners = [[l, w], [l, -w], [-l, -w], [-l, w], [l, w]];
    return { x: corners.map(([a, b]) => x + a * c - b * s), y: corners.map(([a, b]) => y + a * s + b * c) };
  }

  const endBody = (t) => body(t, t.x.at(-1), t.y.at(-1), t.heading.at(-1));

  function manyLines(trajectories, xChannel, yChannel, style) {
    const x = [], y = [];
    for (const trajectory of trajectories) {
      x.push(...trajectory[xChannel], null);
      y.push(...trajectory[yChannel], null);
    }
    return { type: "scatter", mode: "lines", x, y, line: style, hoverinfo: "skip" };
  }

  function lines(view, xChannel, yChannel, hover) {
    const one = (name, trajectory, style) => ({
      type: "scatter", mode: "lines", x: Array.from(trajectory[xChannel]), y: Array.from(trajectory[yChannel]), line: style,
      hovertemplate: `<b>${plain(name)}</b><br>${hover}<extra></extra>`,
    });
    return [
      manyLines(view.drivers, xChannel, yChannel, { color: COLOURS.driver, width: 1 }),
      one(view.item.ads, view.ads, { color: COLOURS.ads, width: 3 }),
      ...view.actors.map(([name, trajectory]) => one(name, trajectory, { color: COLOURS.actor, width: 2, dash: "dash" })),
    ];
  }

  function drawPaths(view) {
    const { scenario, ads, item } = view;
    const [begin, end] = extent(view);
    const solid = (trajectory, colour) => ({
      ...endBody(trajectory), type: "scatter", mode: "lines", fill: "toself", fillcolor: colour, line: { color: colour, width: 1 }, hoverinfo: "skip",
    });
    const traces = [...lines(view, "x", "y", "x %{x:.1f} m, y %{y:.2f} m"), ...view.actors.map(([, t]) => solid(t, COLOURS.actor)), solid(ads, COLOURS.ads)];
    if (item.outcome === "collision") {
      traces.push({
        type: "scatter", mode: "markers", x: [ads.x.at(-1)], y: [ads.y.at(-1)], hovertemplate: "contact<extra></extra>",
        marker: { symbol: "x-thin", size: 13, line: { color: "#b23c00", width: 3.5 } },
      });
    }
    const { road } = scenario;
    Plotly.react("plot-paths", traces, layout(
      { ...title("x along the road, m"), range: [begin, end], showgrid: false },
      { ...title("y, m"), range: [road.right - 0.6, road.left + 0.6], showgrid: false },
      { shapes: roadShapes(scenario, [begin, end]) },
    ), CONFIG);
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
    both.forEach((field, k) => {
      const z = ys.map((_, row) => Array.from(field.subarray(row * xs.length, (row + 1) * xs.length)));
      const heat = {
        type: "heatmap", x: xs, y: ys, z, zmin, zmax, colorscale: "Viridis", zsmooth: "best", hovertemplate: "x %{x:.0f} m, y %{y:.2f} m<br>S = %{z:.2f}<extra></extra>",
        colorbar: { title: { text: "S" }, thickness: 12, outlinewidth: 0, len: 1 },
      };
      const path = k === 0 ? manyLines([view.ads], "x", "y", { color: "#fff", width: 1.8 })
        : manyLines(view.drivers, "x", "y", { color: "rgba(255,255,255,0.7)", width: 1 });
      Plotly.react(["plot-field-ads", "plot-field-drivers"][k], [heat, path], layout(
        { ...title("x along the road, m"), range: [xs[0], xs.at(-1)], showgrid: false },
        { ...title("y, m"), range: [view.scenario.road.right, view.scenario.road.left], showgrid: false }, { margin: { l: 52, r: 8, t: 8, b: 44 } },
      ), CONFIG);
    });
    document.documentElement.dataset.fields = "drawn";
  }

  // --- replay --------------------------------------------------------------------------------------------------------

  const player = sumoReplay.player(byId("replay"));

  const contactOf = (item) => (item.contact === null ? null : { ...item.contact, speed: item.impactSpeed });

  /** What may run beside the case: the other ADSs at the same point, and each driver. */
  function companions(view, all) {
    const { scenario, item } = view;
    const others = scenario.cases.filter((other) => other.point === item.point && other !== item && "ego" in other.vehicles);
    return [
      ...others.map((other) => ({ name: other.ads, ego: all[other.vehicles.ego], actors: actorsOf(other, all), contact: contactOf(other) })),
      ...view.drivers.map((driver, k) => ({ name: `driver ${k + 1}`, ego: driver, actors: view.actors, contact: null })),
    ];
  }

  const actorsOf = (item, all) => Object.entries(item.vehicles).filter(([name]) => name !== "ego").map(([name, k]) => [name, all[k]]);

  function startReplay(view, all) {
    const found = companions(view, all), select = byId("replay-beside");
    fill(select, [[-1, "nothing"], ...found.map(({ name }, k) => [k, name])], -1);
    const own = { name: view.item.ads, ego: view.ads, actors: view.actors, contact: contactOf(view.item) };
    const draw = () => player.show({
      road: view.scenario.road, ghosts: view.drivers, views: [own, ...found.slice(Number(select.value), Number(select.value) + 1)].slice(0, Number(select.value) < 0 ? 1 : 2),
    });
    select.onchange = draw;
    draw();
  }

  // --- the page ------------------------------------------------------------------------------------------------------

  /** The case a reader most wants to see: the collision that cost C most, else the least human-like case. */
  function firstCase() {
    const all = data.scenarios.flatMap((scenario, s) => scenario.cases.map((item, index) => ({ item, s, index })));
    const worst = (entries, cost) => entries.reduce((best, entry) => (best === null || cost(entry.item) > cost(best.item) ? entry : best), null);
    return worst(all.filter(({ item }) => item.lost !== null), (item) => item.lost) ??
      worst(all.filter(({ item }) => item.index !== null), (item) => -item.index) ?? all[0];
  }

  function caseFromAddress() {
    if (!location.hash.startsWith("#case:")) return null;
    const key = decodeURIComponent(location.hash.slice("#case:".length));
    for (const [s, scenario] of data.scenarios.entries()) {
      const index = scenario.cases.findIndex((item) => item.key === key);
      if (index >= 0) return { s, index };
    }
    return null;
  }

  function onPrint(begins) {
    document.documentElement.classList.toggle("printing", begins);
    if (begins) document.querySelectorAll("details").forEach((details) => { details.open = true; });
    for (const plot of document.querySelectorAll(".js-plotly-plot")) {
      if (plot.clientWidth === 0) continue;
      Plotly.relayout(plot, begins ? { width: plot.clientWidth, height: plot.clientHeight } : { width: null, height: null, autosize: true });
    }
  }

  function fail(reason) {
    byId("failure").hidden = false;
    byId("failure").textContent = `A chart of this report could not be drawn (${reason}). The tables and sentences are complete without it.`;
  }

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
  const first = asked ?? firstCase();
  if (first) showCase(first.s, first.index, asked !== null);
  else byId("case-charts").hidden = true;
  document.documentElement.dataset.report = "ready";
})();
