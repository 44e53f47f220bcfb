"""What a report says, read back from its page and from its sheets."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pypdfium2 as pdfium

SAID_IN = ("h1", "h2", "p", "dt", "dd", "th", "td", "figcaption")
# Links of the page to itself and to its downloads, and what enlarges a figure, have no place on paper.
ON_THE_PAGE_ONLY = ("nav", "a", "button", "fieldset", "summary", "style", "title")


class _Texts(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.open, self.found = [], []
        self.feed(page)

    def handle_starttag(self, tag, _):
        if tag not in ("meta", "link", "img", "input"):
            self.open.append(tag)
            if tag in SAID_IN:
                self.found.append([])

    def handle_endtag(self, _):
        self.open.pop()

    def handle_data(self, data):
        if not set(self.open).isdisjoint(SAID_IN) and set(self.open).isdisjoint(ON_THE_PAGE_ONLY):
            self.found[-1].append(data)


def texts_of_page(page: str) -> list[str]:
    """Letters of every element of a page that says something, without what only a page has."""
    return [text for text in (letters("".join(parts)) for parts in _Texts(page).found) if text]


def letters(text: str) -> str:
    """Text without what setting it may change: white space, and the marks of a word that is broken."""
    return re.sub(r"[\s\u200b\ufffe]+", "", text)


def letters_of_sheets(content: bytes | Path) -> str:
    """All letters of a PDF, read by PDFium."""
    document = pdfium.PdfDocument(content)
    return letters("".join(page.get_textpage().get_text_bounded() for page in document))
