"""The page of a check: findings, the picture and the parameters in one HTML file that opens without a network."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from aircraft_sysid_ros.flight_check.check import Checked, nothing_wrong
from aircraft_sysid_ros.flight_check.finding import INFO, short_names
from aircraft_sysid_ros.installation import MissingExtra


def check_page(checked: Checked, picture: bytes, title: str) -> str:
    """The page with a PNG. Raises MissingExtra without jinja2."""
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    except ImportError:
        raise MissingExtra("pages", "jinja2", "workbench") from None
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    nothing = nothing_wrong(checked.motion.flight.duration)
    findings = [(f.severity, f.kind, short_names(f.signals), f.sentence) for f in checked.findings]
    return templates.get_template("check_page.html").render(
        title=title,
        findings=findings,
        nothing=nothing if all(f.severity == INFO for f in checked.findings) else "",
        rates={name: f"{rate:.3g}" if rate == rate else "one sample" for name, rate in checked.rates.items()},
        parameters=checked.parameters,
        picture=b64encode(picture).decode("ascii"),
    )
