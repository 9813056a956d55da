"""Write the catalogue as a page: ``python -m phaselead.report.catalogue_page [docs]``.

With ``--check`` it says what is stale instead."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Mapping
from pathlib import Path

from phaselead.drawing import to_svg
from phaselead.model import Derived, Effect, Parameter, Place, catalogue
from phaselead.record import write_text
from phaselead.report.effect_pictures import CAPTIONS, draw

PLACES = {
    Place.CONVERTER: "output converter",
    Place.TIMING: "between converter and amplifier",
    Place.AMPLIFIER: "amplifier",
    Place.HYSTERESIS: "piezo",
    Place.CREEP: "piezo, slow",
    Place.MECHANICS: "mechanics",
    Place.COUPLING: "between the axes",
    Place.SENSOR: "sensor",
    Place.ENVIRONMENT: "environment",
}
KIND_WORDS = {
    "response": "predicted by the voltage",
    "calibration": "a constant that differs between sessions",
    "disturbance": "predicted by no voltage",
}
HEAD = """# The effects

<!-- Written by python -m phaselead.report.catalogue_page; edit the effect's file in host/phaselead/model/effects/. -->

What `phaselead gap` looks for; an entry says so where its name is not given. Each is one file in
`host/phaselead/model/effects/`, found by its presence: [a new effect is a new file](adding-an-effect.md). They act in
this order, whatever order a stage file lists them in; arrays are volts up to the amplifier and micrometres from the
piezo on:

    {chain}

`U` is the voltage range that the model was fitted on, `X` the quasi-static travel over it ("of range"). Parameters of
role *size* make the effect vanish when they are all 0, those of role *shape* say how it looks. In the figures the model
without the effect is grey, with the effect blue; sizes are exaggerated where the typical one would not be seen.

| effect | acts at | predicted | typical size | compensated |
|---|---|---|---|---|
{rows}
"""
SECTION = """
## {title}

`{name}` · {place} · {kind}

![{title}: {caption}](images/effects/{name}.svg)

*{caption}, with {drawn}*

    {equation}

{source}

| parameter | unit | typical | bounds | role | |
|---|---|---|---|---|---|
{parameters}
{accepts}{derived}
**How it shows**: {shows}.

**What reveals it**: {reveals}.

