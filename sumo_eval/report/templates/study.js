// Draws the charts of a study's page, in the colours of the page, each once it is to be seen.
"use strict";

(async () => {
  const byId = (id) => document.getElementById(id);
  const fail = (reason) => {
    byId("failure").hidden = false;
    byId("failure").textContent = `The chart could not be drawn (${reason}).`;
  };
  window.addEventListener("unhandledrejection", (event) => fail(event.reason));
  const figures = JSON.parse(await sumoEval.inflated(byId("study-figures").textContent));
  const library = document.createElement("script"); // inline scripts run as they are added
  library.textContent = await sumoEval.inflated(byId("plotly-code").textContent);
  document.head.append(library);
  const C = sumoPage.colour;

  // Figures come in the colours of a light page; each stands for its name in the style sheet.
  const NAMES = { "#e6f1f8": "--safe", "#fbd9b5": "--hazardous", "#1b1f24": "--ink", "#0072b2": "--c", "#b23c00": "--hit",
    "#9aa1aa": "--hatch", "#4d9e7a": "--d", "#b26a00": "--actor", "#8a3d74": "--off" };
  const coloured = (value) => {
    if (typeof value === "string") return NAMES[value.toLowerCase()] ? C(NAMES[value.toLowerCase()]) : value;
    if (Array.isArray(value)) return value.map(coloured);
    if (value?.constructor === Object) return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, coloured(one)]));
    return value;
  };

  function draw(plot) {
    const figure = figures[Number(plot.dataset.figure)];
    const axis = { gridcolor: C("--hair"), linecolor: C("--axis"), zeroline: false, ticks: "outside", ticklen: 4, tickcolor: C("--axis") };
    const layout = { ...figure.layout, autosize: true, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: C("--ink") },
      hoverlabel: { bgcolor: C("--paper"), bordercolor: C("--axis"), font: { color: C("--ink") } } };
    for (const name of Object.keys(layout)) if (/^[xy]axis\d*$/.test(name)) layout[name] = { ...axis, ...layout[name] };
    return Plotly.react(plot, coloured(figure.data), coloured(layout), { displaylogo: false, responsive: true, displayModeBar: false });
  }

  /** Draw a chart for the first time, and give it its buttons. */
  async function begin(plot) {
    if (plot.dataset.drawn) return;
    plot.dataset.drawn = "yes";
    // Arrays of numbers come packed; Plotly has unpacked them in what it drew.
    const marks = (trace) => (trace.z ? Array.from(trace.z, (line, r) => Array.from(line, (z, c) => [trace.name ?? "", trace.x[c], trace.y[r], z])).flat()
      : Array.from(trace.x ?? [], (x, i) => [trace.name ?? "", x, trace.y?.[i], Array.isArray(trace.text) ? trace.text[i] : ""]));
    const rows = () => [["series", "x", "y", "value"], ...plot._fullData.filter((trace) => trace.z || trace.hoverinfo !== "skip").flatMap(marks)];
    const svg = async () => {
      const address = await Plotly.toImage(plot, { format: "svg", width: plot.clientWidth, height: plot.clientHeight });
      return decodeURIComponent(address.slice(address.indexOf(",") + 1));
    };
    plot.closest("figure").querySelector("figcaption").append(sumoPage.saver(plot.getAttribute("aria-label"), svg, rows));
    await draw(plot);
  }

  const plots = [...document.querySelectorAll("[data-figure]")];
  const seen = () => plots.filter((plot) => !plot.closest("details:not([open])"));
  for (const fold of document.querySelectorAll("details.fold")) {
    fold.addEventListener("toggle", () => { if (fold.open) fold.querySelectorAll("[data-figure]").forEach(begin); });
  }
  /** For paper the charts are drawn anew: in the colours of a light page and as wide as it is. */
  function forPaper(printing) {
    document.documentElement.classList.toggle("printing", printing);
    return Promise.all(plots.filter((plot) => plot.dataset.drawn).map(async (plot) => {
      await draw(plot);
      await Plotly.Plots.resize(plot);
    }));
  }
  sumoPage.beforePrint(() => Promise.all(plots.map(begin)).then(() => forPaper(true)));
  window.addEventListener("beforeprint", () => { // Ctrl+P waits for nothing: what was folded away is drawn within this call
    plots.forEach(begin);
    forPaper(true);
  });
  window.addEventListener("afterprint", () => forPaper(false));
  sumoPage.onTheme(() => plots.filter((plot) => plot.dataset.drawn).forEach(draw));
  await Promise.all(seen().map(begin));
  document.documentElement.dataset.study = "ready";
})();
