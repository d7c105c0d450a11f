// What every page shares: light and dark, folded sections, buttons that copy and save. Works without a server.
"use strict";

const sumoPage = (() => {
  const root = document.documentElement;
  const KEY = "sumo-eval-theme";

  /** The choice kept on this machine; browsers may refuse to keep any for files. */
  function kept(value) {
    try {
      if (value !== undefined) localStorage.setItem(KEY, value);
      return localStorage.getItem(KEY);
    } catch {
      return null;
    }
  }

  const listeners = [];
  const theme = () => root.dataset.theme;
  function setTheme(name) {
    root.dataset.theme = name;
    listeners.forEach((listener) => listener(name));
  }
  setTheme(kept() ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));

  /** A colour of the style sheet as it stands, such as `--ink`. */
  const colour = (name) => getComputedStyle(root).getPropertyValue(name).trim();

  function button(text, act, about = "") {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    if (about) made.setAttribute("aria-label", about);
    made.addEventListener("click", act);
    return made;
  }

  const preparations = [];
  const forPaper = new Set(); // sections that only printing unfolded

  function openForPaper() {
    for (const fold of folds()) {
      if (!fold.open) forPaper.add(fold);
      fold.open = true;
    }
  }

  const folds = () => [...document.querySelectorAll("details.fold, details[data-gates]")];

  function tools(holder) {
    if (folds().length) {
      const folded = () => folds().some((fold) => !fold.open);
      const all = button("Unfold all", () => {
        const open = folded();
        folds().forEach((fold) => { fold.open = open; });
      });
      document.addEventListener("toggle", () => { all.textContent = folded() ? "Unfold all" : "Fold all"; }, true);
      holder.append(all);
    }
    const words = () => (theme() === "dark" ? "Light" : "Dark");
    const toggle = button(words(), () => {
      setTheme(theme() === "dark" ? "light" : "dark");
      kept(theme());
      toggle.textContent = words();
    });
    holder.append(toggle, button("Print", async () => {
      openForPaper();
      for (const ready of preparations) await ready();
      window.print();
    }));
  }

  /** Open whatever folds an element away. */
  function unfold(element) {
    for (let at = element; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
  }

  /** The part of the address behind `#`; as it was typed where it is no valid encoding, such as `50%`. */
  function anchor() {
    try {
      return decodeURIComponent(location.hash.slice(1));
    } catch {
      return location.hash.slice(1);
    }
  }

  function followAddress() {
    const target = document.getElementById(anchor());
    if (!target) return;
    unfold(target);
    (target.closest("details.fold") ?? target).scrollIntoView();
  }

  // --- saving --------------------------------------------------------------------------------------------------------

  function download(name, address) {
    const link = document.createElement("a");
    link.href = address;
    link.download = name;
    link.click();
  }

  function saveText(name, text, type) {
    const address = URL.createObjectURL(new Blob([text], { type }));
    download(name, address);
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }

  const quoted = (value) => {
    const text = value === null || value === undefined ? "" : String(value);
    const harmless = /^[=+\-@\t]/.test(text) && Number.isNaN(Number(text)) ? `'${text}` : text; // a spreadsheet must run nothing
    return /[",\n\r]/.test(harmless) ? `"${harmless.replaceAll('"', '""')}"` : harmless;
  };
  const csv = (rows) => `${rows.map((row) => row.map(quoted).join(",")).join("\r\n")}\r\n`;

  /** Buttons that save a chart. svg: () => text or a promise of it. rows: () => lists of cells, the head first. */
  function saver(name, svg, rows) {
    const holder = document.createElement("span");
    holder.className = "save";
    const file = name.replace(/[^\w.-]+/g, "_").slice(0, 80);
    holder.append(
      button("SVG", async () => saveText(`${file}.svg`, await svg(), "image/svg+xml"), `Save as SVG: ${name}`),
      button("PNG", async () => download(`${file}.png`, await pixels(await svg())), `Save as PNG: ${name}`),
      button("CSV", () => saveText(`${file}.csv`, csv(rows()), "text/csv"), `Save the data as CSV: ${name}`),
    );
    return holder;
  }

  /** A picture as a PNG of twice its size. */
  async function pixels(svg) {
    const image = new Image();
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [2 * image.naturalWidth, 2 * image.naturalHeight];
    const context = canvas.getContext("2d");
    context.fillStyle = colour("--paper");
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    return canvas.toDataURL("image/png");
  }

  const STYLES = ["fill", "stroke", "stroke-width", "stroke-dasharray", "fill-opacity", "opacity", "font-size", "font-family", "text-anchor", "font-weight"];

  /** An SVG of the page as a file of its own, with the styles that it has here. */
  function standAlone(drawing) {
    const copy = drawing.cloneNode(true);
    const [here, there] = [drawing, copy].map((one) => [one, ...one.querySelectorAll("*")]);
    here.forEach((node, k) => {
      const style = getComputedStyle(node);
      for (const name of STYLES) there[k].setAttribute(name, style.getPropertyValue(name));
    });
    const { width, height } = drawing.getBoundingClientRect();
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("width", Math.round(width));
    copy.setAttribute("height", Math.round(height));
    return new XMLSerializer().serializeToString(copy);
  }

  /** Give every drawing that names its data, `data-chart`, its buttons. `data-head`: names of its columns; a mark's row is its `data-row`; both lists in JSON. */
  function saveDrawings() {
    for (const drawing of document.querySelectorAll("svg[data-chart]")) {
      const marks = [...drawing.querySelectorAll("[data-row]")];
      const rows = () => [JSON.parse(drawing.dataset.head), ...marks.map((one) => JSON.parse(one.dataset.row))];
      drawing.before(saver(drawing.dataset.chart, () => standAlone(drawing), rows));
    }
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.querySelectorAll("[data-tools]").forEach(tools);
    saveDrawings();
    followAddress();
  });
  window.addEventListener("hashchange", followAddress);
  window.addEventListener("beforeprint", openForPaper);
  window.addEventListener("afterprint", () => {
    for (const fold of forPaper) fold.open = false;
    forPaper.clear();
  });
  document.addEventListener("click", async (event) => {
    const from = event.target.closest?.("[data-copy]");
    if (!from) return;
    const text = from.dataset.copy;
    try {
      await navigator.clipboard.writeText(text);
    } catch { // a file has no clipboard in some browsers: the old way works
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    const label = from.dataset.label ??= from.textContent; // a second click finds "copied"
    from.textContent = "copied";
    setTimeout(() => { from.textContent = label; }, 1200);
  });

  /** A button that puts a text on the clipboard. */
  function copier(text) {
    const made = button("copy", () => {}, `Copy ${text}`);
    made.className = "copy";
    made.dataset.copy = text;
    return made;
  }

  return { theme, anchor, beforePrint: (ready) => preparations.push(ready), onTheme: (listener) => listeners.push(listener), colour, unfold, saver, copier, button };
})();