**Confused with**: {confused}.
{named}
**Compensation**: {compensation}
"""


def page() -> dict[str, str]:
    """Every file of the page by its path under docs."""
    effects = catalogue()
    files = {"effects.md": _markdown(effects)}
    files.update({f"images/effects/{name}.svg": _picture(e) for name, e in effects.items()})
    return files


def stale(docs: Path) -> list[str]:
    """Files under ``docs`` that are missing or differ from what would be written. Coordinates, in tenths of a point,
    may differ by one, as between machines."""
    found = []
    for name, text in page().items():
        path = docs / name
        old = path.read_text("utf-8") if path.is_file() else ""
        if not (_alike(old, text) if name.endswith(".svg") else old == text):
            found.append(name)
    known = {Path(name).name for name in page()}
    found += [
        f"images/effects/{p.name}" for p in sorted((docs / "images/effects").glob("*.svg")) if p.name not in known
    ]
    return found


_NUMBER = re.compile(r"-?\d+\.\d+")


def _alike(old: str, new: str) -> bool:
    if _NUMBER.sub("#", old) != _NUMBER.sub("#", new):
        return False
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return all(a == b or abs(float(a) - float(b)) < 0.15 for a, b in pairs)


def _markdown(effects: Mapping[str, Effect]) -> str:
    in_order = sorted(effects.values(), key=lambda e: (e.place, e.order))
    words = [_chain_word(place, in_order) for place in Place]
    head = HEAD.format(chain="\n      -> ".join(words), rows="\n".join(map(_row, effects.values())))
    return head + "".join(_section(e, effects.values()) for e in effects.values())


def _chain_word(place: Place, in_order: list[Effect]) -> str:
    return f"{PLACES[place]}: " + ", ".join(e.name for e in in_order if e.place == place)


def _row(e: Effect) -> str:
    size = next((p for p in e.sizes if p.typical), e.sizes[0])
    compensated = "yes" if e.compensated else "no"
    link = e.title.lower().replace(" ", "-")
    return f"| [`{e.name}`](#{link}) | {PLACES[e.place]} | {_predicted(e)} | {_value(size)} | {compensated} |"


def _predicted(e: Effect) -> str:
    return {"response": "yes", "calibration": "constant", "disturbance": "no"}[e.kind]


def _section(e: Effect, others: Collection[Effect]) -> str:
    caption = CAPTIONS[e.picture.view]
    names = " and ".join(f"`{name}`" for name in e.accepts)
    return SECTION.format(
        title=e.title,
        name=e.name,
        place=PLACES[e.place],
        kind=KIND_WORDS[e.kind],
        caption=caption[0].upper() + caption[1:],
        drawn=", ".join(f"{name} = {value:g}" for name, value in e.picture.params.items()),
        equation=e.equation,
        source=f"Source: {e.source}.",
        parameters="\n".join(map(_parameter, e.parameters)),
        accepts=f"\nA stage file may give {names} instead.\n" if names else "",
        derived=f"\nReported beside them: {'; '.join(map(_derived, e.derived))}.\n" if e.derived else "",
        shows=e.shows,
        reveals=e.reveals,
        confused=", ".join(f"`{name}`" for name in e.confused_with),
        named=f"\n**Named**: {where}.\n" if (where := _named_where(e, others)) else "",
        compensation=e.compensation,
    )


def _named_where(e: Effect, others: Collection[Effect]) -> str:
    """Where `phaselead gap` does not name it, and what else its name may stand for; "" without either."""
    if e.of_base:
        return "not by `gap`: `phaselead fit` finds it, as a part of the base model"
    if stands_for := " and ".join(f"`{one.name}`" for one in others if one.alone_as == e.name):
        return f"on one axis it stands for {stands_for} too, which one axis cannot tell from it"
    if e.alone_as is None:
        return ""
    known = f"one axis alone cannot tell it from `{e.alone_as}`, which is named"
    # What is looked for where several axes move at once acts in front of the modes that they share.
    return f"only where several axes move at once; {known}" if e.before_modes else f"by no records yet; {known}"


def _parameter(p: Parameter) -> str:
    named = "" if p.known is None else f"; named from {p.known[0]:g} to {p.known[1]:g}"
    return f"| `{p.name}` | {p.unit} | {p.typical:g} | {p.low:g} .. {p.high:g} | {p.role} | {p.doc}{named} |"


def _derived(size: Derived) -> str:
    return f"`{size.name}` ({size.unit}), {size.doc}"


def _value(p: Parameter) -> str:
    return f"{p.name} = {p.typical:g} {p.unit}".removesuffix(" 1")


def _picture(e: Effect) -> str:
    """SVG with coordinates rounded to a tenth of a point and names numbered: some come from memory addresses."""
    text = to_svg(draw(e))
    for i, name in enumerate(dict.fromkeys(re.findall(r'id="(\w?[0-9a-f]{10})"', text))):
        text = text.replace(name, f"n{i}")
    rounded = _NUMBER.sub(lambda found: f"{float(found.group()):.1f}", text)
    return re.sub(r"[ \t]+$", "", rounded, flags=re.MULTILINE).rstrip() + "\n"


def main(arguments: list[str]) -> int:
    """Write the page, or with --check list what is stale and return 1 if anything is."""
    docs = Path(next((a for a in arguments if not a.startswith("-")), "docs"))
    if "--check" in arguments:
        old = stale(docs)
        for name in old:
            print(f"{docs / name} is stale; run: python -m phaselead.report.catalogue_page {docs}", file=sys.stderr)
        return 1 if old else 0
    for name, text in page().items():
        path = docs / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
