"""What is said of a signal: kind, severity and one sentence with numbers that ends in what to do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

OF_SAMPLING = ("rate", "gap", "jitter")
KINDS = (*OF_SAMPLING, "held", "saturated", "unit", "sign", "offset", "scale", "noise", "missing")
ERROR, WARNING, INFO = "error", "warning", "info"
SEVERITIES = (ERROR, WARNING, INFO)
#: How a sentence begins of a stream that is as late as another; a signal of that follows, and a comma.
KEEPS_TIME = "it keeps time with "
#: How a sentence begins of a signal that was not recorded.
ABSENT = "not in the recording"


@dataclass(frozen=True)
class Finding:
    """One thing that was found. ``signals`` that share the sentence, as in the MAP of an import."""

    signals: tuple[str, ...]
    kind: str
    severity: str
    sentence: str
    late: float = 0.0  # [s] of a stream that comes too late

    @property
    def records(self) -> list[dict[str, str]]:
        """As JSON: one record for each signal."""
        same = {"kind": self.kind, "severity": self.severity, "sentence": self.sentence}
        return [{"signal": signal, **same} for signal in self.signals]


def short_names(signals: tuple[str, ...]) -> str:
    """Names for a line of text: velocity.{north,east} for two components of one vector."""
    groups: dict[str, list[str]] = {}
    for signal in signals:
        group, _, component = signal.partition(".")
        groups.setdefault(group, []).append(component)
    return ", ".join(
        f"{group}.{{{','.join(parts)}}}" if len(parts) > 1 else f"{group}.{parts[0]}".rstrip(".")
        for group, parts in groups.items()
    )


def joined(findings: Iterable[Finding]) -> list[Finding]:
    """Findings in order, those with the same sentence as one."""
    together: dict[tuple[str, str, str, float], list[str]] = {}
    for finding in findings:
        said = finding.kind, finding.severity, finding.sentence, finding.late
        together.setdefault(said, []).extend(finding.signals)
    return [Finding(tuple(signals), *said) for said, signals in together.items()]
