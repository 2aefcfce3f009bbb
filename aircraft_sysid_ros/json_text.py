"""JSON for people and programs: it has no NaN, so what is not known is null."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(content: Any) -> str:
    """Indented JSON with null for every number that is not finite."""
    return json.dumps(without_nan(content), indent=1, allow_nan=False)


def without_nan(content: Any) -> Any:
    """The same with None for every number that is not finite."""
    if isinstance(content, dict):
        return {key: without_nan(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [without_nan(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
