#!/usr/bin/env python3
"""The page check must fail on each of these mistakes: planted_mistakes.py GOOD_PAGE.html SCRATCH_FOLDER"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from browser import Browser  # noqa: E402
from check_page import VIEWS, check  # noqa: E402

# what was done, text of the page, its replacement, words the check must say
PLANTED = [
    ("an image from a server", "</h1>", '</h1><img alt="x" src="https://example.org/a.png">',
     "refers to another file"),
    ("a request from a script", "document.querySelectorAll('figure.chart').forEach(build);",
     "document.querySelectorAll('figure.chart').forEach(build); fetch('https://example.org/');", "console"),
    ("an exception", "document.querySelectorAll('figure.chart').forEach(build);", "build(null);", "console"),
    ("a wide element", "</header>", '<div style="width:600px;height:9px;background:red"></div></header>',
     "scrolls sideways"),
    ("pale text", "--soft: #545c66", "--soft: #a0a6ad", "contrast"),
    ("pale curves", "--c0: #0063a8", "--c0: #cfe4f5", "of curve"),
    ("a stretched path", "if (!options.on) return;", "return;", "is stretched"),
    ("invisible curves", "showLine: true", "showLine: false", "cannot be seen"),
    ("a chart without words", 'aria-label="The sample', 'data-label="The sample', "says nothing"),
]


def main():
    good, folder = sys.argv[1:3]
    os.makedirs(folder, exist_ok=True)
    with open(good, encoding="utf-8") as file:
        text = file.read()
    failed = 0
    with Browser() as browser:
        for number, (what, old, new, words) in enumerate(PLANTED):
            if old not in text:
                print(f"FAILED {what}: the page no longer holds {old!r}")
                failed += 1
                continue
            path = os.path.join(folder, f"{number}.html")
            with open(path, "w", encoding="utf-8") as file:
                file.write(text.replace(old, new))
            wrong = check(path, views=VIEWS[:1], browser=browser)
            if not any(words in line for line in wrong):
                print(f"FAILED {what} was not seen; the check said {wrong}")
                failed += 1
            else:
                print(f"seen: {what}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
