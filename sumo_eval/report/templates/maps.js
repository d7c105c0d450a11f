// Maps over a space of any number of parameters: which two are the axes, a slice through the others, one or two ADSs.
// Nothing is drawn that does not lie in the slice.
"use strict";

const sumoMaps = (() => {
  const MOST_LEVELS = 25; // more values than this of a parameter are a range, of which a slice has a thickness
  const CELLS = 72; // of a map along each axis, where it is interpolated
  const FINE = 4; // parts of a cell, along y, between which an area's edge is sought
  const HALVINGS = 6; // of a cell, along x, to where an area begins
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
    const levels = levelsOf(scenario, view.panel), { mostPanels, gatheredPanels } = scenario.view;
    if (levels.length <= mostPanels) return levels;
    const { low, high } = scenario.parameters[view.panel];
    return Array.from({ length: gatheredPanels }, (_, k) => low + (high - low) * k / (gatheredPanels - 1));
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

  /** Zones of the slice: { x, y, gp, exact, impossible: polygons [[x, y], ...] }; null where it has none. */
  function zones(scenario, view, panels, panel) {
    const given = scenario.view, k = scenario.parameters.length;
    const own = view.x === given.x && view.y === given.y && view.panel === given.panel;
    const held = heldValues(scenario, view, panels, panel);
    if (own && sliced(scenario, view).every((j) => !view.at[j].all && close(view.at[j].value, given.fixed[j] ?? NaN))) {
      const map = scenario.maps[panel], width = map.x.length;
      const rows = (levels) => Array.from({ length: map.y.length }, (_, r) => Array.from(levels.subarray(r * width, (r + 1) * width), (level) => level / 32000));
      const exactly = held.every((values) => values.length === 1) || !scenario.lattice;
      const grids = exactly ? [map.rooms.map((packed) => rows(sumoEval.decodeLevels(packed)))] : latticeRooms(scenario, view, held);
      return { x: map.x, y: map.y, gp: rows(sumoEval.decodeLevels(map.gp)), exact: rows(sumoEval.decodeLevels(map.exact)), impossible: view.y === null ? [] : areas(scenario, view, grids) };
    }
    if (k < 2 || !scenario.lattice || sliced(scenario, view).some((j) => view.at[j].all)) return null;
    return { ...latticeZones(scenario, view, panels[panel]), impossible: areas(scenario, view, latticeRooms(scenario, view, held)) };
  }

  /** Values of each parameter that is no axis, at which a case would be drawn on this panel: the middle and both ends. */
  function heldValues(scenario, view, panels, panel) {
    return scenario.parameters.map(({ low, high }, j) => {
      const within = (value) => Math.min(Math.max(value, low), high);
      if (j === view.x || j === view.y) return [low];
      if (j === view.panel) {
        const here = panels[panel], middle = (other) => (other === undefined ? here : (here + other) / 2);
        const apart = levelsOf(scenario, j).every((value) => panels.some((one) => close(one, value)));
        return apart ? [here] : [middle(panels[panel - 1]), here, middle(panels[panel + 1])];
      }
      const { value, half } = view.at[j], reach = half * (high - low);
      return reach ? [within(value - reach), value, within(value + reach)] : [value];
    });
  }

  function unpackedLattice(scenario) {
    scenario.lattice.read ??= {
      gp: sumoEval.decodeLevels(scenario.lattice.gp), exact: sumoEval.decodeLevels(scenario.lattice.exact),
      rooms: scenario.lattice.rooms.map((packed) => sumoEval.decodeLevels(packed)),
    };
    return scenario.lattice.read;
  }

  /** Where a value lies on an axis of the lattice: the point below it, and the share of the way to the next. */
  function latticePlace(scenario, j, value) {
    const { low, high } = scenario.parameters[j], { size } = scenario.lattice;
    const at = Math.min(Math.max((value - low) / (high - low), 0), 1) * (size - 1), whole = Math.min(Math.floor(at), size - 2);
    return [whole, at - whole];
  }

  /** Points of the lattice around a place, and their weights: [[number, weight], ...]. */
  function latticeCorners(scenario, places) {
    const { size } = scenario.lattice, k = places.length;
    let corners = [[0, 1]];
    places.forEach(([whole, part], j) => {
      const stride = size ** (k - 1 - j);
      corners = corners.flatMap(([at, weight]) => (part === 0 ? [[at + whole * stride, weight]]
        : [[at + whole * stride, weight * (1 - part)], [at + (whole + 1) * stride, weight * part]]));
    });
    return corners;
  }

  /** Between the points of the lattice everything is interpolated along each parameter. */
  function latticeZones(scenario, view, panelValue) {
    const read = unpackedLattice(scenario);
    const place = (j, value) => latticePlace(scenario, j, value);
    const axis = (j) => Array.from({ length: CELLS + 1 }, (_, i) => scenario.parameters[j].low + (scenario.parameters[j].high - scenario.parameters[j].low) * i / CELLS);
    const [xs, ys] = [axis(view.x), axis(view.y)];
    const held = scenario.parameters.map((_, j) => (j === view.x || j === view.y ? null : place(j, j === view.panel ? panelValue : view.at[j].value)));
    const gp = [], exact = [];
    for (const y of ys) {
      const row = xs.map((x) => {
        const corners = latticeCorners(scenario, held.map((place_, j) => (j === view.x ? place(j, x) : j === view.y ? place(j, y) : place_)));
        return [read.gp, read.exact].map((values) => corners.reduce((sum, [at, weight]) => sum + weight * values[at], 0) / 32000);
      });
      gp.push(row.map((one) => one[0]));
      exact.push(row.map((one) => one[1]));
    }
    return { x: xs, y: ys, gp, exact };
  }

  /** For every choice of the values held: each constraint's room over the two axes, rows of y. */
  function latticeRooms(scenario, view, held) {
    const { size } = scenario.lattice, k = scenario.parameters.length, { rooms } = unpackedLattice(scenario);
    const [across, up] = [view.x, view.y].map((j) => size ** (k - 1 - j));
    const steps = Array.from({ length: size }, (_, i) => i);
    let choices = [[]];
    for (const values of held) choices = choices.flatMap((choice) => values.map((value) => [...choice, value]));
    return choices.map((choice) => {
      const corners = latticeCorners(scenario, choice.map((value, j) => latticePlace(scenario, j, value)));
      return rooms.map((levels) => steps.map((r) => steps.map((c) => corners.reduce((sum, [at, weight]) => sum + weight * levels[at + r * up + c * across], 0))));
    });
  }

  /** Areas of a map in which no point of the slice is possible: polygons [[x, y], ...].
   *  grids: for each choice of what is held, each constraint's room at the points of a grid, rows of y.
   *  Constraints are taken apart: the room of one mostly is straight between points of the grid, the least of two is not.
   */
  function areas(scenario, view, grids) {
    if (!grids[0].length) return [];
    const [columns, rows] = [grids[0][0][0].length - 1, grids[0][0].length - 1];
    const between = (last, share) => { const whole = Math.min(Math.floor(share * last), last - 1); return [whole, share * last - whole]; };
    function room(x, y) {
      const [c, right] = between(columns, x), [r, above] = between(rows, y);
      return Math.max(...grids.map((rooms) => Math.min(...rooms.map((grid) => (
        (1 - above) * ((1 - right) * grid[r][c] + right * grid[r][c + 1]) + above * ((1 - right) * grid[r + 1][c] + right * grid[r + 1][c + 1]))))));
    }
    /** Stretches of y, from 0 to 1, that are impossible at an x. */
    function stretches(x) {
      const found = [], number = CELLS * FINE;
      let before = NaN;
      for (let i = 0; i <= number; i += 1) {
        const now = room(x, i / number);
        if (now < 0 && !(before < 0)) found.push([before >= 0 ? (i - now / (now - before)) / number : 0, 1]);
        if (now >= 0 && before < 0) found.at(-1)[1] = (i - now / (now - before)) / number;
        before = now;
      }
      return found;
    }
    const [xs, ys] = [view.x, view.y].map((j) => (share) => scenario.parameters[j].low + (scenario.parameters[j].high - scenario.parameters[j].low) * share);
    const polygons = [];
    /** Between two x, a strip for each stretch; where a stretch begins or ends between them, halves, as far as it is worth it. */
    function strips(x0, left, x1, right, halvings) {
      if (left.length === right.length) {
        left.forEach(([a, b], i) => polygons.push([[x0, a], [x1, right[i][0]], [x1, right[i][1]], [x0, b], [x0, a]].map(([x, y]) => [xs(x), ys(y)])));
      } else if (halvings) {
        const x = (x0 + x1) / 2, middle = stretches(x);
        strips(x0, left, x, middle, halvings - 1);
        strips(x, middle, x1, right, halvings - 1);
      }
    }
    const all = Array.from({ length: CELLS + 1 }, (_, i) => stretches(i / CELLS));
    for (let i = 0; i < CELLS; i += 1) strips(i / CELLS, all[i], (i + 1) / CELLS, all[i + 1], HALVINGS);
    return polygons;
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
      const row = document.createElement("div"), range = document.createElement("input"), reading = document.createElement("output");
      row.className = "slider";
      row.dataset.slice = parameter.name;
      range.type = "range";
      range.setAttribute("aria-label", words(parameter.name));
      [range.min, range.max, range.step] = stepped ? [0, Math.max(0, levels.length - 1), 1] : [parameter.low, parameter.high, (parameter.high - parameter.low) / 100];
      const nearest = () => levels.reduce((best, value, i) => (Math.abs(value - at.value) < Math.abs(levels[best] - at.value) ? i : best), 0);
      if (stepped && levels.length) at.value = levels[nearest()];
      range.value = stepped ? nearest() : at.value;
      const showValue = () => {
        reading.textContent = at.all ? "all values" : `${+at.value.toPrecision(4)}${at.half ? ` ± ${short(+(at.half * (parameter.high - parameter.low)).toPrecision(3))}` : ""} ${parameter.unit}`;
        range.disabled = at.all;
      };
      range.addEventListener("input", (event) => {
        event.stopPropagation();
        at.value = stepped ? levels[Number(range.value)] : Number(range.value);
        showValue();
        changed(true);
      });
      range.addEventListener("change", (event) => event.stopPropagation());
      const entries = stepped ? [["", "this value"]] : THICKNESS.map((half) => [half, `± ${100 * half} %`]);
      const width = select([...entries, ["all", "all values"]], at.all ? "all" : stepped ? "" : at.half, (value) => {
        at.all = value === "all";
        if (!at.all && !stepped) at.half = Number(value);
        showValue();
        changed(true);
      });
      width.setAttribute("aria-label", `thickness of the slice in ${words(parameter.name)}`);
      showValue();
      const name = document.createElement("span");
      name.textContent = words(parameter.name);
      row.append(name, range, reading, width);
      return row;
    }));
  }

  return { opening, panelsOf, sliced, shows, zones, axes, sliders, levelsOf, labelled, select, words, short };
})();
