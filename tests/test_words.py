"""Docstrings and ``#:`` comments read as plain prose: no dangling first word, and no sentence of more than 30 words."""

import ast
import functools
import io
import re
import tokenize

import pytest
from places import ROOT

SOURCES = [
    path
    for folder in ("sins_env", "solvers", "benchmarks", "examples")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
#: Every Markdown page of the repository.
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *(path for folder in ("docs", "examples", "reproduction") for path in sorted((ROOT / folder).rglob("*.md"))),
]
MOST_WORDS = 30

DANGLING = re.compile(r"(of|by|as|where)\b", re.IGNORECASE)
SECTION = re.compile(r"(Args|Arguments|Attributes|Examples?|Raises|Returns|Yields):$")
BULLET = re.compile(r"([-*]|\d+\.)\s+")
TABLE_ROW = re.compile(r"\S {2,}\S")
BORDER = re.compile(r"(?<=[.!?])[\"')\]]*\s+(?=[\"'(\[`]*[A-Z`])")
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|cf|vs|eqs?|sec|fig|no|ch|pp?|al|resp)\.$", re.IGNORECASE)
CODE = re.compile(r"(:\w+:)?(``.*?``|`.*?`)|https?://\S+|docs/\S+", re.DOTALL)
CITATION = re.compile(r"(docs/[\w/]+\.md)(?:#([\w-]+))?")
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
BARE_PAGE = re.compile(r"(?<![\w/])\w+\.md\b")
WORD = re.compile(r"[A-Za-z][A-Za-z'-]*[a-z]")


def blocks(text):
    """Yield the paragraphs and bullets of a docstring, each as one line; sections, tables and indented formulas are left out."""
    block, in_section, in_bullet = [], False, False
    for line in [*text.expandtabs().split("\n"), ""]:
        bare, indented = line.strip(), line.startswith(" ")
        starts = bool(BULLET.match(bare)) and not in_section
        in_section = bool(SECTION.match(bare)) or (in_section and (indented or not bare))
        prose = bool(bare) and not in_section and (not indented or in_bullet) and not TABLE_ROW.search(bare)
        if block and (starts or not prose):
            yield " ".join(block)
            block = []
        in_bullet = starts or (in_bullet and prose)
        if prose or starts:
            block.append(BULLET.sub("", bare, count=1) if starts else bare)


def sentences(text):
    """Yield the sentences of a docstring's prose."""
    for block in blocks(text):
        begin = 0
        for border in BORDER.finditer(block):
            if not ABBREVIATION.search(block[: border.start()]):
                yield block[begin : border.end()].strip()
                begin = border.end()
        yield block[begin:].strip()


def count_words(sentence):
    """Return the number of words; a piece of code counts as one, a symbol of a formula as none."""
    return len([token for token in CODE.sub(" code ", sentence).split() if WORD.search(token)])


def docstrings(tree):
    """Yield the line and the text of each docstring of a module."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        if isinstance(node, kinds) and (text := ast.get_docstring(node)):
            yield node.body[0].lineno, text


def attribute_comments(source):
    """Yield the line and the text of each ``#:`` comment; lines that follow one another make one comment."""
    begin, lines, last = 0, [], -1
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or not token.string.startswith("#:"):
            continue
        number, own_line = token.start[0], token.line.lstrip().startswith("#:")
        if lines and not (own_line and number == last + 1):
            yield begin, " ".join(lines)
            lines = []
        begin = begin if lines else number
        lines.append(token.string[2:].strip())
        last = number if own_line else -1
    if lines:
        yield begin, " ".join(lines)


def faults(source):
    """Return what is wrong with the words of a module, one line each."""
    texts = [*docstrings(ast.parse(source)), *attribute_comments(source)]
    found = []
    for line, text in sorted(texts):
        for sentence in sentences(text):
            words = count_words(sentence)
            if dangling := DANGLING.match(sentence):
                found.append(f"{line}: begins with {dangling[0]!r}: {sentence}")
            if words > MOST_WORDS:
                found.append(f"{line}: {words} words: {sentence}")
    return found


def test_sentences_are_plain():
    """No sentence begins with Of, By, As or Where, or has more than 30 words."""
    breaches = []
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        breaches += [f"{name}:{fault}" for fault in faults(path.read_text("utf-8"))]
    assert not breaches, "\n" + "\n".join(breaches)


LONG = " ".join(["word"] * 16)


@pytest.mark.parametrize(
    ("doc", "count"),
    [
        ("Whole. Of each run the mean.", 1),
        ("Return the mean, of each run.", 0),
        (f"Begin {LONG} {LONG}.", 1),
        (f"Begin {LONG}. Then {LONG}.", 0),
        (f"Begin {LONG}, e.g. Kalman's {LONG}.", 1),
        (f"Use\n\n    where {LONG} {LONG}\n\nonly.", 0),
        (f"Do it.\n\nRaises:\n    ValueError: where {LONG} {LONG}.", 0),
        (f"Do it.\n\nRaises:\n    ValueError: never.\n\nAs {LONG}.", 1),
        (f"Do it:\n\n- one {LONG};\n- two {LONG}.", 0),
        (f"Do it:\n\n- where one {LONG}\n  {LONG}.", 2),
        ("Do it: ``of a b`` is code.", 0),
    ],
)
def test_faults_of_docstrings(doc, count):
    source = f"def function():\n    {doc!r}\n"
    assert len(faults(source)) == count


def test_faults_of_comments():
    source = "A = 1  #: of each run\nB = 2  #: share of runs\n#: The first line\n#: of a comment.\nC = 3\n"
    assert faults(source) == ["1: begins with 'of': of each run"]


@functools.cache
def anchors(page):
    """Return the anchors of the headings of a Markdown page, in GitHub's spelling."""
    headings = re.findall(r"^#+ +(.*)$", FENCED.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


def test_cited_pages_exist():
    """Whatever code cites, and whatever a page links to, is a file of the repository, with the section that is named."""
    cited = [
        (path, ROOT / page, anchor) for path in SOURCES for page, anchor in CITATION.findall(path.read_text("utf-8"))
    ]
    for path in PAGES:
        links = LINK.findall(FENCED.sub("", path.read_text("utf-8")))
        cited += [(path, (path.parent / page).resolve() if page else path, anchor) for page, anchor in links]
    assert len(cited) > 100
    lost = [
        f"{path.relative_to(ROOT)}: {page.name}#{anchor}"
        for path, page, anchor in cited
        if not page.exists() or (anchor and anchor not in anchors(page))
    ]
    # pages elsewhere, an option of benchmarks/peers.py, and a table of evaluation/contest
    others = {"README.md", "REPRODUCTION.md", "given.md", "board.md"}
    for path in SOURCES:
        bare = set(BARE_PAGE.findall(path.read_text("utf-8"))) - others
        lost += [f"{path.relative_to(ROOT)}: {name}" for name in bare]
    assert not lost, "\n" + "\n".join(lost)
