"""Tables that are written from the code itself: effects and commands."""

from __future__ import annotations

from results import table


def effects() -> str:
    """The library of effects, kind by kind."""
    from aircraft_sysid_ros.effects import LIBRARY

    cell = lambda text: text.replace("|", "\\|")  # noqa: E731
    rows = [
        [
            f"`{e.identifier}`",
            e.name,
            e.kind,
            cell(e.physics),
            cell(e.formula),
            cell(e.residuals),
            e.manoeuvre,
            e.source,
        ]
        for e in LIBRARY
    ]
    header = ["id", "name", "kind", "physics", "formula", "in the residuals", "manoeuvre that shows it", "source"]
    return table(header, rows)


def effect_terms() -> str:
    """Variants, terms by axis and inner numbers of every effect."""
    from aircraft_sysid_ros.effects import LIBRARY

    rows = []
    for effect in LIBRARY:
        shown = (effect.in_coefficients,) if effect.in_coefficients is not None else ()
        for variant in (*effect.variants, *shown):
            terms = [f"{axis}: `{', '.join(texts)}`" for axis, texts in variant.terms.items()]
            what = "; ".join(terms) or f"file: `{'.'.join(variant.setting)}`"
            numbers = str(variant.numbers) if variant.terms else "1"
            rows.append([f"`{effect.identifier}`", variant.name, what.replace("|", "\\|"), numbers])
    return table(["id", "variant", "terms, or key of the aircraft file", "numbers"], rows)


def commands() -> str:
    """Every command with its purpose."""
    from aircraft_sysid_ros.commands.main import COMMANDS

    return table(["command", "what it does"], [[f"`{name}`", purpose] for name, (_, purpose) in COMMANDS.items()])


TABLES = {
    "effects": effects,
    "effect_terms": effect_terms,
    "commands": commands,
}
