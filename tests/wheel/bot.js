// A participant without a person: answers every sheet and drives through the page's own gamepad. Only + - * / in the law.
"use strict";
window.bot = ({ code, wish, opinion }) => {
  const axes = [0, 0, 0, 0], buttons = Array.from({ length: 16 }, () => ({ value: 0, pressed: false }));
  Navigator.prototype.getGamepads = () => {
    const state = sumoDrive.state;
    if (state) {
      const [, , , [x, y, heading, speed], others] = state;
      const near = others.some(([, ox, oy, , their]) => ox > x && ox - x < 60 && Math.abs(oy) < 1.5 && their < speed - 1);
      const beside = others.some(([, ox, oy]) => oy > 1.7 && ox > x - 8 && ox - x < 25);
      const passing = wish.overtakes && !beside && (near || y > 1.2);
      const lane = passing ? 3.5 : 0, lead = Math.min(...others.filter(([, ox, oy]) => ox > x && Math.abs(oy - y) < 1.9).map(([, ox, , , their]) => (ox - x - 4.5) - (speed - their) * 2.2), 1e3);
      const steer = 0.02 * (lane - y) - 0.1 * speed * heading + wish.wander * (Math.floor(x / 40) % 2 - 0.5);
      axes[0] = -Math.max(-1, Math.min(1, steer)) + Math.sign(-steer) * 0.06;
      const pedal = lead < 6 + wish.headway * speed ? -Math.min(1, (6 + wish.headway * speed - lead) * 0.02) : (wish.speed - speed) * 0.08;
      buttons[7].value = Math.max(0, Math.min(1, pedal));
      buttons[6].value = Math.max(0, Math.min(1, -pedal));
    }
    return [{ id: "bot", connected: true, axes, buttons, mapping: "standard" }];
  };
  setInterval(() => {
    const veil = document.querySelector(".veil");
    if (veil && !veil.hidden) {
      const choice = veil.querySelector("select");
      if (choice && choice.value !== "pad") { choice.value = "pad"; choice.dispatchEvent(new Event("change")); }
      wish.speed = sumoDrive.wanted;
      veil.querySelector("button.main").click();
      return;
    }
    const row = document.querySelector(".sheet .row button");
    if (!row || row.disabled) return;
    for (const set of document.querySelectorAll(".sheet fieldset")) {
      const text = set.querySelector("input[type=text]"), yes = set.querySelector("input[type=checkbox]"), marks = [...set.querySelectorAll("input[type=radio]")];
      if (text) text.value = code;
      if (yes) yes.checked = true;
      if (marks.length) marks[Math.max(0, Math.min(9, opinion() - 1))].checked = true;
    }
    if (document.querySelector("h1").textContent === "Thank you") { window.through = true; return; }
    if (document.querySelector("h1").textContent === "Welcome" && window.through) return;
    row.click();
  }, 200);
  return true;
};
