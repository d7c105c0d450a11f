// A recorded case as an animation: the road from above, to scale, a chase view, and speed, TTC and commands over time.
// Used by the report and by the page that `sumo-eval replay` writes. Times run from the start of the recording, s.
"use strict";

const sumoReplay = (() => {
  const MS = 1e-3; // s, to which recorded times are rounded
  const TOUCH = 1e-3; // m; the same as in sumo_eval/method/measures.py
  const COLOURS = { views: ["#0072b2", "#8a3d74"], ghost: "#8593a3", actor: "#b26a00", contact: "#c62828" };
  const LIGHT = { ink: "#1b1f24", muted: "#57606a", hair: "#e6eaee", ground: "#f5f7f9", road: "#d9dde1", lines: COLOURS.views, contact: COLOURS.contact };
  const DARK = { ink: "#e6eaee", muted: "#a3adb8", hair: "#2a323a", ground: "#12161a", road: "#2c343d", lines: ["#3d9ad6", "#d48cc0"], contact: "#ff7b72" };
  let paper = LIGHT; // what is drawn on: that of the page, and white where it is printed
  let printing = false;
  for (const name of ["beforeprint", "afterprint"]) globalThis.window?.addEventListener(name, () => { printing = name === "beforeprint"; });
  function choosePaper() {
    paper = document.documentElement.dataset.theme === "dark" && !printing ? DARK : LIGHT;
  }
  const FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', Arial, sans-serif";
  const BRAKING = -0.5; // m/s2 from which the brake lights are drawn
  const MOST_TTC = 10; // s; longer ones are off the chart
  const SETTLES = 250; // ms without a change after which a picture is drawn with all pixels
  const SPEEDS = [0.25, 0.5, 1, 2, 4];

  /** A channel at a time, linear between samples, constant beyond the ends. */
  function at(t, channel, time) {
    const times = t.time, values = t[channel];
    let low = 0, high = times.length - 1;
    const wanted = time + times[0];
    if (wanted <= times[low]) return values[low];
    if (wanted >= times[high]) return values[high];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= wanted) low = middle; else high = middle;
    }
    let change = values[high] - values[low];
    if (channel === "heading") change -= 2 * Math.PI * Math.round(change / (2 * Math.PI));
    return values[low] + change * (wanted - times[low]) / (times[high] - times[low]);
  }

  const duration = (t) => t.time[t.time.length - 1] - t.time[0];

  /** Whether a trajectory lasts until a time: an actor may leave the road before the case is over. */
  const there = (t, time) => time <= duration(t) + MS; // the contact time is rounded finer
  const present = (view, time) => view.actors.filter(([, actor]) => there(actor, time));

  /** Gap m from an ego, which points along the road, to another body if that is ahead in its path; Infinity otherwise. */
  function gapTo(ego, x, y, other, otherX, otherY, heading) {
    const c = Math.abs(Math.cos(heading)), s = Math.abs(Math.sin(heading));
    const beside = Math.abs(otherY - y) > (ego.width + other.length * s + other.width * c) / 2 - TOUCH;
    return otherX <= x || beside ? Infinity : Math.max(0, otherX - x - (ego.length + other.length * c + other.width * s) / 2);
  }

  /** Speed of a vehicle along the road's line, m/s. */
  function speedAlong(road, speed, heading, x, y) {
    return speed * Math.cos(heading) / (1 - (bends(road) ? lineAt(road.line, x)[3] * y : 0));
  }

  /** Gap m and TTC s to the nearest vehicle ahead in the path, at each sample of the ego; NaN without one, Infinity where
   *  it does not close. The twin of `vehicle_ahead` and `time_to_collision` in sumo_eval/method/measures.py. */
  function ahead(ego, actors, contact, road) {
    const n = ego.time.length, gap = new Float64Array(n).fill(NaN), ttc = new Float64Array(n).fill(NaN);
    for (let k = 0; k < n; k++) {
      let nearest = Infinity, closing = NaN;
      const time = ego.time[k] - ego.time[0], own = speedAlong(road, ego.speed[k], ego.heading[k], ego.x[k], ego.y[k]);
      for (const [name, actor] of actors) {
        if (time < -1e-9 || time > duration(actor) + 1e-9) continue;
        const x = at(actor, "x", time), y = at(actor, "y", time);
        const heading = at(actor, "heading", time);
        let distance = gapTo(ego, ego.x[k], ego.y[k], actor, x, y, heading);
        if (contact && contact.other === name && contact.side === "front" && time >= contact.time - MS) distance = 0;
        if (distance < nearest) {
          nearest = distance;
          closing = own - speedAlong(road, at(actor, "speed", time), heading, x, y);
        }
      }
      if (nearest === Infinity) continue;
      gap[k] = nearest;
      ttc[k] = closing > 0 ? (nearest < TOUCH ? 0 : nearest / closing) : Infinity;
    }
    return { gap, ttc };
  }

  /** Corners [x, y] of a body at a time. */
  function corners(t, time) {
    const [x, y, heading] = ["x", "y", "heading"].map((channel) => at(t, channel, time));
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => [
      x + (a * t.length * c - b * t.width * s) / 2, y + (a * t.length * s + b * t.width * c) / 2,
    ]);
  }

  const TWO_WHEELS = ["bicycle", "motorcycle"];

  /** What a body is drawn as: what its scenario says, or what its size looks like. */
  function kindOf(t) {
    if (t.kind) return t.kind === "pedestrian" || t.kind === "child" ? "person" : t.kind;
    if (t.length < 0.9) return "person";
    if (t.width <= 0.75) return "bicycle";
    if (t.width <= 1.1) return "motorcycle";
    return t.length > 9 ? "truck" : t.length > 5.6 ? "van" : "car";
  }

  /** The parts of a body from above in its own axes, m: { ring: [[ahead, left], ...], role }. role: "body" is filled,
   *  "head" has an edge of its own, "glass" is a line across. pixel: m; what would be smaller than a few of it is drawn larger. */
  function bodyParts(t, pixel = 0) {
    const kind = kindOf(t), half = t.length / 2, wide = t.width / 2;
    const block = (from, to, side) => ({ ring: [[from, side], [to, side], [to, -side], [from, -side]], role: "body" });
    const disc = (ahead, radius, role) => ({
      ring: Array.from({ length: 16 }, (_, k) => [ahead + radius * Math.cos(k * Math.PI / 8), radius * Math.sin(k * Math.PI / 8)]), role,
    });
    if (kind === "person") { // shoulders and a head
      const depth = Math.max(half, 2 * pixel);
      return [block(-depth, depth, Math.max(wide, 4 * pixel)), disc(0, Math.max(0.12, 2 * pixel), "head")];
    }
    if (TWO_WHEELS.includes(kind)) { // two wheels on a line, a handlebar, and who rides
      return [
        block(-half, half, Math.max(kind === "bicycle" ? 0.05 : 0.16, pixel)), block(half - 0.35 - pixel, half - 0.25, wide),
        disc(-0.1 * t.length, Math.max(0.28, 2.5 * pixel), "body"),
      ];
    }
    const parts = [block(-half, half, wide)];
    if (2 * wide < 4 * pixel) return parts;
    const glass = kind === "car" ? 0.2 * half : half - (kind === "truck" ? 2.2 : 1.4);
    return [...parts, { ring: [[glass, 0.8 * wide], [glass, -0.8 * wide]], role: "glass" }];
  }

  /** A body from above, drawn as what it is. t: in the coordinates that `project` takes to the sheet. hollow: outline alone.
   *  plain: without windows, across which a label would be written. */
  function drawBody(context, t, time, project, fill, hollow, plain = false) {
    const [x, y, heading] = ["x", "y", "heading"].map((channel) => at(t, channel, time));
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const local = ([a, b]) => project([x + a * c - b * s, y + a * s + b * c]);
    const [here, ahead] = [local([0, 0]), local([1, 0])];
    const pixel = 1 / Math.hypot(ahead[0] - here[0], ahead[1] - here[1]);
    context.lineWidth = 1.2;
    context.fillStyle = fill;
    for (const { ring, role } of bodyParts(t, pixel)) {
      if (role === "glass" && (hollow || plain)) continue;
      outline(context, ring.map(local));
      if (!hollow && role !== "glass") context.fill();
      context.strokeStyle = role === "glass" ? "rgba(255,255,255,0.75)" : role === "head" && !hollow ? "#fff" : fill;
      context.stroke();
    }
  }

  // --- roads that bend: trajectories are along and across the road, pictures on the map ---------------------------------

  const NODES = [-0.906179845938664, -0.5384693101056831, 0, 0.5384693101056831, 0.906179845938664];
  const WEIGHTS = [0.23692688505618908, 0.47862867049936647, 0.5688888888888889, 0.47862867049936647, 0.23692688505618908];
  const bends = (road) => Boolean(road.line && road.line.length);

  /** [x, y, heading, curvature] of a road's line at s, m, rad and 1/m. line: [[s, x, y, heading, curvature, rate]], where
   *  its stretches begin. The twin of `line_at` in sumo_eval/scenario/road/reference_line.py. */
  function lineAt(line, s) {
    let low = 0, high = line.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (line[middle][0] <= s) low = middle; else high = middle;
    }
    if (low === 0) return [s, 0, 0, 0];
    const [begin, x, y, heading, curvature, rate] = line[low], u = s - begin;
    const turned = (v) => heading + v * (curvature + rate * v / 2);
    let east = 0, north = 0;
    NODES.forEach((node, k) => {
      const angle = turned(u * (1 + node) / 2);
      east += WEIGHTS[k] * Math.cos(angle);
      north += WEIGHTS[k] * Math.sin(angle);
    });
    if (rate === 0 && curvature !== 0) { // an arc may be long: its chord
      const half = curvature * u / 2, chord = u * Math.sin(half) / half || u;
      return [x + chord * Math.cos(heading + half), y + chord * Math.sin(heading + half), heading + 2 * half, curvature];
    }
    return [x + u * east / 2, y + u * north / 2, turned(u), curvature + rate * u];
  }

  /** [x, y, heading] on the map of a place along and across a road. */
  function onMap(road, x, y, heading = 0) {
    if (!bends(road)) return [x, y, heading];
    const [lineX, lineY, along] = lineAt(road.line, x);
    return [lineX - y * Math.sin(along), lineY + y * Math.cos(along), along + heading];
  }

  const maps = new WeakMap();

  /** A trajectory on the map. */
  function mapped(road, t) {
    if (!bends(road)) return t;
    if (!maps.has(t)) {
      const places = Array.from(t.x, (x, k) => onMap(road, x, t.y[k], t.heading[k]));
      maps.set(t, { ...t, x: places.map(([x]) => x), y: places.map(([, y]) => y), heading: places.map(([, , heading]) => heading) });
    }
    return maps.get(t);
  }

  /** The road from above where it bends: the ego's stretch of it lies level, the rest turns away; with a span [from, to], m,
   *  the middle of that. */
  function drawTopOnMap(canvas, scene, view, colour, time, span) {
    const sheet = pen(canvas);
    if (!sheet) return;
    const { context, width, height } = sheet, { road } = scene;
    const scale = Math.min(height / (road.left - road.right + 24), 9, span ? width / (span[1] - span[0]) : 9);
    const s = span ? (span[0] + span[1]) / 2 : at(view.ego, "x", time), share = span ? 0.5 : shareBehind(view, time, width / scale);
    const [x0, y0, level] = onMap(road, s, (road.left + road.right) / 2);
    const [c, n] = [Math.cos(level), Math.sin(level)];
    const px = ([x, y]) => [
      share * width + scale * ((x - x0) * c + (y - y0) * n), height / 2 - scale * ((y - y0) * c - (x - x0) * n),
    ];
    const begin = s - share * width / scale - 30, end = s + (1 - share) * width / scale + 30;
    paintRoad(sheet, road, begin, end, px, scale, { ground: paper.ground, road: paper.road, edge: paper.muted });
    context.fillStyle = paper.muted;
    context.font = `11px ${FONT}`;
    context.textAlign = "center";
    const step = stepOf(scale);
    for (let x = Math.ceil(begin / step) * step; x < end; x += step) {
      const [one, two] = px(onMap(road, x, road.right - 2.6));
      context.fillText(`${x} m`, one, two + 4);
    }
    const car = (t, fill, hollow) => drawBody(context, mapped(road, t), time, px, fill, hollow);
    for (const ghost of scene.ghosts) if (time <= duration(ghost)) car(ghost, COLOURS.ghost, true);
    for (const [name, actor] of present(view, time)) car(actor, touching(view, time) && name === view.contact.other ? paper.contact : COLOURS.actor, false);
    const corners_ = lastBody(context, view, mapped(road, view.ego), px);
    car(view.ego, touching(view, time) ? paper.contact : colour, false);
    const names = namer(context, width);
    for (const [name, t] of [["ego", view.ego], ...present(view, time)]) {
      names.above(name, px(onMap(road, at(t, "x", time), at(t, "y", time))), t.width * scale / 2);
    }
    lastWords(context, corners_, names);
  }

  /** Paint the ground and the road from above.
   *  begin, end: of the stretch that is painted, m along the road. px: pixel of a point of the map. scale: pixels a metre.
   *  colours: of the ground, the road and its edges. */
  function paintRoad({ context, width, height }, road, begin, end, px, scale, colours) {
    const onRoad = ([x, y]) => px(onMap(road, x, y));
    const along = (y) => Array.from({ length: Math.ceil((end - begin) / 2) + 1 }, (_, k) => onRoad([begin + 2 * k, y]));
    const area = (points, colour) => {
      outline(context, points);
      context.fillStyle = colour;
      context.fill();
    };
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, width, height);
    for (const ring of crossingRings(road)) area(ring.map(onRoad), colours.road);
    area([...along(road.left), ...along(road.right).reverse()], colours.road);
    for (const y of [road.left, road.right]) stroke(context, along(y), colours.edge);
    context.setLineDash([3 * scale, 6 * scale]);
    context.lineDashOffset = begin * scale; // dashes stay where they are on the road
    for (let lane = 1; lane < road.lanes; lane++) stroke(context, along(road.right + lane * road.laneWidth), "#fff");
    context.setLineDash([]);
    for (const [x0, x1, y] of road.solid) stroke(context, within([[x0, y], [x1, y]], begin, end).map(onRoad), "#fff"); // no vehicle may cross it
    for (const gone of road.gone) { // where an outermost lane is missing, there is ground, 3 px beyond the road's edge too
      const edge = within(gone.slice(1), begin, end), border = edge.map(onRoad);
      if (edge.length < 2) continue;
      const outer = gone[0][1] + 3 / scale * Math.sign(gone[0][1] - gone[1][1]);
      area([...border, ...edge.map(([x]) => onRoad([x, outer])).reverse()], colours.ground);
      stroke(context, border, colours.edge);
    }
  }

  /** The roads that cross, each as a ring along and across this one; along a bend they keep their width at its line. */
  function crossingRings(road) {
    return road.crossings.map(([x, wide, reach]) => [[x - wide / 2, -reach], [x + wide / 2, -reach], [x + wide / 2, reach], [x - wide / 2, reach]]);
  }

  /** What of a line of points [x, y] lies between two places along the road, a point at every 4 m at most. */
  function within(points, begin, end) {
    const found = [];
    for (let k = 1; k < points.length; k++) {
      const [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
      const [a, b] = [x0, x1].map((x) => Math.min(Math.max(x, begin), end)), parts = Math.max(1, Math.ceil(Math.abs(b - a) / 4));
      if (a === b) continue;
      for (let i = 0; i <= parts; i++) {
        const x = a + (b - a) * i / parts;
        found.push([x, y0 + (y1 - y0) * (x - x0) / (x1 - x0)]);
      }
    }
    return found;
  }

  function pen(canvas, ratio = window.devicePixelRatio || 1) {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (width === 0) return null;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, width, height };
  }

  function stroke(context, points, style) {
    context.beginPath();
    points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.lineWidth = 2;
    context.strokeStyle = style;
    context.stroke();
  }

  function outline(context, points) {
    context.beginPath();
    points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
  }

  const touching = (view, time) => view.contact !== null && time >= view.contact.time - MS;

  /** The last moment at which full braking avoids the contact of a view, s; null where there is none. */
  const lastMoment = (view) => view.contact?.last ?? null;

  /** Share of a sheet's width behind the ego. Once the last moment to brake is over, the sheet shows where the ego was then.
   *  metres: of road along the sheet. */
  function shareBehind(view, time, metres) {
    const last = lastMoment(view), { ego } = view;
    if (last === null || time < last) return 0.3;
    const driven = at(ego, "x", time) - at(ego, "x", last);
    return Math.min(0.7, Math.max(0.3, (driven + ego.length / 2 + 1) / metres)); // 1 m to the edge of the sheet
  }

  /** A broken outline of the ego, of trajectory `t`, at its last moment to brake. Returns its corners on the sheet, px; none
   *  without such a moment. */
  function lastBody(context, view, t, px) {
    const last = lastMoment(view);
    if (last === null) return [];
    const places = corners(t, last).map(px);
    outline(context, places);
    context.setLineDash([4, 3]);
    context.lineWidth = 2;
    context.strokeStyle = paper.contact;
    context.stroke();
    context.setLineDash([]);
    return places;
  }

  /** Names the outline with these corners: behind it, or above it where there is no room. */
  function lastWords(context, places, names) {
    if (!places.length) return;
    const words = "last moment to brake", half = names.halfOf(words);
    const [xs, ys] = [0, 1].map((axis) => places.map((place) => place[axis]));
    const [rear, front] = [Math.min(...xs), Math.max(...xs)], middle = ys.reduce((sum, y) => sum + y, 0) / ys.length;
    if (rear - 5 - 2 * half >= 0) names.write(words, rear - 5 - half, middle + 3, paper.contact);
    else names.write(words, (rear + front) / 2, Math.min(...ys) - 4, paper.contact);
  }

  /** Writes names on a sheet, each on paper of its own, inside the sheet and above the names and bodies that it would cover. */
  function namer(context, width) {
    const taken = []; // boxes [left, right, top, bottom], px
    /** Half the width of a name on its paper, px. */
    const halfOf = (words) => {
      context.font = `600 10px ${FONT}`;
      return context.measureText(words).width / 2 + 2;
    };
    /** centre, base: of the words, px, where they cover nothing. */
    function write(words, centre, base, ink) {
      const half = halfOf(words), x = Math.max(half, Math.min(centre, width - half));
      const boxAt = (y) => [x - half, x + half, y - 9, y + 3];
      let y = base, covered;
      const covers = ([left, right, top, bottom]) => {
        const own = boxAt(y);
        return own[0] < right && own[1] > left && own[2] < bottom && own[3] > top;
      };
      while ((covered = taken.find(covers))) y = covered[2] - 4;
      const [left, right, top, bottom] = boxAt(Math.max(y, 9));
      taken.push([left, right, top, bottom]);
      context.fillStyle = paper.ground;
      context.fillRect(left, top, right - left, bottom - top);
      context.fillStyle = ink;
      context.textAlign = "center";
      context.fillText(words, x, bottom - 3);
    }
    /** Above a body with this centre; side: half its width, px. */
    function above(name, [x, y], side) {
      const half = halfOf(name);
      if (x + half >= 0 && x - half <= width) write(name, x, y - side - 4, paper.ink);
    }
    return { halfOf, write, above, keepFree: (box) => taken.push(box) };
  }

  // --- from above ----------------------------------------------------------------------------------------------------

  /** Between the figures of a scale, m: they stand at least 40 px apart. */
  const stepOf = (scale) => [10, 20, 50, 100, 200].find((step) => step * scale >= 40) ?? 500;

  /** How a case stands at a time, with everybody on the sheet. */
  function still(canvas, scene, view, colour, time) {
    choosePaper();
    named(scene.bodies, view);
    const all = [view.ego, ...view.actors.map(([, actor]) => actor)].map((t) => [at(t, "x", time), t.length / 2]);
    drawTop(canvas, scene, view, colour, time, [Math.min(...all.map(([x, half]) => x - half)) - 8, Math.max(...all.map(([x, half]) => x + half)) + 8]);
  }

  /** How a case stands at a time, near the ego. */
  function moment(canvas, scene, view, colour, time) {
    choosePaper();
    named(scene.bodies, view);
    drawTop(canvas, scene, view, colour, time);
  }

  /** What the others are is said by their scenario, not by their size. */
  function named(bodies, view) {
    for (const [name, actor] of view.actors) actor.kind = (bodies || {})[name] || "car";
  }

  const BESIDE = 6; // m beside the road that are shown where somebody is there

  /** From where to where across the road there is somebody to see, m. */
  function roomOf(road, { actors }) {
    let [low, high] = [road.right, road.left];
    for (const [, { y, width, length }] of actors) {
      const reach = Math.max(width, Math.min(length, 2)) / 2 + 0.3;
      low = Math.min(low, y.reduce((a, b) => Math.min(a, b)) - reach);
      high = Math.max(high, y.reduce((a, b) => Math.max(a, b)) + reach);
    }
    return [Math.max(low, road.right - BESIDE), Math.min(high, road.left + BESIDE)];
  }

  /** span: from where to where along the road, m; without one the sheet goes along with the ego. */
  function drawTop(canvas, scene, view, colour, time, span = null) {
    if (bends(scene.road)) {
      drawTopOnMap(canvas, scene, view, colour, time, span);
      return;
    }
    const sheet = pen(canvas);
    if (!sheet) return;
    const { context, width, height } = sheet, { road } = scene;
    const strip = 24; // px below the road for the scale
    const [low, high] = roomOf(road, view);
    const scale = Math.min((height - strip - 8) / (high - low), 11, span ? width / (span[1] - span[0]) : 11);
    const left = span ? (span[0] + span[1] - width / scale) / 2 : at(view.ego, "x", time) - shareBehind(view, time, width / scale) * width / scale;
    const above = span ? (height - strip - (high - low) * scale) / 2 : 6;
    const px = (x) => (x - left) * scale, py = (y) => above + (high - y) * scale;
    context.fillStyle = paper.ground;
    context.fillRect(0, 0, width, height);
    context.fillStyle = paper.road;
    for (const [x, wide, reach] of road.crossings) context.fillRect(px(x - wide / 2), py(reach), wide * scale, 2 * reach * scale);
    context.fillRect(0, py(road.left), width, (road.left - road.right) * scale);
    const line = (y, style, dash) => {
      context.beginPath();
      context.setLineDash(dash);
      context.lineDashOffset = dash.length ? left * scale : 0;
      context.moveTo(0, py(y));
      context.lineTo(width, py(y));
      context.lineWidth = 2;
      context.strokeStyle = style;
      context.stroke();
      context.setLineDash([]);
    };
    line(road.left, paper.muted, []);
    line(road.right, paper.muted, []);
    for (let lane = 1; lane < road.lanes; lane++) line(road.right + lane * road.laneWidth, "#fff", [3 * scale, 6 * scale]);
    for (const [x0, x1, y] of road.solid) stroke(context, [[px(x0), py(y)], [px(x1), py(y)]], "#fff");
    for (const gone of road.gone) {
      const points = gone.map(([x, y]) => [px(x), py(y)]), outwards = Math.sign(points[0][1] - points[1][1]);
      outline(context, points.map(([x, y], k) => [x, k === 0 || k === 3 ? y + 2 * outwards : y]));
      context.fillStyle = paper.ground;
      context.fill();
      stroke(context, points.slice(1), paper.muted);
    }
    context.fillStyle = paper.muted;
    context.font = `11px ${FONT}`;
    context.textAlign = "center";
    const step = stepOf(scale);
    for (let x = Math.ceil(left / step) * step; px(x) < width; x += step) {
      const words = `${x} m`, half = context.measureText(words).width / 2;
      context.fillRect(px(x), py(low) + 3, 1, 4);
      if (px(x) >= half && px(x) <= width - half) context.fillText(words, px(x), py(low) + 18);
    }
    const names = namer(context, width), onSheet = ([x, y]) => [px(x), py(y)];
    const isWide = (t, name) => 2 * names.halfOf(name) <= t.length * scale - 2 && t.width * scale >= 12;
    const body = (t, fill, name) => drawBody(context, t, time, onSheet, fill, name === null, name !== null && isWide(t, name));
    const vehicles = [["ego", view.ego], ...present(view, time)];
    for (const ghost of scene.ghosts) if (time <= duration(ghost)) body(ghost, COLOURS.ghost, null);
    for (const [name, actor] of vehicles.slice(1)) body(actor, COLOURS.actor, name);
    const places = lastBody(context, view, view.ego, onSheet);
    body(view.ego, colour, "ego");
    // Names come after the bodies, which would cover them. First those that stand on a body, then those above one.
    const [on, over] = [true, false].map((wide) => vehicles.filter(([name, t]) => isWide(t, name) === wide));
    context.textAlign = "center";
    context.fillStyle = "#fff";
    for (const [name, t] of on) {
      const half = names.halfOf(name), [x, y] = onSheet([at(t, "x", time), at(t, "y", time)]), side = t.width * scale / 2;
      context.fillText(name, x, y + 3.5);
      names.keepFree([x - half, x + half, y - side, y + side]);
    }
    for (const [name, t] of over) names.above(name, onSheet([at(t, "x", time), at(t, "y", time)]), t.width * scale / 2);
    lastWords(context, places, names);
    if (!touching(view, time)) return;
    const hit = view.actors.find(([name]) => name === view.contact.other);
    for (const t of [view.ego, ...(hit ? [hit[1]] : [])]) {
      outline(context, corners(t, time).map(([x, y]) => [px(x), py(y)]));
      context.lineWidth = 3;
      context.strokeStyle = paper.contact;
      context.stroke();
    }
  }

  // --- chase view ----------------------------------------------------------------------------------------------------

  const NEAR = 0.4; // m in front of the camera; nearer than that nothing is drawn
  const CAMERA = { behind: 10.5, above: 3.9, pitch: 0.16 };

  /** Camera coordinates (right, up, depth) of a point of the world, m. */
  function seen(camera, [x, y, z]) {
    const [dx, dy, dz] = [x - camera.x, y - camera.y, z - camera.z];
    const [c, s, cp, sp] = [Math.cos(camera.heading), Math.sin(camera.heading), Math.cos(CAMERA.pitch), Math.sin(CAMERA.pitch)];
    const along = dx * c + dy * s;
    return [dx * s - dy * c, along * sp + dz * cp, along * cp - dz * sp];
  }

  /** A polygon in camera coordinates, cut off at the near plane. */
  function clipped(points) {
    const kept = [];
    points.forEach((point, k) => {
      const next = points[(k + 1) % points.length], inside = point[2] >= NEAR;
      if (inside) kept.push(point);
      if (inside !== next[2] >= NEAR) {
        const share = (NEAR - point[2]) / (next[2] - point[2]);
        kept.push(point.map((value, axis) => value + share * (next[axis] - value)));
      }
    });
    return kept;
  }

  function box(t, time, [rear, front], [bottom, top], wide, narrow) {
    const [x, y, heading] = ["x", "y", "heading"].map((channel) => at(t, channel, time));
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const corner = (a, b, z) => [x + a * c - b * s, y + a * s + b * c, z];
    const ring = (z, inset, share) => [[front - inset, 1], [front - inset, -1], [rear + inset, -1], [rear + inset, 1]]
      .map(([a, side]) => corner(a, side * share * t.width / 2, z));
    const low = ring(bottom, 0, wide), high = ring(top, narrow < wide ? 0.35 : 0, narrow);
    const sides = [0, 1, 2, 3].map((k) => [low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]]);
    return { sides: [...sides, high], shades: [0.82, 0.7, 0.92, 0.7, 1.08] };
  }

  function shaded(colour, factor) {
    const parts = [1, 3, 5].map((start) => Math.min(255, Math.round(parseInt(colour.slice(start, start + 2), 16) * factor)));
    return `rgb(${parts.join(",")})`;
  }

  const FINE = { part: 4, dashes: 160, posts: 250, edges: true }; // m: a piece of a bend; how far markings and posts are drawn
  const COARSE = { part: 10, dashes: 80, posts: 100, edges: false };

  /** The road in perspective. ratio: pixels of the canvas for one of the page. coarse: with fewer and larger pieces. */
  function drawChase(canvas, scene, view, colour, time, { ratio, coarse = false } = {}) {
    const sheet = pen(canvas, ratio), detail = coarse ? COARSE : FINE;
    if (!sheet) return;
    const { context, width, height } = sheet, { road } = scene;
    const me = mapped(road, view.ego), heading = at(me, "heading", time);
    const camera = {
      x: at(me, "x", time) - CAMERA.behind * Math.cos(heading), y: at(me, "y", time) - CAMERA.behind * Math.sin(heading),
      z: CAMERA.above, heading,
    };
    const focal = 0.95 * Math.max(height, width / 2), middle = [width / 2, 0.42 * height];
    const screen = ([right, up, depth]) => [middle[0] + focal * right / depth, middle[1] - focal * up / depth];
    const face = (points, fill, stroke = null) => {
      const cut = clipped(points.map((point) => seen(camera, point)));
      if (cut.length < 3) return;
      outline(context, cut.map(screen));
      context.fillStyle = fill;
      context.fill();
      if (!stroke || !detail.edges) return;
      context.lineWidth = 1;
      context.strokeStyle = stroke;
      context.stroke();
    };
    const horizon = middle[1] - focal * Math.tan(CAMERA.pitch);
    context.fillStyle = "#dbe8f2";
    context.fillRect(0, 0, width, height);
    context.fillStyle = "#c9d3c2";
    context.fillRect(0, Math.max(0, horizon), width, height);
    const from = bends(road) ? at(view.ego, "x", time) - CAMERA.behind : camera.x;
    const begin = from - 5, end = from + (bends(road) ? 250 : 400);
    const ground = (x, y, z = 0) => [...onMap(road, x, y).slice(0, 2), z];
    const flat = (x0, x1, y0, y1, fill) => {
      const parts = bends(road) ? Math.ceil((x1 - x0) / detail.part) : 1, lap = parts > 1 ? 0.2 : 0; // m, or seams are seen
      for (let k = 0; k < parts; k++) {
        const [a, b] = [x0 + (x1 - x0) * k / parts, x0 + (x1 - x0) * (k + 1) / parts];
        face([ground(a, y0), ground(b + lap, y0), ground(b + lap, y1), ground(a, y1)], fill);
      }
    };
    for (const [x, wide, reach] of road.crossings) flat(x - wide / 2, x + wide / 2, -reach, reach, "#9aa1a8");
    flat(begin, end, road.right, road.left, "#9aa1a8");
    for (const y of [road.right, road.left]) flat(begin, end, y - 0.07, y + 0.07, "#fff");
    for (let lane = 1; lane < road.lanes; lane++) {
      const y = road.right + lane * road.laneWidth;
      for (let x = Math.floor(begin / 9) * 9; x < from + detail.dashes; x += 9) flat(x, x + 3, y - 0.06, y + 0.06, "#fff");
    }
    for (const [x0, x1, y] of road.solid) flat(Math.max(x0, begin), Math.min(x1, end), y - 0.06, y + 0.06, "#fff");
    for (const gone of road.gone) {
      const outer = gone[0][1] + 0.1 * Math.sign(gone[0][1] - gone[1][1]), edge = within(gone.slice(1), begin, end);
      for (let k = 1; k < edge.length; k++) {
        const [[a, y0], [b, y1]] = [edge[k - 1], edge[k]];
        if (a !== b) face([ground(a, y0), ground(b, y1), ground(b, outer), ground(a, outer)], "#c9d3c2");
      }
    }
    for (let x = Math.ceil(begin / 50) * 50; x < from + detail.posts; x += 50) { // posts every 50 m give the eye a speed
      for (const y of [road.right - 1, road.left + 1]) face([[y - 0.06, 0], [y + 0.06, 0], [y + 0.06, 1], [y - 0.06, 1]].map(([across, up]) => ground(x, across, up)), "#f5f7f9", "#57606a");
    }
    const vehicles = [[me, colour, true], ...present(view, time).map(([name, actor]) => [mapped(road, actor), touching(view, time) && name === view.contact.other ? COLOURS.contact : COLOURS.actor, false])]
      .map((entry) => [...entry, seen(camera, [at(entry[0], "x", time), at(entry[0], "y", time), 0])[2]])
      .filter(([, , , depth]) => depth > -10 && depth < 320).sort((one, other) => other[3] - one[3]);
    for (const [t, fill] of vehicles) drawCar(t, fill);
    if (touching(view, time)) {
      context.lineWidth = 6;
      context.strokeStyle = COLOURS.contact;
      context.strokeRect(3, 3, width - 6, height - 6);
    }

    function drawCar(t, fill) {
      const half = t.length / 2, kind = kindOf(t);
      face(corners(t, time).map(([x, y]) => [x, y, 0.02]), "rgba(27,31,36,0.35)");
      const tall = { truck: 3.6, van: 2.4 }[kind];
      const child = t.kind ? t.kind === "child" : t.length < 0.21; // as scenario/bodies.py has it
      const top = child ? 1.15 : 1.75;
      const parts = kind === "person" ? [
        [box(t, time, [-0.14, 0.14], [0, 0.82 * top], 1, 0.9), fill],
        [box(t, time, [-0.1, 0.1], [0.84 * top, top], 0.42, 0.36), "#e8b48c"],
      ] : kind === "bicycle" || kind === "motorcycle" ? [
        [box(t, time, [-half, half], [0.1, 0.75], kind === "bicycle" ? 0.15 : 0.45, 0.15), "#33414d"],
        [box(t, time, [-0.3, 0.15], [0.75, 1.5], 0.75, 0.6), fill],
        [box(t, time, [-0.1, 0.1], [1.52, 1.78], 0.3, 0.26), "#e8b48c"],
      ] : tall ? [
        [box(t, time, [-half, half - (kind === "truck" ? 2.3 : 1.2)], [0.5, tall], 1, 1), fill],
        [box(t, time, [half - (kind === "truck" ? 2.1 : 1.2), half], [0.4, 0.75 * tall], 0.98, 0.9), "#33414d"],
      ] : [
        [box(t, time, [-half, half], [0.25, 0.85], 1, 1), fill],
        [box(t, time, [-0.42 * t.length, 0.2 * t.length], [0.85, 1.42], 0.94, 0.78), "#33414d"],
      ];
      for (const [part, paint] of parts) {
        part.sides.map((side, k) => [side, k, side.reduce((sum, point) => sum + seen(camera, point)[2], 0)])
          .sort((one, other) => other[2] - one[2])
          .forEach(([side, k]) => face(side, shaded(k === 4 && paint === "#33414d" ? fill : paint, part.shades[k]), "rgba(27,31,36,0.5)"));
      }
      if (kind !== "car" && !tall) return; // no brake lights
      const lit = at(t, "acceleration", time) < BRAKING;
      const lower = parts[0][0], rear = lower.sides[2], mix = (a, b, share) => a.map((value, axis) => value + share * (b[axis] - value));
      const patch = (from, to) => [[from, 0.5], [to, 0.5], [to, 0.85], [from, 0.85]]
        .map(([across, up]) => mix(mix(rear[0], rear[1], across), mix(rear[3], rear[2], across), up));
      const toward = seen(camera, rear[0])[2] < seen(camera, lower.sides[0][0])[2];
      if (toward) for (const [from, to] of [[0.04, 0.22], [0.78, 0.96]]) face(patch(from, to), lit ? "#ff2a1a" : "#7a1f1a");
    }
  }

  // --- in three dimensions -------------------------------------------------------------------------------------------

  const CAMERAS = ["behind", "above", "seat", "free"];

  /** From where to where along the road the recordings of a scene go, m, with what can be seen from there. */
  function extentOf(scene) {
    const all = scene.views.flatMap((view) => [view.ego, ...view.actors.map(([, actor]) => actor)]);
    return [Math.min(...all.map((t) => Math.min(...t.x))) - 300, Math.max(...all.map((t) => Math.max(...t.x))) + 600];
  }

  /** A body of a scene at a time, as `sumoScene` draws it. */
  function bodyAt(scene, t, name, time, colour, more = {}) {
    const it = mapped(scene.road, t), held = Math.min(time, duration(t));
    return {
      x: at(it, "x", held), y: at(it, "y", held), heading: at(it, "heading", held), length: t.length, width: t.width,
      kind: (scene.bodies || {})[name] || (name === "ego" ? kindOf(t) : "car"), colour, brakes: at(t, "acceleration", held) < BRAKING, ...more,
    };
  }

  /** Draw the view of a scene on a canvas of `sumoScene`; through it, as ghosts, another view where one is given. */
  function drawSpace(space, scene, view, colour, time, mode, ghost, sharp) {
    space.onRoad(scene.road, onMap, scene.extent);
    const held = Math.min(time, duration(view.ego)), hit = touching(view, held);
    const me = bodyAt(scene, view.ego, "ego", held, colour, { me: true });
    const others = present(view, held).map(([name, actor]) => [name, bodyAt(scene, actor, name, held, COLOURS.actor)]);
    const vehicles = [me, ...others.map(([, body]) => body)];
    if (ghost) {
      const then = Math.min(time, duration(ghost.ego));
      vehicles.push(bodyAt(scene, ghost.ego, "ego", then, ghost.colour, { alpha: 0.5 }));
      for (const [name, actor] of ghost.actors) {
        const own = view.actors.find(([other]) => other === name), body = bodyAt(scene, actor, name, then, COLOURS.actor, { alpha: 0.35 });
        if (there(actor, then) && (!own || Math.hypot(at(own[1], "x", held) - at(actor, "x", then), at(own[1], "y", held) - at(actor, "y", then)) > 0.05)) vehicles.push(body);
      }
    }
    const struck = hit ? others.filter(([name]) => name === view.contact.other).map(([, body]) => body) : [];
    const moving = (t, body) => {
      const speed = at(t, "speed", held);
      return { ...body, vx: speed * Math.cos(body.heading), vy: speed * Math.sin(body.heading) };
    };
    const contact = hit ? [moving(view.ego, me), ...struck.map((body) => moving(view.actors.find(([name]) => name === view.contact.other)[1], body))] : null;
    return space.draw({ vehicles, contact, camera: { mode, about: me }, sharp });
  }

  // --- charts over time ----------------------------------------------------------------------------------------------

  const CHARTS = [
    { title: "speed, m/s", of: (view) => view.ego.speed, low: 0 },
    { title: `TTC, s (up to ${MOST_TTC})`, of: (view) => view.ahead.ttc, low: 0, high: MOST_TTC },
    { title: "acceleration, m/s²", of: (view) => view.ego.acceleration },
    { title: "steering wheel, °", of: (view) => view.ego.steering_wheel_angle.map((angle) => angle * 180 / Math.PI) },
  ];

  /** A sheet like that of a canvas, whose strokes become SVG: what a chart needs of one, and no more. */
  function svgSheet(width, height) {
    const parts = [], numbers = (...values) => values.map((value) => value.toFixed(1)).join(" ");
    let path = "", dash = [], box = null;
    const context = {
      beginPath: () => { path = ""; },
      moveTo: (x, y) => { path += `M${numbers(x, y)}`; },
      lineTo: (x, y) => { path += `L${numbers(x, y)}`; },
      setLineDash: (lengths) => { dash = lengths; },
      stroke: () => parts.push(`<path d="${path}" fill="none" stroke="${context.strokeStyle}" stroke-width="${context.lineWidth}" stroke-dasharray="${dash.join(" ")}"/>`),
      fillRect: (x, y, wide, tall) => parts.push(`<rect x="${x}" y="${y}" width="${wide}" height="${tall}" fill="${context.fillStyle}"/>`),
      fillText: (text, x, y) => {
        const anchor = { left: "start", center: "middle", right: "end" }[context.textAlign];
        parts.push(`<text x="${x}" y="${y}" fill="${context.fillStyle}" font-size="11" font-family="${FONT}" text-anchor="${anchor}">${text}</text>`);
      },
      rect: (x, y, wide, tall) => { box = `<rect x="${x}" y="${y}" width="${wide}" height="${tall}"/>`; },
      clip: () => parts.push(`<clipPath id="inside">${box}</clipPath><g clip-path="url(#inside)">`),
      save: () => {},
      restore: () => parts.push("</g>"),
    };
    const text = () => `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">${parts.join("")}</svg>`;
    return { context, width, height, text };
  }

  /** What a chart shows, as rows: the ADS, the time, the value. */
  const chartRows = (chart, scene) => [["ads", "time, s", chart.title], ...scene.views.flatMap((view) => {
    const values = chart.of(view);
    return Array.from(values, (value, k) => [view.name, (view.ego.time[k] - view.ego.time[0]).toFixed(3), Number.isFinite(value) ? value : ""]);
  })];

  function drawChart(sheet, chart, scene, time, whole) {
    if (!sheet) return;
    const { context, width, height } = sheet, [left, right, top, bottom] = [40, width - 8, 20, height - 18];
    const series = scene.views.map((view) => chart.of(view));
    const known = series.flatMap((values) => Array.from(values)).filter((value) => Number.isFinite(value));
    const low = chart.low ?? Math.min(-0.5, ...known), high = chart.high ?? Math.max(low + 1, ...known);
    const px = (t) => left + (right - left) * t / whole, py = (value) => bottom - (bottom - top) * (value - low) / (high - low);
    context.font = `11px ${FONT}`;
    context.fillStyle = paper.ink;
    context.textAlign = "left";
    context.fillText(chart.title, left, 12);
    context.fillStyle = paper.muted;
    context.strokeStyle = paper.hair;
    context.lineWidth = 1;
    const digits = high - low < 5 ? 1 : 0;
    for (const value of [low, (low + high) / 2, high]) {
      context.textAlign = "right";
      context.fillText(value.toFixed(digits), left - 5, py(value) + 4);
      context.beginPath();
      context.moveTo(left, py(value));
      context.lineTo(right, py(value));
      context.stroke();
    }
    context.textAlign = "center";
    for (let k = 0; k <= 4; k++) context.fillText(`${(whole * k / 4).toFixed(1)} s`, Math.min(px(whole * k / 4), right - 10), height - 4);
    context.save();
    context.beginPath();
    context.rect(left, top - 2, right - left, bottom - top + 4);
    context.clip();
    series.forEach((values, which) => {
      const { ego, contact } = scene.views[which];
      context.beginPath();
      let drawing = false;
      for (let k = 0; k < values.length; k++) {
        if (!Number.isFinite(values[k])) { drawing = false; continue; }
        const place = [px(ego.time[k] - ego.time[0]), py(values[k])];
        if (drawing) context.lineTo(...place); else context.moveTo(...place);
        drawing = true;
      }
      context.lineWidth = 2;
      context.setLineDash(which ? [6, 3] : []);
      context.strokeStyle = paper.lines[which];
      context.stroke();
      context.setLineDash([]);
      if (!contact) return;
      context.fillStyle = context.strokeStyle = paper.contact;
      context.fillRect(px(contact.time) - 1, top, 2, bottom - top);
      const last = lastMoment(scene.views[which]);
      if (last === null) return;
      context.beginPath();
      context.moveTo(px(last), top);
      context.lineTo(px(last), bottom);
      context.setLineDash([4, 3]);
      context.stroke();
      context.setLineDash([]);
    });
    context.restore();
    if (!known.length) {
      context.textAlign = "center";
      context.fillText("not known in this case", (left + right) / 2, (top + bottom) / 2);
    }
    context.fillStyle = paper.ink;
    context.fillRect(px(Math.min(time, whole)) - 0.5, top - 4, 1, bottom - top + 4);
  }

  // --- the player ----------------------------------------------------------------------------------------------------

  const element = (tag, className, text) => {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  };

  const fixed = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)} ${unit}` : "–");

  function reading(view, time) {
    const { ego } = view, over = time > duration(ego) + 1e-9;
    const held = { ...view.ahead, time: ego.time };
    const k = nearestSample(ego, time);
    const words = [
      `v ${fixed(at(ego, "speed", time), 1, "m/s")}`, `a ${fixed(at(ego, "acceleration", time), 1, "m/s²")}`,
      `steering ${fixed(ego.steering_wheel_angle[k] * 180 / Math.PI, 0, "°")}`, `gap ${fixed(held.gap[k], 1, "m")}`,
      `TTC ${held.ttc[k] === Infinity ? "not closing" : fixed(held.ttc[k], 1, "s")}`,
    ];
    const last = lastMoment(view);
    if (last !== null) words.push(time < last - MS ? `full braking avoids the contact until ${last.toFixed(2)} s` : time > last + MS ? `too late to brake since ${last.toFixed(2)} s` : "last moment to brake");
    if (touching(view, time)) words.push(`contact at t = ${view.contact.time.toFixed(2)} s, ${view.contact.speed.toFixed(1)} m/s`);
    else if (over) words.push("recording over");
    return words.join(" · ");
  }

  function nearestSample(ego, time) {
    const wanted = time + ego.time[0];
    let k = 0;
    while (k + 1 < ego.time.length && ego.time[k + 1] <= wanted + MS) k++;
    return k;
  }

  /** A player in `root`. show(scene): scene { road, views: [{ name, ego, actors: [[name, trajectory]], contact }], ghosts }.
   *  contact: { time, other, side, speed, last: the last moment to brake } or null. A trajectory has the channels that the page's data name. */
  function player(root) {
    const views = element("div", "replay-views");
    const controls = element("div", "player");
    const button = element("button", "replay-play", "Play");
    const hit = element("button", "replay-contact", "Contact"), brake = element("button", "replay-last", "Last moment to brake");
    brake.title = "The last moment at which full braking avoids the contact";
    const slider = element("input", "replay-slider"), track = element("span", "replay-track");
    track.append(slider);
    const clock = element("output", "replay-clock");
    const speed = element("select", "replay-speed");
    button.type = hit.type = brake.type = "button";
    Object.assign(slider, { type: "range", min: 0, max: 1, step: "any", value: 0 });
    slider.setAttribute("aria-label", "Time of the replay, s");
    speed.setAttribute("aria-label", "Speed of the replay");
    speed.append(...SPEEDS.map((factor) => new Option(`${factor}×`, factor, factor === 1, factor === 1)));
    const camera = element("select", "replay-camera");
    camera.setAttribute("aria-label", "Camera");
    camera.append(...CAMERAS.map((mode) => new Option(mode === "seat" ? "driver's seat" : mode, mode)));
    const ghosted = element("label", "replay-ghosted", "one into the other ");
    const together = element("input");
    together.type = "checkbox";
    ghosted.append(together);
    controls.append(button, track, clock, speed, camera, ghosted, brake, hit);
    const charts = element("div", "replay-charts");
    const canvases = CHARTS.map((chart) => {
      const canvas = element("canvas", "replay-chart");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${chart.title} over time`);
      const held = element("div", "replay-held");
      if (typeof sumoPage !== "undefined") {
        held.append(sumoPage.saver(`${chart.title} over time`, () => {
          const sheet = svgSheet(canvas.clientWidth, canvas.clientHeight);
          drawChart(sheet, chart, scene, now, whole);
          return sheet.text();
        }, () => chartRows(chart, scene)));
      }
      held.append(canvas);
      charts.append(held);
      return canvas;
    });
    root.replaceChildren(views, controls, charts);
    let scene = null, panes = [], frame = null, now = 0, whole = 1, settled = null;
    const chases = []; // a canvas for each view, once and for all: a browser gives a page few contexts

    /** The canvas of the view in place k, and what draws in it in three dimensions; null: the plain drawing does. */
    function chaseOf(k) {
      if (!chases[k]) {
        let chase = element("canvas", "replay-chase");
        const space = typeof sumoScene === "undefined" ? null : sumoScene.create(chase, { keep: true });
        if (!space) chase = element("canvas", "replay-chase");
        chase.setAttribute("role", "img");
        chases[k] = { chase, space };
        if (space) {
          space.steerable(() => camera.value === "free", () => draw());
          chase.addEventListener("scene-restored", () => draw());
        }
      }
      return chases[k];
    }

    function show(next) {
      stop();
      scene = next;
      for (const view of scene.views) view.ahead = ahead(view.ego, view.actors, view.contact, scene.road);
      panes = scene.views.map((view, which) => {
        const pane = element("figure", "replay-view");
        const title = element("figcaption", "", view.name);
        title.style.color = COLOURS.views[which];
        const { chase, space } = chaseOf(which), top = element("canvas", "replay-top");
        chase.setAttribute("aria-label", `${view.name} on the road in perspective`);
        top.setAttribute("role", "img");
        top.setAttribute("aria-label", `${view.name} and the other vehicles on the road from above, to scale`);
        const words = element("p", "replay-reading");
        pane.append(title, chase, top, words);
        return { pane, chase, space, top, words, view, colour: COLOURS.views[which] };
      });
      for (const view of scene.views) named(scene.bodies, view);
      scene.extent = extentOf(scene);
      camera.hidden = !panes[0].space;
      ghosted.hidden = !panes[0].space || panes.length < 2;
      views.replaceChildren(...panes.map(({ pane }) => pane));
      whole = Math.max(...scene.views.map((view) => duration(view.ego))) || 1;
      slider.max = whole;
      hit.hidden = !scene.views.some((view) => view.contact);
      brake.hidden = !scene.views.some((view) => lastMoment(view) !== null);
      track.replaceChildren(slider, ...scene.views.flatMap(({ contact }) => (contact ? [[contact.last, "replay-mark last"], [contact.time, "replay-mark"]] : []))
        .filter(([time]) => Number.isFinite(time)).map(([time, name]) => {
          const mark = element("i", name);
          mark.style.setProperty("--at", time / whole);
          return mark;
        }));
      seek(scene.views[0].contact ? scene.views[0].contact.time : 0);
    }

    function seek(time) {
      now = time;
      slider.value = time;
      draw();
    }

    /** sharp: the three-dimensional pictures with all pixels, as they are drawn once nothing has moved for a while. */
    function draw(sharp = false) {
      clearTimeout(settled);
      if (!scene) return;
      if (!sharp && frame === null && panes.some(({ space }) => space)) settled = setTimeout(() => draw(frame === null), SETTLES);
      choosePaper();
      const time = now;
      const one = !ghosted.hidden && together.checked;
      panes.forEach(({ chase, space, top, words, view, colour }, which) => {
        const held = Math.min(time, duration(view.ego));
        chase.hidden = one && which > 0;
        if (!space) drawChase(chase, scene, view, colour, held);
        else if (!chase.hidden) drawSpace(space, scene, view, colour, time, camera.value, one ? { ...panes[1].view, colour: panes[1].colour } : null, sharp);
        drawTop(top, scene, view, colour, held);
        words.textContent = reading(view, time);
      });
      CHARTS.forEach((chart, k) => drawChart(pen(canvases[k]), chart, scene, time, whole));
      clock.textContent = `${time.toFixed(1)} s`;
    }

    function stop() {
      if (frame !== null) cancelAnimationFrame(frame);
      frame = null;
      button.textContent = "Play";
    }

    function rest() {
      stop();
      draw();
    }

    function play() {
      if (frame !== null) return rest();
      let time = now >= whole - MS ? 0 : now, before = null; // a contact ends a recording, whose times are rounded
      button.textContent = "Pause";
      const tick = (clock) => {
        const busy = panes.some(({ space }) => space && space.busy()); // drawing on would only queue up
        if (before !== null || !busy) { // time passes from the first picture on
          time += (clock - (before ?? clock)) / 1000 * Number(speed.value);
          before = clock;
        }
        if (time < whole && busy) {
          frame = requestAnimationFrame(tick);
          return undefined;
        }
        for (const { space } of panes) if (space) space.pace(clock / 1000);
        seek(Math.min(time, whole));
        if (time >= whole) return rest();
        frame = requestAnimationFrame(tick);
        return undefined;
      };
      frame = requestAnimationFrame(tick);
      return undefined;
    }

    button.addEventListener("click", play);
    document.addEventListener("keydown", (event) => { // the space key, wherever it has no meaning of its own
      const own = event.target.closest?.("button, select, textarea, summary, a[href], input:not([type=range])");
      const { top, bottom } = root.getBoundingClientRect();
      if (event.key !== " " || own || !scene || !root.getClientRects().length || bottom < 0 || top > innerHeight) return;
      event.preventDefault();
      play();
    });
    hit.addEventListener("click", () => { stop(); seek(scene.views.find((view) => view.contact).contact.time); });
    brake.addEventListener("click", () => { stop(); seek(scene.views.map(lastMoment).find((last) => last !== null)); });
    slider.addEventListener("input", () => { stop(); now = Number(slider.value); draw(); });
    for (const [what, name] of [[camera, "change"], [together, "change"], ...["resize", "beforeprint", "afterprint"].map((it) => [window, it])]) what.addEventListener(name, () => draw());
    if (typeof sumoPage !== "undefined") sumoPage.onTheme(() => draw());
    return { show, stop, draw };
  }

  return {
    player, ahead, speedAlong, gapTo, at, onMap, pen, paintRoad, drawChase, drawBody, CAMERAS, still, moment, named, mapped, bends, within, crossingRings, roomOf, bodyParts, bodyAt,
  };
})();

if (typeof module !== "undefined") module.exports = sumoReplay;
