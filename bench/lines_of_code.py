"""Lines of code without docstrings, comments and blank lines.

python bench/lines_of_code.py examples/rigcal-radar/src examples/rigcal-minimal/src
"""

import ast
import sys
import tokenize
from pathlib import Path

_EMPTY = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


def lines_of_code(path: Path) -> int:
    """Lines of a Python file that hold a token of code."""
    lines: set[int] = set()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in _EMPTY:
                lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        body = getattr(node, "body", None)
        first = body[0] if isinstance(body, list) and body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            lines -= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def main() -> None:
    """Print one line per folder."""
    for folder in map(Path, sys.argv[1:]):
        count = sum(lines_of_code(path) for path in sorted(folder.rglob("*.py")))
        print(f"{count:5}  {folder}")


if __name__ == "__main__":
    main()
