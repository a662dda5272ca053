#!/usr/bin/env python3
"""Checks a page as its readers see it: headless Chromium without a network, at a phone's and a desktop's
width, in light and dark. Exit status 0 when nothing is wrong; else each mistake is a line.

    check_page.py PAGE.html [--screenshots FOLDER]
"""
import argparse
import contextlib
import html.parser
import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from browser import Browser, BrowserError  # noqa: E402

VIEWS = [("phone-light", 390, 844, False, True), ("phone-dark", 390, 844, True, True),
         ("desktop-light", 1280, 900, False, False), ("desktop-dark", 1280, 900, True, False)]
LARGEST_BYTES = 2_000_000
LEAST_CONTRAST = 4.5       # WCAG 2.1 AA for text
LEAST_LINE_CONTRAST = 3.0  # and for what must be seen in a graphic


class References(html.parser.HTMLParser):
    """Collects what would make a browser ask for another file, and what the markup lacks."""

    def __init__(self):
        super().__init__()
        self.found = []
        self.mistakes = []
        self._style = False
        self._ids = set()

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        for name in ("src", "srcset", "href", "data", "action", "poster", "xlink:href", "formaction"):
            value = values.get(name)
            if value and not value.startswith(("#", "data:")):
                self.found.append(f"<{tag} {name}={value!r}>")
        if "style" in values:
            self._css(values["style"])
        if tag == "html" and not values.get("lang"):
            self.mistakes.append("the page names no language")
        if tag == "img" and "alt" not in values:
            self.mistakes.append("an image without a text")
        if values.get("id") in self._ids:
            self.mistakes.append(f"the id {values['id']} is there twice")
        if values.get("id"):
            self._ids.add(values["id"])
        self._style = tag == "style"

    def handle_endtag(self, tag):
        self._style = False

    def handle_data(self, data):
        if self._style:
            self._css(data)

    def _css(self, text):
        self.found += re.findall(r"@import[^;]*", text)
        self.found += [u for u in re.findall(r"url\(\s*['\"]?([^)'\"]*)", text) if not u.startswith("data:")]


# Runs in the page; returns everything the checks need.
# Whether each curve can be seen costs a redrawing of each; two of the four views do that.
THOROUGH = {"phone-light", "desktop-dark"}

