// The page of a person who drives: draws the states that the server sends, sends the input of hands and feet, asks questions.
// This page never computes a step: the server alone does.
"use strict";

const sumoDrive = (() => {
  // functions of keys: their bits as in hands.py, and the keys that have them
  const BITS = { left: 1, right: 2, drive: 4, brake: 8, hard: 16, evade: 32 };
  const KEYS = {
    ArrowLeft: "left", KeyA: "left", ArrowRight: "right", KeyD: "right", ArrowUp: "drive", KeyW: "drive", ArrowDown: "brake", KeyS: "brake",
    Space: "hard", ShiftLeft: "evade", ShiftRight: "evade",
  };
  const DEAD_ZONE = 0.06; // of a stick, -1..1, in which it counts as released
  const LATE_PICTURE = 50; // ms between two pictures; one that comes later counts as dropped
  const FIGURES_EVERY = 1000; // ms between two messages with figures
  const RETRY_AFTER = 1000; // ms until a lost connection is tried again
  // A drawing is too slow where 5 % of the last TIMED_INPUTS inputs take longer to the picture than LATENCY_BOUND, ms, or than a
  // step and AFTER_STEP, ms, where that is more.
  const TIMED_INPUTS = 40, LATENCY_BOUND = 50, AFTER_STEP = 30;
  // It is also too slow where the median time between TIMED_PICTURES pictures is longer than PICTURE_BOUND, s. After FEW_AFTER ms
  // FEW_PICTURES are enough.
  const TIMED_PICTURES = 45, PICTURE_BOUND = 1 / 45, FEW_AFTER = 1500, FEW_PICTURES = 5;
  const PAUSE = 500; // ms between two pictures that may be a pause
  const PLAIN = [ // the plain drawings, the most expensive first
    { ratio: 1, coarse: false, above: false, name: "plain drawing" },
    { ratio: 0.5, coarse: true, above: false, name: "plain drawing with few pixels" },
    { ratio: 0.5, coarse: true, above: true, name: "plain drawing from above" },
  ];
  const NOTE_TIME = 8000; // ms for which a note stays over the road
  const FINGER_REACH = 70; // px that a finger moves from straight to full steering
  const NO_3D = "This browser draws nothing in 3-D, so the road is drawn plainly.";
  const COLOURS = { me: "#0072b2", other: "#b26a00" };
  const HELD = { // why nothing moves
    hidden: "The window was out of sight. Nothing has moved since.", key: "Nothing moves until you continue.",
    asleep: "This computer was asleep, or stood still. Nothing has moved since.",
    silent: "This window did not answer for a while, so it shows no driver. Nothing has moved since.",
  };
  const REASONS = { 4400: "refused", 4401: "unknown", 4409: "taken", 4429: "refused" }; // codes as in window.py

  const dark = matchMedia("(prefers-color-scheme: dark)");
  const themed = () => { document.documentElement.dataset.theme = dark.matches ? "dark" : "light"; window.dispatchEvent(new Event("resize")); };
  dark.addEventListener("change", themed); // the player draws in the colours of the page's theme
  themed();

  const stage = document.getElementById("stage");
  // For all drives of this page: which of PLAIN is drawn, why, and whether the driver chose the camera, which then stays
  let plainLevel = 0, plainReason = "", cameraChosen = false;
  let socket = null, over = false, drive = null, device = matchMedia("(pointer: coarse)").matches ? "touch" : "keys", calibration = null, shown = null;

  const element = (tag, className, text) => {
    const node = document.createElement(tag);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  };
  /** Options of a select from pairs of value and text, of which one is chosen. */
  const options = (pairs, chosen) => pairs.map(([value, text]) => new Option(text, value, false, value === chosen));
  const say = (message) => { if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

  /** A value that the browser remembers by name; a new `value` replaces it. null where the browser may not remember. */
  function kept(name, value) {
    try {
      if (value !== undefined) localStorage.setItem(name, JSON.stringify(value));
      return JSON.parse(localStorage.getItem(name));
    } catch { return null; }
  }

  // --- pages of text and questions -----------------------------------------------------------------------------------

  function question(it) {
    const set = element("fieldset");
    set.append(element("legend", "", it.text));
    if (it.kind === "scale") {
      const row = element("div", "scale");
      for (let value = it.low; value <= it.high; value++) {
        const label = element("label"), input = element("input");
        Object.assign(input, { type: "radio", name: it.key, value });
        label.append(input, element("span", "", String(value)));
        row.append(label);
      }
      const ends = element("div", "ends");
      ends.append(element("span", "", it.least || ""), element("span", "", it.most || ""));
      set.append(row, ends);
      return { set, value: () => { const found = row.querySelector("input:checked"); return found ? Number(found.value) : null; } };
    }
    if (it.kind === "yes") {
      const label = element("label"), input = element("input");
      Object.assign(input, { type: "checkbox", name: it.key });
      label.append(input, ` ${it.label}`);
      set.append(label);
      return { set, value: () => (input.checked ? true : null) };
    }
    const input = element(it.kind === "code" ? "input" : "textarea");
    if (it.kind === "code") Object.assign(input, { type: "text", autocomplete: "off", spellcheck: false });
    Object.assign(input, { name: it.key, maxLength: it.kind === "code" ? 20 : 1000 });
    input.setAttribute("aria-label", it.text);
    set.append(input);
    return { set, value: () => input.value.trim() || (it.optional ? "" : null) };
  }

  async function sheet(view) {
    const root = element("div", view.replay ? "sheet broad" : "sheet");
    root.append(element("h1", "", view.title));
    for (const text of view.lines || []) root.append(element("p", "", text));
    const place = element("div");
    if (view.replay) root.append(place);
    const asked = (view.questions || []).map((it) => ({ ...question(it), key: it.key }));
    root.append(...asked.map(({ set }) => set));
    const wish = element("p", "wish"), row = element("div", "row");
    wish.setAttribute("role", "alert");
    for (const [name, label] of view.buttons || []) {
      const button = element("button", row.children.length ? "" : "main", label);
      button.type = "button";
      button.addEventListener("click", () => {
        const answers = { button: name };
        for (const { key, value, set } of asked) {
          const given = value();
          if (given === null && name !== "skip" && name !== "stop") {
            wish.textContent = "Please answer every question.";
            set.scrollIntoView({ block: "center" });
            return;
          }
          if (given !== null) answers[key] = given;
        }
        for (const each of row.children) each.disabled = true;
        say({ answers });
      });
      row.append(button);
    }
    root.append(wish, row);
    stage.replaceChildren(root);
    if (view.replay) {
      const all = await sumoEval.decodeTrajectories(view.replay.trajectories, view.replay.channels);
      const views = view.replay.views.map(({ name, vehicles, contact }) => ({
        name, contact, ego: all[vehicles.ego],
        actors: Object.entries(vehicles).filter(([vehicle]) => vehicle !== "ego").map(([vehicle, k]) => [vehicle, all[k]]),
      }));
      sumoReplay.player(place).show({ road: view.replay.road, bodies: view.replay.bodies, views, ghosts: [], seen: "behind" });
    }
  }

  // --- hands and feet ------------------------------------------------------------------------------------------------

  const released = () => ({ steer: 0, throttle: 0, brake: 0 });
  const hands = { keys: 0, stick: released() }; // bits of the keys that are held; mouse or fingers as a stick
  const pressed = new Set(); // codes of keys, of which two may do the same

  const pad = () => Array.from(navigator.getGamepads ? navigator.getGamepads() : []).find((it) => it && it.connected) || null;
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const withoutDeadZone = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : Math.sign(value) * (Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE));

  /** How far an axis or a button of a device is from rest, 0, to full, 1. */
  function share(it, { axis, button, rest, full }) {
    const value = axis === undefined ? it.buttons[button].value : it.axes[axis];
    return full === rest ? 0 : clamp((value - rest) / (full - rest), 0, 1);
  }

  /** [kind, keys, steer, throttle, brake] as `messages.read` takes it. */
  function sample() {
    if (device === "mouse" || device === "touch") return ["stick", 0, hands.stick.steer, hands.stick.throttle, hands.stick.brake];
    const it = device === "keys" ? null : pad();
    if (device === "wheel" && it && calibration) {
      const { left, right, centre, axis, degrees } = calibration.steer;
      const offset = it.axes[axis] - centre, isLeft = (offset > 0) === (left - centre > 0);
      // share of the way to the stop on that side, positive to the left
      const turn = offset / (isLeft ? left - centre : (centre - right) || 1);
      const angle = clamp(turn, -1, 1) * degrees / 2 * Math.PI / 180;
      return ["wheel", 0, angle, share(it, calibration.throttle), share(it, calibration.brake)];
    }
    if (device === "pad" && it) { // the left stick, the right and the left trigger
      return ["stick", 0, clamp(-withoutDeadZone(it.axes[0]), -1, 1), clamp(it.buttons[7].value, 0, 1), clamp(it.buttons[6].value, 0, 1)];
    }
    return ["keys", hands.keys, 0, 0, 0];
  }

  function onKey(event, down) {
    if (!drive) return;
    if (down && (!drive.veil.hidden || event.ctrlKey || event.altKey || event.metaKey)) return; // a release counts even with Ctrl held
    if (down && (event.code === "Escape" || event.code === "KeyP")) {
      event.preventDefault();
      drive.pause("key");
      return;
    }
    const name = KEYS[event.code];
    if (!name) return;
    event.preventDefault();
    const before = hands.keys;
    if (down) pressed.add(event.code); else pressed.delete(event.code);
    hands.keys = [...pressed].reduce((bits, code) => bits | BITS[KEYS[code]], 0);
    if (hands.keys !== before) drive.send(event.timeStamp);
  }

  function releaseAll() {
    hands.keys = 0;
    pressed.clear();
    hands.stick = released();
    if (drive) drive.releaseFingers();
  }

  document.addEventListener("keydown", (event) => onKey(event, true));
  document.addEventListener("keyup", (event) => onKey(event, false));
  for (const name of ["blur", "pagehide"]) window.addEventListener(name, () => { releaseAll(); if (drive) drive.pause("hidden"); });
  document.addEventListener("visibilitychange", () => { if (document.hidden) { releaseAll(); if (drive) drive.pause("hidden"); } });

  // --- driving -------------------------------------------------------------------------------------------------------

  class Drive {
    constructor(view) {
      this.view = view;
      // the latest, as `seat.state_of` makes it: [number of the step, time, number of the answered input, ego, actors]
      this.state = null;
      this.arrived = 0; // when it did, ms
      this.held = true; // nothing moves, until the countdown is over
      this.number = 0; // of the latest input
      this.waiting = []; // [number, time stamp] of inputs that no state includes yet
      this.answered = null; // the time stamp of an input that the next picture shows
      this.latency = []; // ms from input to picture, of the last 200 inputs
      this.unsent = { frames: 0, dropped: 0, stepped: 0, latency: [] };
      this.drawn = null; // when the last picture was drawn, ms; null while nothing moves
      this.mode = kept("camera") || "behind"; // of the camera
      this.wish = kept("drawing") || "automatic"; // or "3-D", "plain"
      this.root = element("div", "drive");
      this.place = element("div", "place");
      this.note = element("p", "note");
      this.note.setAttribute("role", "status");
      this.hud = element("div", "hud");
      this.readings = ["speed", "wanted", "gap", "TTC", "time"].map((name) => {
        const box = element("div", name), value = element("b");
        box.append(value, element("small", "", name));
        this.hud.append(box);
        return value;
      });
      this.thin = element("div", "thin");
      this.hud.append(this.thin);
      this.count = element("div", "count");
      this.veil = element("div", "veil");
      const tools = element("div", "tools"), stop = element("button", "", "Pause");
      this.camera = element("select");
      this.camera.setAttribute("aria-label", "Camera");
      this.camera.addEventListener("change", () => {
        this.mode = kept("camera", this.camera.value) || this.camera.value;
        cameraChosen = !this.space;
        this.startEvaluation();
        this.camera.blur();
      });
      stop.addEventListener("click", () => { this.pause("key"); stop.blur(); });
      tools.append(this.camera, stop);
      this.root.append(this.place, this.hud, this.fingers(), this.note, this.count, tools, this.veil);
      this.drawing();
      this.mouse();
      stage.replaceChildren(this.root);
      this.cover("start");
      this.frame = requestAnimationFrame((now) => this.tick(now));
      this.figures = setInterval(() => this.sendFigures(), FIGURES_EVERY);
    }

    close() {
      cancelAnimationFrame(this.frame);
      clearInterval(this.figures);
      clearTimeout(this.noted);
      this.sendFigures();
    }

    /** Choose how the road is drawn: in 3-D, or plainly where that is wished, or 3-D is missing or too slow.
     *  why: why 3-D, which was drawn until now, is given up; empty: the choice is a new one. */
    drawing(why = "") {
      if (why) this.countStepDown();
      const means = sumoScene.means(), forced = this.wish === "3-D";
      if (!why && !forced && this.wish !== "plain") {
        if (!means) why = NO_3D;
        else if (means === "processor") why = "This computer would draw 3-D with its processor, too late to drive by: the road is drawn plainly.";
      }
      this.canvas = element("canvas");
      this.canvas.setAttribute("role", "img");
      this.canvas.setAttribute("aria-label", "The road ahead");
      this.place.replaceChildren(this.canvas);
      this.space = why || this.wish === "plain" ? null : sumoScene.create(this.canvas); // the scene in 3-D; null: plain
      this.plainly = // why the road is drawn plainly, for the driver; empty: in 3-D, or as wished
        this.space ? "" : plainReason || why || (forced ? NO_3D : "");
      this.means = this.space ? { processor: "software WebGL", graphics: "WebGL" }[means] : "plain drawing";
      if (this.space) this.space.steerable(() => this.mode === "free", () => {});
      const modes = this.space ? sumoReplay.CAMERAS : ["behind", "above"];
      if (!modes.includes(this.mode)) this.mode = "behind";
      if (!this.space && PLAIN[plainLevel].above && !cameraChosen) this.mode = "above";
      this.camera.replaceChildren(...options(modes.map((mode) => [mode, mode === "seat" ? "driver's seat" : mode]), this.mode));
      this.latency = [];
      this.answered = null;
      this.startEvaluation();
      this.showReason();
    }

    /** Show why the road is drawn plainly: on the veil if it is there, else over the road. */
    showReason() {
      const because = this.veil.querySelector(".because");
      if (this.veil.hidden) this.notice(this.plainly);
      else if (because) because.textContent = this.plainly;
    }

    /** Count a change to a cheaper drawing while the person drives: figures name one drawing, so those until now are sent. */
    countStepDown() {
      if (this.held) return;
      this.sendFigures();
      this.unsent.stepped += 1;
    }

    /** Forget the pictures so far: from now on the speed of the present drawing is evaluated. */
    startEvaluation() {
      this.canvas.classList.toggle("few", !this.space && PLAIN[plainLevel].ratio < 1);
      this.timed = 0; // inputs whose latency is known
      this.intervals = []; // ms between the last pictures
      this.longIntervals = 0; // how many in a row were longer than PAUSE
      this.lastPicture = this.since = null; // time of the last picture and of the first, ms
    }

    /** How the road is drawn, in words. */
    get drawnAs() {
      if (this.space) return this.means;
      // the driver may choose the camera above at any level, and another one at the last
      return PLAIN[this.mode === "above" ? 2 : Math.min(plainLevel, 1)].name;
    }

    /** A sentence over the road, for a while. */
    notice(words) {
      this.note.textContent = words;
      clearTimeout(this.noted);
      if (words) this.noted = setTimeout(() => { this.note.textContent = ""; }, NOTE_TIME);
    }

    mouse() {
      const turn = (event) => {
        if (device !== "mouse") return;
        const half = this.place.clientWidth / 2;
        hands.stick = { steer: clamp(-(event.clientX - half) / (0.8 * half), -1, 1), throttle: event.buttons & 1 ? 1 : 0, brake: event.buttons & 2 ? 1 : 0 };
        this.send(event.timeStamp);
      };
      for (const name of ["pointermove", "pointerdown", "pointerup"]) this.place.addEventListener(name, turn);
      this.place.addEventListener("contextmenu", (event) => event.preventDefault());
    }

    /** Controls for fingers. Where a finger lands on the left is straight on; from there it pulls left or right. On the right
     *  are two pedals: the higher the finger, the harder they are pressed. */
    fingers() {
      const all = element("div", "fingers"), wheel = element("div", "finger-wheel"), knob = element("i");
      wheel.append(element("small", "", "steer: pull left or right"), knob);
      let from = null;
      const turn = (event, steer) => {
        hands.stick.steer = steer;
        knob.style.transform = `translateX(${-steer * FINGER_REACH}px)`;
        this.send(event.timeStamp);
      };
      wheel.addEventListener("pointerdown", (event) => {
        from = event.clientX;
        wheel.setPointerCapture(event.pointerId);
        const box = wheel.getBoundingClientRect();
        Object.assign(knob.style, { left: `${event.clientX - box.left}px`, top: `${event.clientY - box.top}px` });
        turn(event, 0);
      });
      wheel.addEventListener("pointermove", (event) => { if (from !== null) turn(event, clamp((from - event.clientX) / FINGER_REACH, -1, 1)); });
      for (const name of ["pointerup", "pointercancel"]) wheel.addEventListener(name, (event) => { from = null; turn(event, 0); });
      all.append(wheel);
      for (const name of ["brake", "throttle"]) {
        const pedal = element("div", `pedal ${name}`);
        pedal.append(element("i"), element("span", "", name));
        let pressed = false;
        const press = (event) => {
          const box = pedal.getBoundingClientRect(), share = pressed ? clamp((box.bottom - event.clientY) / (0.85 * box.height), 0.1, 1) : 0;
          hands.stick[name] = share;
          pedal.firstChild.style.height = `${100 * share}%`;
          this.send(event.timeStamp);
        };
        pedal.addEventListener("pointerdown", (event) => { pressed = true; pedal.setPointerCapture(event.pointerId); press(event); });
        pedal.addEventListener("pointermove", (event) => { if (pressed) press(event); });
        for (const end of ["pointerup", "pointercancel"]) pedal.addEventListener(end, (event) => { pressed = false; press(event); });
        all.append(pedal);
      }
      all.addEventListener("contextmenu", (event) => event.preventDefault());
      this.releaseFingers = () => {
        from = null;
        knob.style.transform = "";
        for (const each of all.querySelectorAll(".pedal i")) each.style.height = "0";
      };
      return all;
    }

    /** What lies over the road while nothing moves: how to drive, and a way on. */
    cover(why) {
      const box = element("div"), { title, lines } = this.view;
      box.append(element("h2", "", why === "start" ? title : "The drive is held"));
      if (why === "start") for (const text of lines || []) box.append(element("p", "", text));
      else box.append(element("p", "", HELD[why]));
      const label = element("label", "", "Drive with "), choice = element("select", "device");
      const devices = [["keys", "keyboard"], ["pad", "gamepad"], ["wheel", "steering wheel"], ["mouse", "mouse"], ["touch", "fingers on the screen"]];
      choice.append(...options(devices, device));
      label.append(choice);
      const drawn = element("label", "", "Draw the road "), drawing = element("select", "drawing"), because = element("p", "because", this.plainly);
      const drawings = [["automatic", "in 3-D where that is quick enough"], ["3-D", "in 3-D, however slow"], ["plain", "plainly"]];
      drawing.append(...options(drawings, this.wish));
      drawing.addEventListener("change", () => {
        this.wish = kept("drawing", drawing.value) || drawing.value;
        [plainLevel, plainReason, cameraChosen] = [0, "", false];
        this.mode = kept("camera") || "behind";
        this.drawing();
      });
      drawn.append(drawing);
      const how = element("p"), row = element("div", "row"), go = element("button", "main", why === "start" ? "Start" : "Continue");
      const showChoice = () => {
        device = choice.value;
        how.replaceChildren(...howTo(device));
        this.root.classList.toggle("by-touch", device === "touch");
        row.querySelector(".calibrate").hidden = device !== "wheel";
        go.disabled = device === "wheel" && !(calibration && pad() && pad().id === calibration.id);
      };
      const calibrate = element("button", "calibrate", "Calibrate");
      const leave = element("button", "", "End this drive");
      calibrate.addEventListener("click", () => this.calibrate(() => this.cover(why)));
      go.addEventListener("click", () => this.start());
      leave.addEventListener("click", () => { leave.disabled = go.disabled = true; say({ quit: true }); });
      row.append(go, calibrate, leave);
      choice.addEventListener("change", showChoice);
      box.append(label, how, drawn, because, row);
      this.veil.replaceChildren(box);
      this.veil.hidden = false;
      calibration = calibration || kept("calibration");
      showChoice();
      go.focus();
    }

    /** Find the axes and buttons of a steering wheel: at each step of rest, left, right, throttle and brake, the one that moved
     *  most is the one that was meant. */
    async calibrate(done) {
      const box = element("div"), text = element("p"), next = element("button", "main", "Next");
      const degrees = element("input");
      Object.assign(degrees, { type: "number", value: (calibration && calibration.steer.degrees) || 900, min: 90, max: 1800 });
      const label = element("label", "", "The wheel turns, from stop to stop, by degrees: ");
      label.append(degrees);
      box.append(element("h2", "", "Calibrate the steering wheel"), text, label, element("div", "row"));
      box.lastChild.append(next);
      this.veil.replaceChildren(box);
      const step = (words) => {
        text.textContent = words;
        next.focus();
        return new Promise((resolve) => {
          next.onclick = () => {
            const it = pad();
            if (it) resolve({ id: it.id, axes: [...it.axes], buttons: it.buttons.map((button) => button.value) });
            else text.textContent = `${words} (No device is seen; press one of its buttons.)`;
          };
        });
      };
      const rest = await step("Press a button of the device, release everything, wheel straight.");
      const left = await step("Turn the wheel all the way to the left and hold it there.");
      const right = await step("Turn it all the way to the right and hold it there.");
      const gas = await step("Let go of the wheel. Press the throttle all the way down and hold it.");
      const stop = await step("Let go. Press the brake all the way down and hold it.");
      const apart = left.axes.map((value, k) => Math.abs(value - right.axes[k])), axis = apart.indexOf(Math.max(...apart));
      const moved = (now) => {
        const changes = [...now.axes.map((value, k) => (k === axis ? 0 : Math.abs(value - rest.axes[k]))), ...now.buttons.map((value, k) => Math.abs(value - rest.buttons[k]))];
        const k = changes.indexOf(Math.max(...changes)), count = now.axes.length;
        return k < count ? { axis: k, rest: rest.axes[k], full: now.axes[k] } : { button: k - count, rest: rest.buttons[k - count], full: now.buttons[k - count] };
      };
      calibration = {
        id: rest.id, steer: { axis, left: left.axes[axis], right: right.axes[axis], centre: rest.axes[axis], degrees: clamp(Number(degrees.value) || 900, 90, 1800) },
        throttle: moved(gas), brake: moved(stop),
      };
      kept("calibration", calibration);
      done();
    }

    start() {
      this.veil.hidden = true;
      this.notice(this.plainly);
      say({ ready: true });
      const begun = performance.now(), whole = 1000 * this.view.countdown;
      const show = () => {
        const left = Math.ceil((whole - (performance.now() - begun)) / 1000);
        this.count.textContent = left > 0 && this.veil.hidden ? String(left) : "";
        if (left > 0 && this.veil.hidden) setTimeout(show, 100);
        else if (this.veil.hidden) this.held = false;
      };
      show();
    }

    /** Nothing moves from here on. */
    pause(why) {
      if (!this.veil.hidden) return;
      say({ pause: why });
      this.hold(why);
    }

    /** The server holds the drive. */
    hold(why) {
      if (!this.veil.hidden) return;
      this.held = true;
      [this.waiting, this.answered] = [[], null]; // the latency of inputs before a pause would include the pause
      this.count.textContent = "";
      this.notice("");
      this.cover(why);
    }

    /** Send what hands and feet do now. stamp: of the event that changed it, ms. */
    send(stamp = null) {
      this.number += 1;
      if (stamp !== null && !this.held) this.waiting.push([this.number, stamp]);
      say({ input: [this.number, this.state ? this.state[0] : -1, ...sample()] });
    }

    /** Take a state of the server, and answer it. */
    take(state) {
      this.state = state;
      this.arrived = performance.now();
      if (!this.held || device !== "keys") this.send();
      while (this.waiting.length && this.waiting[0][0] <= state[2]) {
        const [, stamp] = this.waiting.shift();
        if (this.answered === null) this.answered = stamp;
      }
    }

    /** The ego and the actors where they are now: the last state, continued with its speeds by at most two steps, so that
     *  pictures between two states do not stand still. `alone`: the body as a trajectory of one sample, for the player. */
    bodies(now) {
      const { scene, step } = this.view, ahead = this.held ? 0 : clamp((now - this.arrived) / 1000, 0, 2 * step);
      const put = ([x, y, heading, speed, acceleration], it, more) => {
        const [s, d] = [x + speed * Math.cos(heading) * ahead, y + speed * Math.sin(heading) * ahead];
        const [east, north, turned] = sumoReplay.onMap(scene.road, s, d, heading);
        const alone = { time: [0], x: [s], y: [d], heading: [heading], acceleration: [acceleration], length: it.length, width: it.width };
        return { x: east, y: north, heading: turned, length: it.length, width: it.width, kind: it.kind, brakes: acceleration < -0.5, alone, ...more };
      };
      const me = put(this.state[3], scene.ego, { colour: COLOURS.me, me: true });
      return [me, ...this.state[4].map(([number, ...rest]) => put(rest, scene.others[number - 1], { colour: COLOURS.other }))];
    }

    tick(now) {
      this.frame = requestAnimationFrame((later) => this.tick(later));
      if (!this.state) return;
      if (device === "pad" || device === "wheel") this.poll();
      if (this.space && this.space.busy()) return;
      const bodies = this.bodies(performance.now());
      if (this.space) {
        this.space.onRoad(this.view.scene.road, sumoReplay.onMap, this.view.scene.extent);
        this.space.draw({ vehicles: bodies, camera: { mode: this.mode, about: bodies[0] } });
        this.evaluateSpace(now);
      } else {
        const [me, ...others] = bodies, view = { ego: me.alone, actors: others.map((it, k) => [String(k), it.alone]), contact: null };
        if (this.mode === "above") this.drawAbove(bodies, PLAIN[plainLevel].ratio);
        else sumoReplay.drawChase(this.canvas, { road: this.view.scene.road }, view, COLOURS.me, 0, PLAIN[plainLevel]);
        this.evaluatePlain(now);
      }
      if (this.answered !== null) this.timePicture(this.answered);
      this.answered = null;
      if (!this.held) {
        if (this.drawn !== null) {
          this.unsent.frames += 1;
          if (now - this.drawn > LATE_PICTURE) this.unsent.dropped += 1;
        }
        this.drawn = now;
      } else this.drawn = null;
      this.showReadings();
    }

    /** Where 3-D is too slow, draw fewer pixels, and in the end plainly, unless the driver wishes for 3-D. */
    evaluateSpace(now) {
      if (this.space.lost()) {
        this.drawing("The browser has taken 3-D away from this page: the road is drawn plainly.");
        return;
      }
      const late = this.isLate();
      if (late) this.timed = 0; // `pace` changes the pixels: later inputs count
      if (this.space.pace(now / 1000, late, PICTURE_BOUND) && this.wish !== "3-D") {
        this.drawing("3-D came too late to drive by, even with few pixels: the road is drawn plainly.");
      }
    }

    /** Whether inputs are seen too late to drive by. */
    isLate() { return this.timed >= TIMED_INPUTS && this.latencyWithin(0.95) > Math.max(LATENCY_BOUND, AFTER_STEP + 1000 * this.view.step); }

    /** Where the plain drawing is too slow, take the next cheaper one. A driver who chose the camera keeps it, and gets fewer
     *  pixels at most. */
    evaluatePlain(now) {
      const apart = this.lastPicture === null ? null : now - this.lastPicture;
      this.lastPicture = now;
      this.since ??= now;
      this.longIntervals = apart > PAUSE ? this.longIntervals + 1 : 0; // one is a pause; more in a row are slow pictures
      if (apart === null || this.longIntervals === 1) return;
      this.intervals = [...this.intervals.slice(1 - TIMED_PICTURES), apart];
      const enough = this.intervals.length >= TIMED_PICTURES || (this.intervals.length >= FEW_PICTURES && now - this.since > FEW_AFTER);
      const median = [...this.intervals].sort((a, b) => a - b)[this.intervals.length >> 1];
      const late = this.isLate(), slow = enough && median > 1000 * PICTURE_BOUND;
      if (!late && !slow) return;
      const why = late ? `95 of 100 inputs were seen within ${this.latencyWithin(0.95).toFixed(0)} ms only` : `Pictures came ${median.toFixed(0)} ms apart`;
      const cheapest = cameraChosen || this.mode === "above" ? 1 : 2;
      if (plainLevel < cheapest) {
        this.countStepDown();
        plainLevel += 1;
        if (PLAIN[plainLevel].above) this.camera.value = this.mode = "above";
        plainReason = PLAIN[plainLevel].above
          ? `${why}: the road is drawn from above. The camera can be chosen at the top right.`
          : `${why}: the road is drawn plainly, with fewer pixels and pieces.`;
      } else {
        const end = "nothing cheaper to draw is left; this computer is busy, or too slow to drive by.";
        if (!plainReason.endsWith(end)) plainReason = `${why}, and ${end}`;
      }
      this.plainly = plainReason;
      this.startEvaluation();
      this.showReason();
    }

    /** Time within which a share, 0..1, of the last inputs was seen, ms. */
    latencyWithin(share) {
      const ordered = this.latency.slice(-TIMED_INPUTS).sort((a, b) => a - b);
      return ordered.length ? ordered[Math.min(ordered.length - 1, Math.floor(share * ordered.length))] : 0;
    }

    /** Send the input of a device without events if it changed since the last picture; its latency counts from now. */
    poll() {
      const input = JSON.stringify(sample());
      if (input !== this.polled) this.send(performance.now());
      this.polled = input;
    }

    /** Time from an input to the picture that shows it, which is there once the graphics processor is done with it, or the page
     *  has painted. stamp: of the input, ms. */
    timePicture(stamp) {
      const { space } = this, picture = space ? space.begun() : 0;
      const look = () => {
        if (space !== this.space) return; // drawn in another way by now
        if (space && !space.there(picture)) { setTimeout(look, 1); return; }
        const took = performance.now() - stamp;
        this.latency.push(took);
        this.timed += 1;
        if (this.latency.length > 200) this.latency.shift();
        if (this.unsent.latency.length < 200) this.unsent.latency.push(Math.round(10 * took) / 10);
      };
      if (space) look();
      else { // this frame is painted before the next message is read
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => { port1.close(); look(); };
        port2.postMessage(0);
      }
    }

    /** The plain drawing from above, from 60 m behind the ego to 180 m ahead; ratio: of pixels to those of the page. */
    drawAbove(bodies, ratio) {
      const sheet = sumoReplay.pen(this.canvas, ratio);
      if (!sheet) return;
      const { context, width, height } = sheet, [me] = bodies;
      const scale = Math.max(4, height / 110); // pixels a metre: about 110 m are in view
      const [c, s] = [Math.cos(me.heading), Math.sin(me.heading)];
      /** Pixel of a point of the map. The ego is in the middle, a quarter from the bottom, and heads up. */
      const px = ([x, y]) => {
        const ahead = (x - me.x) * c + (y - me.y) * s, left = (y - me.y) * c - (x - me.x) * s;
        return [width / 2 - scale * left, 0.75 * height - scale * ahead];
      };
      const from = this.state[3][0] - 60;
      sumoReplay.paintRoad(sheet, this.view.scene.road, from, from + 240, px, scale, { ground: "#c9d3c2", road: "#9aa1a8", edge: "#fff" });
      for (const it of bodies) {
        const { x, y, heading, length, width } = it;
        sumoReplay.drawBody(context, { time: [0], x: [x], y: [y], heading: [heading], length, width }, 0, px, it.colour, false);
      }
    }

    /** Show speed, gap and TTC to the nearest actor ahead, time, and how the page draws. */
    showReadings() {
      const [, time, , [x, y, heading, speed], others] = this.state, { scene, wanted } = this.view;
      let gap = Infinity, closing = 0;
      for (const [number, ox, oy, turned, their] of others) {
        const free = sumoReplay.gapTo(scene.ego, x, y, scene.others[number - 1], ox, oy, turned);
        if (free >= gap) continue;
        gap = free;
        closing = sumoReplay.speedAlong(scene.road, speed, heading, x, y) - sumoReplay.speedAlong(scene.road, their, turned, ox, oy);
      }
      const ttc = closing > 0.1 ? gap / closing : Infinity;
      const part = (share) => (this.latency.length ? this.latencyWithin(share).toFixed(0) : "–");
      [`${(3.6 * speed).toFixed(0)} km/h`, `${(3.6 * wanted).toFixed(0)} km/h`, gap < 300 ? `${gap.toFixed(0)} m` : "–", ttc < 30 ? `${ttc.toFixed(1)} s` : "–", `${time.toFixed(1)} s`]
        .forEach((words, k) => { if (this.readings[k].textContent !== words) this.readings[k].textContent = words; });
      const rate = this.space ? `, ${(1 / this.space.interval()).toFixed(0)} pictures/s, ${Math.round(100 * this.space.resolution())} % of the pixels each way` : "";
      const words = `${this.drawnAs}${rate} · input to picture ${part(0.5)} ms, 95 % within ${part(0.95)} ms`;
      if (this.thin.textContent !== words) this.thin.textContent = words;
    }

    /** Send the figures since the last message of this kind, if there are any. */
    sendFigures() {
      const { unsent } = this;
      if (!unsent.frames && !unsent.latency.length && !unsent.stepped) return;
      this.unsent = { frames: 0, dropped: 0, stepped: 0, latency: [] };
      say({ telling: { ...unsent, resolution: this.space ? Math.round(100 * this.space.resolution()) / 100 : PLAIN[plainLevel].ratio, renderer: this.drawnAs } });
    }
  }

  function howTo(kind) {
    if (kind === "keys") {
      const table = element("table");
      for (const [keys, what] of [["← →  or  A D", "steer; release, and the wheel goes back"], ["↑  or  W", "accelerate"], ["↓  or  S", "brake"], ["Space", "brake as hard as the car can"], ["Shift", "with ← →: steer harder, to evade"], ["P  or  Esc", "hold the drive"]]) {
        const row = element("tr"), left = element("td");
        left.append(element("kbd", "", keys));
        row.append(left, element("td", "", what));
        table.append(row);
      }
      return [table];
    }
    return [document.createTextNode({
      pad: "Left stick steers, right trigger accelerates, left trigger brakes. Press a button of the gamepad once, so that the browser shows it.",
      wheel: "The steering wheel turns as far as yours does. It must be calibrated once on this machine.",
      mouse: "Left and right of the middle steers, the left button accelerates, the right one brakes.",
      touch: "Put a finger on the left of the screen and pull it left or right to steer. Two pedals are on the right; the higher you press, the more.",
    }[kind])];
  }

  // --- the connection ------------------------------------------------------------------------------------------------

  function token() {
    const given = location.hash.slice(1);
    try {
      if (given) sessionStorage.setItem("token", given);
      history.replaceState(null, "", location.pathname);
      return given || sessionStorage.getItem("token") || "";
    } catch { return given; }
  }

  function leave() {
    if (drive) drive.close();
    drive = null;
  }

  function show(view) {
    leave();
    shown = view.show;
    if (view.show === "drive") drive = new Drive(view);
    else if (view.show === "sheet") sheet(view);
    else if (view.show === "wait") sheet({ title: "One moment", lines: ["The next drive is being prepared."] });
    else if (view.show === "over") { over = true; sheet(view); }
    document.documentElement.dataset.shown = view.show;
  }

  function connect(secret) {
    socket = new WebSocket(`ws://${location.host}/wheel`);
    socket.addEventListener("open", () => say({ token: secret }));
    socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      if (message.state) { if (drive) drive.take(message.state); }
      else if (message.held) { releaseAll(); if (drive) drive.hold(message.held); } // keys released meanwhile were not reported
      else if (message.finished) { leave(); say(message); } // the drive's last figures, and that they were the last
      else show(message);
    });
    socket.addEventListener("close", (event) => {
      leave();
      if (over) return;
      document.documentElement.dataset.shown = "lost";
      if (REASONS[event.code]) {
        sheet({ title: "This window cannot drive", lines: [event.reason || "The server has shut it out."] });
        document.documentElement.dataset.shown = REASONS[event.code];
        return;
      }
      sheet({ title: "The connection is lost", lines: ["Nothing that was recorded is lost. This page tries again by itself; is the program still running in the terminal?"] });
      setTimeout(() => connect(secret), RETRY_AFTER);
    });
  }

  connect(token());
  return {
    get state() { return drive && drive.state; },
    get latency() { return drive ? [...drive.latency] : []; },
    get interval() { return drive && drive.space ? drive.space.interval() : null; },
    get resolution() { return drive && drive.space ? drive.space.resolution() : null; },
    get means() { return drive && drive.means; },
    get drawnAs() { return drive && drive.drawnAs; },
    get plainly() { return drive && drive.plainly; },
    get shown() { return shown; },
    get wanted() { return drive && drive.view.wanted; },
  };
})();
