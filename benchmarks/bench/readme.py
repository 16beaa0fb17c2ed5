"""The README's short table: what `results.md` says, one row for each thing that was measured."""

from __future__ import annotations

BEGIN, END = "<!-- measured -->\n", "<!-- end of measured -->\n"
_HEADERS = "| measured | here | times better than (below 1: worse) |\n| --- | --- | --- |\n"


def short_table(results: str) -> str:
    """The first table of `results.md` with the peers of a row together, and no spreads."""
    ours: dict[str, str] = {}
    beside: dict[str, list[str]] = {}
    for cells in _first_table(results):
        name, here, unit, peer, _, ratio, _ = cells
        ours[name] = here.partition(" (")[0] + ("" if unit == "1" else f" {unit}")
        if ratio != "–":
            beside.setdefault(name, []).append(f"{peer}: {ratio}")
    rows = [f"| {name} | {value} | {'; '.join(beside.get(name, ['–']))} |\n" for name, value in ours.items()]
    return _HEADERS + "".join(rows)


def with_table(readme: str, results: str) -> str:
    """The README with that table between its two marks. Raises `ValueError` where they are missing."""
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"README.md: has no lines {BEGIN.strip()} and {END.strip()}")
    return f"{before}{BEGIN}{short_table(results)}{END}{after}"


def _first_table(results: str) -> list[list[str]]:
    lines = results.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("| --- ")) + 1
    found = []
    for line in lines[start:]:
        if not line.startswith("| "):
            break
        found.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return found
