"""docs/glossary.md is the law of words: headings and titles of pages, reports and terminals keep to it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fringecal.uncertainty.influences import TEXTS

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "fringecal"
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "procedures").glob("*.md")),
    ROOT / "targets" / "README.md",
]
TITLED = ("workflows", "report", "cli", "records")  # rooms whose strings people read as titles
TABULAR = ("workflows", "report")  # of these, the rooms whose dicts become tables and not files

# Calls whose first argument, title, caption or name is read by people.
TITLES = {
    "Section", "Table", "FigureItem", "Report", "Fact", "Check", "Column", "add_column",
    "set_title", "suptitle", "set_xlabel", "set_ylabel", "set_label",
}  # fmt: skip
SPOKEN = {"title", "caption", "name"}

# English that needs no definition. A word that a metrologist would look up belongs into the glossary instead.
PLAIN = set(
    """
    a about above accept across added administration after against all alone along also amount an and any apart
    appended are as at average axis bad bare be before beforehand below bench beside best between beyond both
    browser but by calibrated call can cannot captured changed checked choosing chosen closed column come
    command compared compares conditionalfail conditionalpass constant contain convention corner could counted
    cover customer data database date day days decision default deg degc depart descent design difference
    distance do does done drawn each end enlarged entry environment every exception fail fails fast figure file
    find first fitted five folder following for formula found fringecal from full further geometry glossary good
    here horizontal house how identification if in info input is issued it item its itself judged kept key kind
    known laboratory large largest last later leaf least left less licence like literature look made marked max
    may measure measured measuring middle millimetre min minute month more most moved must name named need
    neglecting new next no none not note notebook now number obeys object of old older on one only or origin other
    otherwise out outside over own page part pass per percent periodic picture piece possible power predicted
    prediction probably program published purpose rad rank read reading real reason refused report result room
    row run same say second see seen server service session several sha share show shows side since small
    smallest smooth so software space state statement status still store such symbol table taken tape
    temperature term test tested than that the their them there these thesis they thing this those three through
    time times to today together too top true turning tutorial twenty two under up use used usual verdict
    version vertical was way what when where whether which who whole whose why will with without word worst
    would year
    """.split()  # noqa: SIM905 read as text, kept as text
)

# Titles of today that break a rule of the glossary. The list may only shrink: who rewords one takes it out.
STILL_TO_REWORD = {
    "scatter of the breaks",
}


# ---- reading the glossary -------------------------------------------------------------------------
def rows_of(table_header: str) -> list[list[str]]:
    """Cells of every table of the glossary that has this header."""
    tables = re.findall(rf"^{re.escape(table_header)}\n\|[-|]+\n((?:\|.*\n)+)", GLOSSARY, flags=re.MULTILINE)
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for rows in tables for line in rows.splitlines()]


TERMS = rows_of("| term | symbol | unit | definition | source |")
UNUSED = rows_of("| not | but | allowed in |")


def words_in(text: str) -> list[str]:
    """Words of three letters and more, without code, possessives and the numbers and symbols between them."""
    text = re.sub(r"`[^`]*`|\[([^\]]*)\]\([^)]*\)", r" \1 ", text)
    return [re.sub(r"'s?$", "", word) for word in re.findall(r"[a-z][a-z']*[a-z']", text.lower()) if len(word) > 2]


def stems(word: str) -> set[str]:
    """The word itself and what it may be the plural of."""
    found = {word}
    if word.endswith("s"):
        found.add(word[:-1])
    if word.endswith("es"):
        found.add(word[:-2])
    if word.endswith("ies"):
        found.add(f"{word[:-3]}y")
    return found


DEFINED = {word for term, *_ in TERMS for word in words_in(term)}


def unknown_words(title: str) -> set[str]:
    """Words of a title that are neither defined nor plain."""
    return {word for word in words_in(title) if stems(word).isdisjoint(DEFINED | PLAIN)}


def any_of(phrases: list[str]) -> str:
    """Pattern that finds any of the phrases, in the singular and the plural."""
    return rf"\b(?:{'|'.join(map(re.escape, phrases))})(?:s|es)?\b"


def unused_words(title: str) -> set[str]:
    """Words of a title that the glossary replaces by others, except where it allows them."""
    found = set()
    for not_these, _, allowed in UNUSED:
        rest = title.lower()
        if exceptions := re.findall(r"`([^`]+)`", allowed):
            rest = re.sub(any_of(exceptions), " ", rest)
        found |= set(re.findall(any_of(re.findall(r"`([^`]+)`", not_these)), rest))
    return found


# ---- reading the titles ---------------------------------------------------------------------------
def texts_of(node: ast.expr) -> Iterator[str]:
    """What a string expression may say, its values as an ellipsis."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(part.value if isinstance(part, ast.Constant) else "…" for part in parts)
        case ast.BinOp(left=left, right=right):
            yield from (*texts_of(left), *texts_of(right))
        case ast.IfExp(body=body, orelse=other):
            yield from (*texts_of(body), *texts_of(other))


