// Maps over a space of any number of parameters: which two are the axes, a slice through the others, one or two ADSs.
// Nothing is drawn that does not lie in the slice.
"use strict";

const sumoMaps = (() => {
  const MOST_LEVELS = 25; // more values than this of a parameter are a range, of which a slice has a thickness
  const MOST_PANELS = 12;
  const GATHERED = 6;
  const CELLS = 72;
  const THICKNESS = [0.05, 0.1, 0.25, 0.5]; // shares of a parameter's range to each side

  const short = (value) => String(+value.toPrecision(6));
  const words = (name) => name.replaceAll("_", " ");
  const levelsOf = (scenario, k) => [...new Set(scenario.cases.map((item) => item.values[k]))].sort((a, b) => a - b);
  /** Whether a slice is at one of the parameter's values: where these are few and most are taken by several points. */
  const isStepped = (scenario, k) => {
    const number = levelsOf(scenario, k).length, points = new Set(scenario.cases.map((item) => item.values.join())).size;
    return number <= MOST_LEVELS && (number === 1 || 2 * number <= points);
  };
  const close = (a, b) => Math.abs(a - b) <= 1e-9 * Math.max(1, Math.abs(a), Math.abs(b));

  /** The view that a map opens with; `at` holds the slice: parameter -> { value, half, all }. */
  function opening(scenario) {
    const { x, y, panel } = scenario.view;
    const view = { x, y, panel, at: {} };
    const worst = scenario.cases.reduce((best, item) => ((item.aLost ?? -1) > (best?.aLost ?? -1) ? item : best), scenario.cases[0] ?? null);
    scenario.parameters.forEach((parameter, k) => {
      const given = scenario.view.slice[k] ?? worst?.values[k] ?? (parameter.low + parameter.high) / 2;
      view.at[k] = { value: given, half: isStepped(scenario, k) ? 0 : 0.25, all: false };
    });
    return view;
  }

  /** Values of the panels: every level, or some values of a range. */
  function panelsOf(scenario, view) {
    if (view.panel === null) return [null];
    if (view.panel === scenario.view.panel) return scenario.view.panels;
    const levels = levelsOf(scenario, view.panel);
    if (levels.length <= MOST_PANELS) return levels;
    const { low, high } = scenario.parameters[view.panel];
    return Array.from({ length: GATHERED }, (_, k) => low + (high - low) * k / (GATHERED - 1));
  }

  /** The parameters that are no axis and no panel: each has a slider. */
  const sliced = (scenario, view) => scenario.parameters.map((_, k) => k).filter((k) => k !== view.x && k !== view.y && k !== view.panel);

  /** Whether a case lies in the slice, on a panel. */
  function shows(scenario, view, panels, panel, item) {
    if (view.panel !== null) {
      const near = panels.reduce((best, value, k) => (Math.abs(value - item.values[view.panel]) < Math.abs(panels[best] - item.values[view.panel]) ? k : best), 0);
      if (near !== panel) return false;
    }
    return sliced(scenario, view).every((k) => {
      const { value, half, all } = view.at[k];
      const { low, high } = scenario.parameters[k];
      return all || (half ? Math.abs(item.values[k] - value) <= half * (high - low) + 1e-12 : close(item.values[k], value));
    });
  }

  /** Zones of the slice: { x, y, gp, exact, impossible or possible }; null where it has none. */
  function zones(scenario, view, panels, panel) {
    const given = scenario.view, k = scenario.parameters.length;
    const own = view.x === given.x && view.y === given.y && view.panel === given.panel;
    if (own && sliced(scenario, view).every((j) => !view.at[j].all && close(view.at[j].value, given.fixed[j] ?? NaN))) {
      const map = scenario.maps[panel];
      const rows = (levels) => Array.from({ length: map.y.length }, (_, r) => Array.from(levels.subarray(r * map.x.length, (r + 1) * map.x.length), (level) => level / 32000));
      return { x: map.x, y: map.y, gp: rows(sumoEval.decodeLevels(map.gp)), exact: rows(sumoEval.decodeLevels(map.exact)), impossible: map.impossible };
    }
    if (k < 2 || !scenario.lattice || sliced(scenario, view).some((j) => view.at[j].all)) return null;
    return latticeZones(scenario, view, panels[panel]);
  }

  function unpackedLattice(scenario) {
    scenario.lattice.read ??= {
      gp: sumoEval.decodeLevels(scenario.lattice.gp), exact: sumoEval.decodeLevels(scenario.lattice.exact),
      possible: Uint8Array.from(atob(scenario.lattice.possible), (letter) => letter.charCodeAt(0)),
    };
    return scenario.lattice.read;
  }

  /** Between the points of the lattice everything is interpolated along each parameter. */
  function latticeZones(scenario, view, panelValue) {
    const { size } = scenario.lattice, read = unpackedLattice(scenario), k = scenario.parameters.length;
    const place = (j, value) => {
      const { low, high } = scenario.parameters[j];
      const at = Math.min(Math.max((value - low) / (high - low), 0), 1) * (size - 1), whole = Math.min(Math.floor(at), size - 2);
      return [whole, at - whole];
    };
    const axis = (j) => Array.from({ length: CELLS + 1 }, (_, i) => scenario.parameters[j].low + (scenario.parameters[j].high - scenario.parameters[j].low) * i / CELLS);
    const [xs, ys] = [axis(view.x), axis(view.y)];
    const held = scenario.parameters.map((_, j) => (j === view.x || j === view.y ? null : place(j, j === view.panel ? panelValue : view.at[j].value)));
    const strides = Array.from({ length: k }, (_, j) => size ** (k - 1 - j));
    const of = (places) => {
      let corners = [[0, 1]];
      places.forEach(([whole, part], j) => {
        corners = corners.flatMap(([at, weight]) => (part === 0 ? [[at + whole * strides[j], weight]]
          : [[at + whole * strides[j], weight * (1 - part)], [at + (whole + 1) * strides[j], weight * part]]));
      });
      const mean = (values) => corners.reduce((sum, [at, weight]) => sum + weight * values[at], 0);
      return [mean(read.gp) / 32000, mean(read.exact) / 32000, mean(read.possible)];
    };
    const gp = [], exact = [], possible = [];
    for (const y of ys) {
      const row = xs.map((x) => of(held.map((place_, j) => (j === view.x ? place(j, x) : j === view.y ? place(j, y) : place_))));
      gp.push(row.map((one) => one[0]));
      exact.push(row.map((one) => one[1]));
      possible.push(row.map((one) => one[2]));
    }
    return { x: xs, y: ys, gp, exact, possible };
  }

  // --- controls ------------------------------------------------------------------------------------------------------

  function labelled(text, control) {
    const label = document.createElement("label");
    label.append(text, " ", control);
    return label;
  }

  function select(entries, chosen, act) {
    const made = document.createElement("select");
    made.replaceChildren(...entries.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
    made.addEventListener("change", (event) => { event.stopPropagation(); act(made.value); });
    return made;
  }

  /** Axis pickers where there is a choice. */
  function axes(scenario, view, bar, changed) {
    const k = scenario.parameters.length;
    bar.replaceChildren();
    if (k < 2) return;
    const all = scenario.parameters.map((parameter, j) => [j, words(parameter.name)]);
    const pick = (which) => (value) => {
      const before = view[which], now = value === "" ? null : Number(value);
      for (const other of ["x", "y", "panel"]) if (other !== which && view[other] === now && now !== null) view[other] = before;
      view[which] = now;
      changed();
    };
    const xs = select(all, view.x, pick("x")), ys = select(all, view.y, pick("y"));
    xs.dataset.axis = "x";
    ys.dataset.axis = "y";
    bar.append(labelled("across", xs), labelled("up", ys));
    if (k > 2) {
      const panels = select([["", "no panels"], ...all.filter(([j]) => j !== view.x && j !== view.y)], view.panel ?? "", pick("panel"));
      panels.dataset.axis = "panel";
      bar.append(labelled("a panel for each", panels));
    }
  }

  /** A slider for each parameter that is no axis. */
  function sliders(scenario, view, holder, changed) {
    holder.replaceChildren(...sliced(scenario, view).map((k) => {
      const parameter = scenario.parameters[k], at = view.at[k], levels = levelsOf(scenario, k), stepped = isStepped(scenario, k);
      const row = document.createElement("div"), range = document.createElement("input"), said = document.createElement("output");
      row.className = "slider";
      row.dataset.slice = parameter.name;
      range.type = "range";
      range.setAttribute("aria-label", words(parameter.name));
      [range.min, range.max, range.step] = stepped ? [0, Math.max(0, levels.length - 1), 1] : [parameter.low, parameter.high, (parameter.high - parameter.low) / 100];
      const nearest = () => levels.reduce((best, value, i) => (Math.abs(value - at.value) < Math.abs(levels[best] - at.value) ? i : best), 0);
      if (stepped && levels.length) at.value = levels[nearest()];
      range.value = stepped ? nearest() : at.value;
      const tell = () => {
        said.textContent = at.all ? "all values" : `${+at.value.toPrecision(4)}${at.half ? ` ± ${short(+(at.half * (parameter.high - parameter.low)).toPrecision(3))}` : ""} ${parameter.unit}`;
        range.disabled = at.all;
      };
      range.addEventListener("input", (event) => {
        event.stopPropagation();
        at.value = stepped ? levels[Number(range.value)] : Number(range.value);
        tell();
        changed(true);
      });
      range.addEventListener("change", (event) => event.stopPropagation());
      const entries = stepped ? [["", "this value"]] : THICKNESS.map((half) => [half, `± ${100 * half} %`]);
      const width = select([...entries, ["all", "all values"]], at.all ? "all" : stepped ? "" : at.half, (value) => {
        at.all = value === "all";
        if (!at.all && !stepped) at.half = Number(value);
        tell();
        changed(true);
      });
      width.setAttribute("aria-label", `thickness of the slice in ${words(parameter.name)}`);
      tell();
      const name = document.createElement("span");
      name.textContent = words(parameter.name);
      row.append(name, range, said, width);
      return row;
    }));
  }

  return { opening, panelsOf, sliced, shows, zones, axes, sliders, levelsOf, labelled, select, words, short };
})();
