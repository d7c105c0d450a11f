"""What holds for every page: words can be read, charts saved, three screens folded, nothing beside
the window."""

WRITTEN_IN_CELLS = """(async () => {
    // Words on the tiles of heat maps: the colour of each against the pixel of the map beneath it.
    const light = (colour) => colour.map((v) => v / 255)
        .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
    const ratios = [];
    for (const image of document.querySelectorAll(".heatmaplayer image")) {
        const box = image.getBoundingClientRect();
        if (!box.width) continue;
        const map = new Image();
        map.src = image.getAttribute("href") ?? image.getAttribute("xlink:href");
        await map.decode();
        const canvas = new OffscreenCanvas(map.naturalWidth, map.naturalHeight);
        const context = canvas.getContext("2d", { willReadFrequently: true });
        context.drawImage(map, 0, 0);
        for (const word of image.closest(".heatmaplayer").querySelectorAll("text")) {
            if (!word.textContent.trim()) continue;
            const at = word.getBoundingClientRect();
            const [x, y] = [at.x + at.width / 2 - box.x, at.y + at.height / 2 - box.y];
            if (x < 0 || y < 0 || x > box.width || y > box.height) continue;
            const pixel = [x / box.width * canvas.width, y / box.height * canvas.height];
            const beneath = context.getImageData(...pixel, 1, 1).data;
            if (beneath[3] < 128) continue;
            const ink = getComputedStyle(word.querySelector("tspan") ?? word).fill.match(/[\\d.]+/g).map(Number);
            const [a, b] = [light(ink.slice(0, 3)), light([...beneath].slice(0, 3))];
            ratios.push((Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05));
        }
    }
    return ratios;
})()"""

CONTRAST = """(() => {
    const light = (colour) => colour.map((v) => v / 255)
        .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
    const numbers = (text) => text.match(/[\\d.]+/g).map(Number);
    const behind = (element) => {
        for (let at = element; at; at = at.parentElement) {
            const colour = numbers(getComputedStyle(at).backgroundColor);
            if ((colour[3] ?? 1) > 0.99) return colour.slice(0, 3);
        }
        return [255, 255, 255];
    };
    const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const element = walker.currentNode.parentElement;
        if (!walker.currentNode.textContent.trim() || !element.getClientRects().length) continue;
        if (element.closest("svg, script, option")) continue;
        const [a, b] = [light(numbers(getComputedStyle(element).color).slice(0, 3)), light(behind(element))];
        const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        const words = walker.currentNode.textContent.trim().slice(0, 40);
        if (ratio < 4.5) found.push([element.tagName, element.className, words, ratio]);
    }
    return found;
})()"""

KEYS = {"Tab": 9, "Enter": 13, "ArrowDown": 40, "ArrowUp": 38, " ": 32}


def press(page, key):
    """Press a key and let it go."""
    text = {"text": "\r"} if key == "Enter" else {}
    for kind in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=KEYS[key],
            **(text if kind == "keyDown" else {}),
        )  # fmt: skip


def size(page, width, height):
    page.call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=width < 500,
    )


def holds_what_every_page_holds(page, path, ready):
    """Opened on a phone and on desktops, folded and unfolded, light and dark.

    ready: that it is drawn.
    """
    for width, height in ((390, 844), (1400, 900), (2560, 1300)):
        size(page, width, height)
        page.open(path.as_uri(), f"document.readyState === 'complete' && ({ready})")
        screens = page.run("document.documentElement.scrollHeight") / height
        assert screens <= 3.0, (
            f"{path.name}: {screens:.2f} screens of {width} px before anything is unfolded"
        )
        page.run("document.querySelectorAll('details').forEach((fold) => { fold.open = true; })")
        page.wait(f"document.documentElement.scrollWidth <= {width}", 20.0)
    assert page.asked_for() == [path.as_uri()]
    for theme in ("Dark", "Light"):
        page.run(f"document.documentElement.dataset.theme === '{theme.lower()}' || "
                 "document.querySelector('[data-tools]').querySelectorAll('button').forEach((one) "
                 "=> "
                 f"{{ if (one.textContent === '{theme}') one.click(); }})")  # fmt: skip
        assert page.run("document.documentElement.dataset.theme") == theme.lower()
        assert page.run(CONTRAST) == [], path.name
    charts = "[...document.querySelectorAll('svg[data-chart], .js-plotly-plot')]"
    assert page.run(
        f"{charts}.every((one) => one.closest('figure').querySelectorAll('.save button').length "
        "=== 3)"
    )
    assert page.problems == []


def saved_table(page, chart):
    """The lines of the CSV that the button of the first chart inside the selector saves."""
    page.run("""(() => { URL.createObjectURL = (blob) => { blob.text().then((text) => { window.savedText = text; });
        return '#'; }; HTMLAnchorElement.prototype.click = function () {}; window.savedText = ''; })()""")
    page.run(
        f"document.querySelector({chart!r}).closest('figure').querySelectorAll('.save "
        "button')[2].click()"
    )
    page.wait("window.savedText")
    return page.run("window.savedText").splitlines()
