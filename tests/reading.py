"""A report's page as a browser would take it: text, rows of tables, pictures; tags that do not close are an error."""

from html.parser import HTMLParser

ALONE = {"meta", "img", "link", "br"}


class Reading(HTMLParser):
    """Content of a page.

    Args:
        page: its HTML.
    """

    def __init__(self, page: str):
        super().__init__()
        self.open: list[str] = []
        self.text, self.rows, self.pictures, self.attributes = "", [], 0, []
        self.feed(page)
        self.close()
        assert self.open == [], f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *attribute) for attribute in attrs]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self.pictures += tag == "img" and dict(attrs)["src"].startswith("data:image/png;base64,")
        if tag not in ALONE:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
        if "style" not in self.open and self.open != ["html"]:
            self.text = (self.text + data).rstrip(" ") if data.strip() else self.text