def called(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")


def titles_of(tree: ast.Module, *, keys: bool = True) -> Iterator[str]:
    """Titles, captions, names of checks and facts, axis labels, headings of columns; the last also as keys of dicts."""
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            spoken = [word.value for word in node.keywords if word.arg in SPOKEN]
            if called(node) in TITLES:
                for one in (*node.args[:1], *spoken):
                    yield from texts_of(one)
            for word in node.keywords:
                if word.arg == "columns" and isinstance(word.value, ast.List | ast.Tuple):
                    yield from (text for one in word.value.elts for text in texts_of(one))
        elif isinstance(node, ast.Dict) and keys and "DataFrame" in names:
            texts = (text for key in node.keys if key is not None for text in texts_of(key))
            yield from filter(is_a_heading, texts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and has_a_unit(node.value):
            yield node.value


def is_a_heading(key: str) -> bool:
    """Whether a key is for people: keys of files and of functions have underscores or points."""
    return re.search(r"[_.]", key) is None


def has_a_unit(text: str) -> bool:
    """Whether a text is a label with its unit: "angle / deg"."""
    return re.fullmatch(r"[A-Za-z][\w ,'()=-]{0,50} / \(?[A-Za-z%][\w/^]{0,6}\)?", text) is not None


def all_titles() -> dict[str, str]:
    """Every title with the place where it stands; the sources of uncertainty head the rows of budgets."""
    found = dict.fromkeys(TEXTS.values(), "uncertainty/influences.py")
    for page in PAGES:
        text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for heading in re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE):
            found.setdefault(heading, page.relative_to(ROOT).as_posix())
    for room in TITLED:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            place = path.relative_to(PACKAGE).as_posix()
            for title in titles_of(ast.parse(path.read_text(encoding="utf-8")), keys=room in TABULAR):
                found.setdefault(title, place)
    return found


ALL_TITLES = all_titles()


def breaks_a_rule(title: str) -> bool:
    return bool(unused_words(title) or unknown_words(title))


# ---- the glossary itself --------------------------------------------------------------------------
@pytest.mark.parametrize("row", TERMS, ids=lambda row: row[0])
def test_a_term_is_defined_whole(row):
    """Every cell is filled; only symbol and unit may be a dash."""
    assert len(row) == 5, row
    assert all(row), row
    assert "–" not in {row[0], row[3], row[4]}
    assert words_in(row[3]), "a definition says what the thing is"


def test_no_term_is_defined_twice():
    terms = [term for row in TERMS for term in row[0].split(", ")]
    assert sorted({term for term in terms if terms.count(term) > 1}) == []


def test_a_source_says_where():
    """A clause, a standard with its year, the literature at the end of the page, or a page of this project."""
    literature = {name for name, _ in rows_of("| named here | published as |")}
    for term, *_, source in TERMS:
        for one in re.split(r", (?=[A-Z\[])", source):
            known = re.search(r"VIM \d|GUM [A-H\d]|JCGM \d+:\d{4}|ISO|VDI/VDE|AIAG|ILAC|EMVA|this project|\]\(", one)
            assert known or one in literature, f"{term}: {one}"
        if source.startswith("this project"):
            assert "](" in source, f"{term}: the page that derives it is linked"


def test_the_literature_is_used():
    used = " ".join(source for *_, source in TERMS)
    assert [name for name, _ in rows_of("| named here | published as |") if name not in used] == []


@pytest.mark.parametrize("row", UNUSED, ids=lambda row: row[0])
def test_a_word_that_is_not_used_has_another(row):
    assert len(row) == 3
    assert all(row)
    assert unused_words(" ".join(re.findall(r"`([^`]+)`", row[2]))) == set()


def test_the_glossary_keeps_its_own_rules():
    assert {term: unused_words(term) for term, *_ in TERMS if unused_words(term)} == {}


# ---- the titles -----------------------------------------------------------------------------------
def test_titles_use_the_words_of_the_glossary():
    wrong = {
        title: (place, sorted(unused_words(title) | unknown_words(title)))
        for title, place in ALL_TITLES.items()
        if breaks_a_rule(title) and title not in STILL_TO_REWORD
    }
    assert wrong == {}, "reword them, or define the word in docs/glossary.md"


def test_the_list_of_titles_to_reword_only_shrinks():
    done = {title for title in STILL_TO_REWORD if title not in ALL_TITLES or not breaks_a_rule(title)}
    assert done == set(), "these are reworded: take them off STILL_TO_REWORD"


@pytest.mark.parametrize(
    ("title", "unused"),
    [
        ("Phase steps", {"phase steps"}),
        ("Step block, 5 to 50 mm", set()),
        ("mean shift / mm", {"shift"}),
        ("mean fringe shift / mm", set()),
        ("Lamp drift", set()),
        ("lamp moved", {"lamp"}),
        ("Numbers and their doubt", {"doubt"}),
    ],
)
def test_the_reader_of_words_sees_what_is_not_used(title, unused):
    assert unused_words(title) == unused


@pytest.mark.parametrize(
    ("title", "unknown"),
    [
        ("Phase differences of the strips / rad", set()),
        ("Heights from the etalon", {"etalon"}),
        ("The key `etalon` of a table", {"key", "table"} - PLAIN),
    ],
)
def test_the_reader_of_words_sees_what_is_not_defined(title, unknown):
    assert unknown_words(title) == unknown


@pytest.mark.parametrize(
    ("code", "titles"),
    [
        ("Section('Where it changed', ())", ["Where it changed"]),
        ("Table(f'Change of {name}', frame)", ["Change of …"]),
        ("FigureItem('a' if x else 'b', figure)", ["a", "b"]),
        ("pd.DataFrame({'mean error': [1]})", ["mean error"]),
        ("pd.DataFrame(rows, columns=['method', 'what was done'])", ["method", "what was done"]),
        ("NAMES = {'angle_deg': 'angle / deg'}", ["angle / deg"]),
        ("ask('either / or not')", []),
        ("{'no table': 1}", []),
    ],
)
def test_the_reader_of_titles_sees_them(code, titles):
    assert list(titles_of(ast.parse(code))) == titles