LOOK = r"""
(async () => {
  // charts of a page that is still being laid out
  await new Promise((r) => setTimeout(r, 30));
  const luminance = ([r, g, b]) => {
    const part = (c) => ((c /= 255) <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
  };
  const pen = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const parse = (text) => {
    pen.clearRect(0, 0, 1, 1);
    pen.fillStyle = text;
    pen.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const ratio = (a, b) => {
    const [x, y] = [luminance(a), luminance(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const background = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = parse(getComputedStyle(e).backgroundColor);
      if (colour[3] > 0.99) return colour;
    }
    return parse(matchMedia('(prefers-color-scheme: dark)').matches ? '#121212' : '#fff');
  };
  for (const details of document.querySelectorAll('details')) details.dataset.was = details.open;
  const result = { title: document.title, contrasts: [], charts: [], over: [], text: 0 };
  const seen = new Map();
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    if (!walk.currentNode.textContent.trim() || !element.checkVisibility()) continue;
    if (['SCRIPT', 'STYLE', 'NOSCRIPT'].includes(element.tagName)) continue;
    result.text += 1;
    const css = getComputedStyle(element);
    const key = element.tagName + '.' + element.className + css.color + background(element);
    if (seen.has(key)) continue;
    const value = ratio(parse(css.color), background(element));
    seen.set(key, value);
    result.contrasts.push({ what: element.tagName.toLowerCase() + (element.className ? '.' + element.className : ''),
      text: walk.currentNode.textContent.trim().slice(0, 40), size: parseFloat(css.fontSize), ratio: value });
  }
  const width = document.documentElement.clientWidth;
  result.width = width;
  result.scroll_width = document.documentElement.scrollWidth;
  for (const element of document.querySelectorAll('body *')) {
    const box = element.getBoundingClientRect();
    if (box.width > 0 && box.right > width + 1 && !element.closest('.table')) {
      result.over.push(element.tagName.toLowerCase() + '.' + element.className + ' ends at ' + box.right);
    }
  }
  result.tables_without_headers = [...document.querySelectorAll('table')].filter((table) =>
    !table.querySelector('caption') || !table.querySelector('thead th[scope=col]')).length;
  result.small_buttons = [...document.querySelectorAll('button')].filter((b) => b.checkVisibility()
    && b.getBoundingClientRect().height < 22).length;
  const drawn = window.reportCharts || [];
  result.figures = document.querySelectorAll('figure.chart').length;
  for (const figure of document.querySelectorAll('figure.chart')) {
    const canvas = figure.querySelector('canvas');
    const chart = drawn.find((c) => c.canvas === canvas);
    const look = { title: figure.querySelector('h3').textContent, label: canvas.getAttribute('aria-label') || '',
      drawn: !!chart };
    result.charts.push(look);
    if (!chart) continue;
    const box = canvas.getBoundingClientRect();
    const area = chart.chartArea;
    Object.assign(look, { width: box.width, height: box.height,
      plot_width: area.right - area.left, plot_height: area.bottom - area.top });
    const scale = canvas.width / box.width;
    const copy = document.createElement('canvas');
    copy.width = canvas.width;
    copy.height = canvas.height;
    const copied = copy.getContext('2d', { willReadFrequently: true });
    const look_at = () => {
      copied.clearRect(0, 0, copy.width, copy.height);
      copied.drawImage(canvas, 0, 0);
      return copied.getImageData(area.left * scale, area.top * scale,
        look.plot_width * scale, look.plot_height * scale).data;
    };
    const pixels = look_at();
    const paper = background(figure);
    look.lines = chart.data.datasets.map((set, i) => {
      if (set.ww.area || !chart.isDatasetVisible(i)) return null;
      const seen = { name: set.label, points: set.data.length, contrast: ratio(parse(set.borderColor), paper) };
      if (!window.lookThoroughly) return seen;
      // without this curve, how many pixels look different?
      const held = ['x', 'y'].map((name) => [chart.options.scales[name], chart.scales[name]]).map(
        ([options, now]) => ({ options, before: { min: options.min, max: options.max },
          now: { min: now.min, max: now.max } }));
      for (const { options, now } of held) Object.assign(options, now);
      chart.setDatasetVisibility(i, false);
      chart.update('none');
      const without = look_at();
      chart.setDatasetVisibility(i, true);
      for (const { options, before } of held) Object.assign(options, before);
      chart.update('none');
      let count = 0;
      for (let p = 0; p < pixels.length; p += 4) {
        if (Math.abs(pixels[p] - without[p]) + Math.abs(pixels[p + 1] - without[p + 1])
            + Math.abs(pixels[p + 2] - without[p + 2]) + Math.abs(pixels[p + 3] - without[p + 3]) > 60) count += 1;
      }
      return { ...seen, pixels: count };
    });
    const distinct = new Set();
    for (let p = 0; p < pixels.length; p += 4) {
      distinct.add((pixels[p] << 16) + (pixels[p + 1] << 8) + pixels[p + 2] + pixels[p + 3] / 256);
    }
    look.distinct = distinct.size;
    const axis = (s) => ({ min: s.min, max: s.max, ticks: s.ticks.filter((t) => t.label).length,
      crooked: s.type === 'linear' && s.ticks.some((t) => String(t.label).replace(/[^0-9]/g, '').length > 5),
      title: s.options.title.text });
    look.x = axis(chart.scales.x);
    look.y = axis(chart.scales.y);
    look.equal = chart.options.plugins.equal.on;
  }
  return result;
})()
"""


