"""Write requirements.lock: every package of an environment with the hashes of its files, so that pip installs no other.

    .venv/bin/python tools/lock.py

The versions are those that are installed now; pip says where each file comes from and what its hash is. It is for the
Python and the machine that it is written on. No package is installed.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "requirements.lock"
#: Not of the project, or what pip itself is made of.
_LEFT_OUT = {"aircraft-sysid-ros", "aircraft_sysid_ros", "pip"}


def installed() -> list[str]:
    """Every package that pip has installed, as ``name==version``."""
    by_pip = [d for d in metadata.distributions() if (d.read_text("INSTALLER") or "").strip() == "pip"]
    found = {d.metadata["Name"].lower(): d.version for d in by_pip}
    return [f"{name}=={version}" for name, version in sorted(found.items()) if name not in _LEFT_OUT]


def main() -> int:
    """Ask pip, and write."""
    with tempfile.TemporaryDirectory() as folder:
        wanted, report = Path(folder, "wanted.txt"), Path(folder, "report.json")
        wanted.write_text("\n".join(installed()) + "\n", encoding="utf8")
        command = ["install", "--quiet", "--dry-run", "--ignore-installed", "--no-deps", "--report", str(report)]
        subprocess.run([sys.executable, "-m", "pip", *command, "-r", str(wanted)], check=True)
        items = json.loads(report.read_text(encoding="utf8"))["install"]
    lines = [
        f"# By tools/lock.py, for Python {platform.python_version()} on {platform.system()} {platform.machine()}:",
        "# pip install --require-hashes --no-deps -r requirements.lock",
    ]
    for item in sorted(items, key=lambda each: each["metadata"]["name"].lower()):
        hashes = item["download_info"]["archive_info"]["hashes"]
        lines.append(f"{item['metadata']['name']}=={item['metadata']['version']} --hash=sha256:{hashes['sha256']}")
    LOCK.write_text("\n".join(lines) + "\n", encoding="utf8")
    print(f"{LOCK.name}: {len(items)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
