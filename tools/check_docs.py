"""Check the Markdown files: every relative link and anchor leads somewhere, every decision record is complete.

Prints one line for each fault, with file and line, and exits with status 1; says nothing where all is well.
Addresses on other machines are not looked up: a check must not depend on the network.
"""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parent.parent
RECORD_NAME = re.compile(r"\d{4}-[a-z0-9]+(-[a-z0-9]+)*\.md")
RECORD_HEADINGS = ["Context", "Decision", "Consequences", "What would change our mind"]
FENCE = re.compile(r"\s*(```|~~~)")
HEADING = re.compile(r"#{1,6}\s+(?P<text>.*?)\s*#*\s*$")
HTML_ANCHOR = re.compile(r"<\w+[^>]*\b(?:id|name)=\"([^\"]+)\"")
INLINE_LINK = re.compile(r"\]\(\s*<?(?P<target>[^()\s<>]+(?:\([^()\s]*\)[^()\s<>]*)?)>?(?:\s+[\"'][^)]*)?\)")
REFERENCE_LINK = re.compile(r"^\s{0,3}\[[^\]]+\]:\s+<?(?P<target>[^\s<>]+)>?")
HTML_LINK = re.compile(r"\b(?:src|href|srcset)=\"(?P<target>[^\"]+)\"")
ELSEWHERE = re.compile(r"[a-z][a-z0-9+.-]*:|//", re.IGNORECASE)


def markdown_files(root: Path) -> list[Path]:
    """Return the Markdown files below `root` that git knows or would add, sorted; without git, all but the hidden ones."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--", "*.md"]
    try:
        answer = subprocess.run(listing, cwd=root, capture_output=True, check=True)
        names = [name.decode() for name in answer.stdout.split(b"\0") if name]
    except (OSError, subprocess.CalledProcessError):
        names = [path.relative_to(root).as_posix() for path in root.rglob("*.md")]
        names = [name for name in names if not any(part.startswith(".") for part in name.split("/"))]
    return sorted(root / name for name in names if (root / name).is_file())


def prose(path: Path) -> list[tuple[int, str]]:
    """Return the numbered lines (from 1) of a Markdown file, those inside fenced code left out."""
    lines, inside = [], False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if FENCE.match(line):
            inside = not inside
        elif not inside:
            lines.append((number, line))
    return lines


def headings(path: Path) -> list[str]:
    """Return the texts of a Markdown file's headings, in order."""
    return [match["text"] for _, line in prose(path) if (match := HEADING.match(line))]


def anchors(path: Path) -> set[str]:
    """Return what may follow `#` in a link to a Markdown file: its headings' slugs and its own HTML anchors.

    A slug is made as code hosts make it: lower case, markup and punctuation dropped, spaces to hyphens; the second
    heading with the same slug gets `-1`, the third `-2`.
    """
    found: set[str] = set()
    for text in headings(path):
        text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
        slug = re.sub(r"[^\w\- ]", "", text.replace("`", "").lower()).strip().replace(" ", "-")
        candidates = [slug, *(f"{slug}-{again}" for again in range(1, len(found) + 1))]
        found.add(next(candidate for candidate in candidates if candidate not in found))
    return found.union(*(HTML_ANCHOR.findall(line) for _, line in prose(path)))


def link_targets(line: str) -> list[str]:
    """Return where the links and images of one line of Markdown lead; code spans are no links."""
    line = re.sub(r"`[^`]*`", "", line)
    return [
        match["target"] for kind in (INLINE_LINK, REFERENCE_LINK, HTML_LINK) for match in kind.finditer(line)
    ]


def broken_links(path: Path, root: Path) -> list[str]:
    """Return one line for each link in the Markdown file `path` that leads to no file below `root` or to no anchor."""
    broken = []
    for number, line in prose(path):
        for target in link_targets(line):
            if ELSEWHERE.match(target):
                continue
            name, _, anchor = unquote(target).partition("#")
            goal = (path.parent / name).resolve() if name else path
            where = f"{path.relative_to(root).as_posix()}:{number}"
            if not goal.exists() or not goal.is_relative_to(root):
                broken.append(f"{where}: no such file: {target}")
            elif anchor and goal.suffix == ".md" and anchor not in anchors(goal):
                broken.append(
                    f"{where}: no such heading: {target}; there are: {', '.join(sorted(anchors(goal)))}"
                )
    return broken


def incomplete_records(folder: Path) -> list[str]:
    """Return one line for each decision record in `folder` whose name, title or headings are not as agreed."""
    wrong: list[str] = []
    numbers: dict[str, str] = {}
    for path in sorted(folder.glob("*.md")):
        if not RECORD_NAME.fullmatch(path.name):
            wrong.append(
                f"{path.name}: a decision record is called NNNN-title.md, in lower case with hyphens"
            )
            continue
        other = numbers.setdefault(path.name[:4], path.name)
        if other != path.name:
            wrong.append(f"{path.name}: its number is taken by {other}")
        if headings(path)[1:] != RECORD_HEADINGS:
            wrong.append(
                f"{path.name}: expected a title, then the headings {', '.join(RECORD_HEADINGS)}; got {headings(path)}"
            )
    return wrong


def problems(root: Path = ROOT) -> list[str]:
    """Return everything that is wrong with the Markdown files below `root`, one line each."""
    root = root.resolve()
    links = [fault for path in markdown_files(root) for fault in broken_links(path, root)]
    return links + incomplete_records(root / "docs" / "decisions")


if __name__ == "__main__":
    found = problems()
    print("\n".join(found), end="\n" if found else "")
    sys.exit(1 if found else 0)
