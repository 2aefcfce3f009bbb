"""The site of the documentation: built without a warning, complete, and without a network."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mkdocs")
pytest.importorskip("material")
pytest.importorskip("mkdocstrings")

from aircraft_sysid_ros.commands.main import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
#: What a browser would fetch from elsewhere to show a page.
LOADED = re.compile(r"<(?:script|img|iframe)[^>]* src=[\"']?(http[^\"' >]*)|<link[^>]*stylesheet[^>]*(http[^ >]*)")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, as `make site` builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.mark.long
def test_every_page_is_in_the_site_and_loads_nothing_from_elsewhere(site):
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    pages |= {Path(name) for name in ("index.html", "CHANGELOG.html", "CONTRIBUTING.html", "SECURITY.html")}
    for page in pages:
        text = (site / page).read_text(encoding="utf8")
        assert not LOADED.findall(text), page


@pytest.mark.long
def test_the_reference_has_every_command_message_and_call(site):
    commands = (site / "commands.html").read_text(encoding="utf8")
    assert all(f'id="{name}"' in commands for name in COMMANDS) and "--aircraft FILE" in commands
    messages = (site / "messages.html").read_text(encoding="utf8")
    for file in [*(ROOT / "msg_defs").glob("msg/*.msg"), *(ROOT / "msg_defs").glob("srv/*.srv")]:
        assert f'id="{file.stem.lower()}"' in messages
    python = (site / "python-api.html").read_text(encoding="utf8")
    for name in (
        "api.replay",
        "api.diagnose",
        "consumer.ParameterSource.at",
        "consumer.subscriber.ParameterSubscriber",
    ):
        assert f'id="aircraft_sysid_ros.{name}"' in python, name


def test_links_of_the_repository_lead_to_copies_in_the_site(site):
    for name in ("LICENSE", "config/ultra_stick_25e.yaml", "test/test_misprints.py"):
        assert (site / "repository" / name).read_bytes() == (ROOT / name).read_bytes()
    first = (site / "index.html").read_text(encoding="utf8")
    assert 'href="trust.html"' in first and 'src="figures/story.png"' in first
