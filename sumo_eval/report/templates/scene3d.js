// The road and who is on it in three dimensions: WebGL2, one canvas, no library. Used by the replay and by driving.
// Metres, x and y on the map, z up; headings rad, counter-clockwise from x.
"use strict";

const sumoScene = (() => {
  const SKY = [0.80, 0.88, 0.95], GRASS = [0.62, 0.69, 0.55], ASPHALT = [0.42, 0.44, 0.47], SHOULDER = [0.50, 0.52, 0.53];
  const WHITE = [0.96, 0.97, 0.98], BLACK = [0.10, 0.11, 0.13], GLASS = [0.15, 0.20, 0.25], RED = [0.78, 0.16, 0.16];
  const CLOTH = [0.22, 0.27, 0.36], SKIN = [0.80, 0.62, 0.50];
  const COAT = 1, LAMP = 2, GROUND = 3; // what a vertex takes its colour from beside its own: the vehicle's, its brake lamps
  const FLOATS = 10; // of a vertex: place, normal, colour, kind
  const DASH = 3, GAP = 6, POSTS = 50; // m
  const PIECE = 200; // m of road, whose posts and trees are one mesh
  const PIECE_RADIUS = 190, SIGHT = 900; // m, of a piece around its middle; from where the fog leaves 3 % of what stands there
  const FAR = 1500, NEAR = 0.25; // m from the camera, between which bodies are drawn
  const SLOW_FRAME = 1 / 38, QUICK_FRAME = 1 / 57; // s a picture, above which the resolution falls, below which it rises
  const BETWEEN_CHANGES = 15; // pictures between two changes of the resolution,
  const LEAST_BETWEEN = 4, CHANGE_AFTER = 1.5; // or at least 4 once 1.5 s have passed
  const PAUSE = 0.5; // s without a picture that may be a pause
  const LEAST_RATIO = 0.35, MOST_RATIO = 2;

  const VERTEX = `#version 300 es
    layout(location = 0) in vec3 place;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in vec3 colour;
    layout(location = 3) in float kind;
    uniform mat4 camera;
    uniform vec4 pose;   // x, y, cos and sin of the heading
    uniform vec3 size;
    uniform vec3 coat;
    uniform float lit;
    out vec3 world;
    out vec3 up;
    out vec3 shade;
    out float glow;
    out float ground;
    void main() {
      vec3 p = place * size;
      world = vec3(pose.x + pose.z * p.x - pose.w * p.y, pose.y + pose.w * p.x + pose.z * p.y, p.z);
      up = vec3(pose.z * normal.x - pose.w * normal.y, pose.w * normal.x + pose.z * normal.y, normal.z);
      shade = kind == ${COAT}.0 ? coat * colour : (kind == ${LAMP}.0 ? mix(colour, vec3(1.0, 0.12, 0.06), lit) : colour);
      glow = kind == ${LAMP}.0 ? lit : 0.0;
      ground = kind == ${GROUND}.0 ? 1.0 : 0.0;
      gl_Position = camera * vec4(world, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 world;
    in vec3 up;
    in vec3 shade;
    in float glow;
    in float ground;
    uniform vec3 eye;
    uniform float alpha;
    uniform float flatly;
    out vec4 seen;
    void main() {
      float away = distance(world, eye);
      vec3 n = normalize(up);
      float light = mix(0.52 + 0.38 * max(dot(n, normalize(vec3(0.35, -0.45, 0.82))), 0.0) + 0.14 * n.z, 1.0, flatly);
      vec3 c = shade;
      if (ground > 0.5) { // patches give the eye a speed; far away they would only flicker
        vec2 patch_ = step(vec2(0.5), fract(world.xy / 24.0));
        c *= 1.0 + 0.06 * (abs(patch_.x - patch_.y) - 0.5) * exp(-away / 90.0);
      }
      light = mix(light, 1.15, glow);
      float fog = 1.0 - exp(-pow(away / 420.0, 1.6));
      seen = vec4(mix(c * light, vec3(${SKY.join(", ")}), fog), alpha);
    }`;

  // --- meshes: arrays of vertices, flat faces ------------------------------------------------------------------------

  class Mesh {
    constructor() { this.data = []; }

    triangle(a, b, c, colour, kind = 0) {
      const u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const size = Math.hypot(...n) || 1;
      for (const p of [a, b, c]) this.data.push(p[0], p[1], p[2], n[0] / size, n[1] / size, n[2] / size, colour[0], colour[1], colour[2], kind);
    }

    /** A flat face, corners counter-clockwise seen from outside. */
    face(corners, colour, kind = 0) {
      for (let k = 2; k < corners.length; k++) this.triangle(corners[0], corners[k - 1], corners[k], colour, kind);
    }

    /** A box between two corners; its top may be smaller: [x0, x1, y0, y1] there. */
    box([x0, y0, z0], [x1, y1, z1], colour, kind = 0, top = [x0, x1, y0, y1], roof = null) {
      const [u0, u1, v0, v1] = top;
      const low = [[x0, y0, z0], [x1, y0, z0], [x1, y1, z0], [x0, y1, z0]], high = [[u0, v0, z1], [u1, v0, z1], [u1, v1, z1], [u0, v1, z1]];
      for (let k = 0; k < 4; k++) this.face([low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]], colour, kind);
      this.face(high, roof ? roof[0] : colour, roof ? roof[1] : kind);
    }

    /** A side view [[x, z], ...], clockwise from the lower rear, made as wide as y0 to y1. */
    profile(points, y0, y1, colour, kind = 0) {
      this.face(points.map(([x, z]) => [x, y1, z]), colour, kind);
      this.face(points.map(([x, z]) => [x, y0, z]).reverse(), colour, kind);
      points.forEach(([x, z], k) => {
        const [a, c] = points[(k + 1) % points.length];
        this.face([[x, y0, z], [a, y0, c], [a, y1, c], [x, y1, z]], colour, kind);
      });
    }

    wheel(x, y, radius, width, sides = 14) {
      const ring = Array.from({ length: sides }, (_, k) => [x + radius * Math.cos(2 * Math.PI * k / sides), radius + radius * Math.sin(2 * Math.PI * k / sides)]);
      const [y0, y1] = [y - width / 2, y + width / 2];
      ring.forEach(([a, c], k) => {
        const [b, d] = ring[(k + 1) % sides];
        this.face([[a, y1, c], [b, y1, d], [b, y0, d], [a, y0, c]], BLACK);
      });
      this.face(ring.map(([a, c]) => [a, y0, c]), BLACK);
      this.face(ring.map(([a, c]) => [a, y1, c]).reverse(), BLACK);
      const hub = (side, order) => this.face(order(ring.map(([a, c]) => [x + (a - x) * 0.55, side, radius + (c - radius) * 0.55])), [0.62, 0.64, 0.67]);
      hub(y0 - 0.005, (it) => it);
      hub(y1 + 0.005, (it) => it.reverse());
    }

    /** A round body of a given radius, and as high as is said. */
    ball([x, y, z], radius, colour, height = radius) {
      const at = (i, j) => {
        const a = Math.PI * i / 4 - Math.PI / 2, b = Math.PI * j / 4;
        return [x + radius * Math.cos(a) * Math.cos(b), y + radius * Math.cos(a) * Math.sin(b), z + height * Math.sin(a)];
      };
      for (let i = 0; i < 4; i++) for (let j = 0; j < 8; j++) this.face([at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)], colour);
    }
  }

  function lamps(mesh, rear, half, low, high) {
    for (const [from, to] of [[-0.96, -0.62], [0.62, 0.96]]) {
      const x = rear - 0.01;
      mesh.face([[x, from * half, low], [x, from * half, high], [x, to * half, high], [x, to * half, low]], [0.42, 0.09, 0.08], LAMP);
    }
  }

  function headlights(mesh, front, half, low, high) {
    for (const [from, to] of [[-0.94, -0.62], [0.62, 0.94]]) {
      const x = front + 0.01;
      mesh.face([[x, from * half, low], [x, to * half, low], [x, to * half, high], [x, from * half, high]], WHITE);
    }
  }

  const OWN = [1, 1, 1]; // times the coat

  function car(mesh, cabin = true) {
    mesh.profile([[-2.25, 0.26], [-2.25, 0.78], [-2.1, 0.92], [0.75, 0.92], [1.95, 0.76], [2.25, 0.62], [2.25, 0.26]], -0.9, 0.9, OWN, COAT);
    lamps(mesh, -2.25, 0.9, 0.6, 0.77);
    headlights(mesh, 2.25, 0.9, 0.48, 0.61);
    for (const x of [-1.38, 1.38]) for (const y of [-0.8, 0.8]) mesh.wheel(x, y, 0.33, 0.22);
    if (cabin) mesh.box([-2.0, -0.83, 0.92], [0.95, 0.83, 1.44], GLASS, 0, [-1.35, 0.2, -0.64, 0.64], [OWN, COAT]);
  }

  function van(mesh) {
    mesh.profile([[-3.25, 0.35], [-3.25, 2.5], [1.6, 2.5], [2.4, 1.45], [3.25, 1.15], [3.25, 0.35]], -1.08, 1.08, OWN, COAT);
    mesh.face([[1.65, -0.95, 2.42], [2.4, -0.95, 1.48], [2.4, 0.95, 1.48], [1.65, 0.95, 2.42]].map(([x, y, z]) => [x + 0.03, y, z + 0.02]), GLASS);
    for (const y of [-1.09, 1.09]) {
      const window_ = [[0.7, y, 1.4], [2.2, y, 1.4], [1.6, y, 2.2], [0.7, y, 2.2]];
      mesh.face(y < 0 ? window_ : window_.reverse(), GLASS);
    }
    lamps(mesh, -3.25, 1.08, 0.8, 1.25);
    headlights(mesh, 3.25, 1.08, 0.7, 0.95);
    for (const x of [-2.0, 2.1]) for (const y of [-0.95, 0.95]) mesh.wheel(x, y, 0.38, 0.26);
  }

  function truck(mesh) {
    mesh.box([-6, -1.25, 1.05], [3.4, 1.25, 3.7], [0.90, 0.91, 0.92]);
    mesh.box([-6, -0.5, 0.6], [5.6, 0.5, 1.05], BLACK);
    mesh.profile([[3.7, 0.45], [3.7, 3.3], [5.6, 3.2], [6, 1.9], [6, 0.45]], -1.22, 1.22, OWN, COAT);
    mesh.face([[5.62, -1.1, 3.1], [5.98, -1.1, 1.95], [5.98, 1.1, 1.95], [5.62, 1.1, 3.1]].map(([x, y, z]) => [x + 0.03, y, z]), GLASS);
    lamps(mesh, -6, 1.25, 0.75, 1.0);
    headlights(mesh, 6, 1.22, 0.7, 0.95);
    for (const x of [-4.9, -3.7, 4.7]) for (const y of [-1.1, 1.1]) mesh.wheel(x, y, 0.5, 0.3);
  }

  function rider(mesh, seat) {
    mesh.box([-0.2, -0.2, seat], [0.12, 0.2, seat + 0.6], OWN, COAT, [-0.02, 0.26, -0.22, 0.22]);
    mesh.ball([0.16, 0, seat + 0.76], 0.13, BLACK, 0.15);
    for (const y of [-0.14, 0.14]) mesh.box([-0.1, y - 0.07, 0.3], [0.3, y + 0.07, seat + 0.05], CLOTH);
    for (const y of [-0.24, 0.24]) mesh.box([0.05, y - 0.05, seat + 0.3], [0.55, y + 0.05, seat + 0.45], OWN, COAT);
  }

  function motorcycle(mesh) {
    for (const x of [-0.78, 0.78]) mesh.wheel(x, 0, 0.31, 0.16);
    mesh.box([-0.7, -0.16, 0.4], [0.6, 0.16, 0.8], BLACK, 0, [-0.6, 0.5, -0.12, 0.12]);
    mesh.box([0.5, -0.45, 0.98], [0.58, 0.45, 1.04], BLACK);
    lamps(mesh, -1.09, 0.1, 0.62, 0.74);
    rider(mesh, 0.8);
  }

  function bicycle(mesh) {
    for (const x of [-0.48, 0.48]) mesh.wheel(x, 0, 0.32, 0.06);
    mesh.box([-0.45, -0.03, 0.42], [0.42, 0.03, 0.5], BLACK);
    mesh.box([0.3, -0.32, 0.98], [0.36, 0.32, 1.03], BLACK);
    rider(mesh, 0.92);
  }

  function person(mesh, high) {
    const k = high / 1.75;
    for (const y of [-0.1, 0.1]) mesh.box([-0.09, y - 0.08, 0], [0.09, y + 0.08, 0.85 * k], CLOTH);
    mesh.box([-0.1, -0.2, 0.83 * k], [0.1, 0.2, 1.45 * k], OWN, COAT, [-0.1, 0.1, -0.22, 0.22]);
    for (const y of [-0.24, 0.24]) mesh.box([-0.05, y - 0.045, 0.8 * k], [0.05, y + 0.045, 1.42 * k], OWN, COAT);
    mesh.ball([0, 0, 1.6 * k], 0.11, SKIN, 0.14);
  }

  /** How a body is drawn: the mesh, and the length and width, m, for which it was made. */
  const BODIES = {
    car: [car, 4.5, 1.8], van: [van, 6.5, 2.16], truck: [truck, 12, 2.5], motorcycle: [motorcycle, 2.2, 0.9],
    bicycle: [bicycle, 1.6, 0.65], pedestrian: [(mesh) => person(mesh, 1.75), 0.215, 0.478], child: [(mesh) => person(mesh, 1.15), 0.2, 0.4],
    bonnet: [(mesh) => car(mesh, false), 4.5, 1.8],
  };
  const HEIGHTS = { van: 2.5, truck: 3.7, motorcycle: 1.7, bicycle: 1.8, pedestrian: 1.75, child: 1.15 }; // m; others 1.45

  function frame(mesh) {
    const bars = [[-0.5, 0.5], [0, 1]], t = 0.035;
    for (const y of bars[0]) for (const z of bars[1]) mesh.box([-0.5, y - t, z - t], [0.5, y + t, z + t], RED);
    for (const x of bars[0]) for (const z of bars[1]) mesh.box([x - t / 2, -0.5, z - t], [x + t / 2, 0.5, z + t], RED);
    for (const x of bars[0]) for (const y of bars[0]) mesh.box([x - t / 2, y - t, 0], [x + t / 2, y + t, 1], RED);
  }

  function arrow(mesh) {
    mesh.face([[0, -0.1, 0.06], [0.9, -0.1, 0.06], [0.9, 0.1, 0.06], [0, 0.1, 0.06]], OWN, COAT);
    mesh.face([[0.9, -0.4, 0.06], [1.1, 0, 0.06], [0.9, 0.4, 0.06]], OWN, COAT);
  }

  /** The road's surface and markings, in the order in which they cover each other, and the posts and trees beside it. */
  function roadMeshes(road, onMap, [begin, end]) {
    const surface = new Mesh(), pieces = []; // what stands beside the road, by pieces of it, of which only those in sight are drawn
    const bent = Boolean(road.line && road.line.length), step = bent ? 4 : 200;
    const beside = (s) => {
      const k = Math.max(0, Math.floor((s - begin) / PIECE));
      while (pieces.length <= k) {
        const [x, y] = onMap(road, begin + (pieces.length + 0.5) * PIECE, (road.left + road.right) / 2);
        pieces.push({ mesh: new Mesh(), x, y });
      }
      return pieces[k].mesh;
    };
    const place = (s, d, z = 0) => { const [x, y] = onMap(road, s, d); return [x, y, z]; };
    const strip = (from, to, d0, d1, colour, longest = step) => {
      const parts = Math.max(1, Math.ceil((to - from) / longest));
      for (let k = 0; k < parts; k++) {
        const [a, b] = [from + (to - from) * k / parts, from + (to - from) * (k + 1) / parts];
        surface.face([place(a, d0), place(b, d0), place(b, d1), place(a, d1)], colour);
      }
    };
    const crossings = (road.crossings || []).map(([x, wide, reach]) => [x - wide / 2, x + wide / 2, reach]);
    for (const [a, b, reach] of crossings) strip(a - 0.8, b + 0.8, -reach, reach, SHOULDER);
    strip(begin, end, road.right - 0.8, road.left + 0.8, SHOULDER);
    /** Grass where an outermost lane is not there, and the shoulder and the line of the edge that is left. */
    const lawn = (gone) => {
      const outwards = Math.sign(gone[0][1] - gone[1][1]), outer = gone[0][1] + outwards * 0.9;
      const edge = gone[1][0] > gone[3][0] ? gone.slice(1).reverse() : gone.slice(1);
      const cuts = new Set(edge.map(([x]) => Math.min(Math.max(x, begin), end)));
      for (let x = Math.max(edge[0][0], begin); x < Math.min(edge[2][0], end); x += step) cuts.add(x);
      const places = [...cuts].sort((one, other) => one - other);
      const at = (x) => {
        const [[x0, y0], [x1, y1]] = x <= edge[1][0] ? [edge[0], edge[1]] : [edge[1], edge[2]];
        return x1 === x0 ? y1 : y0 + (y1 - y0) * (x - x0) / (x1 - x0);
      };
      const between = (a, b, near, far, colour) => {
        const corners = [place(a, at(a) + near), place(b, at(b) + near), place(b, far(b)), place(a, far(a))];
        surface.face(outwards > 0 ? corners : corners.reverse(), colour);
      };
      for (let k = 1; k < places.length; k++) {
        const [a, b] = [places[k - 1], places[k]];
        between(a, b, 0, () => outer, GRASS);
        between(a, b, 0, (x) => at(x) + 0.8 * outwards, SHOULDER);
        between(a, b, -0.08 * outwards, (x) => at(x) + 0.08 * outwards, WHITE);
      }
    };
    for (const [a, b, reach] of crossings) strip(a, b, -reach, reach, ASPHALT);
    strip(begin, end, road.right, road.left, ASPHALT);
    for (const d of [road.right, road.left]) { // the edge's line leaves the mouth of a road that crosses free
      let from = begin;
      for (const [a, b] of [...crossings].sort((one, other) => one[0] - other[0])) {
        if (a > from) strip(from, a, d - 0.08, d + 0.08, WHITE);
        from = Math.max(from, b);
      }
      if (from < end) strip(from, end, d - 0.08, d + 0.08, WHITE);
    }
    for (let lane = 1; lane < road.lanes; lane++) {
      const d = road.right + lane * road.laneWidth;
      for (let s = Math.floor(begin / (DASH + GAP)) * (DASH + GAP); s < end; s += DASH + GAP) strip(s, s + DASH, d - 0.07, d + 0.07, WHITE, 4);
    }
    for (const [a, b, d] of road.solid || []) if (Math.min(b, end) > Math.max(a, begin)) strip(Math.max(a, begin), Math.min(b, end), d - 0.07, d + 0.07, WHITE);
    for (const gone of road.gone || []) lawn(gone);
    const line = [];
    for (let s = begin; s <= end; s += 8) line.push(place(s, (road.left + road.right) / 2));
    const half = (road.left - road.right) / 2;
    const clear = (x, y) => !bent || line.every(([a, b]) => Math.hypot(a - x, b - y) > half + 5);
    for (let s = Math.ceil(begin / POSTS) * POSTS; s < end; s += POSTS) {
      for (const d of [road.right - 1.1, road.left + 1.1]) {
        const [x, y] = place(s, d), things = beside(s);
        things.box([x - 0.06, y - 0.06, 0], [x + 0.06, y + 0.06, 1], WHITE);
        things.box([x - 0.07, y - 0.07, 0.68], [x + 0.07, y + 0.07, 0.86], BLACK);
      }
    }
    let seed = 1;
    const random = () => { seed = (seed * 1103515245 + 12345) % 2147483648; return seed / 2147483648; };
    for (let s = begin; s < end; s += 22) {
      for (const side of [-1, 1]) {
        const off = 14 + 45 * random(), shift = 20 * random(), high = 4 + 5 * random();
        const [x, y] = place(s + shift, (road.left + road.right) / 2 + side * (half + off));
        if (!clear(x, y)) continue;
        const things = beside(s);
        things.box([x - 0.2, y - 0.2, 0], [x + 0.2, y + 0.2, 0.35 * high], [0.36, 0.28, 0.22]);
        things.ball([x, y, 0.68 * high], 0.3 * high, [0.30 + 0.08 * random(), 0.43 + 0.06 * random(), 0.28], 0.42 * high);
      }
    }
    return { surface, pieces };
  }

  // --- cameras -------------------------------------------------------------------------------------------------------

  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const unit = (a) => { const size = Math.hypot(...a) || 1; return a.map((value) => value / size); };

  /** Eye, what it looks at, and what is up for it; about: { x, y, heading, length, width }, free: { turn, rise, away }. */
  function stand(mode, about, free) {
    const [c, s] = [Math.cos(about.heading), Math.sin(about.heading)];
    const at = (ahead, left, up) => [about.x + ahead * c - left * s, about.y + ahead * s + left * c, up];
    if (mode === "above") return { eye: at(7, 0, 32), look: at(7.01, 0, 0), up: [c, s, 0], wide: 0.85 };
    if (mode === "seat") return { eye: at(-0.02 * about.length, 0.2 * about.width, 1.22), look: at(30, 0.2 * about.width, 0.55), up: [0, 0, 1], wide: 1.15 };
    if (mode === "free") {
      const [turn, flat] = [about.heading + Math.PI + free.turn, Math.cos(free.rise) * free.away];
      return { eye: [about.x + flat * Math.cos(turn), about.y + flat * Math.sin(turn), Math.max(0.4, 0.8 + Math.sin(free.rise) * free.away)], look: [about.x, about.y, 0.8], up: [0, 0, 1], wide: 0.95 };
    }
    return { eye: at(-10.5 - about.length / 2 + 2.25, 0, 4.1), look: at(14, 0, 0.2), up: [0, 0, 1], wide: 0.95 };
  }

  /** Projection times view, column by column. wide: angle of view from top to bottom, rad; less where it is a wide picture. */
  function matrix({ eye, look, up, wide }, aspect) {
    const back = unit([eye[0] - look[0], eye[1] - look[1], eye[2] - look[2]]), right = unit(cross(up, back)), top = cross(back, right);
    const f = 1 / Math.tan(wide / 2 / Math.max(1, Math.min(aspect / 1.6, 1.6))), a = (FAR + NEAR) / (NEAR - FAR), b = 2 * FAR * NEAR / (NEAR - FAR);
    const rows = [[...right, -dot(right, eye)].map((v) => v * f / aspect), [...top, -dot(top, eye)].map((v) => v * f), [...back, -dot(back, eye)]];
    const depth = rows[2].map((v) => v * a);
    depth[3] += b;
    const last = rows[2].map((v) => -v);
    return new Float32Array([0, 1, 2, 3].flatMap((k) => [rows[0][k], rows[1][k], depth[k], last[k]]));
  }

  // --- a canvas ------------------------------------------------------------------------------------------------------

  const software = (gl) => {
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    return /SwiftShader|llvmpipe|Basic Render|Software/i.test(String(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : ""));
  };

  const rgb = (colour) => [1, 3, 5].map((start) => parseInt(colour.slice(start, start + 2), 16) / 255);

  let cached = null;

  /** By what this browser draws in three dimensions: "" not at all, "processor" without a graphics processor, "graphics". */
  function means() {
    if (cached !== null) return cached;
    const asked = (more) => document.createElement("canvas").getContext("webgl2", more);
    const gl = asked({}), quick = gl && asked({ failIfMajorPerformanceCaveat: true });
    cached = !gl ? "" : !quick || software(gl) ? "processor" : "graphics";
    for (const each of [gl, quick]) { // a browser gives a page few contexts
      const end = each && each.getExtension("WEBGL_lose_context");
      if (end) end.loseContext();
    }
    return cached;
  }

  /** A view on a canvas, null where there is no WebGL2. keep: the picture can be read and printed at any time. */
  function create(canvas, { keep = false } = {}) {
    const attributes = { antialias: true, alpha: false, preserveDrawingBuffer: keep, powerPreference: "high-performance" };
    const gl = canvas.getContext("webgl2", attributes);
    if (!gl) return null;
    let program = null, names = {}, meshes = {}, standing = null, lost = false, fence = null, begun = 0, done = 0;
    let ratio = Math.min(window.devicePixelRatio || 1, MOST_RATIO) * (software(gl) ? 0.6 : 1), interval = 1 / 60, last = null, since = 0, long = 0, changed = null;
    const free = { turn: 0.5, rise: 0.35, away: 14 };

    function build() {
      program = gl.createProgram();
      for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      gl.useProgram(program);
      names = Object.fromEntries(["camera", "pose", "size", "coat", "lit", "eye", "alpha", "flatly"].map((name) => [name, gl.getUniformLocation(program, name)]));
      meshes = {};
      standing = null;
      gl.disable(gl.CULL_FACE);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    }

    function upload(mesh) {
      const array = gl.createVertexArray(), buffer = gl.createBuffer();
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(mesh.data), gl.STATIC_DRAW);
      [[0, 3, 0], [1, 3, 3], [2, 3, 6], [3, 1, 9]].forEach(([place, size, from]) => {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 4 * FLOATS, 4 * from);
      });
      return { array, buffer, count: mesh.data.length / FLOATS };
    }

    function known(name, make) {
      if (!meshes[name]) {
        const mesh = new Mesh();
        make(mesh);
        meshes[name] = upload(mesh);
      }
      return meshes[name];
    }

    function put(mesh, { x = 0, y = 0, heading = 0, size = [1, 1, 1], coat = [1, 1, 1], lit = 0 } = {}) {
      gl.uniform4f(names.pose, x, y, Math.cos(heading), Math.sin(heading));
      gl.uniform3fv(names.size, size);
      gl.uniform3fv(names.coat, coat);
      gl.uniform1f(names.lit, lit);
      gl.bindVertexArray(mesh.array);
      gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
    }

    const shadow = (mesh) => mesh.face([[-0.55, -0.56, 0], [0.53, -0.56, 0], [0.53, 0.56, 0], [-0.55, 0.56, 0]], [0.08, 0.09, 0.1]);
    const ground = (mesh) => mesh.face([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], GRASS, GROUND);

    function vehicle(it, bonnet) {
      const kind = bonnet && (it.kind === "car" || !BODIES[it.kind]) ? "bonnet" : BODIES[it.kind] ? it.kind : "car";
      const [make, length, width] = BODIES[kind];
      put(known(kind, make), { ...it, size: [it.length / length, it.width / width, 1], coat: rgb(it.colour), lit: it.brakes ? 1 : 0 });
    }

    /** The road that is drawn; onMap as in `sumoReplay`; extent: [from, to] along it, m. */
    function onRoad(road, onMap, extent) {
      if (standing && standing.road === road && standing.extent[0] <= extent[0] && standing.extent[1] >= extent[1]) return;
      if (standing) for (const part of [standing.surface, ...standing.pieces.map(({ mesh }) => mesh)]) {
        gl.deleteBuffer(part.buffer);
        gl.deleteVertexArray(part.array);
      }
      const made = roadMeshes(road, onMap, extent);
      standing = { road, onMap, extent, surface: upload(made.surface), pieces: made.pieces.map((it) => ({ ...it, mesh: upload(it.mesh) })) };
    }

    /** vehicles: [{ kind, x, y, heading, length, width, colour "#rrggbb", brakes, alpha, me }]; contact: [{ x, y, heading,
     *  length, width, kind, vx, vy }] or null. camera: { mode, about }. sharp: with all pixels, for a picture that stays. */
    function draw({ vehicles, contact = null, camera, sharp = false }) {
      if (lost || !standing || canvas.clientWidth === 0) return false;
      const fine = sharp ? Math.min(window.devicePixelRatio || 1, MOST_RATIO) : ratio;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(1, Math.round(size * fine)));
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      gl.viewport(0, 0, width, height);
      gl.clearColor(...SKY, 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const from = stand(camera.mode, camera.about, free);
      gl.uniformMatrix4fv(names.camera, false, matrix(from, width / height));
      gl.uniform3fv(names.eye, from.eye);
      gl.uniform1f(names.alpha, 1);
      gl.uniform1f(names.flatly, 0);
      gl.disable(gl.DEPTH_TEST);
      gl.disable(gl.BLEND);
      put(known("ground", ground), { x: from.eye[0], y: from.eye[1], size: [FAR, FAR, 1] });
      put(standing.surface);
      gl.enable(gl.BLEND);
      gl.uniform1f(names.alpha, 0.35);
      const near = vehicles.filter((it) => Math.hypot(it.x - from.eye[0], it.y - from.eye[1]) < FAR / 2);
      for (const it of near) if (!(it.alpha < 1)) put(known("shadow", shadow), { ...it, size: [it.length, it.width, 1] });
      gl.uniform1f(names.alpha, 1);
      gl.disable(gl.BLEND);
      gl.enable(gl.DEPTH_TEST);
      const view = unit(from.look.map((v, k) => v - from.eye[k]));
      for (const { mesh, x, y } of standing.pieces) {
        const [dx, dy] = [x - from.eye[0], y - from.eye[1]];
        if (Math.hypot(dx, dy) < SIGHT + PIECE_RADIUS && dx * view[0] + dy * view[1] > -PIECE_RADIUS) put(mesh);
      }
      for (const it of near) if (!(it.alpha < 1)) vehicle(it, it.me && camera.mode === "seat");
      if (contact) {
        gl.uniform1f(names.flatly, 1);
        for (const it of contact) if (!(it.me && camera.mode === "seat")) put(known("frame", frame), { ...it, size: [it.length, it.width, HEIGHTS[it.kind] || 1.45] });
        gl.disable(gl.DEPTH_TEST); // what a body hides is what one wants to see
        for (const it of contact) {
          const speed = Math.hypot(it.vx, it.vy);
          if (speed > 0.3) put(known("arrow", arrow), { x: it.x, y: it.y, heading: Math.atan2(it.vy, it.vx), size: [0.4 * speed, 1, 1], coat: RED });
        }
        gl.enable(gl.DEPTH_TEST);
        gl.uniform1f(names.flatly, 0);
      }
      gl.enable(gl.BLEND);
      for (const it of near) if (it.alpha < 1) {
        gl.uniform1f(names.alpha, it.alpha);
        vehicle(it, false);
      }
      if (fence) gl.deleteSync(fence);
      fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      begun += 1;
      gl.flush();
      return true;
    }

    /** Whether the last picture is still being drawn: a frame more would only queue up behind it. */
    function busy() {
      if (!fence || lost) return false;
      const state = gl.clientWaitSync(fence, 0, 0);
      if (state === gl.TIMEOUT_EXPIRED) return true;
      gl.deleteSync(fence);
      fence = null;
      done = begun;
      return false;
    }

    /** Whether the picture of that number is there, whatever has been begun since. */
    const there = (number) => !busy() || done >= number;

    /** Adapt the resolution after a picture of a motion, drawn at `now`, s: fewer pixels where pictures come too slowly, more
     *  where they come quickly. late: they come too late for another reason. slow: s a picture that is too slow. Returns whether
     *  pictures come too slowly even at the least resolution. */
    function pace(now, late = false, slow = SLOW_FRAME) {
      const apart = last === null ? 1 / 60 : now - last;
      last = now;
      long = apart > PAUSE ? long + 1 : 0;
      if (long === 1) return false; // a pause; more in a row are slow pictures
      interval += 0.1 * (apart - interval);
      since += 1;
      changed ??= now;
      if (since <= BETWEEN_CHANGES && !(since >= LEAST_BETWEEN && now - changed > CHANGE_AFTER)) return false;
      if (interval > slow || late) {
        if (ratio <= LEAST_RATIO) return true;
        [ratio, since, changed] = [Math.max(LEAST_RATIO, ratio * 0.8), 0, now];
      } else if (interval < QUICK_FRAME && since > 10 * BETWEEN_CHANGES && ratio < Math.min(window.devicePixelRatio || 1, MOST_RATIO)) [ratio, since, changed] = [ratio * 1.1, 0, now];
      return false;
    }

    /** Turn the free camera with the mouse or a finger, and come nearer with the wheel, while enabled() says so; changed:
     *  called afterwards. */
    function steerable(enabled, changed) {
      let held = null;
      canvas.addEventListener("pointerdown", (event) => {
        if (!enabled()) return;
        held = [event.clientX, event.clientY];
        canvas.setPointerCapture(event.pointerId);
      });
      canvas.addEventListener("pointerup", () => { held = null; });
      canvas.addEventListener("pointermove", (event) => {
        if (!held) return;
        free.turn -= (event.clientX - held[0]) * 0.008;
        free.rise = Math.min(1.5, Math.max(0.02, free.rise + (event.clientY - held[1]) * 0.006));
        held = [event.clientX, event.clientY];
        changed();
      });
      canvas.addEventListener("wheel", (event) => {
        if (!enabled()) return;
        event.preventDefault();
        free.away = Math.min(150, Math.max(4, free.away * Math.exp(event.deltaY * 0.001)));
        changed();
      }, { passive: false });
    }

    build();
    canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); lost = true; });
    canvas.addEventListener("webglcontextrestored", () => {
      lost = false;
      fence = null;
      const before = standing;
      build();
      if (before) onRoad(before.road, before.onMap, before.extent);
      canvas.dispatchEvent(new Event("scene-restored"));
    });
    return { draw, busy, there, begun: () => begun, pace, onRoad, steerable, lost: () => lost, resolution: () => ratio, interval: () => interval };
  }

  return { create, means };
})();

if (typeof module !== "undefined") module.exports = sumoScene;
