"""A headless browser, if there is one on the path: what pages measure in it, narrow, wide and in print.

No package of Python brings a browser, so ``make test`` alone has none; there pages are read instead (tests/reading.py).
"""

import html
import json
import re
import shutil
import subprocess

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PROGRAM = next(filter(None, map(shutil.which, NAMES)), None)
NARROW, WIDE = 390, 1200  # [pixel]
OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files")
_MEASURE = """<body><script>
const jobs = PAGES.flatMap(page => WIDTHS.map(width => [page, width]));
Promise.all(jobs.map(([page, width]) => new Promise(done => {
  const frame = document.createElement("iframe");
  frame.style = `width: ${width}px; height: 800px`;
  frame.onload = () => setTimeout(() => {
    const inner = frame.contentDocument, root = inner.documentElement;
    const pictures = [...inner.images].map(image => image.naturalWidth);
    const shown = inner.body.dataset.shown ?? null, canvases = [...inner.querySelectorAll("canvas")];
    const ink = canvases.map(c => c.getContext("2d").getImageData(0, 0, c.width, c.height).data.some(x => x > 0));
    const tops = canvases.map(c => c.getBoundingClientRect().top);
    done({width, content: root.scrollWidth, text: inner.body.innerText, scripts: inner.scripts.length, pictures,
          shown, ink, rows: new Set(tops).size});
  }, 500);
  frame.src = page;
  document.body.append(frame);
}))).then(found => { document.body.replaceChildren(JSON.stringify(found)); document.body.id = "measured"; });
</script>
"""


def measured(folder, pages):
    """Measurements of pages (paths) in a browser, narrow and wide, page by page."""
    outer = folder / "measure.html"
    addresses = json.dumps([page.resolve().as_uri() for page in pages])
    outer.write_text(_MEASURE.replace("PAGES", addresses).replace("WIDTHS", json.dumps([NARROW, WIDE])), "utf-8")
    dumped = _run(folder, "--virtual-time-budget=20000", "--dump-dom", outer.as_uri())
    body = re.search(r'<body id="measured">(.*)</body>', dumped, flags=re.DOTALL)[1]
    return json.loads(html.unescape(body))


def printed(folder, page):
    """Number of pages that a page is in print."""
    _run(folder, f"--print-to-pdf={folder / 'page.pdf'}", "--no-pdf-header-footer", page.resolve().as_uri())
    return len(re.findall(rb"/Type\s*/Page\b", (folder / "page.pdf").read_bytes()))


def _run(folder, *words):
    command = [PROGRAM, *OPTIONS, f"--user-data-dir={folder / 'profile'}", *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