def judge(name, look, page):
    """The mistakes in one view."""
    wrong = []
    wrong += [f"console: {message}" for message in page.messages]
    outside = [r for r in page.requests if not r.startswith(("file:", "data:"))]
    wrong += [f"asks for {address}" for address in outside]
    if sum(r.startswith("file:") for r in page.requests) > 1:
        wrong.append(f"needs other files: {page.requests}")
    if look["scroll_width"] > look["width"]:
        wrong.append(f"scrolls sideways: {look['scroll_width']} px in {look['width']}; {look['over'][:5]}")
    if look["text"] < 10:
        wrong.append("hardly any text")
    if look["tables_without_headers"]:
        wrong.append(f"{look['tables_without_headers']} tables without caption or column headings")
    if look["small_buttons"]:
        wrong.append(f"{look['small_buttons']} buttons too small for a finger")
    for item in look["contrasts"]:
        if item["ratio"] < LEAST_CONTRAST:
            wrong.append(f"contrast {item['ratio']:.2f} in {item['what']} ({item['text']!r})")
        if item["size"] < 11:
            wrong.append(f"letters of {item['size']} px in {item['what']} ({item['text']!r})")
    for chart in look["charts"]:
        title = chart["title"]
        if not chart["label"]:
            wrong.append(f"chart {title!r} says nothing to who cannot see it")
        if not chart["drawn"]:
            wrong.append(f"chart {title!r} was not drawn")
            continue
        if chart["plot_width"] < 200 or chart["plot_height"] < 120:
            wrong.append(f"chart {title!r} is {chart['plot_width']:.0f} by {chart['plot_height']:.0f} px")
        if chart["distinct"] < 3:
            wrong.append(f"chart {title!r} is blank")
        for line in filter(None, chart["lines"]):
            if line["points"] and line.get("pixels", 6) < 6:
                wrong.append(f"curve {line['name']!r} of {title!r} cannot be seen")
            if line["contrast"] < LEAST_LINE_CONTRAST:
                wrong.append(f"contrast {line['contrast']:.2f} of curve {line['name']!r} in {title!r}")
        for axis in (chart["x"], chart["y"]):
            if axis["ticks"] < 2:
                wrong.append(f"an axis of {title!r} ({axis['title']}) has fewer than two numbers")
            if axis["crooked"]:
                wrong.append(f"the numbers of an axis of {title!r} ({axis['title']}) are not round")
            if not axis["title"]:
                wrong.append(f"an axis of {title!r} has no name")
        if chart["equal"]:
            x = (chart["x"]["max"] - chart["x"]["min"]) / chart["plot_width"]
            y = (chart["y"]["max"] - chart["y"]["min"]) / chart["plot_height"]
            if abs(x / y - 1) > 0.02:
                wrong.append(f"{title!r} is stretched by {abs(x / y - 1):.1%}")
    return [f"{name}: {text}" for text in wrong]


def check(path, screenshots=None, views=VIEWS, browser=None):
    wrong = []
    size = os.path.getsize(path)
    if size > LARGEST_BYTES:
        wrong.append(f"the file has {size} bytes, more than {LARGEST_BYTES}")
    with open(path, encoding="utf-8") as file:
        references = References()
        references.feed(file.read())
    wrong += [f"refers to another file: {found}" for found in references.found] + references.mistakes
    with contextlib.ExitStack() as stack:
        browser = browser or stack.enter_context(Browser())
        for name, width, height, dark, phone in views:
            page = browser.open(path, width, height, dark, phone)
            page.evaluate(f"window.lookThoroughly = {'true' if name in THOROUGH else 'false'}")
            look = page.evaluate(LOOK)
            wrong += judge(name, look, page)
            if screenshots:
                os.makedirs(screenshots, exist_ok=True)
                page.screenshot(os.path.join(screenshots, name + ".png"))
            least = min((c["ratio"] for c in look["contrasts"]), default=0)
            print(f"{name}: {len(look['charts'])} charts, {look['text']} texts, least contrast {least:.1f}, "
                  f"width {look['scroll_width']} of {look['width']} px")
            page.close()
    print(f"{size / 1e6:.2f} MB")
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page")
    parser.add_argument("--screenshots", metavar="FOLDER")
    arguments = parser.parse_args()
    try:
        wrong = check(arguments.page, arguments.screenshots)
    except (OSError, BrowserError) as error:
        print(error)
        return 1
    for line in wrong:
        print("WRONG", line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
